"""A label of a column -> its name and its unit.

Strom (mA)   U_mot [V]   Zeit in ms   U / V   pos_deg   CH1V
"""

from __future__ import annotations

import re
from functools import cache

import numpy as np

from ..rig.columns import SUPPLY_CURRENT
from ..rig.units import SI_UNIT, UnitError, conversion, is_percent, is_unit_text
from .sheet import Column

_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*")
_PARTED = re.compile(r"(?P<name>.+?)(?:\s+in\s+|\s*/\s*|,\s+)(?P<unit>[^\s/]+(?:/[^\s/]+)?)")
_SUFFIXES = ("us", "ms", "s", "mV", "V", "mA", "A", "deg", "rad", "pct", "rpm", "rad_s", "Nm", "degC")
_SUFFIXED = re.compile(rf"(?P<name>.+?)_(?P<unit>{'|'.join(_SUFFIXES)})")
_SCOPE = re.compile(r"(?P<name>CH\d)(?P<unit>[VA])")
_STATED = re.compile(r"(?P<name>.+?)\s*\[\s*(?P<unit>[^\[\]]+?)\s*\]\s*")  # square brackets hold nothing but a unit
_FORMS = (_BRACKETS, _PARTED, _SUFFIXED, _SCOPE)
_SLUGS = {"rad_s": "rad/s"}
_COUNTS = frozenset({"adc", "raw", "count", "counts", "tick", "ticks", "step", "steps", "lsb", "digits"})
_NO_UNIT = ("", "-", "n/a", "none", "None", "N/A")  # what stands where there is none
# as instruments write them, where our spellings differ
_SPELLED = {"second": "s", "sec": "s", "volt": "V", "ampere": "A", "amp": "A", "°": "deg", "grad": "deg",
            "%tps": "%", "% tps": "%", "perc": "%", "prc": "%", "v dc": "V", "vdc": "V", 
            "1/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "sek": "s", "usec": "us", "msec": "ms"}  # fmt: skip


def column(label: str, values: np.ndarray, unit: str = "") -> Column:
    """A column by its label, which may hold the unit.

    Args:
        label: as it stands in the file.
        values: shape (n,).
        unit: where the file gives it in another place; then the label's own counts only if this one is none.
    """
    label = " ".join(label.split())
    name, own = split(label)
    given = spelled(unit) if spelled(unit) not in _NO_UNIT else ""
    known = given if is_unit(given) else own
    match = _STATED.fullmatch(name) if not known else None
    stated = given or (match["unit"] if match else "")
    return Column(label, match["name"] if match else name, known, np.asarray(values, dtype=float),
                  stated="" if known else stated)  # fmt: skip


def split(label: str) -> tuple[str, str]:
    """Name and unit; the whole label and "" where it holds no unit that a throttle could have."""
    for form in _FORMS:
        match = form.fullmatch(label)
        if match and is_unit(unit := spelled(match["unit"])):
            return match["name"].strip(), unit
    return label, ""


def spelled(unit: str) -> str:
    """A unit as `rig.units` reads it: brackets off, an instrument's spelling made ours."""
    bare = " ".join(unit.split()).strip("[]() ")
    folded = bare.casefold().removesuffix("s") if len(bare) > 2 else bare.casefold()
    return _SLUGS.get(bare, _SPELLED.get(bare.casefold(), _SPELLED.get(folded, bare)))


def is_unit(unit: str) -> bool:
    """True for a unit of anything that a rig logs."""
    return bool(unit) and (is_percent(unit) or bool(quantities_in(unit)))


def is_unknown_unit(stated: str) -> bool:
    """True for a unit that nothing is measured in, and for counts, of which only the user knows what one is."""
    return stated.casefold() in _COUNTS or not is_unit_text(stated)


@cache
def quantities_in(unit: str) -> tuple[str, ...]:
    """Quantities that can be logged in this unit; a current is the motor's until somebody says that it is not."""
    return tuple(quantity for quantity in SI_UNIT if quantity != SUPPLY_CURRENT and fits(quantity, unit))


def fits(quantity: str, unit: str) -> bool:
    """True where a column of this quantity can be logged in this unit."""
    if is_percent(unit):
        return quantity in ("position", "setpoint", "duty")
    try:
        conversion(quantity, unit)
    except UnitError:
        return False
    return True
