"""National Instruments' TDMS, by nptdms: a sheet for each group.

    t_k = wf_start_offset + k wf_increment

Source: National Instruments, TDMS file format; waveform properties as LabVIEW writes them. Differs from source: texts
and truth values are left out.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..sheet import Column, Sheet, column, time_base
from .base import Format, Source, common_ends, reading, seconds, unreadable, warnings_of

_KIND = "a TDMS file"
_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")
_CLOCK = ("start_offset", "increment")
_LOGGERS = ("nptdms.reader", "nptdms.tdms_segment", "nptdms.base_segment")
_LEAD_IN, _NEXT = struct.Struct("<4sIIQQ"), struct.Struct(">Q")  # head of a segment; its length if it is big-endian
_BIG_ENDIAN, _NEVER_CLOSED = 1 << 6, (1 << 64) - 1


def _read(source: Source) -> list[Sheet]:
    import nptdms

    with (
        reading(source, _KIND),
        # opened as a stream: given a path, nptdms would use an index file next to it, even an outdated one
        source.path.open("rb") as stream,
        warnings_of(*_LOGGERS) as odd,
        nptdms.TdmsFile.open(stream) as file,
    ):
        source.refuse_larger(sum(8 * len(channel) for group in file.groups() for channel in group.channels()))
        cut = _cut(source.path)
        sheets = [sheet for group in file.groups() for sheet in _sheets(source.where, file, group, cut)]
    if odd and not cut:
        raise unreadable(source.where, f"its counts do not fit its data ({odd[0]})", _KIND)
    return sheets


def _cut(path: Path) -> str:
    """A sentence if the file ends within a segment, else ""."""
    at, size = 0, path.stat().st_size
    with path.open("rb") as stream:
        while at < size:
            stream.seek(at)
            head = stream.read(_LEAD_IN.size)
            if len(head) < _LEAD_IN.size:
                return f"it is cut off: its last {len(head)} bytes are the beginning of a segment"
            _, mask, _, length, _ = _LEAD_IN.unpack(head)
            length = _NEXT.unpack_from(head, 12)[0] if mask & _BIG_ENDIAN else length
            if length == _NEVER_CLOSED:
                return "its last segment was never closed: the program that wrote it stopped before"
            at += _LEAD_IN.size + length
    return f"it is cut off: {at - size} bytes of its last segment are missing" if at > size else ""


def _sheets(where: str, file: Any, group: Any, cut: str) -> list[Sheet]:
    """One sheet for the channels of each length and clock."""
    part = group.name if len(file.groups()) > 1 else ""
    by_clock: dict[tuple[float, float], list[Any]] = {}
    odd: dict[str, str] = {}
    for channel in group.channels():
        if channel.dtype.kind in "iufM" and (len(channel) > 1 or cut):
            clock = [float(channel.properties.get(f"wf_{name}", 0.0)) for name in _CLOCK]
            by_clock.setdefault((clock[0], clock[1]), []).append(channel)
        elif channel.dtype.kind in "cV":
            odd[channel.name] = str(channel.dtype)
    missing = (*filter(None, (cut,)), *(f"'{name}' cannot be read: its type is {kind}" for name, kind in odd.items()))
    lost = (file.file_status.channel_statuses or {}) if cut else {}
    out = []
    for (first, step), channels in by_clock.items():
        found = [len(each) for each in channels]
        said = [_said(each, lost) for each in channels]
        ends, lacking = common_ends([each.name for each in channels], found, said)
        together: dict[int, list[Column]] = {}
        for channel, kept in zip(channels, ends, strict=True):
            together.setdefault(kept, []).append(_column(channel, kept))
        for length, columns in together.items():
            several = len(by_clock) > 1 or len(together) > 1
            part_name = " ".join(filter(None, (part, columns[0].name if several else "")))
            time = (time_base(first + step * np.arange(length)),) if step > 0.0 else ()
            out.append(Sheet(where, part_name, (*time, *columns), missing=(*missing, *lacking)))
    return out


def _said(channel: Any, lost: Mapping[str, Any]) -> int:
    """Number of values of the channel according to a file that is cut off; 0 if the file is whole."""
    status = lost.get(channel.path)
    return len(channel) + status.expected_length - status.read_length if status is not None else 0


def _column(channel: Any, kept: int) -> Column:
    values = np.asarray(channel[:kept])
    if values.dtype.kind == "M":
        return column(channel.name, seconds(values), "s")
    unit = next((str(channel.properties[name]) for name in _UNITS if name in channel.properties), "")
    return column(channel.name, values, unit)


FORMAT = Format("TDMS", (".tdms",), _read, "nptdms")
