"""Resistance test: plate held, constant voltages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import numpy as np

from .base import AbstractRigTest, Boundary, Graph, Measurement, Reading, RigConfig
from .signals import Line, drive_voltage, plateaus, robust_line


def slope(voltage: np.ndarray, current: np.ndarray) -> Line:
    """i = v/R_a + offset; the offset is that of the current sensor (A), the slope in 1/ohm (Fig. 11)."""
    return robust_line(np.asarray(voltage, dtype=float), np.asarray(current, dtype=float))


def steady_points(trace: Measurement, config: RigConfig) -> list[tuple[float, float]]:
    """Settled voltage and current of every plateau, V and A."""
    voltage, current = drive_voltage(trace, config), trace.channels.get("current")
    if voltage is None or current is None:
        return []
    return [(p.settled(voltage), p.settled(current)) for p in plateaus(voltage)]


@final
class Resistance(AbstractRigTest):
    """The steady current of a held plate over voltage has slope 1/R_a."""

    name = "resistance"
    title = "Motor resistance test"
    boundary = Boundary(plate_held=True)
    drives = ("voltage", "duty")
    observes = ("current",)
    needs = (("voltage", "duty"), ("current",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """R_a = 1/slope of i over v (paper, Fig. 11); a series resistance given in rig.toml is taken off."""
        points = np.array([p for trace in traces for p in steady_points(trace, config)]).reshape(-1, 2)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points) or not np.any(points[:, 0]):
            return Reading({}, notes=("R_a cannot be read: no plateau of voltage with a current",))
        line = slope(points[:, 0], points[:, 1])
        if line.slope <= 0:
            return Reading({}, notes=(f"R_a cannot be read: current over voltage has slope {line.slope:.3g} A/V",))
        total, series = 1 / line.slope, config.series_ohm.get(self.name, 0.0)
        notes = [f"current at zero voltage {line.offset:.3g} A"]
        if series is None:
            notes.append("the series resistance of this test is free, so R_a read here contains it")
        R_a = total - (series or 0.0)
        ends = np.array([min(0.0, points[:, 0].min()), points[:, 0].max()])
        graph = Graph(self.title, "voltage [V]", "steady current [A]", points[:, 0], points[:, 1], ends, line.at(ends),
                      f"slope {line.slope:.4g} A/V: R_a = {R_a:.4g} ohm")  # fmt: skip
        return Reading({"R_a": R_a}, (graph,), tuple(notes))
