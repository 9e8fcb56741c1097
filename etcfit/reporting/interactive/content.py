"""All that the page carries, as one JSON object."""

from __future__ import annotations

from typing import Any

from ... import __version__
from ...files import plain
from ...run_folder.folder import RunFolder
from ...run_folder.manifest import require
from ..page.contents import read_run
from ..page.verdict import left_unexplained, model
from .closed_loop import loop_json
from .plant import plant_json
from .printed_model import Simulation
from .traces import TraceSources, traces_json


def content(run: RunFolder, simulated: Simulation) -> dict[str, Any]:
    """Rig, model, traces and loop; numbers in SI but where a unit stands beside them.

    Args:
        run: a run folder with a fit.
        simulated: of its final model.
    Raises:
        UsageError: no fit, or a file of the run is not what it should be.
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
