"""What a foreign file holds, before anybody says what its columns mean."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .makers import PEDAL_IN_SOME, is_engines, known, may_be_position, words
from .words import quantity_named

TIME = "time"
_VOLTS = 6.0  # that no sensor's reading exceeds
_SEVERAL = 3  # signals of an engine
_OF_A_BENCH = ("voltage", "current", "emf")


@dataclass(frozen=True, eq=False)
class Column:
    """One column as its file has it.

    Args:
        label: as it stands in the file, `Strom (mA)`: what the user calls it.
        name: the label without its unit.
        unit: as the file gives it; "" where it gives none.
        values: in that unit, shape (n,); NaN where the file has no value.
        quantity: where the format itself says it (a scope's time base); "" elsewhere.
        stated: a unit that the file gives and that nothing of a throttle is logged in; "" elsewhere.
        largest: reading of all columns with this label, in any file: one instrument has one unit; NaN if only this one.
    """

    label: str
    name: str
    unit: str
    values: np.ndarray
    quantity: str = ""
    largest: float = float("nan")
    stated: str = ""

    @property
    def peak(self) -> float:
        """Largest magnitude, spikes aside, of this column and of its like."""
        finite = self.values[np.isfinite(self.values)]
        own = float(np.quantile(np.abs(finite), 0.999)) if finite.size else 0.0
        return max(own, self.largest) if np.isfinite(self.largest) else own


@dataclass(frozen=True, eq=False)
class Sheet:
    """Columns of one length, logged together.

    Args:
        file: path, as the user gave it.
        part: of the file, where it has several (a group, a structure, a segment); "" elsewhere.
        columns: each of shape (n,).
        remarks: what the reader had to decide.
        losses: rows or columns that were left out because they are damaged, each in a sentence.
        missing: what the file itself says it holds and does not, or what cannot be read; somebody must accept that.
    """

    file: str
    part: str
    columns: tuple[Column, ...]
    remarks: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """For a message."""
        return f"{self.file}, '{self.part}'" if self.part else self.file

    @property
    def motor(self) -> str:
        """Whose these are, of a file whose parts are motors: `motor` or `motor: test`."""
        return self.part.partition(": ")[0]

    @property
    def rows(self) -> int:
        """How many."""
        return self.columns[0].values.size

    @cached_property
    def is_ecu(self) -> bool:
        """True for the log of an engine computer: it has several signals of an engine.

        Where no voltage or current tells a bench, a setpoint by a maker's name is enough, a TPS beside one signal of an
        engine, or a TPS in per cent.
        """
        names = [column.name for column in self.columns]
        engines = sum(map(is_engines, names))
        bench = any(quantity_named(name) in _OF_A_BENCH and not is_engines(name) for name in names)
        if engines >= _SEVERAL or bench:
            return engines >= _SEVERAL
        if any((found := known(name)) is not None and found[0] == "setpoint" for name in names):
            return True
        target = any(quantity_named(name) == "setpoint" for name in names)
        plates = [column for column in self.columns if words(column.name) in PEDAL_IN_SOME]
        share = any(target if c.unit == "%" else not c.unit and c.peak > _VOLTS for c in plates)
        return share or (engines > 0 and any(map(may_be_position, names)))


def time_base(seconds: np.ndarray) -> Column:
    """A time that the format gives in seconds."""
    return Column("time", "time", "s", np.asarray(seconds, dtype=float), TIME)
