"""RUN/report_interactive.html: one self-contained interactive page; the printed one without scripts is `..page`.

Its data come from the saved models in RUN, not only from the JSON files.
"""

from __future__ import annotations

from typing import Any

from ... import __version__
from ...estimation.goodness import STRAYS
from ...estimation.settings import ContradictionSettings
from ...files import plain, write_text
from ...run_folder.folder import RunFolder
from ...run_folder.manifest import failure_of, require
from ..html import Parts, scripted
from ..page import Page, read_run
from ..page.verdict import left_unexplained, model
from .plant import Simulation, loop_json, plant_json, simulation
from .traces import TraceSources, traces_json


def content(run: RunFolder, simulated: Simulation) -> dict[str, Any]:
    """Rig, model, traces and loop of a run with a fit; numbers in SI unless a unit is given with them.

    Raises:
        UsageError: no fit, or an invalid file in the run.
    """
    require(run.path, "fit")
    contents, diagnosis, final = read_run(run.path), run.diagnosis(), run.final()
    sources = TraceSources(None if diagnosis is None else diagnosis.before, final, diagnosis)
    return plain({
        "schema": "etcfit.interactive/1",
        "version": __version__,
        "rig": final.rig.config.name,
        "synthetic": final.rig.config.synthetic,
        "converged": final.converged,
        "reason": final.reason,
        "model": model(contents),
        "diagnosed": diagnosis is not None,
        "left_unexplained": left_unexplained(contents),
        "chi2_per_dof": float(final.chi2_per_dof),
        "plant": plant_json(final, simulated),
        "loop": loop_json(final, contents.get("pid")),
        "traces": traces_json(sources),
        "hashes": dict(contents.hashes),
    })  # fmt: skip


# in the order of execution, after the printed model; each is plain JavaScript that exports its functions in `etcfit`
SCRIPTS = ("trace_run.js", "loop_run.js", "decode.js", "numbers.js", "theme.js", "chart.js",
           "list.js", "sliders.js", "trace_view.js", "loop_view.js", "main.js")  # fmt: skip
part = Parts((("etcfit.reporting.interactive", "page"),))


def render(data: dict[str, Any], model: str) -> str:
    """The whole page, HTML: the data, see `content`, and the script that simulates, see `plant`."""
    far = ContradictionSettings().compromise
    return scripted(part, data, "style.css", SCRIPTS, [model], synthetic=data["synthetic"], data=data,
                    strays=f"{STRAYS:g}", far=f"{far:g}")  # fmt: skip


NAME = "report_interactive.html"


def write_interactive(run: RunFolder) -> Page:
    """Write RUN/report_interactive.html, completely or not at all, with a part each for a diagnosis and gains in RUN.

    Returns:
        The page's path, and whether its model converged.
    Raises:
        UsageError: no fit, or an invalid file in the run.
    """
    final = run.final()
    simulated = simulation(final)
    page = render(content(run, simulated), simulated.script)
    path = run.path / NAME
    write_text(path, page)
    return Page(path, failure_of(final.converged, final.reason))
