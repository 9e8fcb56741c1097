"""Pictures of a run folder, drawn by this process and, where one was begun in time, by a helper beside it.

Matplotlib holds Python's lock while it draws, so threads gain nothing. A process of its own takes a second to load what
it needs: begun before the models are loaded or sampled, which keeps one core busy, it is ready when pictures are due.
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
"""Where below a folder, and the call that draws it; for a helper a function and arguments that can be pickled."""

_AHEAD = 2  # pictures that the helper is handed at once, so that it need not wait for this process to look up
at_hand: Helper | None = None  # of this process


def begin_helper() -> None:
    """From now on a helper draws beside this process, where there is a core for it; it ends with this process."""
    global at_hand
    if at_hand is None and CORES > 1:
        at_hand = Helper()


def draw_here(folder: Path, jobs: Sequence[Job], report: Report, helper: Helper | None = None) -> None:
    """Draw every picture below a folder, each a file written whole or not at all, with a helper where one is given.

    The last is never handed over: it would be waited for.
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
    """The same with this process's helper, where there is one: for many pictures of plain data."""
    draw_here(folder, jobs, report, at_hand)


def draw_one(path: Path, draw: Callable[[], Figure]) -> None:
    """One picture, in our style."""
    from . import style

    with style.drawing():
        style.save(draw(), path)


class Helper:
    """A process that draws what it is handed. Where it dies, what it had in hand is drawn by the one that began it."""

    def __init__(self) -> None:
        spawning = get_context("spawn")  # a fork would take half of JAX's threads along
        self._line, theirs = spawning.Pipe()
        spawning.Process(target=_serve, args=(theirs,), daemon=True).start()
        theirs.close()
        self._loaded, self._gone = False, False
        self._in_hand: deque[Job] = deque()

    def is_free(self) -> bool:
        """Whether it has loaded what it needs and can be handed one more picture."""
        while not self._gone and self._line.poll():
            self._listen()
        return self._loaded and not self._gone and len(self._in_hand) < _AHEAD

    def take(self, path: Path, draw: Callable[[], Figure]) -> None:
        """Have it draw one picture; it must be free."""
        try:
            self._line.send((path, draw))
        except OSError:
            self._left_alone()
            draw_one(path, draw)
        else:
            self._in_hand.append((path, draw))

    def finish(self) -> None:
        """Wait for what it has in hand.

        Raises:
            whatever a picture of its raised.
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
    """The helper's life: load, then draw one after the other, each answered by None or what it raised."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one that began it is interrupted, and ends it
    if hasattr(os, "nice"):
        os.nice(10)  # whatever is fitted meanwhile comes first
    from . import traces  # noqa: F401  most of what drawing loads

    with suppress(EOFError, OSError):  # the one that began it has ended
        line.send(None)
        while True:
            line.send(_outcome(*line.recv()))


def _outcome(path: Path, draw: Callable[[], Figure]) -> Exception | None:
    try:
        draw_one(path, draw)
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))
        return error
    return None
