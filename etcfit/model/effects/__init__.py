"""The catalogue of effects: one file a family, each effect registered here and nowhere else."""

from __future__ import annotations

from .base import AbstractComputer, AbstractEffect, Besides, Contribution, Inputs, State, fraction, total
from .controller import Controller
from .electrical import (
    ActuationDelay,
    BrushVoltageDrop,
    CoastingBridge,
    DriverDeadZone,
    TorqueSaturation,
    WindingHeating,
)
from .friction import (
    AsymmetricFriction,
    LoadDependentFriction,
    MotorCoulombFriction,
    PreslidingFriction,
    StribeckFriction,
)
from .gear import Backlash, CoggingTorque, StopBounce
from .paper import Armature, CoulombFriction, EndStops, Inertia, ReturnSpring, ViscousFriction
from .sensors import ChannelDelay, CurrentSensorOffset, PositionSensorLag, PositionSensorNonlinearity
from .springs import AirflowTorque, GravityLoad, LimpHomeSpring, QuadraticDrag, StiffeningSpring

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
EFFECTS: tuple[type[AbstractEffect], ...] = (
    *PAPER,
    # electrical
    BrushVoltageDrop,
    WindingHeating,
    DriverDeadZone,
    CoastingBridge,
    ActuationDelay,
    TorqueSaturation,
    # mechanical
    LimpHomeSpring,
    StiffeningSpring,
    StribeckFriction,
    AsymmetricFriction,
    LoadDependentFriction,
    MotorCoulombFriction,
    PreslidingFriction,
    Backlash,
    CoggingTorque,
    QuadraticDrag,
    AirflowTorque,
    StopBounce,
    GravityLoad,
    # sensors
    PositionSensorLag,
    PositionSensorNonlinearity,
    CurrentSensorOffset,
    ChannelDelay,
)

# the input of traces that log a setpoint and no voltage, if rig.toml has [ecu]; not a candidate
COMMANDING: tuple[type[AbstractEffect], ...] = (Controller,)

EFFECT_BY_NAME: dict[str, type[AbstractEffect]] = {effect.name: effect for effect in EFFECTS}

__all__ = [
    "COMMANDING",
    "EFFECTS",
    "EFFECT_BY_NAME",
    "PAPER",
    "AbstractComputer",
    "AbstractEffect",
    "Besides",
    "Contribution",
    "Inputs",
    "State",
    "fraction",
    "total",
]
