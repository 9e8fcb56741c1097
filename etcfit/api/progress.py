"""How far a long computation has come: a bar on a terminal, a bar in a notebook, nothing where nobody looks."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from typing import Any

Report = Callable[[str, float], None]  # what is being done, and the share of it that is done, 0 to 1


def silent(stage: str, done: float) -> None:
    """A progress report that says nothing."""


@contextmanager
def working(quiet: bool = False) -> Iterator[Report]:
    """For a verb that computes: models compiled before are found again, and progress is shown.

    Args:
        quiet: show nothing.
    """
    _keep_compiled()
    with progress(quiet) as report:
        yield report


@contextmanager
def progress(quiet: bool = False, elsewhere: Callable[[], Report] = lambda: silent) -> Iterator[Report]:
    """Show progress where somebody looks, on stderr or below the notebook's cell.

    Args:
        quiet: show nothing.
        elsewhere: makes the report for an output that is neither a terminal nor a notebook.
    """
    with _shown(quiet, elsewhere) as report:
        yield report


def _shown(quiet: bool, elsewhere: Callable[[], Report]) -> AbstractContextManager[Report]:
    if quiet:
        return _plain(silent)
    if in_notebook():
        return notebook_bar()
    return terminal_bar() if sys.stderr.isatty() else _plain(elsewhere())


@contextmanager
def _plain(report: Report) -> Iterator[Report]:
    yield report


def in_notebook() -> bool:
    """Whether this is a Jupyter kernel. IPython is not imported to find out: a kernel has imported it."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None and hasattr(ipython, "get_ipython") else None
    return getattr(shell, "kernel", None) is not None


@contextmanager
def terminal_bar(console: Any = None) -> Iterator[Report]:
    """A bar on stderr that is wiped away at the end.

    Args:
        console: a rich Console to draw on instead.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    plain = TextColumn("{task.description}", markup=False)
    columns = SpinnerColumn(), plain, BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console or Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda stage, done: bar.update(task, description=stage, completed=done)


@contextmanager
def notebook_bar(every: float = 0.2) -> Iterator[Report]:
    """A bar below the cell that is wiped away at the end: rich's own needs ipywidgets, this needs nothing.

    Args:
        every: least time between two updates, s.
    """
    from IPython.core.display import HTML
    from IPython.display import DisplayHandle

    handle = DisplayHandle()
    handle.display(HTML(_bar("starting", 0.0)))
    last = 0.0

    def report(stage: str, done: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - last > every:
            handle.update(HTML(_bar(stage, done)))
            last = now

    try:
        yield report
    finally:
        handle.update(HTML(""))


def _bar(stage: str, done: float) -> str:
    return f'<progress value="{min(max(done, 0.0), 1.0):.3f}" max="1"></progress> <code>{html.escape(stage)}</code>'


@cache
def _keep_compiled() -> None:
    """Once a process, when something is computed for the first time."""
    from ..backend import use_compilation_cache

    use_compilation_cache()
