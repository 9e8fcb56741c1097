"""A time limit for a piece of Python that runs in a thread of its own."""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
from types import TracebackType

_TICK = 0.1  # s between two looks at the clock


class TimeLimitExceeded(BaseException):
    """Raised in the thread that took too long; a BaseException, so that no `except Exception` on its way keeps it."""


class TimeLimit:
    """with TimeLimit(seconds, grace): raises TimeLimitExceeded in this thread once it took longer.

    Python raises it between two of its own instructions. Compiled code that does not come back within the grace is
    ended with its process, for nothing else can stop it; the engine then tries the unit once more.

    Args:
        seconds: that the block may take.
        grace: s it has after that to come back to Python.
    """

    def __init__(self, seconds: float, grace: float) -> None:
        self._seconds, self._grace = seconds, grace

    def __enter__(self) -> None:
        self._thread = threading.get_ident()
        self._stop = time.monotonic() + self._seconds
        self._end = self._stop + self._grace
        _watch(self)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        with _LOCK:
            _WATCHED.discard(self)
            _set_async(self._thread, None)  # one that was set and has not been raised yet

    def look(self, now: float) -> None:
        """Called by the watching thread, which holds the lock."""
        if now >= self._end:
            os.kill(os.getpid(), signal.SIGKILL)
        if now >= self._stop:
            self._stop = self._end
            _set_async(self._thread, TimeLimitExceeded)


# one thread looks after all limits of the process, for a thread a limit would cost more than a tiny unit
_LOCK = threading.Lock()
_WATCHED: set[TimeLimit] = set()
_WATCHMEN: list[threading.Thread] = []


def _watch(limit: TimeLimit) -> None:
    with _LOCK:
        _WATCHED.add(limit)
        if not _WATCHMEN:
            _WATCHMEN.append(threading.Thread(target=_look_always, name="etcfit time limit", daemon=True))
            _WATCHMEN[0].start()


def _look_always() -> None:
    while True:
        time.sleep(_TICK)
        with _LOCK:
            for limit in _WATCHED:
                limit.look(time.monotonic())


def _set_async(thread: int, error: type[BaseException] | None) -> None:
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(error) if error else None)
