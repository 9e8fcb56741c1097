"""Finds mistakes of the rig in its records before any fit; a new detector is one function and its line below.

A detector is a function from `Records` to findings; its name is the kind of mistake that it finds. Its thresholds are
constants at the top of its file.
"""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import MeasurementError
from ..base import Finding, Measurement, RigConfig
from .base import Detector, Records
from .bridge import coasting_bridge, supply_current, switched_voltage, unsigned_current
from .clock import hum, lost_samples, time_scale
from .constants import gear_ratio, series_resistance, unit_scale
from .edges import synchronous_edges
from .lags import slow_current, slow_log
from .levels import channel_offset, saturation
from .signs import channel_sign, swapped_columns

# the registry of detectors; a finding of an earlier one explains what a later one would find in the same test
EXPLAIN = (
    *(switched_voltage, supply_current, unsigned_current, slow_current, swapped_columns, channel_sign),
    *(unit_scale, channel_offset, saturation),
)
REST = (gear_ratio, time_scale, series_resistance, lost_samples, hum, slow_log, coasting_bridge, synchronous_edges)
DETECTORS: tuple[Detector, ...] = (*(Detector(find, True) for find in EXPLAIN), *(Detector(find) for find in REST))


def refuse(folder: str, found: Iterable[Finding]) -> None:
    """Refuse data that physics excludes.

    Raises:
        MeasurementError: names the first such finding, and the number of further ones.
    """
    sure = [finding for finding in found if finding.sure]
    if sure:
        first, more = sure[0], f" ({len(sure) - 1} more like it.)" if len(sure) > 1 else ""
        place = first.file or first.test
        raise MeasurementError(f"{folder}/{place}" if place else folder, f"{first.kind}: {first.found}{more}",
                               "No motor can do this, so these data cannot be fitted.", first.mend)  # fmt: skip


def findings(config: RigConfig, traces: Iterable[Measurement]) -> tuple[Finding, ...]:
    """The findings of every detector in these traces, including held-out ones.

    A finding of a detector that `explains` makes the circuit of its test wrong for later detectors: that of the test
    that it names or, where it names none, of all tests that logged its channel.
    """
    records, out = Records(config, tuple(traces)), []
    for detector in DETECTORS:
        found = tuple(detector.find(records))
        out += found
        if detector.explains:
            channels = {f.channel for f in found if f.test is None}
            having = {trace.test for trace in records.traces if channels & {*trace.channels}}
            records = records.without(having | {f.test for f in found if f.test is not None})
    return tuple(out)
