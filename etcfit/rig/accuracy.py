"""[accuracy] of rig.toml: how far a channel's scale and zero may be off, the same in every trace.

    current = "1 % + 5 mA"        limits of a data sheet: a share of the reading, a fixed amount, or both
    gear = "0.1 %"

A limit is the half width of a rectangular distribution, whose standard deviation is limit / sqrt 3.

Source: GUM (JCGM 100:2008), 4.3.7. Differs from source: no.
"""

from __future__ import annotations

import re
from typing import Any

from .base import Accuracy, TpsCalibration
from .toml import Toml, closest, shown
from .units import EXAMPLES, UnitError, is_percent, to_channel

CHANNELS = ("current", "voltage", "position", "emf", "motor_speed")
KEYS = (*CHANNELS, "gear")
_FARTHEST = 0.5  # share of the reading: nothing that is further off is an instrument
_TERM = re.compile(r"([0-9.]+(?:[eE][-+]?\d+)?)\s*(\S.*)")


def read_accuracy(toml: Toml, travel: tuple[float, float], tps: TpsCalibration | None) -> dict[str, Accuracy]:
    """The table, by channel ("gear" for the ratio).

    Raises:
        MeasurementError: a channel or a unit that is not known, or a limit that no instrument has.
    """
    return {key: _limits(toml, key, value, travel, tps) for key, value in toml.table("accuracy", KEYS).items()}


def _limits(toml: Toml, key: str, value: Any, travel: tuple[float, float], tps: TpsCalibration | None) -> Accuracy:
    where, relative, absolute = f"accuracy.{key}", 0.0, 0.0
    for term in toml.string(where, value).split("+"):
        match = _TERM.fullmatch(term.strip())
        if match is None:
            raise toml.wrong(where, f"found {shown(value)}.", "It must be limits with units, joined by +.",
                             f'Write, say, {key} = "{_example(key)}".')  # fmt: skip
        number, unit = float(match[1]), match[2].strip()
        if is_percent(unit):
            relative += number / 100.0
        elif key == "gear":
            raise toml.wrong(where, f"found {shown(value)}.", "A ratio has no unit but %.", 'Write gear = "0.1 %".')
        else:
            absolute += number * _scale(toml, key, unit, travel, tps)
    if not relative + absolute > 0.0 or relative > _FARTHEST:
        raise toml.wrong(where, f"found {shown(value)}.", f"It must lie above 0 and below {100 * _FARTHEST:.0f} %.",
                         "Correct it, or delete the line.")  # fmt: skip
    return Accuracy(relative, absolute)


def _scale(toml: Toml, key: str, unit: str, travel: tuple[float, float], tps: TpsCalibration | None) -> float:
    """One of that unit in SI; sensor volts count for a position."""
    try:
        quantity = "tps" if key == "position" and tps is not None and unit.endswith("V") else key
        return abs(to_channel(quantity, unit, travel, tps)[1].scale)
    except UnitError as err:
        known = EXAMPLES[key].replace(" or ", ", ").split(", ")
        raise toml.wrong(f"accuracy.{key}", str(err), f"Accepted: %, and {key} in {EXAMPLES[key]}.",
                         closest(unit, known, "Correct the unit.")) from err  # fmt: skip


def _example(key: str) -> str:
    return {"current": "1 % + 5 mA", "position": "0.3 % + 0.1 deg", "motor_speed": "0.5 % + 2 rpm"}.get(
        key, "0.1 %" if key == "gear" else "0.5 % + 10 mV"
    )
