"""What the records tell of the rig's own mistakes before any fit; a newcomer adds one file here and its class below."""

from __future__ import annotations

from collections.abc import Iterable

from ...errors import MeasurementError
from ..base import Measurement, RigConfig
from ..finding import Finding
from .base import AbstractDetector, Records
from .channel_offset import ChannelOffset
from .channel_sign import ChannelSign
from .coasting_bridge import CoastingBridge
from .gear_ratio import GearRatio
from .hum import Hum
from .lost_samples import LostSamples
from .saturation import Saturation
from .series_resistance import SeriesResistance
from .slow_current import SlowCurrent
from .slow_log import SlowLog
from .supply_current import SupplyCurrent
from .swapped_columns import SwappedColumns
from .switched_voltage import SwitchedVoltage
from .synchronous_edges import SynchronousEdges
from .time_scale import TimeScale
from .unit_scale import UnitScale
from .unsigned_current import UnsignedCurrent

# the one registration; what stands first explains what a later one would find in the same test
DETECTORS: tuple[AbstractDetector, ...] = tuple(
    detector()
    for detector in (
        SwitchedVoltage,
        SupplyCurrent,
        UnsignedCurrent,
        SlowCurrent,
        SwappedColumns,
        ChannelSign,
        UnitScale,
        ChannelOffset,
        Saturation,
        GearRatio,
        TimeScale,
        SeriesResistance,
        LostSamples,
        Hum,
        SlowLog,
        CoastingBridge,
        SynchronousEdges,
    )
)


def refuse(folder: str, found: Iterable[Finding]) -> None:
    """Refuse data that physics rules out.

    Args:
        folder: what the message calls the rig.
        found: of its records.

    Raises:
        MeasurementError: naming the first such find, and how many more there are.
    """
    sure = [finding for finding in found if finding.sure]
    if sure:
        first, more = sure[0], f" ({len(sure) - 1} more like it.)" if len(sure) > 1 else ""
        place = first.file or first.test
        raise MeasurementError(f"{folder}/{place}" if place else folder, f"{first.kind}: {first.found}{more}",
                               "No motor does this, so no fit takes it.", first.mend)  # fmt: skip


def findings(
    config: RigConfig, traces: Iterable[Measurement], detectors: Iterable[AbstractDetector] = DETECTORS
) -> tuple[Finding, ...]:
    """What every detector finds in these traces, held out ones too.

    Args:
        config: rig.toml.
        traces: as read.
        detectors: which; each with its own thresholds.
    """
    records, out = Records(config, tuple(traces)), []
    for detector in detectors:
        found = tuple(detector.find(records))
        records = records.without(_blamed(found, records)) if detector.explains else records
        out += found
    return tuple(out)


def _blamed(found: Iterable[Finding], records: Records) -> set[str]:
    """Tests whose circuit is read wrong: those named, or, of what lies in every test, those that logged the channel."""
    everywhere = {f.channel for f in found if f.test is None}
    having = {trace.test for trace in records.traces if everywhere & {*trace.channels}}
    return having | {f.test for f in found if f.test is not None}
