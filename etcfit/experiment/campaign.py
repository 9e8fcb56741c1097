"""The next tests, chosen: those that add most where the data say least, within what the rig can bear.

    gain = log(S(F) / S(F + J_k^T J_k)) / (T_k + T_handling)

S is the sum of the relative variances (A) or the geometric mean of them (D). The best is taken, its information added,
and the rest judged again. J_k is the whitened Jacobian that `advice` judges by.
Source: optimal experiment design by Fisher information, Ljung 1999, ch. 13; greedy choice, Fedorov 1972. Differs from
source: a modest set of candidates, not a spectrum.

Each planned test is simulated by several models, which differ as much as the data leave open; the worst counts. There
are limits on voltage, current, winding temperature and on how near the plate comes to its stops.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ..errors import UsageError
from ..estimation.fitted_model import Fitted
from ..estimation.ready import ready
from ..estimation.result import FitResult
from ..problem.free_parameters import FreeParameters
from ..problem.problem import EstimationProblem
from ..rig import TEST_BY_NAME, TESTS
from ..rig.base import CHANNELS, Rig
from .advice import Judge, informations_of_others, judge_of, judged_at
from .candidates import Candidate, candidates
from .plan import Setting, channels, remark, trace_of
from .settings import AdviceSettings, CampaignSettings

COPPER = 0.0039  # 1/K, growth of its resistance
# of a winding that no `winding_heating` was fitted to: of some 16 g of copper, J/K; time constant, s
HEAT_CAPACITY, COOLING = 6.0, 30.0


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a planned test will show by each of D models; the first is the most likely one."""

    time: np.ndarray  # s, shape (n,)
    shown: Mapping[str, np.ndarray]  # by channel, SI, shape (D, n) each
    warmth: np.ndarray  # of the winding above ambient, K, shape (D, n)

    @property
    def amps(self) -> float:
        """Largest current by any of them, A."""
        return float(np.abs(self.shown["current"]).max()) if "current" in self.shown else 0.0

    def hottest(self, ambient: float) -> float:
        """Highest temperature of the winding by any of them, degC."""
        return ambient + float(self.warmth.max())


@dataclass(frozen=True)
class Winding:
    """Heat of the winding, one node: C dD/dt = R_a (1 + alpha D_most) i^2 - C D / tau.

    Source: Boglietti et al. 2009. Differs from source: one node; the resistance is that at the limit, on the safe side.
    """

    capacity: float  # heat capacity C, J/K
    cooling: float  # time constant tau of its cooling, s
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

    def pause(self, warmth: float) -> float:
        """Time in which it cools from so much to 3 K above ambient, s."""
        return self.cooling * float(np.log(max(warmth / 3.0, 1.0)))


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
    if (amps := forecast.amps) > settings.current:
        out.append(f"{amps:.1f} A, limit {settings.current:g} A")
    if (hot := forecast.hottest(settings.ambient)) > settings.temperature:
        out.append(f"winding {hot:.0f} degC, limit {settings.temperature:g} degC")
    if candidate.window is not None and candidate.free_plate and "position" in forecast.shown:
        lowest, highest = s.kept_to(settings.margin)
        (begin, end), angle = candidate.window, forecast.shown["position"]
        low = float(angle[:, (forecast.time >= begin) & (forecast.time <= end)].min())
        if low < lowest:
            out.append(f"plate down to {np.degrees(low):.0f} deg, where it rests {np.degrees(s.rest):.0f} deg")
        if (high := float(angle.max())) > highest:
            out.append(f"plate up to {np.degrees(high):.0f} deg, open stop {np.degrees(s.open):.0f} deg")
    return tuple(out)


_SLACK = 0.03  # of what a quantity does in a test: what no model promises
_NOISE = 3.0  # standard deviations of a sample
_ROOM = 1.25  # of a range over what is expected
_FINE = 3.0  # steps of a logger may be so many standard deviations of the noise wide: 12 of a uniform error's variance
DOUBT = 0.05  # relative standard deviation of the graph readings that draws from a folder without a fit have
_DETERMINABLE = 0.5  # relative standard error that all candidates together must reach for a parameter to count


class Criterion(StrEnum):
    """What is to become small.

    A: the sum of the relative variances, which what is known least rules. D: their geometric mean.
    """

    A = "A"
    D = "D"

    def log_size(self, sd: np.ndarray) -> float:
        """Logarithm of it.

        Args:
            sd: relative standard errors, shape (P,).
        """
        return float(np.log(np.mean(sd**2)) if self is Criterion.A else np.mean(np.log(sd**2)))


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """One of the next tests."""

    candidate: Candidate  # what is played and logged
    forecast: Forecast  # what it will show
    # before, after: relative standard errors of all parameters before and after it, shape (P,)
    before: np.ndarray
    after: np.ndarray
    pause: float  # time for the winding to cool afterwards, s
    file: str  # where in the measurement folder its record goes


