"""Pictures of a run folder, drawn by this process and, if it was started in time, by a helper process.

Matplotlib holds Python's lock while it draws, so threads are no faster. A process takes a second to import its modules:
started before the models are loaded or sampled, which needs only one core, it is ready when pictures are drawn.
"""

from __future__ import annotations

import os
import signal
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..estimation.joint_fit import Report
from ..problem.cores import CORES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Job = tuple[Path, "Callable[[], Figure]"]
"""Path below a folder, and the call that draws the picture; for a helper a function and arguments that can be
pickled."""

_AHEAD = 2  # pictures that the helper gets at once, so that it does not wait for this process
at_hand: Helper | None = None  # helper of this process


def begin_helper() -> None:
    """Start a helper that draws for this process if there is a free core; it ends with this process."""
    global at_hand
    if at_hand is None and CORES > 1:
        at_hand = Helper()


def draw_here(folder: Path, jobs: Sequence[Job], report: Report, helper: Helper | None = None) -> None:
    """Draw every picture below a folder, each a file written completely or not at all, with a helper if given.

    The helper never gets the last picture, because this process would wait for it.
    """
    for k, (path, draw) in enumerate(jobs, 1):
        report(f"drawing {path}", (k - 1) / len(jobs))
        if helper is not None and k < len(jobs) and helper.is_free():
            helper.take(folder / path, draw)
        else:
            draw_one(folder / path, draw)
    if helper is not None:
        helper.finish()


def draw_shared(folder: Path, jobs: Sequence[Job], report: Report) -> None:
    """The same with this process's helper, if there is one, for many pictures of plain data."""
    draw_here(folder, jobs, report, at_hand)


def draw_one(path: Path, draw: Callable[[], Figure]) -> None:
    """One picture, in our style."""
    from . import style

    with style.drawing():
        style.save(draw(), path)


class Helper:
    """A process that draws pictures. If it dies, the parent process draws its unfinished pictures."""

    def __init__(self) -> None:
        spawning = get_context("spawn")  # a fork would copy a part of JAX's threads
        self._line, theirs = spawning.Pipe()
        spawning.Process(target=_serve, args=(theirs,), daemon=True).start()
        theirs.close()
        self._loaded, self._gone = False, False
        self._in_hand: deque[Job] = deque()

    def is_free(self) -> bool:
        """Whether it has imported its modules and can take one more picture."""
        while not self._gone and self._line.poll():
            self._listen()
        return self._loaded and not self._gone and len(self._in_hand) < _AHEAD

    def take(self, path: Path, draw: Callable[[], Figure]) -> None:
        """Give it one picture; it must be free."""
        try:
            self._line.send((path, draw))
        except OSError:
            self._left_alone()
            draw_one(path, draw)
        else:
            self._in_hand.append((path, draw))

    def finish(self) -> None:
        """Wait for its unfinished pictures.

        Raises:
            Any error of one of its pictures.
        """
        while self._in_hand:
            self._listen()

    def _listen(self) -> None:
        try:
            said = self._line.recv()
        except (EOFError, OSError):
            self._left_alone()
            return
        if not self._loaded:
            self._loaded = True
            return
        self._in_hand.popleft()
        if said is not None:
            raise said

    def _left_alone(self) -> None:
        self._gone = True
        while self._in_hand:
            draw_one(*self._in_hand.popleft())


def _serve(line: Connection[Any, Any]) -> None:
    """Main function of the helper: import, then draw pictures in turn, each answered by None or its error."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process is interrupted, and ends the helper
    if hasattr(os, "nice"):
        os.nice(10)  # a fit that runs meanwhile has priority
    from . import traces  # noqa: F401  most of the imports for drawing

    with suppress(EOFError, OSError):  # the parent process has ended
        line.send(None)
        while True:
            job, outcome = line.recv(), None
            try:
                draw_one(*job)
            except Exception as error:
                error.add_note("".join(traceback.format_exception(error)))
                outcome = error
            line.send(outcome)
