"""What a column is taken for, why, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..rig.units import conversion, is_percent
from .sheet import Column

UNEXPLAINED = "neither its name nor what it does tells what it is"
LEFT_OUT = ""  # the quantity of a column that no trace gets


@dataclass(frozen=True, eq=False)
class Take:
    """One column, named.

    Args:
        column: as its file has it.
        quantity: of a measurement folder's CSV; LEFT_OUT where it is none.
        unit: as that CSV will have it, a number before it where the sign is turned; "" if not yet known.
        reason: in words.
        sure: False where somebody should be asked.
        said: by the user, so that no guess changes it.
    """

    column: Column
    quantity: str
    unit: str
    reason: str
    sure: bool = True
    said: bool = False

    @property
    def header(self) -> str:
        """As the folder's CSV has it."""
        return f"{self.quantity} [{self.unit}]"

    @property
    def si(self) -> np.ndarray:
        """Values in SI, shape (n,); a share of the travel where they are per cent of it, sensor volts for `tps`."""
        if is_percent(self.unit):
            return 0.01 * self.column.values
        told = conversion(self.quantity, self.unit)
        return told.scale * self.column.values + told.offset

    def turned(self, why: str, sure: bool) -> Take:
        """The same with its sign turned."""
        if is_percent(self.unit):  # a header cannot turn a share of the travel, but it can an angle
            why, unit = f"{why} (100 % as 90 degrees)", "-0.9 deg"
        else:
            unit = self.unit.removeprefix("-1 ") if self.unit.startswith("-1 ") else f"-1 {self.unit}"
        return replace(self, unit=unit, reason=f"{self.reason}; sign turned: {why}", sure=self.sure and sure)


def left_out(column: Column, reason: str, sure: bool = True) -> Take:
    """A column that no trace gets."""
    return Take(column, LEFT_OUT, "", reason, sure)
