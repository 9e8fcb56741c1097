"""One trace of each rig test as it would be made: what is driven, for how long, from where.

A new rig test needs no plan of its own: without one it can be judged once a trace of it was measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..problem.trace import InitialState, Trace, prepare
from ..rig import TEST_BY_NAME
from ..rig.base import AbstractRigTest, Channel, Measurement
from .setting import Setting


@dataclass(frozen=True, eq=False)
class Plan:
    """A trace that does not exist yet.

    Args:
        test: name of its rig test.
        says: how it is made, for whoever makes it.
        time: s, shape (n,).
        volts: V, shape (n,); None with open terminals.
        angle: where the plate is at first, rad.
        release: when a held plate is let go, s; None where nobody holds it.
    """

    test: str
    says: str
    time: np.ndarray
    volts: np.ndarray | None
    angle: float
    release: float | None = None


def resistance(s: Setting) -> Plan:
    """Plate held, a quarter of the supply."""
    level, time = 0.25 * s.supply, _clock(0.5, 1000.0)
    return Plan("resistance", f"plate held, {level:.1f} V for 0.5 s", time, np.full(time.size, level), s.rest)


def inductance(s: Setting) -> Plan:
    """Plate held, a jump to a volt that is sampled much faster than L_a/R_a."""
    time = _clock(0.02, 20_000.0)
    return Plan("inductance", "plate held, step to 1 V, sampled at 20 kHz", time, _step(time, 0.002, 1.0), s.rest)


def back_emf(s: Setting) -> Plan:
    """Terminals open, let go from open."""
    return _let_go("back_emf", s)


def inertia(s: Setting) -> Plan:
    """As the back-EMF test; what differs is who logs it."""
    return _let_go("inertia", s)


def viscous(s: Setting) -> Plan:
    """Gear apart, a jump to half the supply."""
    level, time = 0.5 * s.supply, _clock(1.0, 1000.0)
    says = f"motor alone, step to {level:.1f} V, 1 s at 1 kHz, speed logged"
    return Plan("viscous", says, time, _step(time, s.settings.quiet, level), s.rest)


def static_load(s: Setting) -> Plan:
    """A slow ramp to open and back."""
    peak, time = s.within(1.1 * (s.balance(s.open) + s.friction)), _clock(16.0, 250.0)
    volts = peak * np.clip(np.minimum(time / 7.5, (15.5 - time) / 7.5), 0.0, 1.0)
    return Plan("static_load", f"ramp to {peak:.1f} V and back in 16 s", time, volts, s.rest)


PLANS: dict[str, Callable[[Setting], Plan]] = {
    plan.__name__: plan for plan in (resistance, inductance, back_emf, viscous, static_load, inertia)
}


def sweeps(s: Setting) -> list[Plan]:
    """Driven responses to choose from: sine sweeps about half travel, of rising amplitude and band.

    The smallest just overcomes dry friction both ways; the largest, where the supply gives it, takes a slow plate from
    stop to stop and no further.
    """
    middle = s.within(s.balance(0.5 * (s.rest + s.open)))
    most = min(s.friction + s.volts(s.values["K_s"] * 0.5 * (s.open - s.rest)), s.supply - abs(middle))
    least = min(1.2 * s.friction, 0.8 * most)
    amplitudes = np.geomspace(least, most, s.settings.levels)
    return [_sweep(s, middle, float(a), band) for a in amplitudes for band in s.settings.bands]


def _sweep(s: Setting, middle: float, amplitude: float, band: float) -> Plan:
    """middle + amplitude sin(phase), the frequency rising exponentially."""
    time, lowest = _clock(s.duration, s.rate), s.settings.lowest
    rate = np.log(band / lowest) / s.duration
    volts = middle + amplitude * np.sin(2.0 * np.pi * lowest * np.expm1(rate * time) / rate)
    says = f"sine sweep {lowest:g} to {band:g} Hz in {s.duration:.1f} s, {middle:.2f} ± {amplitude:.2f} V"
    return Plan("response", says, time, volts, s.rest)


def channels(plan: Plan, s: Setting) -> tuple[str, ...]:
    """What would be observed: what this rig logs, and what the test cannot do without."""
    test = TEST_BY_NAME[plan.test]
    logged = [name for name in test.observes if name in s.logged[plan.test]]
    return tuple(dict.fromkeys((*logged, *_must(test, logged))))


def _must(test: AbstractRigTest, logged: list[str]) -> list[str]:
    """The first of each group of alternatives of which nothing is logged, inputs apart."""
    groups = [[name for name in group if name in test.observes] for group in test.needs]
    return [group[0] for group in groups if group and not set(group) & set(logged)]


def trace_of(plan: Plan, s: Setting) -> Trace:
    """The planned trace, ready for the model. Its samples are blanks: no Jacobian depends on them."""
    blank = {name: np.full(plan.time.size, plan.angle if name == "position" else 0.0) for name in channels(plan, s)}
    if plan.volts is not None:
        blank["voltage"] = plan.volts
    logged = {name: Channel(plan.time, v, s.noise[name], False, name, "", 1.0) for name, v in blank.items()}
    trace = prepare(Measurement(f"{plan.test}/planned", plan.test, plan.time, logged), s.config)
    assert trace is not None, "a plan drives and observes"
    if plan.release is None:
        return trace
    held = InitialState((0.0, plan.angle, 0.0), (0.0, trace.start.sd[1], 0.0))
    return replace(trace, start=held, release=(plan.release, 1e-3))


def _let_go(test: str, s: Setting) -> Plan:
    says, quiet = "terminals open, plate let go from open, 0.5 s at 2 kHz", s.settings.quiet
    return Plan(test, says, _clock(0.5, 2000.0), None, s.open, quiet)


def _clock(duration: float, rate: float) -> np.ndarray:
    return np.arange(round(duration * rate)) / rate


def _step(time: np.ndarray, at: float, level: float) -> np.ndarray:
    return np.where(time < at, 0.0, level)
