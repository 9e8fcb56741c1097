"""Simulates planned tests before they are made, and says which limits of the rig each of them would exceed.

Each test is simulated by several models, which differ as much as the data leave open; the worst counts. There are
limits on voltage, current, winding temperature and on how near the plate comes to its stops. `campaign` calls it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..problem.free_parameters import FreeParameters
from ..problem.problem import EstimationProblem
from ..rig import TEST_BY_NAME
from .candidates import Candidate
from .plan import Setting, trace_of
from .settings import CampaignSettings

COPPER = 0.0039  # 1/K, growth of its resistance
# of a winding that no `winding_heating` was fitted to: of some 16 g of copper, J/K; time constant, s
HEAT_CAPACITY, COOLING = 6.0, 30.0


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a planned test will show by each of D models; the first is the most likely one."""

    time: np.ndarray  # s, shape (n,)
    shown: Mapping[str, np.ndarray]  # by channel, SI, shape (D, n) each
    warmth: np.ndarray  # of the winding above ambient, K, shape (D, n)


@dataclass(frozen=True)
class Winding:
    """Heat of the winding, one node: C dD/dt = R_a (1 + alpha D_most) i^2 - C D / tau.

    Source: Boglietti et al. 2009. Differs from source: one node; the resistance is that at the limit, on the safe side.
    """

    capacity: float  # C, J/K
    cooling: float  # tau, s
    fitted: bool  # whether `winding_heating` of the model says so; else it is assumed

    @classmethod
    def of_model(cls, values: Mapping[str, float]) -> Winding:
        """From the model, as far as it knows: r_h = alpha R_a^2 / C."""
        if values.get("r_h", 0.0) > 0.0:
            return cls(COPPER * values["R_a"] ** 2 / values["r_h"], values["tau_h"], True)
        return cls(HEAT_CAPACITY, COOLING, False)

    def warmth(self, time: np.ndarray, current: np.ndarray, R_a: np.ndarray, most: float) -> np.ndarray:
        """K above where it began, shape (D, n).

        Args:
            time: evenly spaced, s, shape (n,).
            current: A, shape (D, n).
            R_a: ohm, shape (D,).
            most: K, for which the resistance is taken.
        """
        from scipy.signal import lfilter

        dt = float(time[1] - time[0])
        keep = np.exp(-dt / self.cooling)
        heat = R_a[:, None] * (1.0 + COPPER * most) * current**2 / self.capacity
        return np.asarray(lfilter([dt], [1.0, -keep], heat, axis=1))

    def pause(self, warmth: float, within: float = 3.0) -> float:
        """Time in which it cools from so much to `within` K of ambient, s."""
        return self.cooling * float(np.log(max(warmth / within, 1.0)))


def forecasts(
    every: Sequence[Candidate],
    s: Setting,
    known: FreeParameters,
    x: np.ndarray,
    least: tuple[int, ...],
    settings: CampaignSettings,
) -> list[Forecast]:
    """Simulate each candidate by every model.

    Args:
        x: coordinates of the models, shape (D, P).
        least: shape that the batch has at least, so that what was compiled serves again.
    """
    # whatever the model can show, whether the rig logs it or not
    traces = tuple(trace_of(c.plan, s, [n for n in TEST_BY_NAME[c.plan.test].observes if n in s.noise]) for c in every)
    problem = EstimationProblem.of_traces(s.config, known, traces, None, least).refined(x[0])
    runs = [problem.free_run(each) for each in x]
    R_a = np.array([float(known.layout.values(each, known.held)["R_a"]) for each in x])
    winding = Winding.of_model(s.values)
    out = []
    for k, trace in enumerate(traces):
        shown = {name: np.stack([run[k][:, m] for run in runs]) for m, name in enumerate(trace.channels)}
        current = shown.get("current", np.zeros((len(x), trace.instants.size)))
        warmth = winding.warmth(trace.instants, current, R_a, settings.temperature - settings.ambient)
        out.append(Forecast(trace.instants, shown, warmth))
    return out


def exceeded_limits(
    candidate: Candidate, forecast: Forecast, s: Setting, settings: CampaignSettings
) -> tuple[str, ...]:
    """Which limits a candidate would exceed by any of the models, in words; () where none."""
    if not all(np.isfinite(values).all() for values in forecast.shown.values()):
        return ("the model runs away",)
    out = []
    if candidate.played is not None and (volts := float(np.abs(candidate.played.volts).max())) > s.supply:
        out.append(f"{volts:.1f} V of a supply of {s.supply:.1f} V")
    amps = float(np.abs(forecast.shown["current"]).max()) if "current" in forecast.shown else 0.0
    if amps > settings.current:
        out.append(f"{amps:.1f} A, limit {settings.current:g} A")
    hot = settings.ambient + float(forecast.warmth.max())
    if hot > settings.temperature:
        out.append(f"winding {hot:.0f} degC, limit {settings.temperature:g} degC")
    if candidate.window is not None and candidate.free_plate and "position" in forecast.shown:
        margin = settings.margin * (s.open - s.rest)
        (begin, end), angle = candidate.window, forecast.shown["position"]
        low = float(angle[:, (forecast.time >= begin) & (forecast.time <= end)].min())
        if low < s.rest + margin:
            out.append(f"plate down to {np.degrees(low):.0f} deg, where it rests {np.degrees(s.rest):.0f} deg")
        if (high := float(angle.max())) > s.open - margin:
            out.append(f"plate up to {np.degrees(high):.0f} deg, open stop {np.degrees(s.open):.0f} deg")
    return tuple(out)
