"""The catalogue of rig effects, mistakes and habits of a rig: one file each, registered here and nowhere else."""

from __future__ import annotations

from .base import AbstractRigEffect, Logged, Place, number_of
from .channel_drift import ChannelDrift
from .channel_gain import ChannelGain
from .channel_offset import ChannelOffset
from .edge_phase import EdgePhase
from .gear_ratio import GearRatio
from .sensor_end_points import SensorEndPoints
from .series_resistance import SeriesResistance
from .time_scale import TimeScale

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
)
FAMILY_BY_KIND: dict[str, type[AbstractRigEffect]] = {family.kind: family for family in RIG_EFFECTS}


def at_places(logged: Logged) -> tuple[type[AbstractRigEffect], ...]:
    """Every rig effect that a rig could show whose tests logged these channels."""
    return tuple(family.at(place) for family in RIG_EFFECTS for place in family.places(logged))


def rig_effect(name: str) -> type[AbstractRigEffect] | None:
    """The effect that rig.toml calls `kind[test.channel]`; None where no family has that kind."""
    kind, _, rest = name.partition("[")
    family = FAMILY_BY_KIND.get(kind)
    if family is None or (rest and not rest.endswith("]")):
        return None
    return family.at(Place(*rest.removesuffix("]").split(".", 1)) if rest else Place())


__all__ = [
    "FAMILY_BY_KIND",
    "RIG_EFFECTS",
    "AbstractRigEffect",
    "ChannelDrift",
    "ChannelGain",
    "ChannelOffset",
    "EdgePhase",
    "GearRatio",
    "Logged",
    "Place",
    "SeriesResistance",
    "TimeScale",
    "at_places",
    "number_of",
    "rig_effect",
]
