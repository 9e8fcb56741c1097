"""Hands out units to workers and their results to the store; the failure of one unit affects no other.

Each worker has one task at a time: when a worker dies, the unit that it was fitting is known. A task is a portion of
units, as many as fit into a third of a second; for slow units it is one unit. The client holds the names of the units
that are left but no results: those go to the store as they arrive.

Where a worker dies, Dask returns its task. Tasks that Dask itself loses (a worker that never comes back, an answer that
never arrives) are found here: every other second the client checks where its tasks are.
"""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

from ... import __version__
from ...errors import UsageError
from ..settings import EngineSettings
from ..unit import AbstractWork, FailedUnit, Lost, Order, Portion, Trouble, UnitResult
from .cluster import FIRST_WORKER, Crew
from .store import Store

LOOK = 0.1  # s: longest wait for an answer
RECOUNT = 2.0  # s between two checks of the workers and their tasks
MISSING = 10.0  # s after which a task that no worker has, while a worker is free, is handed out again
LARGEST_PORTION = 256  # units in one task

Orders = tuple[Order, ...]
Ends = list[UnitResult | FailedUnit]


class Tally(NamedTuple):
    """Counts of a run through a fleet."""

    # fitted, failed: units with a new result, and without one
    fitted: int
    unchanged: int  # units whose stored result, or failure, still holds
    failed: int


def run_units(
    units: Sequence[str],
    work: AbstractWork,
    crew: Crew,
    store: Store,
    report: Callable[[str, float], None],
    settings: EngineSettings = EngineSettings(),
) -> Tally:
    """Work on every unit whose stored result no longer holds.

    Args:
        units: names, in the order in which they are handed out.
        work: the work, sent to each worker one time.
        crew: the workers, see `cluster.crew`.
        store: an open store for the results. The output of local workers goes to workers.log in its folder.
        report: called with the current step in words and the share done.
        settings: limits after which a unit is given up.
    Raises:
        UsageError: the workers have another version of etcfit, or none is left.
        OSError: the store cannot be written.
        KeyboardInterrupt: from the user; results that have come back are kept.
    """
    from .worker import FleetWorkerPlugin, version

    known = store.digests()
    agenda = Agenda((Order(unit, known.get(unit, "")) for unit in dict.fromkeys(units)), settings)
    name = f"etcfit-{uuid.uuid4().hex}"
    log = store.folder.absolute() / "workers.log" if crew.local else None
    crew.client.register_plugin(FleetWorkerPlugin(name, work, log))
    try:
        found: Any = crew.client.run(version)
        if other := {each for each in found.values() if each != __version__}:
            raise UsageError(f"workers have etcfit {', '.join(sorted(other))}, this is {__version__}: "
                             "install the same version on all")  # fmt: skip
        return _work_off(agenda, Tasks(name, crew, settings), store, report)
    finally:
        store.flush()
        with suppress(Exception):  # the workers may be gone already
            crew.client.unregister_worker_plugin(name)


def _work_off(agenda: Agenda, tasks: Tasks, store: Store, report: Callable[[str, float], None]) -> Tally:
    fitted, unchanged, failed, total = 0, 0, 0, agenda.waiting
    try:
        while agenda.waiting or tasks.out:
            tasks.hand_out(agenda)
            # an answer stays with its worker until it is fetched, and is lost if the next unit kills the worker
            answers = [(task.orders, tasks.answer(task)) for task in tasks.ended()]
            tasks.hand_out(agenda)
            for orders, answer in answers:
                ends, same = agenda.take_back(orders, answer)
                store.add(ends)
                unchanged += same
                failed += sum(isinstance(end, FailedUnit) for end in ends)
                fitted += sum(isinstance(end, UnitResult) for end in ends)
            if answers:
                report("fit the units", (fitted + unchanged + failed) / max(total, 1))
    finally:
        tasks.cancel()
    return Tally(fitted, unchanged, failed)


