"""Moment of inertia test: terminals open, plate let go from open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from .back_emf import emf_of
from .base import AbstractRigTest, Boundary, Graph, Measurement, Reading, RigConfig
from .signals import Motion, longest_run, motion, off_stops, on_times, robust_line, smoothing_window

LOWEST_SHARE = 0.02  # of J_eq: where J_L is put when N^2 J_m alone exceeds J_eq


def load_torque(angle: np.ndarray, speed: np.ndarray, B_eq: float, known: Mapping[str, float]) -> np.ndarray:
    """What opposes the motion, N m: B_eq w + K_s theta + T_PL + T_f sgn(w).

    Source: Eq. 7. Differs from source: there friction is + T_f, which would speed a closing plate up.
    """
    return B_eq * speed + known["K_s"] * angle + known["T_PL"] + known["T_f"] * np.sign(speed)


def equivalent(load: float, acceleration: float) -> float:
    """J_eq = -load/acceleration, kg m2 (Eq. 7)."""
    return -load / acceleration


def fall(moved: Motion, speed: np.ndarray, config: RigConfig, sigma: float) -> slice:
    """From a tenth of the top closing speed to the stop or the top speed, whichever comes first."""
    free = off_stops(moved.angle, config, sigma)
    falling = longest_run(free & (speed < 0.1 * speed.min()))
    if falling.stop - falling.start < 3:
        return falling
    top = falling.start + int(np.argmin(speed[falling]))
    # a plate that reaches the stop at speed leaves half a smoothing window of mixed slope behind
    inside = falling.stop - moved.window // 2
    stop = min(falling.stop, max(inside, falling.start + 3))
    return slice(falling.start, stop if top >= inside else max(min(stop, top + 1), falling.start + 3))


@final
class Inertia(AbstractRigTest):
    """The return spring accelerates the free plate; torque over acceleration is J_eq."""

    name = "inertia"
    title = "Moment of inertia test"
    boundary = Boundary(terminals_open=True, released=True)
    drives = ()
    observes = ("emf", "position")
    needs = (("position", "emf", "voltage"),)

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """J_eq (Eq. 7, friction's sign mended), averaged over the fall: impulse of the load against speed gained."""
        missing = [s for s in ("K_s", "T_PL", "T_f") if s not in known]
        if missing:
            return Reading({}, notes=(f"J_eq cannot be read: {', '.join(missing)} not known",))
        graphs = [g for trace in traces if (g := self._graph(trace, config, known)) is not None]
        if not graphs:
            return Reading({}, notes=("J_eq cannot be read: no free fall of the plate",))
        # each fall's slope counts with its speed gained
        gained = np.array([np.ptp(g.line_x) for g in graphs])
        slopes = np.array([np.ptp(g.line_y) / np.ptp(g.line_x) for g in graphs])
        J_eq = float(np.sum(slopes * gained**2) / np.sum(gained**2))
        return Reading(*_split(J_eq, known, tuple(graphs)))

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
        # the impulse is smooth, the speed noisy: regress the speed on it, slope 1/J_eq
        line = robust_line(impulse, w)
        if line.slope <= 0:
            return None
        ends = impulse[[0, -1]]
        return Graph(f"{self.title}, {trace.file}", "plate speed [rad/s]", "impulse of the load torque [N m s]", w,
                     impulse, line.at(ends), ends, f"slope: J_eq = {1 / line.slope:.4g} kg m2")  # fmt: skip


def _split(
    J_eq: float, known: Mapping[str, float], graphs: tuple[Graph, ...]
) -> tuple[dict[str, float], tuple[Graph, ...], tuple[str, ...]]:
    """J_L = J_eq - N^2 J_m, floored."""
    values = {"J_eq": J_eq}
    if "J_m" not in known:
        return values, graphs, ("J_L cannot be read: J_m is not known; J_eq = N^2 J_m + J_L is",)
    J_L = J_eq - known["N"] ** 2 * known["J_m"]
    floor = LOWEST_SHARE * J_eq
    values["J_L"] = max(J_L, floor)
    if floor <= J_L:
        return values, graphs, ()
    return values, graphs, (f"J_L = J_eq - N^2 J_m = {J_L:.3g} kg m2, put at {floor:.3g}: J_m takes it all",)
