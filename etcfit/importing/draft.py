"""All guesses together: the planned traces and their doubts; then the texts of a measurement folder, which the folder's
own reader reads before anything is written.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

import numpy as np

from .. import __version__
from ..errors import MeasurementError
from ..rig.base import Rig, RigConfig
from ..rig.checks import refuse
from ..rig.config import config_of
from ..rig.reader import assembled, checked, log_of
from ..rig.table import Table
from ..rig.toml import Toml, parse
from ..rig.user_text import hash_comment
from .answers import Answers, Doubt, column_doubt, loss_doubt, rig_doubt, rig_test_doubt
from .guesses import NameplateGuess, nameplate_guesses, rig_test_of, turned
from .quantities import takes_of
from .record import FEWEST, Record, cut, whole
from .sheet import TIME, Sheet
from .take import LEFT_OUT, Take

_MOST = 60  # largest number of columns in a message
_DIGITS = "%.15g"  # digits of a cell: as many as a float64 always has


@dataclass(frozen=True, eq=False)
class Trace:
    """One planned CSV."""

    record: Record  # its rows and columns
    file: str  # `<test>/<name>.csv`
    reason: str  # reason for the rig test

    @property
    def test(self) -> str:
        """The rig test."""
        return self.file.partition("/")[0]

    @property
    def shown(self) -> list[Take]:
        """The columns of the CSV, time first."""
        takes = [take for take in self.record.takes if take.quantity != LEFT_OUT]
        return sorted(takes, key=lambda take: take.quantity != TIME)

    def table(self) -> Table:
        """The CSV as the folder's reader reads it."""
        rows, shown = self.record.rows, self.shown
        cells = np.column_stack([take.column.values[rows] for take in shown])
        filled = np.isfinite(cells).any(axis=1)
        places = np.arange(rows.start + 1, rows.start + 1 + len(cells))
        return Table(tuple(take.header for take in shown), 0, places[filled], cells[filled], ", row ")


@dataclass(frozen=True, eq=False)
class Draft:
    """A planned measurement folder."""

    traces: tuple[Trace, ...]  # in order
    nameplate: tuple[NameplateGuess, ...]  # guesses for rig.toml
    unused: Mapping[str, str]  # sheet -> why it is not used
    doubts: tuple[Doubt, ...]  # guesses that the user should confirm


def drafted(sheets: Sequence[Sheet], answers: Answers, known: RigConfig | None) -> Draft:
    """Plan the folder for these sheets.

    Args:
        known: the given rig.toml, or None.
    Raises:
        MeasurementError: a file without usable content, or with contradicting columns.
    """
    records, unused = _records(sheets, answers)
    records = turned(records)
    traces, doubts = _traces(records, answers)
    guesses = nameplate_guesses(records, known)
    of_columns = [
        column_doubt(record.sheet, take.column.label, take.header if take.quantity else "left out", take.reason)
        for record in _one_a_sheet(records) for take in record.takes if not take.sure
    ]  # fmt: skip
    doubts = [*(loss_doubt(sheet) for sheet in sheets if sheet.missing), *doubts, *of_columns,
              *(rig_doubt(each.short, each.reason) for each in guesses)]  # fmt: skip
    left = {doubt.key: doubt for doubt in doubts if doubt.key not in answers.accepted}
    return Draft(tuple(traces), tuple(guesses), unused, tuple(left.values()))


def _records(sheets: Sequence[Sheet], answers: Answers) -> tuple[list[Record], dict[str, str]]:
    """The traces in the sheets; a part of a file without any is set aside, a file without any is refused."""
    records: list[Record] = []
    unused: dict[str, MeasurementError] = {}
    for sheet in sheets:
        try:
            takes = takes_of(sheet, answers)
            _refuse_useless(sheet, takes)
            record = whole(*_at_one_row_an_instant(sheet, takes))
            _refuse_falling_time(record)
            records += cut(record)
        except MeasurementError as error:
            unused[sheet.where] = error
    used = {record.sheet.file for record in records}
    for sheet in sheets:
        if sheet.file not in used or (sheet.where in unused and not sheet.part):
            raise unused[sheet.where]
    return records, {where: error.found for where, error in unused.items()}