class Agenda:
    """Orders that wait, in order, and the history of each unit; independent of Dask.

        units of a portion = time of a portion / time of a unit, the mean over the last ones

    The settings state when a unit is given up, and how long a portion takes.
    """

    def __init__(self, orders: Iterable[Order], settings: EngineSettings) -> None:
        self._orders, self._settings = deque(orders), settings
        self._tried: dict[str, int] = {}
        self._alone: set[str] = set()
        self._refused: dict[str, str] = {}
        self._seconds_a_unit = settings.portion

    @property
    def waiting(self) -> int:
        """Number of orders that wait."""
        return len(self._orders)

    def next_portion(self, workers: int) -> Orders:
        """The next orders; a unit whose portion was lost goes alone, and the last units are shared evenly."""
        fair = -(-len(self._orders) // max(workers, 1))
        fitting = int(self._settings.portion / max(self._seconds_a_unit, 1e-9))
        most = max(1, min(fair, fitting, LARGEST_PORTION))
        orders = [self._orders.popleft()]
        while len(orders) < most and self._orders and not self._alone & {orders[0].unit, self._orders[0].unit}:
            orders.append(self._orders.popleft())
        return tuple(orders)

    def refused(self, orders: Orders) -> str | None:
        """The worker that failed this unit before; None where none did."""
        return self._refused.get(orders[0].unit) if len(orders) == 1 else None

    def take_back(self, orders: Orders, answer: Portion | Lost) -> tuple[Ends, int]:
        """The results and given-up units of some orders, and the number of unchanged units.

        Where no result came back for several units, each goes alone next, to find the one that caused it.
        """
        if isinstance(answer, Lost):
            if len(orders) == 1:
                return self._try_again(orders[0], answer.why, None, answer.deaths), 0
            self._alone |= {order.unit for order in orders}
            self._orders.extendleft(reversed(orders))
            return [], 0
        seconds = answer.seconds / max(len(answer.ends), 1)
        self._seconds_a_unit += (seconds - self._seconds_a_unit) / 4
        self._orders.extendleft(reversed(orders[len(answer.ends) :]))
        ends: Ends = []
        for order, end in zip(orders, answer.ends, strict=False):
            if isinstance(end, Trouble):
                ends += self._try_again(order, end.why, answer.worker)
            elif end is not None:
                ends.append(end)
        return ends, answer.ends.count(None)

    def _try_again(self, order: Order, why: str, worker: str | None, tries: int = 1) -> Ends:
        """Put the unit back for another worker; it has failed where it was tried often enough."""
        unit = order.unit
        self._tried[unit] = self._tried.get(unit, 0) + tries
        if self._tried[unit] >= self._settings.tries:
            return [FailedUnit(unit, f"{why} It was tried {self._tried[unit]} times.")]
        self._alone.add(unit)
        if worker is not None:
            self._refused[unit] = worker
        self._orders.appendleft(order)
        return []


@dataclass
class Task:
    """A task in progress."""

    future: Any  # Dask's future
    orders: Orders  # its orders
    seen: float  # s, when it was last known to be in progress
    begun: float | None = None  # s, when it was first seen on a worker; None before
    worker: str | None = None  # the worker on which it was last seen


class Tasks:
    """The tasks in progress, one for each worker; each wait for a task has a limit.

    Args:
        name: name of the run, by which workers find its work.
        crew: the workers.
        settings: limits after which a task is given up; workers get them with each task.
    """

    def __init__(self, name: str, crew: Crew, settings: EngineSettings) -> None:
        self._name, self._crew, self._client, self._settings = name, crew, crew.client, settings
        self.out: dict[str, Task] = {}
        self._threads: dict[str, int] = {}
        self._counted = -RECOUNT
        self._staffed = self._renewed = time.monotonic()

    def hand_out(self, agenda: Agenda) -> None:
        """Hand out a portion to every worker that has none.

        Raises:
            UsageError: there has been no worker for `FIRST_WORKER` seconds.
        """
        from .worker import do_portion

        self._look()
        places = max(sum(self._threads.values()), 1)
        while agenda.waiting and len(self.out) < places:
            orders = agenda.next_portion(places)
            refused = agenda.refused(orders)
            others = [worker for worker in self._threads if worker != refused] if refused else []
            # strict: with a mere preference for other workers, Dask lets an idle worker steal the unit it just failed
            key = f"units-{uuid.uuid4().hex}"
            future = self._client.submit(
                do_portion, self._name, orders, self._settings, key=key, pure=False, workers=others or None
            )
            self.out[key] = Task(future, orders, time.monotonic())

    def ended(self) -> list[Task]:
        """Tasks that ended, or that no worker has any more; empty after a tenth of a second without one."""
        from distributed import wait

        if not any(task.future.done() for task in self.out.values()):
            with suppress(TimeoutError, CancelledError), self._client.as_current():
                wait([task.future for task in self.out.values()], timeout=LOOK, return_when="FIRST_COMPLETED")
        now = time.monotonic()
        over = [key for key, task in self.out.items() if task.future.done() or self._given_up(task, now)]
        return [self.out.pop(key) for key in over]

    def answer(self, task: Task) -> Portion | Lost:
        """The result of a task that ended."""
        from distributed import KilledWorker

        unit, future = task.orders[0].unit, task.future
        try:
            return future.result(timeout=FIRST_WORKER) if future.done() else self._abandon(task)
        except KilledWorker as error:
            self._counted = -RECOUNT  # there is one worker less for a while
            why = (f"{unit}: its worker process ended while it fitted this unit: it was killed, "
                   "or exceeded its memory limit.")  # fmt: skip
            return Lost(why, error.allowed_failures + 1)
        except Exception as error:  # any error of the transport: it affects no other unit
            return Lost(f"{unit}: {type(error).__name__}: {error}.")
        finally:
            future.release()

    def cancel(self) -> None:
        """Cancel all tasks in progress."""
        self._client.cancel([task.future for task in self.out.values()], force=True)
        self.out.clear()

    def _workers(self) -> dict[str, int]:
        found: Any = self._client.nthreads()
        return dict(found)

    def _look(self) -> None:
        """Update the number of workers and their tasks. A task may wait, but not while a worker is idle."""
        if time.monotonic() - self._counted < RECOUNT:
            return
        self._threads = self._workers()
        doing: Any = self._client.processing()
        self._counted = now = time.monotonic()
        on = {key: worker for worker, keys in doing.items() for key in keys}
        busy = all(len(doing.get(worker, ())) >= threads for worker, threads in self._threads.items())
        for key, task in self.out.items():
            if key in on:
                same = task.begun is not None and task.worker == on[key]
                task.worker, task.begun = on[key], task.begun if same else now
            if key in on or busy:
                task.seen = now
        if self._threads:
            self._staffed = self._renewed = now
        elif now - self._staffed > FIRST_WORKER:
            raise UsageError(f"there has been no worker process for {FIRST_WORKER:g} s. Results are kept: give the "
                             "workers more memory, or start fewer of them, and run again.")  # fmt: skip
        elif now - self._renewed > MISSING:
            self._crew.renew()
            self._renewed = now

    def _given_up(self, task: Task, now: float) -> bool:
        """Whether no worker has the task, or one has it for longer than any unit may take."""
        limits = self._settings
        most = limits.portion + limits.time_limit + limits.grace + FIRST_WORKER  # the last: to prepare the work
        return now - task.seen > MISSING or (task.begun is not None and now - task.begun > most)

    def _abandon(self, task: Task) -> Lost:
        """Cancel the task, and restart its worker where it is local, so that no process fits its units any more."""
        self._client.cancel([task.future], force=True)
        if self._crew.local and task.worker is not None and task.worker in self._workers():
            self._client.restart_workers([task.worker], timeout=MISSING, raise_for_error=False)
        self._counted = -RECOUNT
        return Lost(f"{task.orders[0].unit}: its worker took it and never answered.")
