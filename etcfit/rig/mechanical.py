"""The paper's rig tests of mechanical parameters: viscous friction of the motor alone, static load, moment of
inertia."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import final

import numpy as np

from .base import DRIVES, AbstractRigTest, Boundary, Graph, Measurement, Reading, RigConfig
from .electrical import emf_of
from .signals import (
    Motion,
    drive_voltage,
    mean_delay,
    motion,
    off_stops,
    on_times,
    plateaus,
    robust_fit,
    robust_line,
    runs,
    settled_points,
    smoothing_window,
)

LOWEST_SHARE = 0.02  # share of J_eq that J_L gets where N^2 J_m alone exceeds J_eq


def viscous_whole(B_m: float, N: float, B_L: float = 0.0) -> float:
    """B_eq = N^2 B_m + B_L, N m s/rad at the plate; the paper neglects B_L."""
    return N**2 * B_m + B_L


def inertia(delay: float, B_m: float, known: Mapping[str, float]) -> float:
    """J_m from the delay of the speed: delay = (J_m R_a + L_a B_m)/(K_m K_b + R_a B_m), kg m2.

    The delay is the sum of both time constants of Eqs. 1-2; L_a B_m is about 1 % of it and neglected.
    """
    return delay * (known["K_m"] * known["K_b"] + known["R_a"] * B_m) / known["R_a"]


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
    """The motor alone, gear apart, voltage steps: at steady speed K_m i_a = B_m omega_m."""

    name = "viscous"
    title = "Viscous frictional coefficient test"
    boundary = Boundary(gear_apart=True)
    observes = ("current", "motor_speed")
    needs = (("voltage", "duty"), ("current",), ("motor_speed",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """B_m: slope of T_m = B_m omega_m + offset (Eq. 6, Fig. 15); J_m: delay of the speed after a step."""
        if "K_m" not in known:
            return Reading({}, notes=("B_m cannot be read: K_m is not known",))
        logged = [(drive_voltage(t, config), t.channels.get("motor_speed"), t.channels.get("current")) for t in traces]
        points = settled_points((drive or current, speed, current) for drive, speed, current in logged)
        if not len(points) or not np.any(points[:, 0]):
            return Reading({}, notes=("B_m cannot be read: there is no plateau with a steady motor speed",))
        speed, torque = points[:, 0], known["K_m"] * points[:, 1]
        line = robust_line(speed, torque)
        values, notes = {}, [f"motor torque at zero speed {line.offset:.3g} N m"]
        if line.slope > 0:
            values = {"B_m": line.slope, "B_L": 0.0, "B_eq": viscous_whole(line.slope, known["N"])}
            notes.append("B_L: the paper neglects it, 0")
        else:
            notes.append(f"B_m cannot be read: torque over speed has slope {line.slope:.3g} N m s/rad")
        times = [t for trace in traces for t in delays(trace, config)]
        if times and {"R_a", "K_b"} <= set(known):
            values["J_m"] = inertia(float(np.median(times)), values.get("B_m", 0.0), known)
            notes.append(f"the speed follows the voltage after {1e3 * float(np.median(times)):.4g} ms")
        ends = np.array([min(0.0, speed.min()), speed.max()])
        graph = Graph(self.title, "motor speed [rad/s]", "motor torque [N m]", speed, torque, ends, line.at(ends),
                      f"slope: B_m = {line.slope:.3g} N m s/rad")  # fmt: skip
        return Reading(values, (graph,), tuple(notes))


def branches(trace: Measurement, config: RigConfig, known: Mapping[str, float]) -> np.ndarray:
    """Rows (angle, torque, direction) where the plate moves: rad, N m at the plate, +1 opening or -1 closing.

    Moving: the slope of the position over 2 % of the trace is above a tenth of its upper level, off both stops.
    """
    position, push = trace.channels.get("position"), trace.channels.get("torque", trace.channels.get("current"))
    moved = None if position is None else motion(position, 0.02 * float(position.time[-1] - position.time[0]))
    if position is None or push is None or moved is None:
        return np.empty((0, 3))
    pace = np.abs(moved.speed)
    moving = off_stops(moved.angle, config, position.sigma) & (pace > 0.1 * np.quantile(pace, 0.95))
    torque = moved.smooth(push) * (1.0 if "torque" in trace.channels else known["N"] * known["K_m"])
    return np.column_stack([moved.angle, torque, np.sign(moved.speed)])[moving]


@final
class StaticLoad(AbstractRigTest):
    """A slow voltage ramp up and down: torque over angle has a hysteresis 2 T_f wide with the spring in its middle."""

    name = "static_load"
    title = "Static load test"
    boundary = Boundary()
    observes = ("current", "position", "motor_speed", "emf")
    needs = (DRIVES, ("position",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """Parallel lines T = K_s theta + T_PL +- T_f through the two branches (Eq. 5, Fig. 14)."""
        if "K_m" not in known and not all("torque" in trace.channels for trace in traces):
            return Reading({}, notes=("K_s, T_PL and T_f cannot be read: K_m is not known",))
        rows = np.concatenate([np.empty((0, 3)), *(branches(trace, config, known) for trace in traces)])
        angle, torque, way = rows.T
        if min(np.sum(way > 0), np.sum(way < 0)) < 5:
            return Reading({}, notes=("K_s, T_PL and T_f cannot be read: no slow opening and closing",))
        K_s, T_PL, T_f = (float(c) for c in robust_fit(np.column_stack([angle, np.ones_like(angle), way]), torque))
        values = {"K_s": K_s, "T_PL": T_PL, "T_f": max(T_f, 1e-6)}
        notes = () if T_f > 0 else (f"T_f reads {T_f:.3g} N m: there is no hysteresis",)
        ends = np.array([angle.min(), angle.max()])
        graphs = tuple(
            Graph(f"{self.title}, {name}", "plate angle [rad]", "motor torque at the plate [N m]", angle[way * s > 0],
                  torque[way * s > 0], ends, K_s * ends + T_PL + s * T_f,
                  f"K_s = {K_s:.4g} N m/rad, T_PL {'+' if s > 0 else '-'} T_f = {T_PL + s * T_f:.4g} N m")
            for name, s in (("opening", 1), ("closing", -1))
        )  # fmt: skip
        return Reading(values, graphs, notes)


def load_torque(angle: np.ndarray, speed: np.ndarray, B_eq: float, known: Mapping[str, float]) -> np.ndarray:
    """Torque that opposes the motion, N m: B_eq w + K_s theta + T_PL + T_f sgn(w).

    Source: Eq. 7. Differs from source: friction there is + T_f, which would accelerate a closing plate.
    """
    return B_eq * speed + known["K_s"] * angle + known["T_PL"] + known["T_f"] * np.sign(speed)


def fall(moved: Motion, speed: np.ndarray, config: RigConfig, sigma: float) -> slice:
    """The fall from a tenth of the top closing speed to the stop or the top speed, whichever comes first."""
    free = off_stops(moved.angle, config, sigma)
    falling = slice(*max(runs(free & (speed < 0.1 * speed.min())), key=lambda run: run[1] - run[0], default=(0, 0)))
    if falling.stop - falling.start < 3:
        return falling
    top = falling.start + int(np.argmin(speed[falling]))
    # where a plate reaches the stop at speed, the slope within half a smoothing window of it includes rest
    inside = falling.stop - moved.window // 2
    stop = min(falling.stop, max(inside, falling.start + 3))
    return slice(falling.start, stop if top >= inside else max(min(stop, top + 1), falling.start + 3))


@final
class Inertia(AbstractRigTest):
    """Terminals open, plate released from open: the return spring's torque over the acceleration is J_eq."""

    name = "inertia"
    title = "Moment of inertia test"
    boundary = Boundary(terminals_open=True, released=True)
    observes = ("emf", "position")
    needs = (("position", "emf", "voltage"),)

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """J_eq (Eq. 7, with the sign of friction corrected), averaged over the fall: impulse of the load over speed."""
        missing = [s for s in ("K_s", "T_PL", "T_f") if s not in known]
        if missing:
            return Reading({}, notes=(f"J_eq cannot be read: {', '.join(missing)} not known",))
        graphs = [g for trace in traces if (g := self._graph(trace, config, known)) is not None]
        if not graphs:
            return Reading({}, notes=("J_eq cannot be read: no free fall of the plate",))
        # the slope of each fall is weighted by its gain of speed
        gained = np.array([np.ptp(g.line_x) for g in graphs])
        slopes = np.array([np.ptp(g.line_y) / np.ptp(g.line_x) for g in graphs])
        J_eq = float(np.sum(slopes * gained**2) / np.sum(gained**2))
        if "J_m" not in known:
            return Reading({"J_eq": J_eq}, tuple(graphs),
                           ("J_L cannot be read: J_m is not known; J_eq = N^2 J_m + J_L is",))  # fmt: skip
        J_L, floor = J_eq - known["N"] ** 2 * known["J_m"], LOWEST_SHARE * J_eq
        heavy = f"J_L = J_eq - N^2 J_m = {J_L:.3g} kg m2; it is set to {floor:.3g}, because J_m alone explains J_eq"
        return Reading({"J_eq": J_eq, "J_L": max(J_L, floor)}, tuple(graphs), () if floor <= J_L else (heavy,))

    def _graph(self, trace: Measurement, config: RigConfig, known: Mapping[str, float]) -> Graph | None:
        """-integral of load dt over speed for one fall; its slope is J_eq."""
        position, emf = trace.channels.get("position"), emf_of(trace)
        moved = None if position is None else motion(position, smoothing_window(position))
        if position is None or moved is None:
            return None
        speed = moved.speed
        if emf is not None and "K_b" in known:
            back = on_times(emf, moved.time) / (known["N"] * known["K_b"])
            speed = back if float(np.dot(back, moved.speed)) > 0 else -back
        part = fall(moved, moved.speed, config, position.sigma)
        w, angle = speed[part], moved.angle[part]
        if len(w) < 5:
            return None
        B_eq = known["N"] ** 2 * known.get("B_m", 0.0) + known.get("B_L", 0.0)
        load = load_torque(angle, moved.speed[part], B_eq, known)
        impulse = -np.r_[0.0, np.cumsum((load[1:] + load[:-1]) / 2)] * moved.step
        # the impulse is smooth and the speed noisy: regress the speed on the impulse, slope 1/J_eq
        line = robust_line(impulse, w)
        if line.slope <= 0:
            return None
        ends = impulse[[0, -1]]
        return Graph(f"{self.title}, {trace.file}", "plate speed [rad/s]", "impulse of the load torque [N m s]", w,
                     impulse, line.at(ends), ends, f"slope: J_eq = {1 / line.slope:.4g} kg m2")  # fmt: skip
