"""A draft -> the texts of a measurement folder, read back by the folder's own reader before anything is written."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import __version__
from ..errors import MeasurementError
from ..rig.base import Rig
from ..rig.checks import refuse
from ..rig.config import config_of
from ..rig.reader import assembled, checked, log_of
from ..rig.table import Table
from ..rig.toml import Toml, parse
from ..rig.user_text import hash_comment
from .draft import Draft, Trace
from .sheet import TIME
from .take import LEFT_OUT, Take

_DIGITS = "%.15g"  # of a cell: as many as a float64 surely has


def texts(draft: Draft, name: str, digests: Mapping[str, str], given: str) -> dict[str, str]:
    """Path inside the folder -> text.

    Args:
        draft: what is to be written.
        name: of the rig.
        digests: file -> SHA-256.
        given: text of a rig.toml that was given; "" where there is none.
    """
    head = hash_comment(_story(draft, digests))
    body = given if given.strip() else _rig_toml(draft, name)
    return {"rig.toml": f"{head}\n\n{body}", **{trace.file: _csv(trace) for trace in draft.traces}}


def read_back(draft: Draft, files: Mapping[str, str], to: Path) -> Rig:
    """What the reader makes of it.

    Raises:
        MeasurementError: it refuses it, or physics does; then a guess was wrong.
    """
    path = f"{to}/rig.toml"
    toml = Toml(path, files["rig.toml"], parse(files["rig.toml"], path))
    config = checked(config_of(toml, to.absolute().name), [trace.file for trace in draft.traces], toml)
    logs = []
    for trace in draft.traces:
        where = f"{trace.record.sheet.where} (as {trace.file})"
        try:
            logs.append(log_of(_table(trace), where, trace.file, config, toml))
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
    """The reader's message, with what was guessed and the options that change it."""
    taken = ", ".join(f"'{take.column.label}' as {take.header}" for take in _shown(trace))
    file = Path(trace.record.sheet.file).name
    mend = (f"{error.mend} Guessed were {taken}, and the test {trace.test}. "
            f"Correct the guess: --column 'HEADER=QUANTITY [UNIT]', or --test '{file}=TEST'.")  # fmt: skip
    return MeasurementError(error.where, error.found, error.required, mend)


def _shown(trace: Trace) -> list[Take]:
    """The columns of the CSV, time first."""
    takes = [take for take in trace.record.takes if take.quantity != LEFT_OUT]
    return sorted(takes, key=lambda take: take.quantity != TIME)


def _cells(trace: Trace) -> np.ndarray:
    return np.column_stack([take.column.values[trace.record.rows] for take in _shown(trace)])


def _table(trace: Trace) -> Table:
    cells = _cells(trace)
    header = tuple(take.header for take in _shown(trace))
    rows = np.arange(trace.record.rows.start + 1, trace.record.rows.start + 1 + len(cells))
    filled = np.isfinite(cells).any(axis=1)
    return Table(header, 0, rows[filled], cells[filled], ", row ")


def _csv(trace: Trace) -> str:
    import pandas as pd

    table = _table(trace)
    rows = trace.record.rows
    part = f", rows {rows.start + 1} to {rows.stop}" if trace.record.cut else ""
    out = io.StringIO()
    out.write(hash_comment([f"from {trace.record.sheet.where}{part}; numbers as they stand there"]) + "\n")
    frame = pd.DataFrame(table.cells, columns=list(table.header))
    frame.to_csv(out, index=False, float_format=_DIGITS, lineterminator="\n")
    return out.getvalue()


def _rig_toml(draft: Draft, name: str) -> str:
    tables = [guess for guess in draft.nameplate if guess.text.startswith("[")]
    keys = [guess for guess in draft.nameplate if guess not in tables]
    lines = ["[rig]", f"name = {json.dumps(name, ensure_ascii=False)}",
             "# gear_ratio = 20.68  # motor turns for one turn of the plate: count the teeth and fill it in",
             "# supply_V = 12.0     # needed where a log has duty but no voltage"]  # fmt: skip
    for guess in keys:
        lines += [hash_comment([f"guessed: {guess.reason}"]), guess.text.rstrip()]
    for guess in tables:
        lines += ["", hash_comment([f"guessed: {guess.reason}"]), guess.text.rstrip()]
    return "\n".join([*lines, ""])


def _story(draft: Draft, digests: Mapping[str, str]) -> list[str]:
    """Every guess with its reason, by file."""
    lines = [
        f"Written by etcfit import {__version__}. What was guessed stands below, each with its reason.",
        "Correct a unit or a sign in a CSV's header, a rig test by moving the CSV to that test's folder.",
    ]
    for file, digest in digests.items():
        lines += ["", f"{file}", f"  SHA-256 {digest}"]
        mine = [trace for trace in draft.traces if trace.record.sheet.file == file]
        for trace in mine:
            part = f" (of '{trace.record.sheet.part}')" if trace.record.sheet.part else ""
            lines.append(f"  -> {trace.file}{part}: {trace.reason}")
        seen: set[int] = set()
        for trace in mine:
            if id(trace.record.sheet) not in seen:
                seen.add(id(trace.record.sheet))
                lines += [f"     {_told(take)}" for take in trace.record.takes]
                sheet = trace.record.sheet
                lines += [f"     {remark}" for remark in (*sheet.remarks, *sheet.losses, *sheet.missing)]
        lines += [f"  {where} is not taken: {why}" for where, why in draft.unused.items() if where.startswith(file)]
    return lines


def _told(take: Take) -> str:
    taken = f"-> {take.header}" if take.quantity else "left out"
    guess = "" if take.sure else "  (in doubt, and taken)"
    return f"'{take.column.label}' {taken}: {take.reason}{guess}"
