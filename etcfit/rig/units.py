"""Converts units of column headers and [noise] keys to SI.

    value_SI = scale * logged + offset

Source: pint's registry. It takes a quarter of a second to load, so a table has pint's results for the most frequent
units.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from .base import CHANNELS, TpsCalibration
from .rows import NUMBER

# quantity -> the unit to which pint converts it
SI_UNIT: dict[str, str] = {
    **CHANNELS,
    "duty": "dimensionless",
    "time": "s",
    "tps": "V",
    "supply_current": "A",  # of the bridge's supply: `columns.py` makes it the motor's
}

EXAMPLES: dict[str, str] = {
    "time": "s or ms",
    "voltage": "V or mV",
    "current": "A or mA",
    "position": "rad, deg or %",
    "emf": "V or mV",
    "motor_speed": "rad/s or rpm",
    "setpoint": "rad, deg or %",
    "duty": "1 or %",
    "supply": "V",
    "torque": "N m or mN m",
    "temperature": "degC or K",
    "tps": "V or mV",
    "supply_current": "A or mA",
}

# spellings that pint does not know, or reads as another unit (Nm is its number-metre)
SPELLINGS: dict[str, str] = {
    **dict.fromkeys(("u/min", "rev/min", "r/min", "rpm", "revs/min"), "rpm"),
    **dict.fromkeys(("-", "1", "fraction"), "dimensionless"),
    **dict.fromkeys(("%", "percent", "pct"), "percent"),
    **dict.fromkeys(("volt", "volts"), "V"),
    **dict.fromkeys(("amp", "amps", "ampere", "amperes"), "A"),
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("degree", "degrees", "deg"), "deg"),
    **dict.fromkeys(("radian", "radians", "rad"), "rad"),
    **dict.fromkeys(("kg*m2", "kg m2", "kgm2"), "kg*m^2"),
    **dict.fromkeys(("celsius", "degc", "deg c", "°c"), "degC"),
}

# (required unit in pint's spelling, logged unit) -> scale: pint's results, which the tests compare
USUAL: dict[tuple[str, str], float] = {
    **{(unit, unit): 1.0 for unit in SI_UNIT.values()},
    **{(unit, f"m{unit}"): 1e-3 for unit in ("V", "A", "s")},
    ("rad", "deg"): math.pi / 180.0,
    ("rad/s", "rpm"): math.pi / 30.0,
    ("dimensionless", "percent"): 0.01,
}

# names, each with a small power, joined by * / . or a space: enough for all units, and safe for pint
_NAME = r"[^\W\d_]{1,20}|[°%µμΩ][^\W\d_]{0,3}|1"
_POWERED = rf"(?:{_NAME})(?:\^-?\d|\*\*-?\d|[²³])?"
_GRAMMAR = re.compile(rf"{_POWERED}(?:\s*[*/·.]\s*{_POWERED}|\s+{_POWERED})*")
_NEWTON_METRE = re.compile(r"([mkµμ]?N)[-·. ]?([cm]?m)")

# texts in rows of units, without brackets, in small letters: of benches, engines and cars
_UNIT_TEXTS = frozenset("""
    s sec secs second seconds ms msec us µs usec min h hour v mv volt volts kv a ma amp amps ampere ua ohm kohm w kw hp
    % pct percent deg degree degrees ° rad mrad turn rev rpm u/min 1/min min-1 rpm/s rad/s deg/s °/s %/s v/s kpa/s
    kpa hpa pa mpa bar mbar psi inhg c f k °c °f degc degf deg_c deg_f °ca ca btdc degbtdc n nm n.m n*m lbft lb-ft kg g
    lb m mm cm km ft mi m/s km/h kmh kph mph m/s2 m/s^2 g/s kg/h g/cyl mg/cyl lb/min l/h cc cc/min ml mg mm3 hz khz
    db afr lambda λ lam la l :1 ratio x raw adc bits bit bool flag enum counts count ticks step steps - 1 n/a none o2
    gear state status index hex string text pct/s fraction
    """.split())  # fmt: skip  # noqa: SIM905


def usual_unit(quantity: str) -> str:
    """The first of the units that a message names."""
    return EXAMPLES[quantity].split(" or ")[0].split(",")[0]


def is_unit_text(text: str) -> bool:
    """True for a text that is a unit in a row of units, of any logged quantity."""
    return text.strip("[]() ").casefold() in _UNIT_TEXTS


class UnitError(ValueError):
    """An unknown unit, or one of the wrong dimension; the text describes it."""


@dataclass(frozen=True)
class Conversion:
    """si = scale * logged + offset."""

    scale: float
    offset: float = 0.0


def is_percent(unit: str) -> bool:
    """Percent, in any usual spelling."""
    return _pint_spelling(unit) == "percent"


@cache
def conversion(quantity: str, unit: str) -> Conversion:
    """The conversion of a column of this quantity and unit to SI.

    A number may stand before the unit, as in `-1 A` or `1.02 s`, for a channel with the wrong sign or scale.

    Angles and their rates must name an angle: pint reads 1/min as 0.017 rad/s, but in a German log it means rpm.

    Raises:
        UnitError: not a unit, or not one of this quantity.
    """
    factor, _, rest = unit.strip().partition(" ")
    if rest and NUMBER.fullmatch(factor):
        if not 1e-12 <= abs(float(factor)) <= 1e12:
            raise UnitError(f"the number in '{unit}' is no scale.")
        whole = conversion(quantity, rest.strip())
        return Conversion(float(factor) * whole.scale, whole.offset)
    si, logged = SI_UNIT[quantity], _pint_spelling(unit)
    if (si, logged) in USUAL:
        return Conversion(USUAL[si, logged])
    return by_pint(quantity, unit)


def fits(quantity: str, unit: str) -> bool:
    """Whether a column of this quantity can be logged in this unit."""
    if is_percent(unit):
        return quantity in ("position", "setpoint", "duty")
    try:
        conversion(quantity, unit)
    except UnitError:
        return False
    return True


def by_pint(quantity: str, unit: str) -> Conversion:
    """`conversion` by pint alone, for a unit without a number before it."""
    si, logged = SI_UNIT[quantity], _pint_spelling(unit)
    try:
        same = len({str(_quantity(1.0, each).to_root_units().units) for each in (logged, si)}) == 1
        zero, one = (float(_quantity(x, logged).to(si).magnitude) for x in (0.0, 1.0)) if same else (0.0, 0.0)
    except Exception as err:  # any error of pint, or of its tokenizer, for a text that is no unit
        raise UnitError(f"unit '{unit}' is not known.") from err
    if not same:
        raise UnitError(f"unit '{unit}' is not one of {quantity}.")
    return Conversion(one - zero, zero)


@cache
def to_si(unit: str) -> tuple[str, Conversion]:
    """The SI unit of any unit, as pint writes it, and the conversion to it.

    Raises:
        UnitError: not a unit.
    """
    spelt = _pint_spelling(unit.strip())
    try:
        zero, one = (_quantity(x, spelt).to_base_units() for x in (0.0, 1.0))
    except UnitError:
        raise
    except Exception as err:  # any error of pint for a text that is no unit
        raise UnitError(f"unit '{unit}' is not known.") from err
    return f"{one.units:~C}", Conversion(float(one.magnitude - zero.magnitude), float(zero.magnitude))


def _pint_spelling(unit: str) -> str:
    text = " ".join(unit.split())
    if match := _NEWTON_METRE.fullmatch(text):
        return f"{match[1]}*{match[2]}"
    return SPELLINGS.get(text.casefold(), text)


@cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


def _quantity(magnitude: float, unit: str) -> Any:
    if not _GRAMMAR.fullmatch(unit):
        raise UnitError(f"'{unit}' does not read as a unit.")
    return _registry().Quantity(magnitude, unit)


def to_channel(
    quantity: str, unit: str, travel: tuple[float, float], tps: TpsCalibration | None
) -> tuple[str, Conversion]:
    """The channel of a quantity, and its conversion with the data of the rig.

        percent:  theta = travel_0 + x/100 (travel_1 - travel_0)
        tps:      theta = (V - V_closed)/(V_open - V_closed) travel_tps

    Raises:
        UnitError: as `conversion`; also for percent of an endless travel, or sensor voltage without a calibration.
    """
    if quantity in ("position", "setpoint") and is_percent(unit):
        span = travel[1] - travel[0]
        if span == float("inf"):
            raise UnitError(f"{quantity} in percent of a travel without end stops.")
        return quantity, Conversion(span / 100, travel[0])
    if quantity != "tps":
        return quantity, conversion(quantity, unit)
    volts = conversion("tps", unit)
    if tps is None:
        raise UnitError("tps needs the sensor's calibration, and rig.toml has no [tps].")
    rad_per_volt = tps.travel / (tps.open_V - tps.closed_V)
    return "position", Conversion(rad_per_volt * volts.scale, (volts.offset - tps.closed_V) * rad_per_volt)
