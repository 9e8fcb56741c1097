"""The content of a foreign file, before its columns have a meaning.

A label has a name and a unit: `Strom (mA)`, `U_mot [V]`, `Zeit in ms`, `U / V`, `pos_deg`, `CH1V`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from ..rig.columns import SUPPLY_CURRENT
from ..rig.units import SI_UNIT, fits, is_percent, is_unit_text
from .names import PEDAL_IN_SOME, is_engines, known, may_be_position, plain_words, quantity_named

TIME = "time"
_VOLTS = 6.0  # largest reading of a sensor
_SEVERAL = 3  # least number of an engine's signals in an ECU's log
_OF_A_BENCH = ("voltage", "current", "emf")

_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]\s*")
_PARTED = re.compile(r"(?P<name>.+?)(?:\s+in\s+|\s*/\s*|,\s+)(?P<unit>[^\s/]+(?:/[^\s/]+)?)")
_SUFFIXED = re.compile(r"(?P<name>.+?)_(?P<unit>us|ms|s|mV|V|mA|A|deg|rad|pct|rpm|rad_s|Nm|degC)")
_SCOPE = re.compile(r"(?P<name>CH\d)(?P<unit>[VA])")
_STATED = re.compile(r"(?P<name>.+?)\s*\[\s*(?P<unit>[^\[\]]+?)\s*\]\s*")  # square brackets always contain a unit
_COUNTS = frozenset({"adc", "raw", "count", "counts", "tick", "ticks", "step", "steps", "lsb", "digits"})
_NO_UNIT = ("", "-", "n/a", "none", "None", "N/A")  # texts for a missing unit
# spellings of instruments -> ours
_SPELLED = {"second": "s", "sec": "s", "volt": "V", "ampere": "A", "amp": "A", "°": "deg", "grad": "deg",
            "%tps": "%", "% tps": "%", "perc": "%", "prc": "%", "v dc": "V", "vdc": "V",
            "1/min": "rpm", "/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "sek": "s", "usec": "us", "msec": "ms",
            "unix time": "s"}  # fmt: skip
# a scope may save each channel in its own file: F0001CH1.CSV and F0001CH2.CSV are one recording
_CHANNEL = re.compile(r"(?P<stem>.*?)_?(?:CH|ch)(?P<number>[1-8])(?P<suffix>\.\w+)")


@dataclass(frozen=True, eq=False)
class Column:
    """One column of a file."""

    label: str  # label in the file, `Strom (mA)`, by which the user names it
    name: str  # the label without its unit
    unit: str  # unit in the file, or ""
    values: np.ndarray  # in that unit, shape (n,); NaN where the file has no value
    quantity: str = ""  # quantity, if the format itself defines it (a scope's time base)
    # reading of all columns with this label, in any file: one instrument has one unit; NaN if only this one
    largest: float = float("nan")
    stated: str = ""  # a unit in the file that no signal of a throttle has, or ""

    @property
    def finite(self) -> np.ndarray:
        """The values without gaps."""
        return self.values[np.isfinite(self.values)]

    @property
    def peak(self) -> float:
        """Largest magnitude, without spikes, of this column and of all with its label."""
        own = float(np.quantile(np.abs(self.finite), 0.999)) if self.finite.size else 0.0
        return max(own, self.largest) if np.isfinite(self.largest) else own

    @property
    def varies(self) -> bool:
        return self.finite.size > 2 and float(np.ptp(self.finite)) > 0.0

    @property
    def is_whole(self) -> bool:
        """Whether all values are whole numbers."""
        return bool(np.all(self.finite == np.round(self.finite)))


@dataclass(frozen=True, eq=False)
class Sheet:
    """Columns of one length, logged together."""

    file: str  # path, as the user gave it
    part: str  # part of the file, if it has several (a group, a structure, a segment), or ""
    columns: tuple[Column, ...]  # each of shape (n,)
    remarks: tuple[str, ...] = ()  # decisions of the reader
    losses: tuple[str, ...] = ()  # sentences on damaged rows or columns that were left out
    # sentences on missing or unreadable content, which the user must accept
    missing: tuple[str, ...] = ()

    @property
    def where(self) -> str:
        """For a message."""
        return f"{self.file}, '{self.part}'" if self.part else self.file

    @property
    def motor(self) -> str:
        """Motor of this part of a file, whose name is `motor` or `motor: test`."""
        return self.part.partition(": ")[0]

    @property
    def rows(self) -> int:
        return self.columns[0].values.size

    @cached_property
    def is_ecu(self) -> bool:
        """Whether this is the log of an engine computer, with several signals of an engine.

        If no voltage or current shows a bench, one of these is enough: a setpoint with a maker's name, a TPS with one
        signal of an engine, or a TPS in per cent.
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
    """The time column of a format that gives seconds."""
    return Column("time", "time", "s", np.asarray(seconds, dtype=float), TIME)


def column(label: str, values: np.ndarray, unit: str = "") -> Column:
    """A column from its label, which may contain the unit.

    Args:
        label: label in the file.
        values: shape (n,).
        unit: unit given elsewhere in the file; the label's own counts only if this one is empty.
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
    """Name and unit; the whole label and "" if it contains no unit of a throttle's signal."""
    for form in (_BRACKETS, _PARTED, _SUFFIXED, _SCOPE):
        match = form.fullmatch(label)
        if match and is_unit(unit := spelled(match["unit"])):
            return match["name"].strip(), unit
    return label, ""


def spelled(unit: str) -> str:
    """A unit in the form for `rig.units`: without brackets, in our spelling."""
    bare = " ".join(unit.split()).strip("[]() ")
    folded = bare.casefold().removesuffix("s") if len(bare) > 2 else bare.casefold()
    return "rad/s" if bare == "rad_s" else _SPELLED.get(bare.casefold(), _SPELLED.get(folded, bare))


def is_unit(unit: str) -> bool:
    """Whether a rig has signals in this unit."""
    return bool(unit) and (is_percent(unit) or bool(quantities_in(unit)))


def is_unknown_unit(stated: str) -> bool:
    """Whether a unit is unknown, or counts, whose size only the user knows."""
    return stated.casefold() in _COUNTS or not is_unit_text(stated)


@cache
def quantities_in(unit: str) -> tuple[str, ...]:
    """Quantities that can be logged in this unit; a current counts as the motor's unless the user says otherwise."""
    return tuple(quantity for quantity in SI_UNIT if quantity != SUPPLY_CURRENT and fits(quantity, unit))


def merged(sheets: Sequence[Sheet]) -> list[Sheet]:
    """The sheets, with those of one recording in several files merged."""
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
    """The sheets, each column with the largest reading under its label, for the guess of its unit."""
    largest: dict[str, float] = {}
    for column in (column for sheet in sheets for column in sheet.columns):
        largest[column.label] = max(column.peak, largest.get(column.label, 0.0))
    return [
        replace(sheet, columns=tuple(replace(column, largest=largest[column.label]) for column in sheet.columns))
        for sheet in sheets
    ]
