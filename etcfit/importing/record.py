"""A stretch of a sheet as signals in SI, for guesses about sign and rig test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import shapes
from .settings import GuessSettings
from .sheet import TIME, Sheet
from .take import LEFT_OUT, UNEXPLAINED, Take


@dataclass(frozen=True, eq=False)
class Record:
    """What will be one trace.

    Args:
        sheet: whose rows these are.
        rows: which.
        takes: of the sheet's columns, time among them.
        cut: why the sheet was cut here; "" where it was not.
    """

    sheet: Sheet
    rows: slice
    takes: tuple[Take, ...]
    cut: str = ""

    @property
    def time(self) -> np.ndarray:
        """s, shape (n,)."""
        return next(take.si for take in self.takes if take.quantity == TIME)[self.rows]

    @property
    def signals(self) -> Mapping[str, np.ndarray]:
        """By quantity, SI, gaps bridged, each of shape (n,); time left out."""
        return {take.quantity: shapes.filled(take.si[self.rows]) for take in self.takes
                if take.quantity not in (LEFT_OUT, TIME)}  # fmt: skip

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Labels of columns that move, and of which nothing tells what they are."""
        return tuple(take.column.label for take in self.takes if take.reason == UNEXPLAINED)

    def plate(self, signals: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Position or sensor volts."""
        return signals.get("position", signals.get("tps"))

    def drive(self, signals: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """What drives the motor: voltage, duty or torque."""
        return next((signals[name] for name in ("voltage", "duty", "torque") if name in signals), None)

    def take(self, quantity: str) -> Take | None:
        """The column of this quantity."""
        return next((take for take in self.takes if take.quantity == quantity), None)

    def with_take(self, new: Take) -> Record:
        """With one column taken otherwise."""
        return replace(self, takes=tuple(new if take.column is new.column else take for take in self.takes))

    def within(self, rows: slice, cut: str) -> Record:
        """Some of its rows, counted from its own first."""
        first = self.rows.start
        return replace(self, rows=slice(first + rows.start, first + rows.stop), cut=cut)


def whole(sheet: Sheet, takes: Sequence[Take]) -> Record:
    """All rows of a sheet."""
    return Record(sheet, slice(0, sheet.columns[0].values.size), tuple(takes))


def let_go(record: Record, settings: GuessSettings) -> bool:
    """True where nobody drives the plate: no drive was logged, or a voltage that follows the plate's speed."""
    signals = record.signals
    plate, voltage = record.plate(signals), signals.get("voltage")
    if plate is None or record.sheet.is_ecu or {"current", "setpoint", "torque", "duty"} & set(signals):
        return False
    if voltage is None:
        return True
    speed = shapes.slope(plate, record.time)
    follows = abs(shapes.correlation(voltage, speed)) > settings.surely_follows
    return follows and shapes.span(voltage) > 8.0 * shapes.noise(voltage) and not _is_step(voltage, settings)


def _is_step(voltage: np.ndarray, settings: GuessSettings) -> bool:
    """True for a voltage that jumps from zero to its top within a sample and stands there: no plate speeds up so."""
    size = np.abs(voltage)
    top = float(np.quantile(size, 0.99))
    flat = size > (1.0 - settings.one_level) * top
    jumps = flat[1:] & (size[:-1] < 0.1 * top)
    return bool(jumps.any()) and max(b - a for a, b in shapes.runs(flat)) >= settings.fewest
