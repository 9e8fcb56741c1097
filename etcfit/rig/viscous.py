"""Viscous friction test: the motor alone, gear apart, voltage steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import final

import numpy as np

from .base import AbstractRigTest, Boundary, Graph, Measurement, Reading, RigConfig
from .signals import Line, drive_voltage, mean_delay, plateaus, robust_line


def slope(motor_speed: np.ndarray, motor_torque: np.ndarray) -> Line:
    """T_m = B_m omega_m + offset; slope in N m s/rad (Eq. 6, Fig. 15)."""
    return robust_line(np.asarray(motor_speed, dtype=float), np.asarray(motor_torque, dtype=float))


def equivalent(B_m: float, N: float, B_L: float = 0.0) -> float:
    """B_eq = N^2 B_m + B_L, N m s/rad at the plate; the paper neglects B_L."""
    return N**2 * B_m + B_L


def inertia(delay: float, B_m: float, known: Mapping[str, float]) -> float:
    """J_m from the delay of the speed: delay = (J_m R_a + L_a B_m)/(K_m K_b + R_a B_m), kg m2.

    That is the sum of both time constants of Eqs. 1-2; L_a B_m is some 1 % of it and left out.
    """
    return delay * (known["K_m"] * known["K_b"] + known["R_a"] * B_m) / known["R_a"]


def steady_points(trace: Measurement, config: RigConfig) -> list[tuple[float, float]]:
    """Settled motor speed (rad/s) and current (A) of every plateau of the drive."""
    drive = drive_voltage(trace, config) or trace.channels.get("current")
    speed, current = trace.channels.get("motor_speed"), trace.channels.get("current")
    if drive is None or speed is None or current is None:
        return []
    return [(p.settled(speed), p.settled(current)) for p in plateaus(drive)]


def delays(trace: Measurement, config: RigConfig) -> list[float]:
    """Mean delays of the motor speed after every voltage step, s."""
    drive, speed = drive_voltage(trace, config), trace.channels.get("motor_speed")
    if drive is None or speed is None:
        return []
    found, times = plateaus(drive, least=0.002), []
    for before, after in pairwise(found):
        first, last = before.settled(speed), after.settled(speed)
        if np.isfinite(last - first) and abs(last - first) > 10 * speed.sigma:
            times.append(mean_delay(speed, (before.stop + after.start) / 2, first, last, after.stop))
    return [t for t in times if np.isfinite(t) and t > 0]


@final
class Viscous(AbstractRigTest):
    """The motor alone at steady speed: K_m i_a = B_m omega_m."""

    name = "viscous"
    title = "Viscous frictional coefficient test"
    boundary = Boundary(gear_apart=True)
    drives = ("voltage", "duty")
    observes = ("current", "motor_speed")
    needs = (("voltage", "duty"), ("current",), ("motor_speed",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """B_m: slope of motor torque over motor speed (Eq. 6); J_m: delay of the speed after a step."""
        if "K_m" not in known:
            return Reading({}, notes=("B_m cannot be read: K_m is not known",))
        points = np.array([p for trace in traces for p in steady_points(trace, config)]).reshape(-1, 2)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points) or not np.any(points[:, 0]):
            return Reading({}, notes=("B_m cannot be read: the motor does not turn steadily anywhere",))
        speed, torque = points[:, 0], known["K_m"] * points[:, 1]
        line = slope(speed, torque)
        values, notes = _damping(line, known["N"])
        times = [t for trace in traces for t in delays(trace, config)]
        if times and {"R_a", "K_b"} <= set(known):
            values["J_m"] = inertia(float(np.median(times)), values.get("B_m", 0.0), known)
            notes.append(f"the speed follows the voltage after {1e3 * float(np.median(times)):.4g} ms")
        ends = np.array([min(0.0, speed.min()), speed.max()])
        graph = Graph(self.title, "motor speed [rad/s]", "motor torque [N m]", speed, torque, ends, line.at(ends),
                      f"slope: B_m = {line.slope:.3g} N m s/rad")  # fmt: skip
        return Reading(values, (graph,), tuple(notes))


def _damping(line: Line, N: float) -> tuple[dict[str, float], list[str]]:
    notes = [f"motor torque at zero speed {line.offset:.3g} N m"]
    if line.slope <= 0:
        return {}, [*notes, f"B_m cannot be read: torque over speed has slope {line.slope:.3g} N m s/rad"]
    notes.append("B_L: the paper neglects it, 0")
    return {"B_m": line.slope, "B_L": 0.0, "B_eq": equivalent(line.slope, N)}, notes
