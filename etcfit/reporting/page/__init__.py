"""RUN/report.html: one self-contained page of everything that a run folder holds.

It is made from the folder's files alone (FORMAT.md), so that it can be made again, elsewhere and later, without a fit.
"""

from __future__ import annotations

from pathlib import Path

from ...files import whole
from .contents import read_run
from .render import render


def write_page(run_dir: Path | str) -> Path:
    """Write RUN/report.html, whole or not at all.

    Args:
        run_dir: a run folder with a fit.json; what else it holds becomes a section each.
    Returns:
        Where the page is.
    Raises:
        UsageError: no fit.json, or a file of the run is not what it should be.
    """
    run = Path(run_dir)
    page = render(read_run(run))
    with whole(run / "report.html") as draft:
        draft.write_text(page, encoding="utf-8")
    return run / "report.html"
