"""The table of gains over the supply, for pid.json."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..control.pid import Gains, Task
from ..control.supply_table import AtSupply, OverPosition, SupplyTable
from ..model.ecu import Ecu, Terms
from ..model.ecus import GENERIC, EcuProfile, Scheduling


def supply_table_json(task: Task, gains: Gains, table: SupplyTable) -> dict[str, Any]:
    """Gains at each supply, what they are worth at the ends of a car's supply, and what is said of other tables.

    Args:
        task: what they were found for.
        gains: of the ECU's own supply.
        table: made of them.
    """
    profile, body = task.profile, task.loop.body
    notation = (profile or GENERIC).notation
    if notation is None:
        over = (1.0 if task.ecu.compensated else task.ecu.supply / supply for supply in table.supplies)
        rows = tuple(Terms(each, each, each) for each in over)
        unit, form = f"share of the gain at {task.ecu.supply:g} V", "whatever its unit"
    else:
        rows = table.written(gains, notation, task.ecu, body.upper - body.lower)
        unit, form = notation.unit, notation.form
    return {
        "ecu_has": None if profile is None else profile.scheduling.name.lower(),
        "designed_at_V": task.ecu.supply,
        "supply_V": table.supplies,
        "gains": {name: [getattr(row, name) for row in rows] for name in Terms._fields},
        "unit": unit,
        "form": form,
        "worst": [_end(end) for end in table.ends],
        "position": _position(table.position),
        "says": list(_said(profile, table, task.ecu)),
    }


def _end(end: AtSupply) -> dict[str, Any]:
    return {"supply_V": end.supply, "fixed": end.fixed.known(), "table": end.table.known(), "helps": end.helps}


def _position(over: OverPosition) -> dict[str, Any]:
    return {"crossover_Hz": over.frequency, "within_pct": 100.0 * over.near, "share_of_travel_within": over.alike,
            "least_ratio": over.ratio.min(), "largest_ratio": over.ratio.max()}  # fmt: skip


def _said(profile: EcuProfile | None, table: SupplyTable, ecu: Ecu) -> Iterator[str]:
    """Who has such a table, what it is worth, and where another one is worth nothing."""
    if ecu.compensated:
        yield "the ECU divides by the battery voltage: its gains mean the same at every supply, no table is needed"
    elif profile is not None:
        yield f"{profile.title} has {profile.scheduling.value}" + _so(profile.scheduling)
    yield from map(_of_end, table.ends)
    yield _of_position(table.position)
    yield ("over the error: the linear plant does not know it, so that nothing here gives such a table; what a small "
           "error meets is dry friction, and no table has been tried")  # fmt: skip


def _so(scheduling: Scheduling) -> str:
    """What follows for the table."""
    return {
        Scheduling.TABLE: "",
        Scheduling.CODE: "",
        Scheduling.NONE: ": fixed gains it must be",
        Scheduling.UNKNOWN: ": look for one before you plan with it",
    }[scheduling]


def _of_end(end: AtSupply) -> str:
    """Tracking with and without the table."""
    fixed, table = end.fixed, end.table
    return (f"at {end.supply:g} V, worst of winding and friction: RMSE {fixed.rmse_pct:.3g} % with fixed gains, "
            f"{table.rmse_pct:.3g} % with the table; overshoot {fixed.overshoot_pct:.3g} and "
            f"{table.overshoot_pct:.3g} %: it {'helps' if end.helps else 'does not help'} tracking there")  # fmt: skip


def _of_position(over: OverPosition) -> str:
    """Whether a table over the position had anything to compensate."""
    known = (f"over the position: at the crossover of {over.frequency:.3g} Hz the plant's gain is within "
             f"{100.0 * over.near:g} % of that at a quarter of the travel over {100.0 * over.alike:.0f} % "
             "of it")  # fmt: skip
    if over.alike == 1.0:
        return f"{known}: a table would be flat"
    return (f"{known}, and {over.ratio.min():.2g} to {over.ratio.max():.2g} times it at the extremes: springs, "
            "which feed-forward and integral carry")  # fmt: skip
