"""ASAM MDF (.mf4, .mdf), by asammdf; the frames of a bus log are decoded by a DBC given beside it.

Groups that were sampled at their own rates become one sheet: every instant of any of them a row, gaps elsewhere.

Source: ASAM MDF 4.2, as asammdf reads it. Differs from source: texts and arrays are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import MeasurementError
from ..labels import column
from ..sheet import Column, Sheet, time_base
from .base import Format, Source, unreadable

_KIND = "a measurement file of ASAM MDF"
_TICK = 6  # decimals of a second: instants nearer than a microsecond are one


def _read(source: Source) -> list[Sheet]:
    import asammdf

    try:
        mdf = asammdf.MDF(source.path)
    except Exception as err:  # its parser raises whatever it meets in a damaged file
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    with mdf:
        signals = _signals(mdf)
        if source.buses:
            databases: Any = {"CAN": [(str(path), 0) for path in source.buses]}
            with mdf.extract_bus_logging(databases) as decoded:
                signals = [*_decoded_only(signals), *_signals(decoded)]
    if signals and not _decoded_only(signals):
        raise MeasurementError(source.where, "a bus log: frames, and nothing that says what they mean.",
                               "Signals are required, or the DBC that decodes them.",
                               "Name the .dbc among the files.")  # fmt: skip
    together = _united(signals)
    return [] if together is None else [Sheet(source.where, "", together)]


def _signals(mdf: Any) -> list[Any]:
    """Numbers over time, of every group."""
    found = []
    for group, _ in enumerate(mdf.groups):
        if not mdf.groups[group].channel_group.cycles_nr:
            continue
        for index, _ in enumerate(mdf.groups[group].channels):
            if index == mdf.masters_db.get(group):
                continue
            signal = mdf.get(group=group, index=index)
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iuf" and len(signal.timestamps):
                found.append(signal)
    return found


def _decoded_only(signals: list[Any]) -> list[Any]:
    """Without the raw parts of the frames, whose numbers mean nothing."""
    return [signal for signal in signals if not signal.name.startswith(("CAN_", "LIN_"))]


def _united(signals: list[Any]) -> tuple[Column, ...] | None:
    if not signals:
        return None
    instants = [np.round(np.asarray(signal.timestamps, dtype=float), _TICK) for signal in signals]
    time = np.unique(np.concatenate(instants))
    columns = []
    for signal, own in zip(signals, instants, strict=True):
        values = np.full(time.size, np.nan)
        values[np.searchsorted(time, own)] = signal.samples
        columns.append(column(signal.name, values, signal.unit))
    return (time_base(time), *columns)


FORMAT = Format("MDF", (".mf4", ".mdf"), _read, "asammdf")
