"""ASAM MDF (.mf4, .mdf), by asammdf; the frames of a bus log are decoded by a DBC among the files.

Groups with different rates become one sheet: one row for every instant of any of them, with gaps elsewhere.

Source: ASAM MDF 4.2, as asammdf reads it. Differs from source: texts are left out, and so are arrays, with a remark.
"""

from __future__ import annotations

import io
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..sheet import Column, Sheet, column, time_base
from .base import Format, Source, common_rows, reading, warnings_of, with_gaps

_KIND = "a measurement file of ASAM MDF"
_TICK = 6  # decimals of a second: instants nearer than a microsecond are equal
_FRAMES = ("CAN_", "LIN_")  # names of a bus log's raw parts, whose numbers have no meaning
_FLAGS = slice(60, 64)  # bytes of the file's first block: tasks that its logger did not finish


def _read(source: Source) -> list[Sheet]:
    import asammdf

    with reading(source, _KIND), _opened(source.path) as stream, warnings_of("asammdf") as odd:
        try:
            with asammdf.MDF(stream) as mdf:
                groups = [(group.channel_group.cycles_nr, len(group.channels)) for group in mdf.groups]
                source.refuse_larger(sum(8 * cycles * channels for cycles, channels in groups))
                signals = _signals(mdf, odd)
                if source.buses:
                    databases: Any = {"CAN": [(str(path), 0) for path in source.buses]}
                    with mdf.extract_bus_logging(databases) as decoded:
                        signals = [*_meant(signals), *_signals(decoded, odd)]
        except Exception as err:
            # close the object that asammdf was building when it failed: else its destructor fails too, and prints that
            for frame, _ in traceback.walk_tb(err.__traceback__):
                with suppress(Exception):
                    frame.f_locals["self"].close()  # a second call returns at once
            raise
    if signals and not _meant(signals):
        raise MeasurementError(source.where, "a bus log: frames, and nothing that says what they mean.",
                               "Signals are required, or the DBC that decodes them.",
                               "Name the .dbc among the files.")  # fmt: skip
    together, remarks = _united(source, signals)
    return [Sheet(source.where, "", together, remarks, missing=tuple(dict.fromkeys(odd)))]


def _opened(path: Path) -> io.BytesIO | io.BufferedReader:
    """A stream, which is always closed; a copy if the unfinished tasks of the logger must be completed."""
    with path.open("rb") as file:
        head = file.read(_FLAGS.stop)
    return io.BytesIO(path.read_bytes()) if any(head[_FLAGS]) else path.open("rb")


def _meant(signals: list[Any]) -> list[Any]:
    return [signal for signal in signals if not signal.name.startswith(_FRAMES)]


def _signals(mdf: Any, odd: list[str]) -> list[Any]:
    """Signals of numbers over time, of every group.

    Args:
        mdf: the file's object of asammdf.
        odd: a sentence on each array, which cannot be read, is added to it.
    """
    found = []
    for group, _ in enumerate(mdf.groups):
        if not (rows := mdf.groups[group].channel_group.cycles_nr):
            continue
        for index, _ in enumerate(mdf.groups[group].channels):
            if index == mdf.masters_db.get(group):
                continue
            signal = mdf.get(group=group, index=index)
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iuf":
                if not len(signal.timestamps) == len(signal.samples) == rows:
                    there = f"{len(signal.samples)} values and {len(signal.timestamps)} times"
                    raise ValueError(f"'{signal.name}' has {there}, its group says {rows}")
                if np.any(~(np.diff(signal.timestamps) >= 0.0)):
                    raise ValueError(f"the time of '{signal.name}' falls")
                found.append(signal)
            elif signal.samples.dtype.kind not in "SUO" and not signal.name.startswith(_FRAMES):
                odd.append(f"'{signal.name}' cannot be read: it is an array")
    return found


def _united(source: Source, signals: list[Any]) -> tuple[tuple[Column, ...], tuple[str, ...]]:
    if not signals:
        return (), ()
    instants = [np.round(np.asarray(signal.timestamps, dtype=float), _TICK) for signal in signals]
    time, places = common_rows(source, instants, len(signals))
    columns, remarks = [], []
    for signal, rows in zip(signals, places, strict=True):
        columns.append(column(signal.name, with_gaps(time.size, rows, signal.samples), signal.unit))
        if lost := rows.size - np.unique(rows).size:
            remarks.append(f"'{signal.name}': of samples at one instant the last counts; {lost} left out")
    return (time_base(time), *columns), tuple(remarks)


FORMAT = Format("MDF", (".mf4", ".mdf"), _read, "asammdf")
