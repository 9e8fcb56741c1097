"""The catalogue of effects: one file each, registered here and nowhere else."""

from __future__ import annotations

from .armature import Armature
from .base import AbstractEffect, Contribution, Inputs, State, total
from .coulomb_friction import CoulombFriction
from .end_stops import EndStops
from .gravity_load import GravityLoad
from .inertia import Inertia
from .return_spring import ReturnSpring
from .viscous_friction import ViscousFriction

# Eqs. 1-2 of the paper: always there
PAPER: tuple[type[AbstractEffect], ...] = (
    Armature,
    Inertia,
    ViscousFriction,
    ReturnSpring,
    CoulombFriction,
    EndStops,
)

# every known effect; those beyond the paper have an off value
EFFECTS: tuple[type[AbstractEffect], ...] = (*PAPER, GravityLoad)

EFFECT_BY_NAME: dict[str, type[AbstractEffect]] = {effect.name: effect for effect in EFFECTS}

__all__ = [
    "EFFECTS",
    "EFFECT_BY_NAME",
    "PAPER",
    "AbstractEffect",
    "Contribution",
    "Inputs",
    "State",
    "total",
]
