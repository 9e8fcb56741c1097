"""[accuracy] of rig.toml: the possible calibration error of each instrument, which no trace shows.

    |shown - true| <= r |true| + a,   standard uncertainties  u_gain = r / sqrt 3,  u_offset = a / sqrt 3

A text such as "1 % + 5 mA" is what a data sheet states: a bound, all errors within it equally likely, so r and a are
half-widths of rectangular distributions. { sd = "0.5 % + 2 mA" } states standard uncertainties of normal ones, as a
calibration certificate does (halve its expanded uncertainty at k = 2). One error a channel, shared by all its traces.

Source: GUM (JCGM 100:2008) 4.3.3, 4.3.7, type B. Differs from source: no.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from .base import Accuracy, TpsCalibration
from .rows import NUMBER
from .toml import Toml
from .units import EXAMPLES, UnitError, conversion, fits, is_percent, to_channel

CHANNELS = ("voltage", "current", "position", "emf", "motor_speed", "torque")
RELATIVE = ("gear", "time")  # a ratio and a clock: only a relative error is possible
END_POINTS = "sensor_end_points"  # each end of the position sensor separately, V or an angle
KEYS = (*CHANNELS, END_POINTS, *RELATIVE)
SHARES = {"%": 1e-2, "percent": 1e-2, "ppm": 1e-6, "ppb": 1e-9}
MOST = 1.0  # largest relative error that is accepted
EXAMPLE = '"1 % + 5 mA"'
_TERM = re.compile(rf"\s*({NUMBER.pattern.removeprefix('[+-]?')})\s*([^\s\d+.,][^+]*?)\s*(?:\+|$)")


def read_accuracy(toml: Toml, travel: tuple[float, float], tps: TpsCalibration | None) -> dict[str, Accuracy]:
    """The entries of [accuracy], by channel, `gear`, `time` and `sensor_end_points`; {} where it is absent.

    Raises:
        MeasurementError: an unknown key, no number, a unit of the wrong dimension, or a value that has no calibration.
    """
    return {key: _entry(toml, key, value, travel, tps) for key, value in toml.table("accuracy", KEYS).items()}


def _entry(toml: Toml, key: str, value: Any, travel: tuple[float, float], tps: TpsCalibration | None) -> Accuracy:
    where, text, distribution = f"accuracy.{key}", value, "rectangular"
    if isinstance(value, dict) and set(value) == {"sd"}:
        text, distribution = value["sd"], "normal"
    if not isinstance(text, str):
        raise toml.refused(where, value, f"It must be a text as {EXAMPLE}, or {{ sd = {EXAMPLE} }}.",
                           f"Write {key} = {_example(key)}.")  # fmt: skip
    bare = re.sub(r"^\s*(±|\+\s*/?\s*-)\s*", "", text)  # a plus-minus sign before it is allowed
    terms = list(_TERM.finditer(bare))
    if not terms or "".join(term[0] for term in terms) != bare or bare.rstrip().endswith("+"):
        raise toml.refused(where, text, "It must be numbers with units, joined by +.",
                           f"Write {key} = {_example(key)}.")  # fmt: skip
    relative = absolute = 0.0
    for number, unit in ((float(term[1]), term[2].strip()) for term in terms):
        if (share := SHARES.get("%" if is_percent(unit) else unit)) is not None:
            relative += number * share
        else:
            absolute += number * _scale(toml, where, key, unit, travel, tps)
    if not 0.0 <= relative <= MOST or not 0.0 < relative + absolute < math.inf:
        raise toml.refused(where, text, "It must be above 0 and at most 100 % of the value.",
                           "Correct it, or delete the line: a calibration that is not stated counts as exact."
                           )  # fmt: skip
    return Accuracy(relative, absolute, "normal" if distribution == "normal" else "rectangular")


def _scale(
    toml: Toml, where: str, key: str, unit: str, travel: tuple[float, float], tps: TpsCalibration | None
) -> float:
    """Factor from the unit to SI."""
    if key in RELATIVE:
        raise toml.wrong(where, f"found the unit '{unit}'.", "It must be a share of the value: %, ppm or ppb.",
                         f"Write {key} = {_example(key)}.")  # fmt: skip
    quantity = "position" if key == END_POINTS else key
    try:
        if quantity == "position" and fits("tps", unit):
            return abs(to_channel("tps", unit, travel, tps)[1].scale)
        return abs(conversion(quantity, unit).scale)
    except UnitError as err:
        raise toml.wrong(where, str(err), f"Accepted: a share (%, ppm), or {quantity} in {EXAMPLES[quantity]}.",
                         f"Correct the unit, as in {key} = {_example(key)}.") from err  # fmt: skip


def _example(key: str) -> str:
    shares: Mapping[str, str] = {"gear": '"0.5 %"', "time": '"50 ppm"', END_POINTS: '"0.5 deg"'}
    units = {"position": "0.2 deg", "motor_speed": "5 rpm", "torque": "2 mN*m", "current": "5 mA"}
    return shares.get(key, f'"1 % + {units.get(key, "10 mV")}"')
