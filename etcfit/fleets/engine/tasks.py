"""The tasks that are out, one for each worker; none of them is waited for without end.

A worker that dies gives its task back through Dask. What Dask itself loses (a worker that never comes back, an answer
that never arrives) is found here: every other second the client looks where its tasks are.
"""

from __future__ import annotations

import time
import uuid
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from ...errors import UsageError
from .agenda import Agenda
from .cluster import Crew
from .order import Lost, Order, Portion
from .settings import EngineSettings

_LOOK = 0.1  # s after which a wait for an answer ends, answer or not
_RECOUNT = 2.0  # s between two looks at the workers and what they do


@dataclass
class _Task:
    """One that is out.

    Args:
        future: Dask's.
        orders: what it is on.
        seen: s, when it was last known to be on its way.
        begun: s, when it was first seen on a worker; None before.
        worker: that it was last seen on.
    """

    future: Any
    orders: tuple[Order, ...]
    seen: float
    begun: float | None = None
    worker: str | None = None


class Tasks:
    """The tasks that are out.

    Args:
        name: of the run, by which workers find its work.
        crew: the workers.
        settings: sent with each task; they also say when one is given up.
    """

    def __init__(self, name: str, crew: Crew, settings: EngineSettings) -> None:
        self._name, self._crew, self._client, self._settings = name, crew, crew.client, settings
        self._out: dict[str, _Task] = {}
        self._threads: dict[str, int] = {}
        self._counted = -_RECOUNT
        self._staffed = self._renewed = time.monotonic()

    def __bool__(self) -> bool:
        """Whether any is out."""
        return bool(self._out)

    def hand_out(self, agenda: Agenda) -> None:
        """A portion for every worker that has none.

        Raises:
            UsageError: there has been no worker for as long as one waits for the first.
        """
        self._look()
        places = max(sum(self._threads.values()), 1)
        while agenda and len(self._out) < places:
            self._submit(agenda.next_portion(places), agenda)

    def ended(self) -> list[_Task]:
        """Tasks that ended, or that nobody works on any more; none after a tenth of a second without one."""
        from distributed import wait

        if not any(task.future.done() for task in self._out.values()):
            with suppress(TimeoutError, CancelledError), self._client.as_current():
                wait([task.future for task in self._out.values()], timeout=_LOOK, return_when="FIRST_COMPLETED")
        now = time.monotonic()
        over = [key for key, task in self._out.items() if task.future.done() or self._given_up(task, now)]
        return [self._out.pop(key) for key in over]

    def answer(self, task: _Task) -> tuple[tuple[Order, ...], Portion | Lost]:
        """What the orders of a task that ended came to."""
        from distributed import KilledWorker

        unit, future = task.orders[0].unit, task.future
        try:
            if not future.done():
                return task.orders, self._abandoned(task)
            return task.orders, future.result(timeout=self._settings.first_worker)
        except KilledWorker as error:
            self._counted = -_RECOUNT  # one less, for a while
            why = (f"{unit}: its worker process ended while it was on this unit: killed, "
                   "or grown beyond the memory it may have.")  # fmt: skip
            return task.orders, Lost(why, error.allowed_failures + 1)
        except Exception as error:  # whatever of the way there and back: it costs no other unit
            return task.orders, Lost(f"{unit}: {type(error).__name__}: {error}.")
        finally:
            future.release()

    def cancel(self) -> None:
        """Take back all that is out."""
        self._client.cancel([task.future for task in self._out.values()], force=True)
        self._out.clear()

    def _submit(self, orders: tuple[Order, ...], agenda: Agenda) -> None:
        from .worker import do_portion

        refused = agenda.refused(orders)
        others = [worker for worker in self._threads if worker != refused] if refused else []
        # strictly: where others are only preferred, Dask lets an idle worker steal the unit it just failed
        key = f"units-{uuid.uuid4().hex}"
        future = self._client.submit(
            do_portion, self._name, orders, self._settings, key=key, pure=False, workers=others or None
        )
        self._out[key] = _Task(future, orders, time.monotonic())

    def _workers(self) -> dict[str, int]:
        found: Any = self._client.nthreads()
        return dict(found)

    def _look(self) -> None:
        """How many workers there are, and what they are on."""
        if time.monotonic() - self._counted < _RECOUNT:
            return
        self._threads = self._workers()
        doing: Any = self._client.processing()
        self._counted = now = time.monotonic()
        self._locate(doing, now)
        if self._threads:
            self._staffed = self._renewed = now
        elif now - self._staffed > self._settings.first_worker:
            raise UsageError(f"no worker process has been left for {self._settings.first_worker:g} s. What was done is "
                             "kept: give the workers more memory, or take fewer of them, and start again.")  # fmt: skip
        elif now - self._renewed > self._settings.missing:
            self._crew.renew()
            self._renewed = now

    def _locate(self, doing: dict[str, Any], now: float) -> None:
        """Where each task is. One may wait, but not while a worker has nothing to do."""
        on = {key: worker for worker, keys in doing.items() for key in keys}
        busy = all(len(doing.get(worker, ())) >= threads for worker, threads in self._threads.items())
        for key, task in self._out.items():
            if key in on:
                same = task.begun is not None and task.worker == on[key]
                task.worker, task.begun = on[key], task.begun if same else now
            if key in on or busy:
                task.seen = now

    def _given_up(self, task: _Task, now: float) -> bool:
        """Whether it is nowhere, or on a worker for longer than any unit may take."""
        limits = self._settings
        most = limits.portion + limits.time_limit + limits.grace + limits.first_worker  # the last: to prepare the work
        return now - task.seen > limits.missing or (task.begun is not None and now - task.begun > most)

    def _abandoned(self, task: _Task) -> Lost:
        """Taken back, and a worker of ours started anew, so that nobody can be on its units any more."""
        self._client.cancel([task.future], force=True)
        if self._crew.local and task.worker is not None and task.worker in self._workers():
            self._client.restart_workers([task.worker], timeout=self._settings.missing, raise_for_error=False)
        self._counted = -_RECOUNT
        return Lost(f"{task.orders[0].unit}: its worker took it and was not heard of again.")
