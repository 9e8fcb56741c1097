"""The catalogue of effects: one file each, registered here and nowhere else."""

from __future__ import annotations

from .actuation_delay import ActuationDelay
from .airflow_torque import AirflowTorque
from .armature import Armature
from .asymmetric_friction import AsymmetricFriction
from .backlash import Backlash
from .base import AbstractComputer, AbstractEffect, Besides, Contribution, Inputs, State, fraction, total
from .brush_voltage_drop import BrushVoltageDrop
from .channel_delay import ChannelDelay
from .coasting_bridge import CoastingBridge
from .cogging_torque import CoggingTorque
from .controller import Controller
from .coulomb_friction import CoulombFriction
from .current_sensor_offset import CurrentSensorOffset
from .driver_dead_zone import DriverDeadZone
from .end_stops import EndStops
from .gravity_load import GravityLoad
from .inertia import Inertia
from .limp_home_spring import LimpHomeSpring
from .load_dependent_friction import LoadDependentFriction
from .motor_coulomb_friction import MotorCoulombFriction
from .position_sensor_lag import PositionSensorLag
from .position_sensor_nonlinearity import PositionSensorNonlinearity
from .presliding_friction import PreslidingFriction
from .quadratic_drag import QuadraticDrag
from .return_spring import ReturnSpring
from .stiffening_spring import StiffeningSpring
from .stop_bounce import StopBounce
from .stribeck_friction import StribeckFriction
from .torque_saturation import TorqueSaturation
from .viscous_friction import ViscousFriction
from .winding_heating import WindingHeating

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

# what drives the throttle in traces that log a setpoint and no voltage, where rig.toml has [ecu]; no candidate
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
