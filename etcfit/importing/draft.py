"""All guesses together: which traces there will be, and what of them is in doubt."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

import numpy as np

from ..errors import MeasurementError
from ..rig.base import RigConfig
from .answers import Answers
from .cuts import cut
from .doubts import AbstractDoubt, ColumnDoubt, LossDoubt, RigDoubt, TestDoubt
from .nameplate import NameplateGuess, sensor_guess, supply_guess, travel_guess
from .quantities import takes_of
from .record import Record, whole
from .rig_tests import rig_test_of
from .settings import GuessSettings
from .sheet import TIME, Sheet
from .signs import turned
from .take import LEFT_OUT, Take

_MOST = 60  # columns that a message lists


@dataclass(frozen=True, eq=False)
class Trace:
    """One CSV to be.

    Args:
        record: its rows and columns.
        file: `<test>/<name>.csv`.
        reason: of the rig test.
    """

    record: Record
    file: str
    reason: str

    @property
    def test(self) -> str:
        """The rig test."""
        return self.file.partition("/")[0]


@dataclass(frozen=True, eq=False)
class Draft:
    """A measurement folder to be.

    Args:
        traces: in order.
        nameplate: guesses that rig.toml needs.
        unused: sheet -> why nothing of it was taken.
        doubts: what somebody should confirm.
    """

    traces: tuple[Trace, ...]
    nameplate: tuple[NameplateGuess, ...]
    unused: Mapping[str, str]
    doubts: tuple[AbstractDoubt, ...]


def drafted(
    sheets: Sequence[Sheet], answers: Answers, known: RigConfig | None, settings: GuessSettings = GuessSettings()
) -> Draft:
    """The folder that these sheets make.

    Args:
        sheets: of all files.
        answers: what the user said.
        known: a rig.toml that was given; None where there is none.
        settings: what decides a guess.
    Raises:
        MeasurementError: a file of which nothing can be taken, or whose columns contradict themselves.
    """
    records, unused = _records(sheets, answers, settings)
    records = turned(records, settings)
    traces, doubts = _traces(records, answers, settings)
    makers = (sensor_guess, travel_guess, supply_guess)
    guesses = [each for each in (make(records, known, settings) for make in makers) if each is not None]
    doubts = [*_of_losses(sheets), *doubts]
    doubts += [doubt for record in _one_a_sheet(records) for doubt in _of_columns(record)]
    doubts += [RigDoubt("rig.toml", each.short, each.reason) for each in guesses]
    open_ = {doubt.key: doubt for doubt in doubts if doubt.key not in answers.accepted}
    return Draft(tuple(traces), tuple(guesses), unused, tuple(open_.values()))


def _records(sheets: Sequence[Sheet], answers: Answers, settings: GuessSettings) -> tuple[list[Record], dict[str, str]]:
    """The traces that the sheets hold; a part of a file without any is set aside, a file without any refused."""
    records: list[Record] = []
    unused: dict[str, MeasurementError] = {}
    for sheet in sheets:
        try:
            record = whole(*_at_one_row_an_instant(sheet, _useful(sheet, answers, settings)))
            _refuse_falling_time(record, settings)
            records += cut(record, settings)
        except MeasurementError as error:
            unused[sheet.where] = error
    used = {record.sheet.file for record in records}
    for sheet in sheets:
        if sheet.file not in used or (sheet.where in unused and not sheet.part):
            raise unused[sheet.where]
    return records, {where: error.found for where, error in unused.items()}


def _at_one_row_an_instant(sheet: Sheet, takes: list[Take]) -> tuple[Sheet, list[Take]]:
    """An engine computer may write several rows a tick of its clock: their last readings make one row."""
    time = next(take for take in takes if take.quantity == TIME).column.values
    more = np.flatnonzero(np.diff(time) == 0.0)
    if not more.size or not sheet.is_ecu:
        return sheet, takes
    starts = np.setdiff1d(np.arange(time.size), more + 1)
    group = np.searchsorted(starts, np.arange(time.size), side="right") - 1
    kept = {id(column): replace(column, values=_last_of(column.values, group, starts.size)) for column in sheet.columns}
    told = f"{more.size} rows at the instant of the row above are one with it"
    made = replace(sheet, columns=tuple(kept.values()), remarks=(*sheet.remarks, told))
    return made, [replace(take, column=replace(take.column, values=_last_of(take.column.values, group, starts.size)))
                  for take in takes]  # fmt: skip


def _last_of(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """The last reading of each group of rows; NaN where there is none."""
    there = np.isfinite(values)
    out = np.full(count, np.nan)
    out[group[there]] = values[there]
    return out


def _refuse_falling_time(record: Record, settings: GuessSettings) -> None:
    """A clock may begin anew, once for each trace; one that falls at every other row is none.

    Raises:
        MeasurementError: it falls, or stands still.
    """
    time = record.time
    falls = np.flatnonzero(~(np.diff(time) > 0.0))
    if settings.fewest * falls.size < time.size and falls.size < max(1, time.size - 1):
        return
    k = int(falls[0]) if falls.size else 0
    before, after = (f"{each:.12g}" for each in time[[k, min(k + 1, time.size - 1)]])
    raise MeasurementError(f"{record.sheet.where}, row {k + 2}", f"time goes from {before} to {after} s, "
                           f"and does not rise at {falls.size} of {max(1, time.size - 1)} steps.",
                           "Time must rise strictly within a trace.",
                           "Sort the log, or name the time's column: --column 'HEADER=time [s]'.")  # fmt: skip


def _useful(sheet: Sheet, answers: Answers, settings: GuessSettings) -> list[Take]:
    takes = takes_of(sheet, answers, settings)
    if all(take.quantity in (LEFT_OUT, TIME) for take in takes):
        names = [take.column.label for take in takes if take.quantity == LEFT_OUT]
        labels, more = "', '".join(names[:_MOST]), f" and {len(names) - _MOST} others" if len(names) > _MOST else ""
        raise MeasurementError(sheet.where, f"nothing says what '{labels}'{more} is.",
                               "A trace needs a voltage, a current, a position or a speed.",
                               "Name the columns: --column 'HEADER=voltage [V]'.")  # fmt: skip
    return takes


def _traces(
    records: Sequence[Record], answers: Answers, settings: GuessSettings
) -> tuple[list[Trace], list[AbstractDoubt]]:
    pieces: dict[int, list[Record]] = {}
    for record in records:
        pieces.setdefault(id(record.sheet), []).append(record)
    traces, doubts = [], []
    for parts in pieces.values():
        for k, record in enumerate(parts, start=1):
            said, shown = answers.test_of(record.sheet.file), rig_test_of(record, settings)
            test, reason = (said, "said so") if said else (shown.test, shown.reason)
            if not said and not (shown.sure and test):
                doubts.append(TestDoubt(record.sheet.where, test, reason, record.sheet.file))
            name = _free(f"{test or 'unknown'}/{_slug(record.sheet)}{f'_{k}' if len(parts) > 1 else ''}", traces)
            traces.append(Trace(record, name, f"{reason}; {record.cut}" if record.cut else reason))
    return traces, doubts


def _free(name: str, traces: Sequence[Trace]) -> str:
    """A file name that no trace has: two folders may hold a scope.csv each."""
    taken, number, free = {trace.file for trace in traces}, 1, f"{name}.csv"
    while free in taken:
        number += 1
        free = f"{name}_{number}.csv"
    return free


def _slug(sheet: Sheet) -> str:
    """A plain name for a file."""
    stem = PurePath(sheet.file.replace("\\", "/")).stem
    text = "_".join(filter(None, (stem, sheet.part)))
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_").casefold() or "trace"


def _of_losses(sheets: Sequence[Sheet]) -> list[AbstractDoubt]:
    """A file that lacks what it says it holds may lack what tells one rig test from another."""
    return [
        LossDoubt(sheet.where, f"{sheet.rows} whole rows of {len(sheet.columns)} columns", "; ".join(sheet.missing))
        for sheet in sheets
        if sheet.missing
    ]


def _one_a_sheet(records: Sequence[Record]) -> list[Record]:
    return list({id(record.sheet): record for record in reversed(records)}.values())[::-1]


def _of_columns(record: Record) -> list[AbstractDoubt]:
    return [
        ColumnDoubt(f"{record.sheet.where}, column '{take.column.label}'",
                    take.header if take.quantity else "left out", take.reason, record.sheet.file, take.column.label)
        for take in record.takes if not take.sure
    ]  # fmt: skip
