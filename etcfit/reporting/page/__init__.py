"""RUN/report.html: one self-contained page of everything that a run folder holds.

It is made from the folder's files alone (formats.md), so that it can be made again, elsewhere and later, without a
fit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...run_folder.manifest import CONVERGED, NOT_CONVERGED, failure_of, replacing
from .contents import read_run


@dataclass(frozen=True)
class Page:
    """What came of writing it.

    Args:
        failure: why the model that it shows did not converge, or "".
        missing: why pictures are missing from it, or "".
    """

    path: Path
    failure: str
    missing: str = ""


def write_page(run_dir: Path | str) -> Page:
    """Write RUN/report.html, whole or not at all, from RUN/fit.json and whatever else the run folder holds.

    Returns:
        Where the page is, and whether its model converged.
    Raises:
        UsageError: no fit.json, or a file of the run is not what it should be.
    """
    from .render import render  # the closing of a fit reads contents and verdict, and none of what a page loads

    run = Path(run_dir)
    contents = read_run(run)
    page = render(contents)
    final = contents.final
    converged = final.get("converged", True)
    with replacing(run, "report", CONVERGED if converged else NOT_CONVERGED, {}) as draft:
        (draft / "report.html").write_text(page, encoding="utf-8")
    return Page(run / "report.html", failure_of(converged, final.get("reason", "")))
