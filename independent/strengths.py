"""Three strengths of each effect: just visible in a folder of size "twin", as on a real throttle body, and obvious.

"Just visible" is a rise of chi2 by some hundreds after a refit of Eqs. 1-2. What shows depends on the body too, and on
where its plate goes. Backlash shows only where the load of the gear changes sign: as the plate lands on a stop and the
motor flies on, whatever the gap, and under a hard reversal; a bounce only after an impact. Dry friction told apart by
direction is a preload until something viscous goes with it. A limp-home spring is never faint: the plate rests
elsewhere.
"""

from __future__ import annotations

import math

from . import effects as of
from .effects import Effects

COPPER = 0.0039  # 1/K


def _cogging(amplitude: float) -> of.CoggingTorque:
    return of.CoggingTorque(amplitude, per_turn=6.0, phase=0.7, second=0.1, uneven=0.1)


def _heating(capacity: float, conductance: float) -> of.WindingHeating:
    return of.WindingHeating(COPPER, capacity, conductance, housing_capacity=60.0, housing_conductance=0.3)


def _limp(degrees: float, stiffness: float, preload: float, corner: float) -> of.LimpHomeSpring:
    return of.LimpHomeSpring(math.radians(degrees), stiffness, preload, corner)


# name -> (low, medium, high)
_LISTED: dict[str, tuple] = {
    "limp_home_spring": (_limp(0.1, 0.5, 0.05, 0.001), _limp(9.0, 0.9, 0.33, 0.008), _limp(14.0, 1.5, 0.45, 0.012)),
    "stribeck_friction": tuple(of.StribeckFriction(*s) for s in ((0.0015, 0.5), (0.06, 0.5), (0.10, 0.8))),
    "load_dependent_friction": tuple(of.LoadDependentFriction(share) for share in (0.004, 0.12, 0.25)),
    "cogging_torque": tuple(_cogging(amplitude) for amplitude in (0.001, 0.02, 0.05)),
    "winding_heating": tuple(_heating(*s) for s in ((30.0, 0.6), (3.0, 0.15), (1.0, 0.05))),
    "brush_voltage_drop": tuple(of.BrushVoltageDrop(volts) for volts in (0.004, 0.25, 0.7)),
    "driver_dead_zone": tuple(of.DriverDeadZone(volts) for volts in (0.003, 0.2, 0.6)),
    "actuation_delay": tuple(of.ActuationDelay(delay) for delay in (0.12e-3, 1e-3, 4e-3)),
    "torque_saturation": tuple(of.TorqueSaturation(limit) for limit in (8.0, 2.5, 1.5)),
    "asymmetric_friction": tuple(
        of.AsymmetricFriction(dry, -dry, viscous, -viscous)
        for dry, viscous in ((0.002, 0.0001), (0.015, 0.001), (0.03, 0.003))
    ),
    "motor_coulomb_friction": tuple(of.MotorCoulombFriction(torque) for torque in (8e-5, 1e-3, 3e-3)),
    "presliding_friction": tuple(of.PreslidingFriction(angle) for angle in (0.0002, 0.006, 0.02)),
    "backlash": tuple(of.Backlash(math.radians(gap)) for gap in (0.02, 0.5, 1.5)),
    "quadratic_drag": tuple(of.QuadraticDrag(drag) for drag in (2e-5, 2e-4, 6e-4)),
    "airflow_torque": tuple(of.AirflowTorque(peak) for peak in (0.0005, 0.03, 0.08)),
    "stop_bounce": tuple(of.StopBounce(restitution) for restitution in (0.05, 0.25, 0.5)),
    "gravity_load": tuple(of.GravityLoad(torque) for torque in (0.002, 0.03, 0.08)),
    "position_sensor_lag": tuple(of.PositionSensorLag(time) for time in (0.1e-3, 4e-3, 15e-3)),
    "position_sensor_nonlinearity": tuple(
        of.PositionSensorNonlinearity(*bends) for bends in ((0.0008, 0.0004), (0.012, 0.006), (0.04, 0.02))
    ),
    "current_sensor_offset": tuple(of.CurrentSensorOffset(amps) for amps in (0.0015, 0.02, 0.08)),
    "channel_delay": tuple(of.ChannelDelay(time) for time in (0.2e-3, 0.6e-3, 2e-3)),
    "friction_spot": tuple(of.FrictionSpot(torque) for torque in (0.0015, 0.06, 0.15)),
    "stiffening_spring": tuple(of.StiffeningSpring(torque) for torque in (0.0018, 0.05, 0.15)),
    "current_limit": tuple(of.CurrentLimit(amps) for amps in (5.0, 3.5, 2.0)),
    "sensor_dead_spot": tuple(of.SensorDeadSpot(width=width) for width in (0.005, 0.04, 0.12)),
    "friction_drift": tuple(of.FrictionDrift(*rates) for rates in ((1e-4, 1e-5), (1.5e-3, 2e-4), (4e-3, 6e-4))),
    "friction_tide": tuple(of.FrictionTide(torque) for torque in (0.0015, 0.03, 0.08)),
    "torque_ripple": tuple(of.TorqueRipple(share) for share in (0.003, 0.06, 0.15)),
    "supply_cycling": tuple(of.SupplyCycling(share) for share in (0.002, 0.04, 0.12)),
    "sensor_hysteresis": tuple(of.SensorHysteresis(play) for play in (0.0005, 0.008, 0.025)),
}

STRENGTHS: dict[str, tuple[Effects, Effects, Effects]] = {
    name: (Effects(**{name: low}), Effects(**{name: medium}), Effects(**{name: high}))
    for name, (low, medium, high) in _LISTED.items()
}

MEDIUM: dict[str, Effects] = {name: medium for name, (_, medium, _) in STRENGTHS.items()}
