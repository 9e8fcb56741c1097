"""Is the logged current that of the motor, or what another place or another instrument makes of it?

    of the motor       i
    of the supply      i_s = d i,  d = v / V_s      so   i = i_s V_s / v
    without its sign   |i|                          so   i = |i| sgn(v - k w)

Each reading is put into `circuit.py`'s equation, over the same windows, and the right one leaves the least. What is
near no voltage tells nothing: the duty d is zero there.

Source: Mohan, Undeland and Robbins 2003, ch. 7 (mean current of the source of a bridge). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Measurement, RigConfig
from ..signals import drive_voltage, on_times
from .circuit import Value, Windows, left_by, values_of, windows_of

NEAR = 0.1  # of the largest voltage: a smaller one tells nothing
FEWEST = 12  # windows
ROUNDS = 3  # in which the sign of the current and k are found together


@dataclass(frozen=True, eq=False)
class OtherCurrent:
    """One rig test, its current read in three ways.

    Args:
        motor: windows with the current as logged.
        supply: with that of the motor, were a supply's logged; for a supply of `volts`.
        volts: of the supply; 1 where nobody knows it, and then R is one of 1 V.
    """

    motor: Windows
    supply: Windows
    volts: float

    @cached_property
    def sign(self) -> np.ndarray:
        """Of the motor's current in each window, were it logged without it, shape (n,)."""
        sign = np.sign(self.motor.volts)
        for _ in range(ROUNDS):
            values = values_of(_signed(self.motor, sign)) or {}
            sign = np.sign(self.motor.volts - (values["k"].value if "k" in values else 0.0) * self.motor.turn)
        return sign

    @cached_property
    def unsigned(self) -> Windows:
        """With that of the motor, were it logged without its sign."""
        return _signed(self.motor, self.sign)

    def better(self, other: Windows, part: float, rows: np.ndarray | None = None) -> tuple[float, Value] | None:
        """How many times less another reading leaves, and the R that it shows; None where it shows no motor.

        Args:
            other: the windows with that reading.
            part: of the windows that leave less than what is compared.
            rows: windows in which they are compared; None: in all.
        """
        motor = self.motor if np.any(other.brushes) else _signed(self.motor, np.ones(self.motor.volts.size))
        as_logged, values = values_of(motor), values_of(other)
        if as_logged is None or values is None or "R" not in values:
            return None
        if values["R"].sign(2.0) <= 0 or ("k" in values and values["k"].sign(2.0) < 0):
            return None
        there = np.ones(other.volts.size, dtype=bool) if rows is None else rows
        left = [np.quantile(np.abs(left_by(v, w)[there]), part) for v, w in ((as_logged, motor), (values, other))]
        return float(left[0] / max(left[1], 1e-12)), values["R"]


def _signed(w: Windows, sign: np.ndarray) -> Windows:
    """Without brushes: a drop with the voltage's sign would explain a held voltage by itself."""
    return replace(w, amperes=sign * w.amperes, rise=sign * w.rise, brushes=np.zeros_like(w.brushes))


def other_current(traces: Sequence[Measurement], config: RigConfig) -> OtherCurrent | None:
    """The current of one rig test in each reading; None where too few windows tell."""
    if TEST_BY_NAME[traces[0].test].boundary.terminals_open:
        return None
    drives = {t.file: v for t in traces if "current" in t.channels and (v := drive_voltage(t, config)) is not None}
    having = [t for t in traces if t.file in drives]
    least = NEAR * max((float(np.max(np.abs(v.value))) for v in drives.values()), default=0.0)
    if least == 0.0:
        return None
    volts = supply_of(having, config) or 1.0

    def divided(i: np.ndarray, v: np.ndarray) -> np.ndarray:
        return i * volts / np.where(np.abs(v) < least, least, v)

    small = _windows(having, drives, config, lambda i, v: (np.abs(v) < least).astype(float))
    motor, supply = (_windows(having, drives, config, read) for read in (lambda i, v: i, divided))
    if small is None or motor is None or supply is None:
        return None
    rows = (small.amperes == 0.0) & (small.calm > 0.0)
    return OtherCurrent(motor.where(rows), supply.where(rows), volts) if rows.sum() >= FEWEST else None


def supply_of(traces: Sequence[Measurement], config: RigConfig) -> float | None:
    """Voltage of the supply, logged or in rig.toml, V; None where nobody knows it."""
    logged = [float(np.median(t.channels["supply"].value)) for t in traces if "supply" in t.channels]
    return float(np.median(logged)) if logged else config.supply_V


def _windows(
    traces: Sequence[Measurement],
    drives: dict[str, Channel],
    config: RigConfig,
    read: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> Windows | None:
    """Windows of all traces, with something made of current and voltage in the place of the current."""
    parts = []
    for trace in traces:
        current = trace.channels["current"]
        value = read(current.value, on_times(drives[trace.file], current.time))
        changed = replace(trace, channels={**trace.channels, "current": replace(current, value=value)})
        parts.append(windows_of(changed, config))
    kept = [each for each in parts if each is not None]
    return Windows.joined(kept) if kept else None
