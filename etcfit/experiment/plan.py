"""What a planner knows of a rig, and one trace of each rig test as it would be made: what is driven, for how long, from
where.

A new rig test needs no plan of its own: without one it can be judged once a trace of it was measured.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..problem.trace import InitialState, Trace, prepare
from ..rig import TEST_BY_NAME, TESTS
from ..rig.base import AbstractRigTest, Channel, Measurement, Rig, RigConfig
from .settings import PlanSettings

# standard deviation of one sample of a sensor that this rig has not been seen with, SI; what a hobbyist's logger has
USUAL = {"voltage": 0.01, "current": 0.01, "position": 0.002, "emf": 0.01, "motor_speed": 1.0}
_ANYWHERE = frozenset({"current", "position"})  # seen whatever is done to the rig
QUIET = 0.05  # s before anything happens in a trace
_LEVELS = 3  # amplitudes of the sweeps to choose from


@dataclass(frozen=True, eq=False)
class Setting:
    """A rig as a planner sees it."""

    config: RigConfig  # the rig
    values: Mapping[str, float]  # of all parameters, SI, by symbol
    supply: float  # V
    noise: Mapping[str, float]  # standard deviation of one sample by channel, SI
    assumed: frozenset[str]  # channels whose noise is not the rig's own
    rest: float  # where the plate rests without a drive, rad
    rate: float  # at which driven plates are logged, Hz
    duration: float  # of such a log, s
    # channels that this rig logs, by rig test: those seen in a trace of the same boundary, for a shaft's speed is seen
    # with the gear apart only, and an EMF at open terminals
    logged: Mapping[str, frozenset[str]]
    settings: PlanSettings = PlanSettings()  # of the plans

    @classmethod
    def of_rig(cls, rig: Rig, values: Mapping[str, float], settings: PlanSettings = PlanSettings()) -> Setting:
        """From what was measured, as far as that tells; the rest from the settings."""
        seen: dict[str, list[float]] = {}
        for trace in rig.measurements:
            for name, channel in trace.channels.items():
                seen.setdefault(name, []).append(channel.error)
        own = {name: float(np.median(sigmas)) for name, sigmas in seen.items()}
        driven = [t for t in rig.measurements if t.test in ("response", "static_load", "drive")]
        rests = [t.channels["position"].value[0] for t in driven if "position" in t.channels]
        responses = [t.time for t in rig.measurements if t.test == "response"]
        volts = [np.abs(t.channels["voltage"].value).max() for t in rig.measurements if "voltage" in t.channels]
        return cls(
            config=rig.config,
            values=values,
            supply=rig.config.supply_V or float(max(volts, default=settings.supply)),
            noise=USUAL | own,
            assumed=frozenset(USUAL) - frozenset(own),
            rest=float(np.clip(np.median(rests) if rests else 0.0, *rig.config.travel)),
            rate=1.0 / float(np.median([np.median(np.diff(t)) for t in responses])) if responses else settings.rate,
            duration=float(np.median([np.ptp(t) for t in responses])) if responses else settings.duration,
            logged={test.name: _logged(test, rig) for test in TESTS},
            settings=settings,
        )

    @property
    def open(self) -> float:
        """The upper stop, rad; a quarter turn from rest where there is none."""
        upper = self.config.travel[1]
        return upper if np.isfinite(upper) else self.rest + 0.5 * np.pi

    def kept_to(self, margin: float) -> tuple[float, float]:
        """Angles that stay off its rest and the open stop by this share of the way between them, rad."""
        off = margin * (self.open - self.rest)
        return self.rest + off, self.open - off

    def volts(self, torque: float) -> float:
        """Steady voltage whose motor torque is this one at the plate: R_a T / (N K_m), V."""
        return float(self.values["R_a"] * torque / (self.config.gear_ratio * self.values["K_m"]))

    def balance(self, angle: float) -> float:
        """Voltage that holds the plate at this angle by the start model, V."""
        return self.volts(self.values["T_PL"] + self.values["K_s"] * angle)

    @property
    def friction(self) -> float:
        """Voltage that overcomes dry friction, V."""
        return self.volts(self.values["T_f"])

    def within(self, volts: float) -> float:
        """What the supply can give of it, V."""
        return float(np.clip(volts, -self.supply, self.supply))


def _logged(test: AbstractRigTest, rig: Rig) -> frozenset[str]:
    """Channels of a rig test that this rig logs, see `Setting`."""
    alike = [m for m in rig.measurements if TEST_BY_NAME[m.test].boundary == test.boundary]
    seen = frozenset(name for m in (alike or rig.measurements) for name in m.channels)
    return frozenset(test.observes) & (seen if alike else seen & _ANYWHERE)


@dataclass(frozen=True, eq=False)
class Plan:
    """A trace that does not exist yet."""

    test: str  # name of its rig test
    says: str  # how it is made, for whoever makes it
    time: np.ndarray  # s, shape (n,)
    volts: np.ndarray | None  # V, shape (n,); None with open terminals
    angle: float  # where the plate is at first, rad
    release: float | None = None  # when a held plate is let go, s; None where nobody holds it


def resistance(s: Setting) -> Plan:
    """Plate held, a quarter of the supply."""
    level, time = 0.25 * s.supply, even_clock(0.5, 1000.0)
    return Plan("resistance", f"plate held, {level:.1f} V for 0.5 s", time, np.full(time.size, level), s.rest)


def inductance(s: Setting) -> Plan:
    """Plate held, a jump to a volt that is sampled much faster than L_a/R_a."""
    time = even_clock(0.02, 20_000.0)
    return Plan("inductance", "plate held, step to 1 V, sampled at 20 kHz", time, _step(time, 0.002, 1.0), s.rest)


def viscous(s: Setting) -> Plan:
    """Gear apart, a jump to half the supply."""
    level, time = 0.5 * s.supply, even_clock(1.0, 1000.0)
    says = f"motor alone, step to {level:.1f} V, 1 s at 1 kHz, speed logged"
    return Plan("viscous", says, time, _step(time, QUIET, level), s.rest)


def static_load(s: Setting) -> Plan:
    """A slow ramp to open and back."""
    peak, time = s.within(1.1 * (s.balance(s.open) + s.friction)), even_clock(16.0, 250.0)
    volts = peak * np.clip(np.minimum(time / 7.5, (15.5 - time) / 7.5), 0.0, 1.0)
    return Plan("static_load", f"ramp to {peak:.1f} V and back in 16 s", time, volts, s.rest)


def _release(test: str) -> Callable[[Setting], Plan]:
    """Terminals open, the plate let go from open; two tests, which differ in what is logged."""
    says = "terminals open, plate let go from open, 0.5 s at 2 kHz"
    return lambda s: Plan(test, says, even_clock(0.5, 2000.0), None, s.open, QUIET)


PLANS: dict[str, Callable[[Setting], Plan]] = {
    "resistance": resistance,
    "inductance": inductance,
    "back_emf": _release("back_emf"),
    "viscous": viscous,
    "static_load": static_load,
    "inertia": _release("inertia"),
}


def sweeps(s: Setting) -> list[Plan]:
    """Driven responses to choose from: sine sweeps about half travel, of rising amplitude and band.

        v = middle + amplitude sweep,    see `sine_sweep`

    The smallest just overcomes dry friction both ways; the largest, where the supply gives it, takes a slow plate from
    stop to stop and no further.
    """
    middle = s.within(s.balance(0.5 * (s.rest + s.open)))
    most = min(s.friction + s.volts(s.values["K_s"] * 0.5 * (s.open - s.rest)), s.supply - abs(middle))
    least = min(1.2 * s.friction, 0.8 * most)
    time, lowest, plans = even_clock(s.duration, s.rate), s.settings.lowest, []
    for amplitude in map(float, np.geomspace(least, most, _LEVELS)):
        for band in s.settings.bands:
            volts = middle + amplitude * sine_sweep(time, lowest, band, s.duration)
            says = f"sine sweep {lowest:g} to {band:g} Hz in {s.duration:.1f} s, {middle:.2f} ± {amplitude:.2f} V"
            plans.append(Plan("response", says, time, volts, s.rest))
    return plans


def channels(plan: Plan, s: Setting) -> tuple[str, ...]:
    """What would be observed: what this rig logs, and what the test cannot do without.

    Of each group of alternatives of which nothing is logged, inputs apart, that is the first.
    """
    test = TEST_BY_NAME[plan.test]
    logged = [name for name in test.observes if name in s.logged[plan.test]]
    groups = [[name for name in group if name in test.observes] for group in test.needs]
    must = [group[0] for group in groups if group and not set(group) & set(logged)]
    return tuple(dict.fromkeys((*logged, *must)))


def remark(plan: Plan, s: Setting) -> str:
    """Channels that the test needs and this rig has not logged so far, in words; "" where there are none."""
    new = [name.replace("_", " ") for name in channels(plan, s) if name in s.assumed]
    return f"{', '.join(new)} not logged so far: noise assumed" if new else ""


def trace_of(plan: Plan, s: Setting, names: Sequence[str] | None = None) -> Trace:
    """The planned trace with these channels, `channels` where not given, ready for the model.

    Its samples are blanks: no Jacobian depends on them.
    """
    names = channels(plan, s) if names is None else names
    blank = {name: np.full(plan.time.size, plan.angle if name == "position" else 0.0) for name in names}
    if plan.volts is not None:
        blank["voltage"] = plan.volts
    logged = {name: Channel(plan.time, v, s.noise[name], False, name, "", 1.0) for name, v in blank.items()}
    trace = prepare(Measurement(f"{plan.test}/planned", plan.test, plan.time, logged), s.config)
    assert trace is not None, "a plan drives and observes"
    if plan.release is None:
        return trace
    held = InitialState((0.0, plan.angle, 0.0), (0.0, trace.start.sd[1], 0.0))
    return replace(trace, start=held, release=(plan.release, 1e-3))


def sine_sweep(time: np.ndarray, lowest: float, highest: float, duration: float) -> np.ndarray:
    """sin(2 pi f_0 (e^(r t) - 1) / r),    r = ln(f_1 / f_0) / T

    Source: Farina 2000 (exponential sweep). Differs from source: no.
    """
    rate = np.log(highest / lowest) / duration
    return np.sin(2.0 * np.pi * lowest * np.expm1(rate * time) / rate)


def even_clock(duration: float, rate: float) -> np.ndarray:
    """Instants from 0, s."""
    return np.arange(round(duration * rate)) / rate


def _step(time: np.ndarray, at: float, level: float) -> np.ndarray:
    return np.where(time < at, 0.0, level)
