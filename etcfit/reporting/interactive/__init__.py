"""RUN/report_interactive.html: one self-contained page to work with; the printed one without scripts is `..page`.

Its data are those of the models in RUN, so it is made from their saved state, not from the JSON files alone.
"""

from __future__ import annotations

from ...files import whole
from ...run_folder.folder import RunFolder
from ..page import Page
from .content import content
from .printed_model import simulation
from .render import render

NAME = "report_interactive.html"


def write_interactive(run: RunFolder) -> Page:
    """Write RUN/report_interactive.html, whole or not at all.

    Args:
        run: a run folder with a fit; a diagnosis and gains in it become a part each.
    Returns:
        Where the page is, and whether its model converged.
    Raises:
        UsageError: no fit, or a file of the run is not what it should be.
    """
    final = run.final()
    simulated = simulation(final)
    page = render(content(run, simulated), simulated.script)
    path = run.path / NAME
    with whole(path) as draft:
        draft.write_text(page, encoding="utf-8")
    why = "" if final.converged else f"the fit of the model that is shown did not converge: {final.reason}"
    return Page(path, why)
