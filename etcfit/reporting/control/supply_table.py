"""Gains over the supply, for stdout."""

from __future__ import annotations

from rich.console import Group, RenderableType

from ...control.pid import Gains, Task
from ...control.supply_table import SupplyTable
from ...model.ecus import Scheduling
from ...run_folder.design import supply_table_json
from ..blocks import headed, plain_table, sentences
from ..numbers import short

_NOWHERE = (Scheduling.NONE, Scheduling.UNKNOWN)


def supply_table(task: Task, gains: Gains, table: SupplyTable) -> RenderableType:
    """The table where there is somewhere to type it in, and what is said of tables anywhere.

    Args:
        task, gains, table: as `run_folder.supply_table_json` takes them.
    """
    written, profile = supply_table_json(task, gains, table), task.profile
    words = sentences("Tables of gains", written["says"])
    assert words is not None, "there is always something to say"
    if profile is not None and profile.scheduling in _NOWHERE:
        return words
    shown = plain_table("gain", *(f"{supply:g} V" for supply in written["supply_V"]))
    for name, row in written["gains"].items():
        shown.add_row(name, *(short(gain, 4) for gain in row))
    unit = f"{written['unit']}, {written['form']}"
    return Group(headed(f"Gains over the supply that keep the loop what it is, in {unit}", shown), words)
