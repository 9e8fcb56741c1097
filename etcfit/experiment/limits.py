"""What a trace will do to the rig by the model, over what is not known of it, and which limit it would pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..problem.free_parameters import FreeParameters
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace, prepare
from ..rig import TEST_BY_NAME
from ..rig.base import Channel, Measurement
from .candidates import Candidate, free_plate
from .plan import Plan
from .setting import Setting
from .settings import CampaignSettings

COPPER = 0.0039  # 1/K, growth of its resistance


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a trace will show, by each of D models; the first is the one that is believed.

    Args:
        time: s, shape (n,).
        shown: by channel, SI, shape (D, n) each.
        warmth: of the winding above ambient, K, shape (D, n).
    """

    time: np.ndarray
    shown: Mapping[str, np.ndarray]
    warmth: np.ndarray


@dataclass(frozen=True)
class Winding:
    """Heat of the winding, one node: C dD/dt = R_a (1 + alpha D_most) i^2 - C D / tau.

    Source: Boglietti et al. 2009. Differs from source: one node; the resistance is that at the limit, on the safe side.
    Args:
        capacity: C, J/K.
        cooling: tau, s.
        fitted: whether `winding_heating` of the model says so; else it is assumed.
    """

    capacity: float
    cooling: float
    fitted: bool

    @classmethod
    def of(cls, values: Mapping[str, float], settings: CampaignSettings) -> Winding:
        """From the model, as far as it knows: r_h = alpha R_a^2 / C."""
        if values.get("r_h", 0.0) > 0.0:
            return cls(COPPER * values["R_a"] ** 2 / values["r_h"], values["tau_h"], True)
        return cls(settings.heat_capacity, settings.cooling, False)

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


def watched(plan: Plan, s: Setting) -> Trace:
    """The planned trace with whatever the model can show in it, whether the rig logs it or not."""
    names = TEST_BY_NAME[plan.test].observes
    blank = {name: np.full(plan.time.size, plan.angle if name == "position" else 0.0) for name in names}
    if plan.volts is not None:
        blank["voltage"] = plan.volts
    every = {name: Channel(plan.time, v, s.noise[name], False, name, "", 1.0) for name, v in blank.items()
             if name in s.noise}  # fmt: skip
    trace = prepare(Measurement(f"{plan.test}/watched", plan.test, plan.time, every), s.config)
    assert trace is not None, "a plan drives and observes"
    if plan.release is None:
        return trace
    held = replace(trace.start, state=(0.0, plan.angle, 0.0), sd=(0.0, trace.start.sd[1], 0.0))
    return replace(trace, start=held, release=(plan.release, 1e-3))


def forecasts(
    every: Sequence[Candidate],
    s: Setting,
    known: FreeParameters,
    x: np.ndarray,
    least: tuple[int, ...],
    settings: CampaignSettings,
) -> list[Forecast]:
    """Each candidate by every model.

    Args:
        every: the candidates.
        s: the rig.
        known: which parameters x stands for.
        x: coordinates of the models, shape (D, P).
        least: shape that the batch has at least, so that what was compiled serves again.
        settings: of the winding's heat.
    """
    traces = tuple(watched(c.plan, s) for c in every)
    problem = EstimationProblem.of(s.config, known, traces, None, least).refined(x[0])
    runs = [problem.free_run(each) for each in x]
    R_a = np.array([float(known.layout.values(each, known.held)["R_a"]) for each in x])
    winding = Winding.of(s.values, settings)
    out = []
    for k, trace in enumerate(traces):
        shown = {name: np.stack([run[k][:, m] for run in runs]) for m, name in enumerate(trace.channels)}
        current = shown.get("current", np.zeros((len(x), trace.instants.size)))
        warmth = winding.warmth(trace.instants, current, R_a, settings.temperature - settings.ambient)
        out.append(Forecast(trace.instants, shown, warmth))
    return out


def passed(candidate: Candidate, forecast: Forecast, s: Setting, settings: CampaignSettings) -> tuple[str, ...]:
    """Which limits a candidate would pass by any of the models, in words; () where none."""
    return tuple(_passed(candidate, forecast, s, settings))


def _passed(candidate: Candidate, forecast: Forecast, s: Setting, settings: CampaignSettings) -> Iterator[str]:
    if not all(np.isfinite(values).all() for values in forecast.shown.values()):
        yield "the model runs away"
        return
    if candidate.played is not None and (volts := float(np.abs(candidate.played.volts).max())) > s.supply:
        yield f"{volts:.1f} V of a supply of {s.supply:.1f} V"
    amps = float(np.abs(forecast.shown["current"]).max()) if "current" in forecast.shown else 0.0
    if amps > settings.current:
        yield f"{amps:.1f} A, limit {settings.current:g} A"
    hot = settings.ambient + float(forecast.warmth.max())
    if hot > settings.temperature:
        yield f"winding {hot:.0f} degC, limit {settings.temperature:g} degC"
    if candidate.window is not None and free_plate(candidate) and "position" in forecast.shown:
        yield from _near_a_stop(candidate.window, forecast, s, settings)


def _near_a_stop(
    window: tuple[float, float], forecast: Forecast, s: Setting, settings: CampaignSettings
) -> Iterator[str]:
    margin = settings.margin * (s.open - s.rest)
    angle, inside = forecast.shown["position"], (forecast.time >= window[0]) & (forecast.time <= window[1])
    if (low := float(angle[:, inside].min())) < s.rest + margin:
        yield f"plate down to {np.degrees(low):.0f} deg, where it rests {np.degrees(s.rest):.0f} deg"
    if (high := float(angle.max())) > s.open - margin:
        yield f"plate up to {np.degrees(high):.0f} deg, open stop {np.degrees(s.open):.0f} deg"
