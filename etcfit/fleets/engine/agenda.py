"""What is still to be done, in which portions, and when a unit is given up; knows nothing of Dask."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

from ..unit import FailedUnit
from .order import Lost, Order, Portion, Trouble
from .settings import EngineSettings


class Agenda:
    """Orders that wait, in order, and what each unit has been through.

        units of a portion = time of a portion / time of a unit, the mean over the last ones

    Args:
        orders: what to do.
        settings: when a unit is given up, and how large portions are.
    """

    def __init__(self, orders: Iterable[Order], settings: EngineSettings) -> None:
        self._waiting, self._settings = deque(orders), settings
        self._tried: dict[str, int] = {}
        self._alone: set[str] = set()
        self._refused: dict[str, str] = {}
        self._seconds_a_unit = settings.portion

    def __bool__(self) -> bool:
        """Whether anything waits."""
        return bool(self._waiting)

    @property
    def waiting(self) -> int:
        """How many orders."""
        return len(self._waiting)

    def next_portion(self, workers: int) -> tuple[Order, ...]:
        """The next orders; a unit whose portion died goes alone, and the last ones are shared out evenly."""
        fair = -(-len(self._waiting) // max(workers, 1))
        fitting = int(self._settings.portion / max(self._seconds_a_unit, 1e-9))
        most = max(1, min(fair, fitting, self._settings.largest_portion))
        orders = [self._waiting.popleft()]
        while len(orders) < most and self._waiting and not self._alone & {orders[0].unit, self._waiting[0].unit}:
            orders.append(self._waiting.popleft())
        return tuple(orders)

    def refused(self, orders: Sequence[Order]) -> str | None:
        """The worker that failed this unit before; None where none did."""
        return self._refused.get(orders[0].unit) if len(orders) == 1 else None

    def came_back(self, portion: Portion) -> list[FailedUnit]:
        """Take note of a portion; the units given up with it."""
        ended = len(portion.done) + len(portion.unchanged) + len(portion.trouble)
        self._seconds_a_unit += (portion.seconds / max(ended, 1) - self._seconds_a_unit) / 4
        self._waiting.extendleft(reversed(portion.left))
        return [failed for each in portion.trouble for failed in self._again(each, portion.worker)]

    def lost(self, orders: Sequence[Order], lost: Lost) -> list[FailedUnit]:
        """A worker died, or its answer could not be had; of several units each then goes alone, to see which it was.

        Args:
            orders: it was on.
            lost: why nothing came back.
        """
        if len(orders) == 1:
            return self._again(Trouble(orders[0], lost.why), None, lost.deaths)
        self._alone |= {order.unit for order in orders}
        self._waiting.extendleft(reversed(orders))
        return []

    def _again(self, trouble: Trouble, worker: str | None, tries: int = 1) -> list[FailedUnit]:
        unit = trouble.order.unit
        self._tried[unit] = self._tried.get(unit, 0) + tries
        if self._tried[unit] >= self._settings.tries:
            return [FailedUnit(unit, f"{trouble.why} It was tried {self._tried[unit]} times.")]
        self._alone.add(unit)
        if worker is not None:
            self._refused[unit] = worker
        self._waiting.appendleft(trouble.order)
        return []
