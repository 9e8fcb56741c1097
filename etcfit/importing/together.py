"""What files have in common: one recording in several files, one instrument in several recordings.

A scope may save each channel in a file of its own: F0001CH1.CSV and F0001CH2.CSV are one recording.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .sheet import TIME, Sheet

_CHANNEL = re.compile(r"(?P<stem>.*?)_?(?:CH|ch)(?P<number>[1-8])(?P<suffix>\.\w+)")


def merged(sheets: Sequence[Sheet]) -> list[Sheet]:
    """The sheets, those of one recording side by side."""
    out: dict[object, Sheet] = {}
    for k, sheet in enumerate(sheets):
        match, time = _CHANNEL.fullmatch(sheet.file), _time(sheet)
        key = (match["stem"], match["suffix"], time.tobytes()) if match and time is not None else k
        out[key] = _beside(out[key], sheet) if key in out else sheet
    return list(out.values())


def _time(sheet: Sheet) -> np.ndarray | None:
    return next((column.values for column in sheet.columns if column.quantity == TIME), None)


def _beside(first: Sheet, other: Sheet) -> Sheet:
    more = tuple(column for column in other.columns if column.quantity != TIME)
    remark = f"{other.file} has the same times: another channel of the recording"
    return replace(first, columns=(*first.columns, *more), remarks=(*first.remarks, *other.remarks, remark),
                   losses=(*first.losses, *other.losses), missing=(*first.missing, *other.missing))  # fmt: skip


def with_common_peaks(sheets: Sequence[Sheet]) -> list[Sheet]:
    """The sheets, each column knowing the largest reading under its label, by which its unit is guessed."""
    largest: dict[str, float] = {}
    for column in (column for sheet in sheets for column in sheet.columns):
        largest[column.label] = max(column.peak, largest.get(column.label, 0.0))
    return [
        replace(sheet, columns=tuple(replace(column, largest=largest[column.label]) for column in sheet.columns))
        for sheet in sheets
    ]