@dataclass(frozen=True, eq=False)
class Campaign:
    """What to measure next, in the order in which it is made."""

    rig: Rig  # what was measured so far
    at_fit: bool  # whether the models are those of a fit; else of the graph readings
    symbols: tuple[str, ...]  # free parameters, P
    values: dict[str, float]  # of all parameters, SI, at which it was planned
    setting: Setting  # the rig as a planner sees it
    tests: tuple[PlannedTest, ...]  # of the plan
    left_out: tuple[tuple[str, str], ...]  # what would pass a limit: which candidate, and the limit
    winding: Winding  # its heat
    criterion: Criterion  # by which it was chosen
    settings: CampaignSettings  # limits, candidates
    cautions: tuple[str, ...] = ()  # how far the model can be believed

    @property
    def now(self) -> np.ndarray:
        """Relative standard errors before all of it, shape (P,)."""
        return self.tests[0].before

    @property
    def expected(self) -> np.ndarray:
        """Relative standard errors after all of it, shape (P,)."""
        return self.tests[-1].after

    @property
    def seconds(self) -> float:
        """Length of all logs, s."""
        return sum(test.candidate.seconds for test in self.tests)

    def remark(self, test: PlannedTest) -> str:
        """See `plan.remark`."""
        return remark(test.candidate.plan, self.setting)


def plan_campaign(
    rig: Rig,
    at: FitResult | None = None,
    settings: CampaignSettings = CampaignSettings(),
    criterion: Criterion = Criterion.A,
    without: Sequence[str] = (),
    supply: float | None = None,
) -> Campaign:
    """Choose the next tests; arguments as of `etcfit.plan`.

    Args:
        at: the fit to plan by, of this rig, with its effects; None: the graph readings, with `DOUBT` of them.
    Raises:
        MeasurementError: nothing can be fitted.
        UsageError: no such rig test, no voltage drives this rig, or nothing keeps within the limits.
    """
    if unknown := [name for name in without if name not in TEST_BY_NAME]:
        raise UsageError(f"there is no rig test {unknown[0]}. There are {', '.join(test.name for test in TESTS)}.")
    known, x = judged_at(rig, at)
    fitted, _, _ = ready(rig)
    if any(trace.torque_driven for trace in fitted):
        raise UsageError("this rig is driven by a torque: no voltage can be planned for it.")
    problem = at.problem if at is not None else EstimationProblem.of_traces(rig.config, known, fitted).refined(x)
    judge, _ = judge_of(problem, known.layout, x, AdviceSettings(plan=settings.plan))
    values = known.values(x)
    setting = Setting.of_rig(rig, values, settings.plan)
    setting = setting if supply is None else replace(setting, supply=supply)

    every = candidates(setting, settings, {trace.test.name for trace in fitted}, tuple(without))
    models = _models(rig, at, known, x, judge, settings)
    seen = forecasts(every, setting, known, models, problem.room, settings)
    bad = [exceeded_limits(c, f, setting, settings) for c, f in zip(every, seen, strict=True)]
    left = list(_largest(every, bad))
    if not left:
        nearest = min(range(len(every)), key=lambda k: len(bad[k]))
        raise UsageError(f"no test keeps within the limits: {every[nearest].plan.says} would have "
                         f"{'; '.join(bad[nearest])}. Fit the folder first and plan by its RUN, or allow more current "
                         "or heat.")  # fmt: skip
    informations = dict(
        zip(left, informations_of_others(problem, [trace_of(every[k].plan, setting) for k in left], x), strict=True)
    )
    chosen = sorted(_chosen(every, informations, judge, settings, criterion), key=lambda k: _effort(every[k]))
    # stated standard errors over those of the Fisher information, at least 1
    wide = 1.0 if at is None else np.maximum(judge.relative(at.taken_as_exact().covariance) / judge.sd(), 1.0)
    winding, more, tests = Winding.of_model(values), np.zeros_like(judge.information), []
    for number, k in enumerate(chosen, 1):
        before, more = wide * judge.sd(more), more + informations[k]
        pause = winding.pause(float(seen[k].warmth[:, -1].max()))
        file = f"{every[k].plan.test}/plan_{number}.csv"
        tests.append(PlannedTest(every[k], seen[k], before, wide * judge.sd(more), pause, file))
    left_out = tuple((every[k].plan.says, "; ".join(why)) for k, why in enumerate(bad) if why)
    return Campaign(rig, at is not None, known.layout.free, values, setting, tuple(tests), left_out, winding,
                    criterion, settings, () if at is None else tuple(at.state.cautions))  # fmt: skip


