"""National Instruments' TDMS, by nptdms: a sheet for each group.

    t_k = wf_start_offset + k wf_increment

Source: National Instruments, TDMS file format; waveform properties as LabVIEW writes them. Differs from source: no.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import Format, Source, unreadable

_KIND = "a TDMS file"
_UNITS = ("unit_string", "NI_UnitDescription", "Unit", "unit")


def _read(source: Source) -> list[Sheet]:
    import nptdms

    try:
        file = nptdms.TdmsFile.read(source.path)
    except Exception as err:  # whatever its parser makes of bytes that are no such file
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    groups = file.groups()
    return [sheet for group in groups for sheet in _sheets(source.where, group.name if len(groups) > 1 else "", group)]


def _sheets(where: str, part: str, group: Any) -> list[Sheet]:
    """Channels of one length and one clock belong together."""
    together: dict[tuple[int, float, float], list[Column]] = {}
    for channel in group.channels():
        values = np.asarray(channel[:])
        if values.dtype.kind in "iuf" and values.size > 1:
            start, step = (float(channel.properties.get(f"wf_{name}", 0.0)) for name in _CLOCK)
            unit = next((str(channel.properties[name]) for name in _UNITS if name in channel.properties), "")
            together.setdefault((values.size, start, step), []).append(column(channel.name, values, unit))
    out = []
    for (length, first, step), columns in together.items():
        told = " ".join(filter(None, (part, columns[0].name if len(together) > 1 else "")))
        time = (time_base(first + step * np.arange(length)),) if step > 0.0 else ()
        out.append(Sheet(where, told, (*time, *columns)))
    return out


_CLOCK = ("start_offset", "increment")
FORMAT = Format("TDMS", (".tdms",), _read, "nptdms")
