"""What client and workers say to each other."""

from __future__ import annotations

from dataclasses import dataclass

from ..unit import FailedUnit, UnitResult


@dataclass(frozen=True)
class Order:
    """A unit to work on.

    Args:
        unit: its name.
        known: digest of the result that is stored; "" where there is none.
    """

    unit: str
    known: str


@dataclass(frozen=True)
class Trouble:
    """A unit that got no result for a reason that may lie with its worker: no room on the disk, no memory.

    Args:
        order: the unit's.
        why: as a person must read it.
    """

    order: Order
    why: str


@dataclass(frozen=True)
class Portion:
    """What came of some orders.

    Args:
        worker: address of who did it.
        seconds: that it took.
        done: results, good and bad.
        unchanged: units whose stored result still holds.
        trouble: units to try elsewhere.
        left: orders not begun, because those before took longer than expected.
    """

    worker: str
    seconds: float
    done: tuple[UnitResult | FailedUnit, ...]
    unchanged: tuple[str, ...]
    trouble: tuple[Trouble, ...]
    left: tuple[Order, ...]


@dataclass(frozen=True)
class Lost:
    """Orders of which nothing came back.

    Args:
        why: what to say of a unit that was alone.
        deaths: workers that it cost; an existing scheduler may have tried several before it said so.
    """

    why: str
    deaths: int = 1