def _refuse_useless(sheet: Sheet, takes: Sequence[Take]) -> None:
    if all(take.quantity in (LEFT_OUT, TIME) for take in takes):
        names = [take.column.label for take in takes if take.quantity == LEFT_OUT]
        labels, more = "', '".join(names[:_MOST]), f" and {len(names) - _MOST} others" if len(names) > _MOST else ""
        raise MeasurementError(sheet.where, f"nothing says what '{labels}'{more} is.",
                               "A trace needs a voltage, a current, a position or a speed.",
                               "Name the columns: --column 'HEADER=voltage [V]'.")  # fmt: skip


def _at_one_row_an_instant(sheet: Sheet, takes: list[Take]) -> tuple[Sheet, list[Take]]:
    """Merge rows at one instant: an engine computer may write several rows per tick; their last readings make one
    row."""
    time = next(take for take in takes if take.quantity == TIME).column.values
    more = np.flatnonzero(np.diff(time) == 0.0)
    if not more.size or not sheet.is_ecu:
        return sheet, takes
    starts = np.setdiff1d(np.arange(time.size), more + 1)
    group = np.searchsorted(starts, np.arange(time.size), side="right") - 1

    def last_of(values: np.ndarray) -> np.ndarray:
        """The last reading of each group of rows; NaN where there is none."""
        there = np.isfinite(values)
        out = np.full(starts.size, np.nan)
        out[group[there]] = values[there]
        return out

    remark = f"{more.size} rows at the instant of the row above are one with it"
    columns = tuple(replace(column, values=last_of(column.values)) for column in sheet.columns)
    made = replace(sheet, columns=columns, remarks=(*sheet.remarks, remark))
    return made, [replace(t, column=replace(t.column, values=last_of(t.column.values))) for t in takes]


def _refuse_falling_time(record: Record) -> None:
    """Refuse a clock that falls at every other row; it may begin again once for each trace."""
    time = record.time
    falls = np.flatnonzero(~(np.diff(time) > 0.0))
    if FEWEST * falls.size < time.size and falls.size < max(1, time.size - 1):
        return
    k = int(falls[0]) if falls.size else 0
    before, after = (f"{each:.12g}" for each in time[[k, min(k + 1, time.size - 1)]])
    raise MeasurementError(f"{record.sheet.where}, row {k + 2}", f"time goes from {before} to {after} s, "
                           f"and does not rise at {falls.size} of {max(1, time.size - 1)} steps.",
                           "Time must rise strictly within a trace.",
                           "Sort the log, or name the time's column: --column 'HEADER=time [s]'.")  # fmt: skip


def _traces(records: Sequence[Record], answers: Answers) -> tuple[list[Trace], list[Doubt]]:
    pieces: dict[int, list[Record]] = {}
    for record in records:
        pieces.setdefault(id(record.sheet), []).append(record)
    traces: list[Trace] = []
    doubts: list[Doubt] = []
    for parts in pieces.values():
        for k, record in enumerate(parts, start=1):
            said, shown = answers.test_of(record.sheet.file), rig_test_of(record)
            test, reason = (said, "said so") if said else (shown.test, shown.reason)
            if not said and not (shown.sure and test):
                doubts.append(rig_test_doubt(record.sheet, test, reason))
            name = f"{test or 'unknown'}/{_slug(record.sheet)}{f'_{k}' if len(parts) > 1 else ''}"
            # two folders may each hold a scope.csv
            taken, free, number = {trace.file for trace in traces}, f"{name}.csv", 1
            while free in taken:
                number += 1
                free = f"{name}_{number}.csv"
            traces.append(Trace(record, free, f"{reason}; {record.cut}" if record.cut else reason))
    return traces, doubts


def _one_a_sheet(records: Sequence[Record]) -> list[Record]:
    """The first record of each sheet."""
    firsts: dict[int, Record] = {}
    for record in records:
        firsts.setdefault(id(record.sheet), record)
    return list(firsts.values())


def _slug(sheet: Sheet) -> str:
    """A plain name for a file."""
    stem = PurePath(sheet.file.replace("\\", "/")).stem
    text = "_".join(filter(None, (stem, sheet.part)))
    return re.sub(r"[^A-Za-z0-9]+", "_", text).strip("_").casefold() or "trace"


def texts(draft: Draft, name: str, digests: Mapping[str, str], given: str) -> dict[str, str]:
    """Path inside the folder -> text.

    Args:
        draft, name: the planned folder, and the rig's name.
        digests: file -> SHA-256.
        given: text of the given rig.toml, or "".
    """
    head = hash_comment(_story(draft, digests))
    body = given if given.strip() else _rig_toml(draft, name)
    return {"rig.toml": f"{head}\n\n{body}", **{trace.file: _csv(trace) for trace in draft.traces}}


