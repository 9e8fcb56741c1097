"""Progress of a long computation and its remaining time: a bar on a terminal or in a notebook, else lines of text."""

from __future__ import annotations

import html
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache
from typing import Any, NamedTuple

from ..errors import visible

Report = Callable[[str, float], None]  # name of the current step, and the share of the work that is done, 0 to 1
Clock = Callable[[], float]  # s since an arbitrary instant
# the pace of the work gives an estimate only after
_EARLIEST = 3.0  # s of work,
_LEAST = 0.03  # this share of the work,
_STEPS = 2  # and so many steps
_EVERY = 30.0  # s between two lines, at most


class Expected(NamedTuple):
    """Duration of some work, expected before it begins."""

    seconds: float  # the duration
    why: str  # the source of the estimate, as in "as last time"


def silent(stage: str, done: float) -> None:
    """A progress report that prints nothing."""


def part_of(report: Report, low: float, high: float) -> Report:
    """The report for one part of longer work: its share 0 to 1 becomes low to high of the whole."""
    return lambda stage, done: report(stage, low + (high - low) * done)


class Remaining:
    """Seconds left: expected minus elapsed; without an expectation, at the pace so far, (1 - s) (t - t_0) / (s -
    s_0)."""

    def __init__(self, expected: Expected | None = None, clock: Clock = time.monotonic) -> None:
        self._whole, self._clock = (0.0 if expected is None else expected.seconds), clock
        self._began = self._start = self._last = clock()
        self._first = self.share = 0.0
        self._steps = 0

    def update(self, share: float) -> None:
        """Set the share that is done. A share that falls begins a new part of the work, with a pace of its own."""
        now = self._clock()
        if share < self.share:
            self._start, self._first, self._steps = now, share, 0
        if share > self.share:
            self._last, self._steps = now, self._steps + 1
        self.share = share

    @property
    def _is_expected(self) -> bool:
        """Whether the expected duration is still possible."""
        return self._clock() - self._began < self._whole

    @property
    def elapsed(self) -> float:
        """Time since the start, s."""
        return self._clock() - self._began

    @property
    def seconds(self) -> float | None:
        """Time left, s; None as long as there is no estimate."""
        now = self._clock()
        if self._is_expected:
            return self._whole - (now - self._began)
        took, gained = self._last - self._start, self.share - self._first
        if took < _EARLIEST or gained < _LEAST or self._steps < _STEPS:
            return None
        left = (1.0 - self.share) * took / gained - (now - self._last)
        return left if left > 0.0 else None

    def __str__(self) -> str:
        """The text that is shown: "about 40 s left", or "" as long as there is no estimate. A search may end early."""
        left = self.seconds
        return "" if left is None else f"{'about' if self._is_expected else 'up to'} {in_words(left)} left"


def in_words(seconds: float) -> str:
    """A duration, rounded as coarsely as an estimate is accurate: "5 s", "40 s", "3 min", "2 h"."""
    if seconds < 90.0:
        return f"{5 * max(1, round(seconds / 5.0))} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.0f} h"


@contextmanager
def working(quiet: bool | Report = False, expected: Expected | None = None) -> Iterator[Report]:
    """For a verb that computes: use models compiled before, and show progress, or tell it to a function."""
    keep_compiled()
    with nullcontext(quiet) if callable(quiet) else progress(quiet, expected) as report:
        yield report


def progress(
    quiet: bool = False, expected: Expected | None = None, say: Callable[[str], None] | None = None
) -> AbstractContextManager[Report]:
    """Show progress on stderr or below the notebook's cell.

    Args:
        say: prints a line if the output is neither a terminal nor a notebook; None: such an output shows no progress.
    """
    if quiet:
        return nullcontext(silent)
    if in_notebook():
        return notebook_bar(expected)
    if sys.stderr.isatty():
        return terminal_bar(expected)
    return nullcontext(silent) if say is None else plain_lines(say, expected)


