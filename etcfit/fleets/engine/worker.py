"""What runs in a worker process: a portion of units, each of which can fail by itself.

Loaded in every worker, and by Dask before anything else of the package: it imports neither JAX nor pandas.
"""

from __future__ import annotations

import os
import threading
import time
import traceback
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from distributed import WorkerPlugin, get_worker
from distributed.protocol import pickle

from ... import __version__
from ...errors import MeasurementError
from ..unit import FailedUnit, UnitResult
from .order import Order, Portion, Trouble
from .settings import EngineSettings
from .time_limit import TimeLimit, TimeLimitExceeded
from .work import AbstractWork

# a worker is a process for one core: more threads would only take time from its neighbours. PJRT_NPROC is XLA's own
ONE_CORE = {"ETCFIT_CORES": "1", "PJRT_NPROC": "1"}
# so that the client, which hands out the work, never waits for a core behind those that do it
_BEHIND = 3


class FleetWorkerPlugin(WorkerPlugin):
    """The fleet's work, as it lies in a worker process: sent once, also to a worker that comes or comes back later.

    Args:
        name: of this run.
        work: what to do.
        log: of a process of our own: file that takes what it prints; None where somebody else started it.
    """

    def __init__(self, name: str, work: AbstractWork, log: Path | None) -> None:
        self.name, self.log = name, log
        self._packed = pickle.dumps(work)  # opened after `setup`: what it imports reads the environment

    def setup(self, worker: Any) -> None:
        """Called by Dask when the worker has this object."""
        for variable, value in ONE_CORE.items():
            os.environ.setdefault(variable, value)
        if self.log is not None:
            _print_into(self.log)
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
    """Of etcfit, where this is called."""
    return __version__


def do_portion(name: str, orders: Sequence[Order], settings: EngineSettings) -> Portion:
    """The task: orders one after the other, until the time of a portion is up."""
    worker: Any = get_worker()
    work = worker.plugins[name].ready()
    start, ended = time.monotonic(), []
    for order in orders:
        ended.append(_one(work, order, settings))
        if time.monotonic() - start > settings.portion:
            break
    return Portion(
        worker.address,
        time.monotonic() - start,
        tuple(end for end in ended if isinstance(end, (UnitResult, FailedUnit))),
        tuple(end for end in ended if isinstance(end, str)),
        tuple(end for end in ended if isinstance(end, Trouble)),
        tuple(orders[len(ended) :]),
    )


def _one(work: AbstractWork, order: Order, settings: EngineSettings) -> UnitResult | FailedUnit | Trouble | str:
    """One unit's end; its name where nothing has changed."""
    digest = ""
    try:
        with TimeLimit(settings.time_limit, settings.grace):
            digest = work.digest(order.unit)
            if digest == order.known:
                return order.unit
            return replace(work.fit(order.unit), digest=digest)
    except TimeLimitExceeded:
        return FailedUnit(order.unit, f"{order.unit}: stopped, it took longer than {settings.time_limit:g} s. "
                          "Allow more time, or shorten its traces.")  # fmt: skip
    except MeasurementError as error:
        return FailedUnit(order.unit, str(error), digest)
    except (OSError, MemoryError) as error:  # of this machine, perhaps, and not of the unit: no digest, no verdict
        return Trouble(order, f"{order.unit}: {_said(error)}.")
    except Exception as error:
        return FailedUnit(order.unit, f"{order.unit}: {_said(error)} ({_where(error)}).", digest)


def _said(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _where(error: BaseException) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"in {Path(frame.filename).name}:{frame.lineno}"


@cache
def _step_behind() -> None:
    """Once in a process, however many runs it serves."""
    os.nice(_BEHIND)


def _print_into(log: Path) -> None:
    """What this process prints from now on, and what libraries write past Python, goes to the end of a file."""
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (1, 2):
        os.dup2(handle, stream)
    os.close(handle)
