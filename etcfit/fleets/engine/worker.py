"""The code of a worker process: it fits a portion of units, each of which can fail by itself.

Dask loads it in every worker before the rest of the package, so it imports neither JAX nor pandas.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any

from distributed import WorkerPlugin, get_worker
from distributed.protocol import pickle

from ... import __version__
from ...errors import MeasurementError
from ..settings import EngineSettings
from ..unit import AbstractWork, FailedUnit, Order, Portion, Trouble, UnitResult

# a worker is a process for one core: more threads would only take time from its neighbours. PJRT_NPROC is XLA's own
ONE_CORE = {"ETCFIT_CORES": "1", "PJRT_NPROC": "1"}
# so that the client, which hands out the work, never waits for a core that a worker uses
_BEHIND = 3
_TICK = 0.1  # s between two looks at the clock of a time limit


class FleetWorkerPlugin(WorkerPlugin):
    """The fleet's work in a worker process; Dask sends it to each worker, also to one that joins or restarts later.

    Args:
        name: name of this run.
        work: the work.
        log: file for the output of a local process; None where the process was started elsewhere.
    """

    def __init__(self, name: str, work: AbstractWork, log: Path | None) -> None:
        self.name, self.log = name, log
        self._packed = pickle.dumps(work)  # unpacked after `setup`, because its imports read the environment

    def setup(self, worker: Any) -> None:
        """Called by Dask when the worker has this object."""
        for variable, value in ONE_CORE.items():
            os.environ.setdefault(variable, value)
        if self.log is not None:
            # append all later output of this process to a file, including what libraries write past Python
            handle = os.open(self.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            for stream in (1, 2):
                os.dup2(handle, stream)
            os.close(handle)
            _step_behind()
        self._lock, self._work = threading.Lock(), None

    def ready(self) -> AbstractWork:
        """The work, prepared."""
        with self._lock:
            if self._work is None:
                work: AbstractWork = pickle.loads(self._packed)
                work.prepare()
                self._work = work
            return self._work


def version() -> str:
    """Version of etcfit in the process that calls it."""
    return __version__


def do_portion(name: str, orders: Sequence[Order], settings: EngineSettings) -> Portion:
    """The task: orders one after the other, until the time of a portion is up."""
    worker: Any = get_worker()
    work = worker.plugins[name].ready()
    start = time.monotonic()
    ends: list[UnitResult | FailedUnit | Trouble | None] = []
    for order in orders:
        ends.append(_end(work, order, settings))
        if time.monotonic() - start > settings.portion:
            break
    return Portion(worker.address, time.monotonic() - start, tuple(ends))


def _end(work: AbstractWork, order: Order, settings: EngineSettings) -> UnitResult | FailedUnit | Trouble | None:
    """The result of one unit; None where its stored result still holds."""
    unit, digest = order.unit, ""
    try:
        with TimeLimit(settings.time_limit, settings.grace):
            digest = work.digest(unit)
            return None if digest == order.known else replace(work.fit(unit), digest=digest)
    except TimeLimitExceeded:
        return FailedUnit(unit, f"{unit}: stopped, it took longer than {settings.time_limit:g} s. "
                          "Allow more time, or shorten its traces.")  # fmt: skip
    except MeasurementError as error:
        return FailedUnit(unit, str(error), digest)
    except (OSError, MemoryError) as error:  # the cause may be this machine, not the unit: no digest is stored
        return Trouble(f"{unit}: {_said(error)}.")
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        where = f"in {Path(frame.filename).name}:{frame.lineno}"
        return FailedUnit(unit, f"{unit}: {_said(error)} ({where}).", digest)


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


@cache
def _step_behind() -> None:
    """Lower the priority of the process, one time however many runs it serves."""
    os.nice(_BEHIND)


class TimeLimitExceeded(BaseException):
    """Raised in the thread that took too long; a BaseException, so that no `except Exception` catches it."""


class TimeLimit:
    """with TimeLimit(seconds, grace): raises TimeLimitExceeded in this thread when the block takes longer.

    Python raises it between two of its own instructions. Where compiled code does not return within the grace, the
    process is ended, because nothing else can stop the code; the engine then tries the unit again.

    Args:
        seconds: time that the block may take.
        grace: further time for compiled code to return to Python, s.
    """

    def __init__(self, seconds: float, grace: float) -> None:
        self._seconds, self._grace = seconds, grace

    def __enter__(self) -> None:
        self._thread = threading.get_ident()
        self._stop = time.monotonic() + self._seconds
        self._end = self._stop + self._grace
        with _LOCK:
            _WATCHED.add(self)
            if not _WATCHMEN:
                _WATCHMEN.append(threading.Thread(target=_look_always, name="etcfit time limit", daemon=True))
                _WATCHMEN[0].start()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        with _LOCK:
            _WATCHED.discard(self)
            _set_async(self._thread, None)  # withdraws an exception that was set but not raised yet

    def look(self, now: float) -> None:
        """Called by the watching thread, which holds the lock."""
        if now >= self._end:
            os.kill(os.getpid(), signal.SIGKILL)
        if now >= self._stop:
            self._stop = self._end
            _set_async(self._thread, TimeLimitExceeded)


# one thread watches all limits of the process, because one thread for each limit would cost more than a tiny unit
_LOCK = threading.Lock()
_WATCHED: set[TimeLimit] = set()
_WATCHMEN: list[threading.Thread] = []


def _look_always() -> None:
    while True:
        time.sleep(_TICK)
        with _LOCK:
            for limit in _WATCHED:
                limit.look(time.monotonic())


def _set_async(thread: int, error: type[BaseException] | None) -> None:
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(error) if error else None)
