"""What a foreign file holds, before anybody says what its columns mean.

A label holds a name and a unit: `Strom (mA)`, `U_mot [V]`, `Zeit in ms`, `U / V`, `pos_deg`, `CH1V`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from ..rig.columns import SUPPLY_CURRENT
from ..rig.units import SI_UNIT, UnitError, conversion, is_percent, is_unit_text
from .names import PEDAL_IN_SOME, is_engines, known, may_be_position, plain_words, quantity_named

TIME = "time"
_VOLTS = 6.0  # that no sensor's reading exceeds
_SEVERAL = 3  # signals of an engine
_OF_A_BENCH = ("voltage", "current", "emf")

_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*")
_PARTED = re.compile(r"(?P<name>.+?)(?:\s+in\s+|\s*/\s*|,\s+)(?P<unit>[^\s/]+(?:/[^\s/]+)?)")
_SUFFIXED = re.compile(r"(?P<name>.+?)_(?P<unit>us|ms|s|mV|V|mA|A|deg|rad|pct|rpm|rad_s|Nm|degC)")
_SCOPE = re.compile(r"(?P<name>CH\d)(?P<unit>[VA])")
_STATED = re.compile(r"(?P<name>.+?)\s*\[\s*(?P<unit>[^\[\]]+?)\s*\]\s*")  # square brackets hold nothing but a unit
_COUNTS = frozenset({"adc", "raw", "count", "counts", "tick", "ticks", "step", "steps", "lsb", "digits"})
_NO_UNIT = ("", "-", "n/a", "none", "None", "N/A")  # what stands where there is none
# as instruments write them, where our spellings differ
_SPELLED = {"second": "s", "sec": "s", "volt": "V", "ampere": "A", "amp": "A", "°": "deg", "grad": "deg",
            "%tps": "%", "% tps": "%", "perc": "%", "prc": "%", "v dc": "V", "vdc": "V",
            "1/min": "rpm", "/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "sek": "s", "usec": "us", "msec": "ms",
            "unix time": "s"}  # fmt: skip
# a scope may save each channel in a file of its own: F0001CH1.CSV and F0001CH2.CSV are one recording
_CHANNEL = re.compile(r"(?P<stem>.*?)_?(?:CH|ch)(?P<number>[1-8])(?P<suffix>\.\w+)")


@dataclass(frozen=True, eq=False)
class Column:
    """One column as its file has it."""

    label: str  # as it stands in the file, `Strom (mA)`: what the user calls it
    name: str  # the label without its unit
    unit: str  # as the file gives it; "" where it gives none
    values: np.ndarray  # in that unit, shape (n,); NaN where the file has no value
    quantity: str = ""  # where the format itself says it (a scope's time base); "" elsewhere
    # reading of all columns with this label, in any file: one instrument has one unit; NaN if only this one
    largest: float = float("nan")
    stated: str = ""  # a unit that the file gives and that nothing of a throttle is logged in; "" elsewhere

    @property
    def finite(self) -> np.ndarray:
        """Values that are there."""
        return self.values[np.isfinite(self.values)]

    @property
    def peak(self) -> float:
        """Largest magnitude, spikes aside, of this column and of its like."""
        own = float(np.quantile(np.abs(self.finite), 0.999)) if self.finite.size else 0.0
        return max(own, self.largest) if np.isfinite(self.largest) else own

    @property
    def varies(self) -> bool:
        return self.finite.size > 2 and float(np.ptp(self.finite)) > 0.0

    @property
    def is_whole(self) -> bool:
        """Whether it holds whole numbers alone."""
        return bool(np.all(self.finite == np.round(self.finite)))


@dataclass(frozen=True, eq=False)
class Sheet:
    """Columns of one length, logged together."""

    file: str  # path, as the user gave it
    part: str  # of the file, where it has several (a group, a structure, a segment); "" elsewhere
    columns: tuple[Column, ...]  # each of shape (n,)
    remarks: tuple[str, ...] = ()  # what the reader had to decide
    losses: tuple[str, ...] = ()  # rows or columns that were left out because they are damaged, each in a sentence
    # sentences: what the file says it holds and does not, and what cannot be read; somebody must accept that
    missing: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """For a message."""
        return f"{self.file}, '{self.part}'" if self.part else self.file

    @property
    def motor(self) -> str:
        """Motor of this part of a file: its part is called `motor` or `motor: test`."""
        return self.part.partition(": ")[0]

    @property
    def rows(self) -> int:
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
        plates = [column for column in self.columns if plain_words(column.name) in PEDAL_IN_SOME]
        share = any(target if c.unit == "%" else not c.unit and c.peak > _VOLTS for c in plates)
        return share or (engines > 0 and any(map(may_be_position, names)))


def time_base(seconds: np.ndarray) -> Column:
    """A time that the format gives in seconds."""
    return Column("time", "time", "s", np.asarray(seconds, dtype=float), TIME)


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
    for form in (_BRACKETS, _PARTED, _SUFFIXED, _SCOPE):
        match = form.fullmatch(label)
        if match and is_unit(unit := spelled(match["unit"])):
            return match["name"].strip(), unit
    return label, ""


def spelled(unit: str) -> str:
    """A unit as `rig.units` reads it: brackets off, an instrument's spelling made ours."""
    bare = " ".join(unit.split()).strip("[]() ")
    folded = bare.casefold().removesuffix("s") if len(bare) > 2 else bare.casefold()
    return "rad/s" if bare == "rad_s" else _SPELLED.get(bare.casefold(), _SPELLED.get(folded, bare))


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


def merged(sheets: Sequence[Sheet]) -> list[Sheet]:
    """The sheets, those of one recording in several files side by side."""
    out: dict[object, Sheet] = {}
    for k, sheet in enumerate(sheets):
        match = _CHANNEL.fullmatch(sheet.file)
        time = next((column.values for column in sheet.columns if column.quantity == TIME), None)
        key = (match["stem"], match["suffix"], time.tobytes()) if match and time is not None else k
        if key in out:
            first = out[key]
            more = tuple(column for column in sheet.columns if column.quantity != TIME)
            remark = f"{sheet.file} has the same times: another channel of the recording"
            sheet = replace(
                first, columns=(*first.columns, *more), remarks=(*first.remarks, *sheet.remarks, remark),
                losses=(*first.losses, *sheet.losses), missing=(*first.missing, *sheet.missing),
            )  # fmt: skip
        out[key] = sheet
    return list(out.values())


def with_common_peaks(sheets: Sequence[Sheet]) -> list[Sheet]:
    """The sheets, each column knowing the largest reading under its label, by which its unit is guessed."""
    largest: dict[str, float] = {}
    for column in (column for sheet in sheets for column in sheet.columns):
        largest[column.label] = max(column.peak, largest.get(column.label, 0.0))
    return [
        replace(sheet, columns=tuple(replace(column, largest=largest[column.label]) for column in sheet.columns))
        for sheet in sheets
    ]
