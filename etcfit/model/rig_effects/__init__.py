"""The catalogue of rig effects, mistakes and habits of a rig: one file a family, registered here and nowhere else."""

from __future__ import annotations

from .base import DRIVING, OBSERVED, AbstractRigEffect, Logged, Place, number_of
from .body import GearRatio, OtherRig, SensorEndPoints
from .channels import ChannelDrift, ChannelGain, ChannelOffset
from .circuit import SeriesResistance, SupplySag, WarmStart
from .clocks import ChannelLate, EdgePhase, TimeScale, TraceLate

# families of effects; `at` makes the effect of one place
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
    """Every rig effect that could show in a rig with these channels, by test and by single trace."""
    files = traces or {}
    return tuple(family.at(p) for family in RIG_EFFECTS for p in (*family.places(logged), *family.in_traces(files)))


def rig_effect(name: str) -> type[AbstractRigEffect] | None:
    """The effect with the name `kind[place]` (see `Place`) or `kind` in rig.toml; None if there is none."""
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