def read_back(draft: Draft, files: Mapping[str, str], to: Path) -> Rig:
    """Read the planned folder with the folder's reader.

    Raises:
        MeasurementError: the reader refuses it, or it is physically impossible; then a guess was wrong.
    """
    path = f"{to}/rig.toml"
    toml = Toml(path, files["rig.toml"], parse(files["rig.toml"], path))
    config = checked(config_of(toml, to.absolute().name), [trace.file for trace in draft.traces], toml)
    logs = []
    for trace in draft.traces:
        where = f"{trace.record.sheet.where} (as {trace.file})"
        try:
            logs.append(log_of(trace.table(), where, trace.file, config, toml))
        except MeasurementError as error:
            raise _with_guesses(error, trace) from error
    rig = assembled(str(to), config, logs, (), toml)
    try:
        refuse(str(to), rig.findings)
    except MeasurementError as error:
        file = error.where.removeprefix(f"{to}/")
        blamed = next((t for t in draft.traces if file in (t.file, t.test)), draft.traces[0])
        raise _with_guesses(error, blamed) from error
    return rig


def _with_guesses(error: MeasurementError, trace: Trace) -> MeasurementError:
    """The reader's error, with the guesses and the options that change them."""
    taken = ", ".join(f"'{take.column.label}' as {take.header}" for take in trace.shown)
    file = Path(trace.record.sheet.file).name
    mend = (f"{error.mend} Guessed were {taken}, and the test {trace.test}. "
            f"Correct the guess: --column 'HEADER=QUANTITY [UNIT]', or --test '{file}=TEST'.")  # fmt: skip
    return MeasurementError(error.where, error.found, error.required, mend)


def _csv(trace: Trace) -> str:
    import pandas as pd

    table, rows = trace.table(), trace.record.rows
    part = f", rows {rows.start + 1} to {rows.stop}" if trace.record.cut else ""
    out = io.StringIO()
    out.write(hash_comment([f"from {trace.record.sheet.where}{part}; numbers as they stand there"]) + "\n")
    frame = pd.DataFrame(table.cells, columns=list(table.header))
    frame.to_csv(out, index=False, float_format=_DIGITS, lineterminator="\n")
    return out.getvalue()


def _rig_toml(draft: Draft, name: str) -> str:
    lines = ["[rig]", f"name = {json.dumps(name, ensure_ascii=False)}",
             "# gear_ratio = 20.68  # motor turns for one turn of the plate: count the teeth and fill it in",
             "# supply_V = 12.0     # needed where a log has duty but no voltage"]  # fmt: skip
    for guess in sorted(draft.nameplate, key=lambda guess: guess.text.startswith("[")):  # keys before tables
        lines += [""] if guess.text.startswith("[") else []
        lines += [hash_comment([f"guessed: {guess.reason}"]), guess.text.rstrip()]
    return "\n".join([*lines, ""])


def _story(draft: Draft, digests: Mapping[str, str]) -> list[str]:
    """Every guess with its reason, by file."""
    lines = [
        f"Written by etcfit import {__version__}. All guesses follow, each with its reason.",
        "Correct a unit or a sign in a CSV's header, a rig test by moving the CSV to that test's folder.",
    ]
    for file, digest in digests.items():
        lines += ["", f"{file}", f"  SHA-256 {digest}"]
        mine = [trace for trace in draft.traces if trace.record.sheet.file == file]
        for trace in mine:
            part = f" (of '{trace.record.sheet.part}')" if trace.record.sheet.part else ""
            lines.append(f"  -> {trace.file}{part}: {trace.reason}")
        for record in _one_a_sheet([trace.record for trace in mine]):
            for take in record.takes:
                taken = f"-> {take.header}" if take.quantity else "left out"
                guess = "" if take.sure else "  (in doubt, and taken)"
                lines.append(f"     '{take.column.label}' {taken}: {take.reason}{guess}")
            sheet = record.sheet
            lines += [f"     {remark}" for remark in (*sheet.remarks, *sheet.losses, *sheet.missing)]
        lines += [f"  {where} is not taken: {why}" for where, why in draft.unused.items() if where.startswith(file)]
    return lines