def in_notebook() -> bool:
    """Whether this is a Jupyter kernel. No import of IPython is needed: a kernel has imported it."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None and hasattr(ipython, "get_ipython") else None
    return getattr(shell, "kernel", None) is not None


class Lines:
    """One line for each new stage, and one at least every half minute if nothing is reported."""

    def __init__(
        self,
        say: Callable[[str], None],
        expected: Expected | None = None,
        clock: Clock = time.monotonic,
        every: float = _EVERY,
    ) -> None:
        self._say, self._clock, self._left, self._every = say, clock, Remaining(expected, clock), every
        self._stage, self._said, self._lock = "", clock(), threading.Lock()
        if expected is not None and expected.seconds >= _EARLIEST:
            say(f"this takes about {in_words(expected.seconds)}, {expected.why}")

    def report(self, stage: str, done: float) -> None:
        """Set the current step, and the share of the work that is done."""
        with self._lock:
            self._left.update(done)
            if stage != self._stage:
                self._stage = stage
                self._print(str(self._left))

    def tick(self) -> None:
        """Print a line if the last one is old; called regularly."""
        with self._lock:
            if self._stage and self._clock() - self._said >= self._every:
                gone = f"{100.0 * self._left.share:.0f} % done after {in_words(self._left.elapsed)}"
                self._print(", ".join(filter(None, (gone, str(self._left)))))

    def _print(self, remark: str) -> None:
        self._say(f"{self._stage} ({remark})" if remark else self._stage)
        self._said = self._clock()


@contextmanager
def plain_lines(
    say: Callable[[str], None], expected: Expected | None = None, every: float = _EVERY
) -> Iterator[Report]:
    """Lines for a log; see `Lines`."""
    lines, ended = Lines(say, expected, every=every), threading.Event()

    def watch() -> None:
        while not ended.wait(1.0):
            lines.tick()

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield lines.report
    finally:
        ended.set()
        watcher.join()


@contextmanager
def terminal_bar(expected: Expected | None = None, console: Any = None) -> Iterator[Report]:
    """A bar on stderr that is removed at the end."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, ProgressColumn, SpinnerColumn, Task, TextColumn, TimeElapsedColumn
    from rich.text import Text

    remaining = Remaining(expected)

    class LeftColumn(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(str(remaining), style="progress.remaining")

    plain = TextColumn("{task.description}", markup=False)
    columns = SpinnerColumn(), plain, BarColumn(bar_width=20), TimeElapsedColumn(), LeftColumn()
    with Progress(*columns, console=console or Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)

        def report(stage: str, done: float) -> None:
            remaining.update(done)
            bar.update(task, description=visible(stage), completed=done)

        yield report


@contextmanager
def notebook_bar(expected: Expected | None = None, every: float = 0.2) -> Iterator[Report]:
    """A bar below the cell that is removed at the end; unlike rich's own it does not need ipywidgets."""
    from IPython.core.display import HTML
    from IPython.display import DisplayHandle

    handle, remaining = DisplayHandle(), Remaining(expected)
    handle.display(HTML(_bar("starting", 0.0, str(remaining))))
    last = 0.0

    def report(stage: str, done: float) -> None:
        nonlocal last
        now = time.monotonic()
        remaining.update(done)
        if now - last > every:
            handle.update(HTML(_bar(stage, done, str(remaining))))
            last = now

    try:
        yield report
    finally:
        handle.update(HTML(""))


def _bar(stage: str, done: float, left: str) -> str:
    bar = f'<progress value="{min(max(done, 0.0), 1.0):.3f}" max="1"></progress>'
    return f"{bar} <code>{html.escape(visible(stage))}</code> {left}"


@cache
def keep_compiled() -> None:
    """Keep compiled models on the disk for later processes; called before the first computation."""
    from ..backend import use_compilation_cache

    use_compilation_cache()
