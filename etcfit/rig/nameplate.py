"""What a nameplate may say: limits so wide that only a slip of digits or units lies beyond them, not an unusual rig."""

from __future__ import annotations

from typing import Any, NamedTuple

from .toml import Toml, shown


class Range(NamedTuple):
    """Least and greatest value, and the cure for one beyond them."""

    low: float
    high: float
    unit: str
    mend: str


GEAR_RATIO = Range(0.01, 1e4, "", "Count the teeth: motor turns for one turn of the plate, as 20.68.")
SUPPLY = Range(1.0, 100.0, " V", "Give it in volts, as 12.0.")
STOP = Range(-3600.0, 3600.0, " degrees", "Give it in degrees, as 90.0; inf and -inf mean no stop.")
SENSOR = Range(-100.0, 100.0, " V", "Give it in volts, as 4.73.")
SENSOR_TRAVEL = Range(0.1, 3600.0, " degrees", "Give the angle from closed_V to open_V in degrees, as 90.0.")
SERIES = Range(0.0, 1e4, " ohm", "Give it in ohms, as 0.5.")
LEAST_TRAVEL = 0.1  # degrees between the stops


def within(toml: Toml, key: str, value: Any, limits: Range) -> float:
    """A number that a rig can have.

    Raises:
        MeasurementError: it is none, not finite, or lies beyond the limits.
    """
    number = toml.positive(key, value) if limits.low > 0.0 else toml.finite(key, value)
    if not limits.low <= number <= limits.high:
        raise toml.wrong(key, f"found {shown(value)}.",
                         f"It must lie between {limits.low:g} and {limits.high:g}{limits.unit}.",
                         limits.mend)  # fmt: skip
    return number