def _models(
    rig: Rig, at: FitResult | None, known: FreeParameters, x: np.ndarray, judge: Judge, settings: CampaignSettings
) -> np.ndarray:
    """Coordinates of the model believed and of further ones, shape (1 + draws, P)."""
    if at is not None:
        covariance = at.fitted().covariance
    else:
        covariance = judge.covariance() + np.diag((DOUBT * known.layout.reach(x)) ** 2)
    drawn = Fitted(rig.config, known, x, covariance).laplace(settings.draws, np.random.default_rng(settings.seed))
    return np.vstack((x[None], drawn))


def _largest(every: Sequence[Candidate], bad: Sequence[tuple[str, ...]]) -> Iterator[int]:
    """Candidates of largest amplitude within the limits, two of each group: a smaller one says less."""
    groups: dict[tuple[str, float, float], list[int]] = {}
    for k, why in enumerate(bad):
        if not why:
            groups.setdefault(every[k].group, []).append(k)
    for members in groups.values():
        yield from members[-2:]


def _chosen(
    every: Sequence[Candidate],
    informations: dict[int, np.ndarray],
    judge: Judge,
    settings: CampaignSettings,
    criterion: Criterion,
) -> list[int]:
    """Indices of the tests, best first."""
    determinable = judge.sd(sum(informations.values())) < _DETERMINABLE
    if not determinable.any():
        determinable[:] = True

    def size(more: np.ndarray | float) -> float:
        return criterion.log_size(judge.sd(more)[determinable])

    chosen: list[int] = []
    more = np.zeros_like(judge.information)
    while len(chosen) < settings.tests:
        left = {k: each for k, each in informations.items() if k not in chosen}
        if not left:
            break
        here = size(more)
        drop = {k: here - size(more + each) for k, each in left.items()}
        best = max(drop, key=lambda k: drop[k] / (every[k].seconds + settings.handling))
        if chosen and drop[best] < settings.least:
            break
        chosen.append(best)
        more = more + informations[best]
    return chosen


def _effort(candidate: Candidate) -> int:
    """What has to be done to the rig, least first: driven plate, open terminals, held plate, gear apart."""
    b = TEST_BY_NAME[candidate.plan.test].boundary
    return 3 if b.gear_apart else 2 if b.plate_held else 1 if b.terminals_open else 0


def band(test: PlannedTest, s: Setting, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Between what a channel should stay, SI, shape (n,) each: range over the models, noise, and 3 % of its span."""
    values = test.forecast.shown[name]
    slack = _SLACK * float(np.ptp(values[0])) + _NOISE * s.noise[name]
    return values.min(axis=0) - slack, values.max(axis=0) + slack


@dataclass(frozen=True)
class LoggedColumn:
    """One column of the record, in the unit of its header."""

    header: str  # as it stands in the CSV
    # low, high: range that the logger needs
    low: float
    high: float
    resolution: float  # coarsest step that loses nothing; 0 where it does not matter


def logger(test: PlannedTest, campaign: Campaign) -> tuple[LoggedColumn, ...]:
    """How a planned test is to be logged: columns of its record, time first, in the headers that the rig has used."""
    plan, s = test.candidate.plan, campaign.setting
    out = [LoggedColumn("time [s]", 0.0, test.candidate.seconds, 0.01 * float(plan.time[1] - plan.time[0]))]
    drive = () if plan.volts is None else ("voltage",)
    for name in (*drive, *channels(plan, s)):
        value = plan.volts if name == "voltage" and plan.volts is not None else test.forecast.shown[name]
        ends, noise = np.array([value.min(), value.max()]), s.noise[name]
        spread = 0.5 * np.ptp(ends) * (_ROOM - 1.0) + 5.0 * noise
        ends, header, scale = ends + np.array([-spread, spread]), f"{name} [{CHANNELS[name]}]", 1.0
        # as the rig logged it in this test, or else in another
        every = sorted((m for m in campaign.rig.measurements if name in m.channels), key=lambda m: m.test != plan.test)
        if every:
            used = every[0].channels[name]
            ends, header, scale = np.sort(used.logged(ends)), used.header, abs(used.scale)
        out.append(LoggedColumn(header, float(ends[0]), float(ends[1]), float(_FINE * noise / scale)))
    return tuple(out)
