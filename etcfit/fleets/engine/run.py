"""Units handed out to workers, and their results to the store; one that fails costs itself alone.

Each worker has one task at a time: when a worker dies, the unit that it was on is known, and no other is suspected. A
task is a portion of units, as many as fit into a third of a second; of slow ones it is one. The client holds the names
that are left, and no results: those go to the store as they come.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ... import __version__
from ...errors import UsageError
from ..unit import FailedUnit
from .agenda import Agenda
from .cluster import Crew
from .order import Lost, Order
from .settings import EngineSettings
from .store import Store
from .tasks import Tasks
from .work import AbstractWork


@dataclass(frozen=True)
class Tally:
    """How a run through a fleet went.

    Args:
        fitted: units with a new result.
        unchanged: units whose stored result, or failure, still holds.
        failed: units that failed now.
    """

    fitted: int = 0
    unchanged: int = 0
    failed: int = 0

    @property
    def units(self) -> int:
        """All of them."""
        return self.fitted + self.unchanged + self.failed

    def and_also(self, other: Tally) -> Tally:
        """After another run too."""
        return Tally(self.fitted + other.fitted, self.unchanged + other.unchanged, self.failed + other.failed)

    def with_ends(self, ends: Sequence[Any], unchanged: int) -> Tally:
        """After these too."""
        failed = sum(isinstance(end, FailedUnit) for end in ends)
        return Tally(self.fitted + len(ends) - failed, self.unchanged + unchanged, self.failed + failed)


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
        units: in the order in which they are handed out.
        work: sent to every worker once.
        crew: the workers, see `cluster.crew`.
        store: takes the results; open. What workers of our own print goes to workers.log in its folder.
        report: told what is done, and which share of it.
        settings: when a unit is given up.
    Raises:
        UsageError: the workers have another version of etcfit, or none is left.
        OSError: the store cannot be written.
        KeyboardInterrupt: as it comes; what has come back is kept.
    """
    from .worker import FleetWorkerPlugin

    known = store.digests()
    agenda = Agenda((Order(unit, known.get(unit, "")) for unit in dict.fromkeys(units)), settings)
    name = f"etcfit-{uuid.uuid4().hex}"
    crew.client.register_plugin(
        FleetWorkerPlugin(name, work, store.folder.absolute() / "workers.log" if crew.local else None)
    )
    try:
        _check_versions(crew)
        return _worked_off(agenda, Tasks(name, crew, settings), store, report)
    finally:
        store.flush()
        _leave(crew, name)


def _worked_off(agenda: Agenda, tasks: Tasks, store: Store, report: Callable[[str, float], None]) -> Tally:
    tally, total = Tally(), agenda.waiting
    try:
        while agenda or tasks:
            tasks.hand_out(agenda)
            # an answer lies with its worker until it is fetched, and goes with it if the next unit kills that
            answers = [tasks.answer(task) for task in tasks.ended()]
            tasks.hand_out(agenda)
            for orders, answer in answers:
                if isinstance(answer, Lost):
                    ends, unchanged = agenda.lost(orders, answer), 0
                else:
                    ends, unchanged = [*answer.done, *agenda.came_back(answer)], len(answer.unchanged)
                store.add(ends)
                tally = tally.with_ends(ends, unchanged)
            if answers:
                report("fit the units", tally.units / max(total, 1))
    finally:
        tasks.cancel()
    return tally


def _check_versions(crew: Crew) -> None:
    from .worker import version

    found: Any = crew.client.run(version)
    other = {each for each in found.values() if each != __version__}
    if other:
        raise UsageError(f"workers have etcfit {', '.join(sorted(other))}, this is {__version__}: "
                         "install the same version on all")  # fmt: skip


def _leave(crew: Crew, name: str) -> None:
    """Take the work off the workers; that they are gone already is no matter."""
    try:
        crew.client.unregister_worker_plugin(name)
    except Exception:
        return
