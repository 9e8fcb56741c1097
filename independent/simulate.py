"""A truth, a rig and a voltage in; the exact motion at any instants out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .drives import Drive
from .effects import Effects, at_the_motor
from .kernel import Plant, at_rest, record, run
from .truth import OPEN, Truth

H_MAX = 40e-6  # s, longest step
SETTLING = 6.0  # s that a plate let go from open is given to come to rest
REHEARSAL = 200e-6  # s, longest step where only a protocol hangs on the outcome
NEVER = float("inf")
STIFF = 40e-6  # s, longest step in which teeth, brushes and a driver's limit stay stable
FASTEST = 25.0  # rad/s, about what no plate exceeds
STIFFENING = ("backlash", "brush_voltage_drop", "driver_dead_zone", "current_limit")


@dataclass(frozen=True)
class Motion:
    """What really happened at each instant, SI, shape (n,) each."""

    # time, current, speed, angle, warmth: of the plate and the winding
    time: np.ndarray
    current: np.ndarray
    speed: np.ndarray
    angle: np.ndarray
    warmth: np.ndarray
    voltage: np.ndarray  # that was commanded
    motor_speed: np.ndarray  # at the plate's shaft; the plate's own but for backlash
    sensed: np.ndarray  # angle that the position sensor follows


def throttle(truth: Truth, effects: Effects, series_ohm: float = 0.0) -> Plant:
    """The whole throttle body on a closed circuit."""
    return Plant(
        R=truth.R_a + series_ohm,
        L=truth.L_a,
        closed_circuit=1.0,
        k=truth.N * truth.K_b,
        k_t=truth.N * truth.K_m,
        J=truth.J_eq,
        B=truth.B_eq,
        K_s=truth.K_s,
        T_PL=truth.T_PL,
        T_f=truth.T_f,
        N=truth.N,
        lower=0.0,
        upper=OPEN,
        effects=effects,
        J_m=truth.N**2 * truth.J_m,
        B_m=truth.N**2 * truth.B_m,
    )


def terminals_open(truth: Truth, effects: Effects) -> Plant:
    """The throttle body with nothing on its terminals."""
    return throttle(truth, effects)._replace(closed_circuit=0.0)


def motor_alone(truth: Truth, effects: Effects) -> Plant:
    """The motor with the gear apart, still written at the plate's shaft: no plate, spring, dry friction or stops."""
    bare = throttle(truth, at_the_motor(effects))._replace(K_s=0.0, T_PL=0.0, T_f=0.0, lower=-NEVER, upper=NEVER)
    return bare._replace(J=truth.N**2 * truth.J_m, B=truth.N**2 * truth.B_m)


def simulate(
    plant: Plant, drive: Drive, instants: np.ndarray, *, angle: float, held_until: float = 0.0, h_max: float = H_MAX
) -> Motion:
    """The motion at the instants (s, rising, within the drive), from rest at the angle (rad) without current."""
    if instants[0] < drive.time[0] or instants[-1] > drive.time[-1] or np.any(np.diff(instants) <= 0):
        raise ValueError("the instants must rise and lie within the drive")
    out = run(
        record(plant),
        *_acting(plant, drive),
        instants,
        float(held_until),
        at_rest(plant, float(angle)),
        longest_step(plant, h_max),
    )
    current, speed, theta, warmth, voltage, motor_speed, sensed = out.T
    if "actuation_delay" in plant.effects.on:
        voltage = drive.at(instants)
    return Motion(instants, current, speed, theta, warmth, voltage, motor_speed, sensed)


def longest_step(plant: Plant, h_max: float) -> float:
    """As wished, or as stable: bristles at the fastest speed, and all else that is stiff; s."""
    if set(STIFFENING) & set(plant.effects.on):
        h_max = min(h_max, STIFF)
    if plant.effects.presliding_friction.angle > 0.0:
        h_max = min(h_max, plant.effects.presliding_friction.angle / FASTEST)
    return h_max


def _acting(plant: Plant, drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Knots (s, V) of what reaches the driver's bridge of the voltage commanded."""
    late = plant.effects.actuation_delay
    if late.delay > 0.0:
        drive = drive.delayed(late.delay, late.period).slewed(late.rise)
    return drive.time, drive.volts


def resting_angle(truth: Truth, effects: Effects) -> float:
    """Where the plate rests once let go from open, terminals open: at the closed stop, or near its default; rad."""
    time = np.array([0.0, SETTLING])
    still = Drive(time, np.zeros(2))
    settled = simulate(terminals_open(truth, effects), still, time, angle=OPEN, h_max=REHEARSAL)
    return float(settled.angle[-1])
