"""Inductance test: plate held, voltage step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np

from .base import AbstractRigTest, Boundary, Channel, Graph, Measurement, Reading, RigConfig
from .signals import Plateau, drive_voltage, plateaus, rise_time


@dataclass(frozen=True)
class VoltageStep:
    """One voltage step: its total resistance (ohm), time constant (s), instant and levels (A)."""

    R_t: float
    tau: float
    instant: float
    first: float
    last: float
    stop: float


def resistance(voltage: float, current: float) -> float:
    """R_t = v_a / i_a, ohm: motor, sensor and harness."""
    return voltage / current


def inductance(R_t: float, tau: float) -> float:
    """L_a = R_t tau, H (Eq. 3)."""
    return R_t * tau


def steps(trace: Measurement, config: RigConfig) -> list[VoltageStep]:
    """Every voltage step of a trace.

    The step lies between two samples of the voltage; half way is its best guess. Differences across the step free
    R_t of both sensors' offsets.
    """
    voltage, current = drive_voltage(trace, config), trace.channels.get("current")
    if voltage is None or current is None:
        return []
    found = plateaus(voltage, least=0.002)
    tried = (_step(voltage, current, before, after) for before, after in pairwise(found))
    return [step for step in tried if step is not None]


def _step(voltage: Channel, current: Channel, before: Plateau, after: Plateau) -> VoltageStep | None:
    first, last = before.settled(current), after.settled(current)
    if not np.isfinite(last - first) or abs(last - first) < 5 * current.sigma:
        return None
    instant = (before.stop + after.start) / 2
    tau = rise_time(current, instant, first, last, after.stop)
    R_t = resistance(after.settled(voltage) - before.settled(voltage, 1.0), last - first)
    return VoltageStep(R_t, tau, instant, first, last, after.stop) if tau > 0 and R_t > 0 else None


def profile(trace: Measurement, step: VoltageStep, R_t: float, tau: float) -> Graph:
    """Fig. 12: the current after the step and Eq. 3 through it, over ten time constants."""
    current = trace.channels["current"]
    shown = (current.time >= step.instant - tau) & (current.time <= min(step.instant + 10 * tau, step.stop))
    since = np.linspace(0, 10 * tau, 200)
    says = f"R_t = {R_t:.4g} ohm, 63 % after tau = {1e3 * tau:.4g} ms: L_a = {1e3 * R_t * tau:.4g} mH"
    return Graph("Motor inductance test, " + trace.file, "time since the step [s]", "current [A]",
                 current.time[shown] - step.instant, current.value[shown], since,
                 step.first + (step.last - step.first) * (1 - np.exp(-since / tau)), says)  # fmt: skip


@final
class Inductance(AbstractRigTest):
    """The current of a held plate rises as 1 - exp(-t/tau) to v/R_t, tau = L_a/R_t."""

    name = "inductance"
    title = "Motor inductance test"
    boundary = Boundary(plate_held=True)
    drives = ("voltage", "duty")
    observes = ("current",)
    needs = (("voltage", "duty"), ("current",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """R_t = v/i and the 63 % time of every step, averaged over repeats; L_a = R_t tau (Eq. 3)."""
        found = [(trace, step) for trace in traces for step in steps(trace, config)]
        if not found:
            return Reading({}, notes=("L_a cannot be read: no voltage step with a current rise after it",))
        R_t = float(np.median([step.R_t for _, step in found]))
        tau = float(np.mean(_inliers(np.array([step.tau for _, step in found]))))
        values, notes = {"L_a": inductance(R_t, tau)}, [f"R_t = {R_t:.4g} ohm, tau = {1e3 * tau:.4g} ms"]
        gap = max(float(np.median(np.diff(trace.time))) for trace, _ in found)
        if gap > 0.2 * tau:
            notes.append(f"samples {1e3 * gap:.3g} ms apart are coarse for tau; the joint fit will do better")
        if "R_a" in known and not isinstance(config.series_ohm.get(self.name), float):
            values[f"series_ohm.{self.name}"] = R_t - known["R_a"]
        return Reading(values, tuple(profile(t, s, R_t, tau) for t, s in found[:6]), tuple(notes))


def _inliers(values: np.ndarray) -> np.ndarray:
    """Values within a factor 2 of their median."""
    middle = np.median(values)
    return values[(values > middle / 2) & (values < 2 * middle)]
