"""The catalogue of rig effects, mistakes and habits of a rig: one file each, registered here and nowhere else."""

from __future__ import annotations

from .base import DRIVING, OBSERVED, AbstractRigEffect, Logged, Place, number_of
from .channel_drift import ChannelDrift
from .channel_gain import ChannelGain
from .channel_late import ChannelLate
from .channel_offset import ChannelOffset
from .edge_phase import EdgePhase
from .gear_ratio import GearRatio
from .other_rig import OtherRig
from .sensor_end_points import SensorEndPoints
from .series_resistance import SeriesResistance
from .supply_sag import SupplySag
from .time_scale import TimeScale
from .trace_late import TraceLate
from .warm_start import WarmStart

# families; `at` makes the effect of one place
RIG_EFFECTS: tuple[type[AbstractRigEffect], ...] = (
    SeriesResistance,
    ChannelGain,
    ChannelOffset,
    ChannelDrift,
    TimeScale,
    GearRatio,
    SensorEndPoints,
    EdgePhase,
    ChannelLate,
    TraceLate,
    SupplySag,
    WarmStart,
    OtherRig,
)
FAMILY_BY_KIND: dict[str, type[AbstractRigEffect]] = {family.kind: family for family in RIG_EFFECTS}


def at_places(logged: Logged, traces: Logged | None = None) -> tuple[type[AbstractRigEffect], ...]:
    """Every rig effect that a rig could show whose tests, and whose single traces, logged these channels."""
    files = traces or {}
    return tuple(family.at(p) for family in RIG_EFFECTS for p in (*family.places(logged), *family.in_traces(files)))


def rig_effect(name: str) -> type[AbstractRigEffect] | None:
    """The effect that rig.toml calls `kind[place]` (see `Place`) or `kind`; None where none has that name."""
    kind, _, rest = name.partition("[")
    family = FAMILY_BY_KIND.get(kind)
    if family is None:
        return None
    found = family.at(Place.named(rest.removesuffix("]")))
    return found if found.name == name else None


__all__ = [
    "DRIVING",
    "FAMILY_BY_KIND",
    "OBSERVED",
    "RIG_EFFECTS",
    "AbstractRigEffect",
    "ChannelDrift",
    "ChannelGain",
    "ChannelLate",
    "ChannelOffset",
    "EdgePhase",
    "GearRatio",
    "Logged",
    "OtherRig",
    "Place",
    "SeriesResistance",
    "SupplySag",
    "TimeScale",
    "TraceLate",
    "WarmStart",
    "at_places",
    "number_of",
    "rig_effect",
]
