"""The paper's rig tests of the motor's circuit: resistance, inductance, back-EMF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np

from .base import AbstractRigTest, Boundary, Channel, Graph, Measurement, Reading, RigConfig
from .signals import (
    drive_voltage,
    motion,
    off_stops,
    plateaus,
    rise_time,
    robust_line,
    robust_slope,
    settled_points,
    smoothing_window,
)


@final
class Resistance(AbstractRigTest):
    """Plate held, constant voltages: the steady current over voltage has slope 1/R_a."""

    name = "resistance"
    title = "Motor resistance test"
    boundary = Boundary(plate_held=True)
    observes = ("current",)
    needs = (("voltage", "duty"), ("current",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """R_a = 1/slope of i = v/R_a + sensor offset (paper, Fig. 11), less a series resistance given in rig.toml."""
        driven = [(drive_voltage(trace, config), trace.channels.get("current")) for trace in traces]
        points = settled_points((voltage, voltage, current) for voltage, current in driven)
        if not len(points) or not np.any(points[:, 0]):
            return Reading({}, notes=("R_a cannot be read: no plateau of voltage with a current",))
        line = robust_line(points[:, 0], points[:, 1])
        if line.slope <= 0:
            return Reading({}, notes=(f"R_a cannot be read: current over voltage has slope {line.slope:.3g} A/V",))
        total, series = 1 / line.slope, config.series_ohm.get(self.name, 0.0)
        notes = [f"current at zero voltage {line.offset:.3g} A"]
        if series is None:
            notes.append("the series resistance of this test is free, so this R_a includes it")
        R_a = total - (series or 0.0)
        ends = np.array([min(0.0, points[:, 0].min()), points[:, 0].max()])
        graph = Graph(self.title, "voltage [V]", "steady current [A]", points[:, 0], points[:, 1], ends, line.at(ends),
                      f"slope {line.slope:.4g} A/V: R_a = {R_a:.4g} ohm")  # fmt: skip
        return Reading({"R_a": R_a}, (graph,), tuple(notes))


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

    The step lies between two samples of the voltage; the middle is the best estimate. Differences across the step
    remove the offsets of both sensors from R_t.
    """
    voltage, current = drive_voltage(trace, config), trace.channels.get("current")
    if voltage is None or current is None:
        return []
    found = []
    for before, after in pairwise(plateaus(voltage, least=0.002)):
        first, last = before.settled(current), after.settled(current)
        if not np.isfinite(last - first) or abs(last - first) < 5 * current.sigma:
            continue
        instant = (before.stop + after.start) / 2
        tau = rise_time(current, instant, first, last, after.stop)
        R_t = resistance(after.settled(voltage) - before.settled(voltage, 1.0), last - first)
        if tau > 0 and R_t > 0:
            found.append(VoltageStep(R_t, tau, instant, first, last, after.stop))
    return found


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
    """Plate held, voltage step: the current rises as 1 - exp(-t/tau) to v/R_t, tau = L_a/R_t."""

    name = "inductance"
    title = "Motor inductance test"
    boundary = Boundary(plate_held=True)
    observes = ("current",)
    needs = (("voltage", "duty"), ("current",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """R_t = v/i and the 63 % time of every step, averaged over repeats; L_a = R_t tau (Eq. 3)."""
        found = [(trace, step) for trace in traces for step in steps(trace, config)]
        if not found:
            return Reading({}, notes=("L_a cannot be read: no voltage step with a current rise after it",))
        R_t = float(np.median([step.R_t for _, step in found]))
        taus = np.array([step.tau for _, step in found])
        middle = np.median(taus)
        tau = float(np.mean(taus[(taus > middle / 2) & (taus < 2 * middle)]))
        values, notes = {"L_a": inductance(R_t, tau)}, [f"R_t = {R_t:.4g} ohm, tau = {1e3 * tau:.4g} ms"]
        gap = max(float(np.median(np.diff(trace.time))) for trace, _ in found)
        if gap > 0.2 * tau:
            notes.append(f"samples {1e3 * gap:.3g} ms apart are coarse for tau; the joint fit is more accurate")
        if "R_a" in known and not isinstance(config.series_ohm.get(self.name), float):
            values[f"series_ohm.{self.name}"] = R_t - known["R_a"]
        return Reading(values, tuple(profile(t, s, R_t, tau) for t, s in found[:6]), tuple(notes))


def back_emf_constant(emf: float, plate_speed: float, N: float) -> float:
    """K_b = e_b/(N omega_L), V s/rad (Eq. 4)."""
    return emf / (N * plate_speed)


def emf_of(trace: Measurement) -> Channel | None:
    """The EMF; with open terminals a logged terminal voltage is the EMF."""
    return trace.channels.get("emf", trace.channels.get("voltage"))


def fast_part(trace: Measurement, config: RigConfig) -> tuple[np.ndarray, np.ndarray]:
    """Speed (rad/s) and EMF (V), equally smoothed, off the stops and above 60 % of the plate's top speed."""
    emf, position = emf_of(trace), trace.channels.get("position")
    moved = None if emf is None or position is None else motion(position, smoothing_window(position))
    if emf is None or position is None or moved is None:
        return np.empty(0), np.empty(0)
    free = off_stops(moved.angle, config, position.sigma) & (moved.time >= emf.time[0]) & (moved.time <= emf.time[-1])
    # within half a window of a stop the slope includes rest
    inner = np.convolve(free, np.ones(moved.window), "same") >= moved.window - 0.5
    used = inner if inner.sum() >= 3 else free
    top = np.max(np.abs(moved.speed[used]), initial=0.0)
    used = used & (np.abs(moved.speed) > 0.6 * top)
    return moved.speed[used], moved.smooth(emf)[used]


@final
class BackEmf(AbstractRigTest):
    """Terminals open, plate released from open: e_b = K_b N omega_L; the return spring moves the plate."""

    name = "back_emf"
    title = "Back electromotive force test"
    boundary = Boundary(terminals_open=True, released=True)
    observes = ("emf", "position")
    needs = (("emf", "voltage"), ("position",))

    def reading(self, traces: Sequence[Measurement], config: RigConfig, known: Mapping[str, float]) -> Reading:
        """Slope of e_b over omega_L where the plate is fast (Eq. 4, Fig. 13), over the gear ratio."""
        parts = [fast_part(trace, config) for trace in traces]
        speed, emf = (np.concatenate([p[k] for p in parts]) if parts else np.empty(0) for k in (0, 1))
        if len(speed) < 3:
            return Reading({}, notes=("K_b cannot be read: no EMF of a moving plate",))
        ratio = robust_slope(speed, emf)
        notes = () if ratio > 0 else ("EMF and position have opposite signs: the leads of the EMF are exchanged",)
        K_b = back_emf_constant(abs(ratio), 1.0, known["N"])
        ends = np.array([0.0, speed[np.argmax(np.abs(speed))]])
        graph = Graph(self.title, "plate speed [rad/s]", "EMF [V]", speed, emf, ends, ratio * ends,
                      f"slope {abs(ratio):.4g} V s/rad at the plate: K_b = {K_b:.4g} V s/rad")  # fmt: skip
        return Reading({"K_b": K_b}, (graph,), notes)
