"""Static load test: a slow voltage ramp up and down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from .base import DRIVES, AbstractRigTest, Boundary, Graph, Measurement, Reading, RigConfig
from .signals import motion, off_stops, robust_fit


def halves(opening_torque: float, closing_torque: float) -> tuple[float, float]:
    """T_PL, T_f from the torques at the knee, N m: T_PL + T_f opening, T_PL - T_f closing (Eq. 5)."""
    return (opening_torque + closing_torque) / 2, (opening_torque - closing_torque) / 2


def stiffness(torque_rise: float, angle_from: float, angle_to: float) -> float:
    """K_s: torque rise over angle along one branch, N m/rad (Fig. 14)."""
    return torque_rise / (angle_to - angle_from)


def branches(trace: Measurement, config: RigConfig, known: Mapping[str, float]) -> np.ndarray:
    """Rows (angle, torque, direction) where the plate moves: rad, N m at the plate, +1 opening or -1 closing.

    Moving: the slope of the position over 2 % of the trace, above a tenth of its own upper level, off both stops.
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
    """Motor torque over angle, opening and closing: the hysteresis is 2 T_f wide, its middle is the spring."""

    name = "static_load"
    title = "Static load test"
    boundary = Boundary()
    drives = DRIVES
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
        notes = () if T_f > 0 else (f"T_f read as {T_f:.3g} N m: no hysteresis",)
        ends = np.array([angle.min(), angle.max()])
        graphs = tuple(
            Graph(f"{self.title}, {name}", "plate angle [rad]", "motor torque at the plate [N m]", angle[way * s > 0],
                  torque[way * s > 0], ends, K_s * ends + T_PL + s * T_f,
                  f"K_s = {K_s:.4g} N m/rad, T_PL {'+' if s > 0 else '-'} T_f = {T_PL + s * T_f:.4g} N m")
            for name, s in (("opening", 1), ("closing", -1))
        )  # fmt: skip
        return Reading(values, graphs, notes)
