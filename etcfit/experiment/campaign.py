"""The next tests, chosen: what tells most of what the data know least, within what the rig can bear.

    gain = log(S(F) / S(F + J_k^T J_k)) / (T_k + T_handling)

S is the sum of the relative variances (A) or the geometric mean of them (D). The best is taken, its information added,
and the rest judged again. J_k is the whitened Jacobian that `advice` judges by.
Source: optimal experiment design by Fisher information, Ljung 1999, ch. 13; greedy choice, Fedorov 1972. Differs from
source: a modest set of candidates, not a spectrum.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ..errors import UsageError
from ..estimation.fitted_model import Fitted
from ..estimation.levenberg_marquardt import information_of
from ..estimation.ready import ready
from ..estimation.result import FitResult
from ..problem import weights
from ..problem.free_parameters import FreeParameters, Layout
from ..problem.problem import EstimationProblem
from ..rig import TEST_BY_NAME, TESTS
from ..rig.base import Rig
from .advice import Judge, beside, informations, judged_at
from .candidates import Candidate, candidates
from .limits import Forecast, Winding, forecasts, passed
from .plan import channels, trace_of
from .setting import Setting
from .settings import AdviceSettings, CampaignSettings


class Criterion(StrEnum):
    """What is to become small.

    A: the sum of the relative variances, which what is known least rules. D: their geometric mean.
    """

    A = "A"
    D = "D"

    def of(self, sd: np.ndarray) -> float:
        """Logarithm of it.

        Args:
            sd: relative standard errors, shape (P,).
        """
        return float(np.log(np.mean(sd**2)) if self is Criterion.A else np.mean(np.log(sd**2)))


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """One of the next tests.

    Args:
        candidate: what is played and logged.
        forecast: what it will show.
        before, after: relative standard errors of all parameters before and after it, shape (P,).
        pause: time for the winding to cool afterwards, s.
        file: where in the measurement folder its record goes.
    """

    candidate: Candidate
    forecast: Forecast
    before: np.ndarray
    after: np.ndarray
    pause: float
    file: str


@dataclass(frozen=True, eq=False)
class Campaign:
    """What to measure next, in the order in which it is made.

    Args:
        rig: what was measured so far.
        at_fit: whether the models are those of a fit; else of the graph readings.
        symbols: free parameters, P.
        values: of all parameters, SI, at which it was planned.
        setting: the rig as a planner sees it.
        tests: of the plan.
        left_out: what would pass a limit: which candidate, and the limit.
        winding: its heat.
        criterion: by which it was chosen.
        settings: limits, candidates.
        cautions: how far the model can be believed.
    """

    rig: Rig
    at_fit: bool
    symbols: tuple[str, ...]
    values: dict[str, float]
    setting: Setting
    tests: tuple[PlannedTest, ...]
    left_out: tuple[tuple[str, str], ...]
    winding: Winding
    criterion: Criterion
    settings: CampaignSettings
    cautions: tuple[str, ...] = ()

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


def plan_campaign(
    rig: Rig,
    at: FitResult | None = None,
    settings: CampaignSettings = CampaignSettings(),
    criterion: Criterion = Criterion.A,
    without: Sequence[str] = (),
    supply: float | None = None,
) -> Campaign:
    """Choose the next tests.

    Args:
        rig: a measurement folder.
        at: the fit to plan by, of this rig, with its effects; the graph readings, with `settings.doubt` of them, where
            not given.
        settings: limits and candidates.
        criterion: what is to become small.
        without: rig tests that nobody can make.
        supply: V; that of the rig where None.
    Raises:
        MeasurementError: nothing can be fitted.
        UsageError: no such rig test, no voltage drives this rig, or nothing keeps within the limits.
    """
    _must_be_tests(without)
    known, x = judged_at(rig, at)
    fitted, _, _ = ready(rig)
    if any(trace.torque_driven for trace in fitted):
        raise UsageError("this rig is driven by a torque: no voltage can be planned for it.")
    problem = at.problem if at is not None else EstimationProblem.of(rig.config, known, fitted).refined(x)
    prior_sd = problem.weighted(weights.free_running(problem)).prior_sd[: x.size]
    information = information_of(prior_sd, np.zeros((0, x.size))) + sum(informations(problem, x))
    values = known.values(x)
    setting = _setting(rig, values, settings, supply)
    judge = Judge(known.layout, x, information, AdviceSettings(plan=settings.plan))

    every = candidates(setting, settings, {trace.test.name for trace in fitted}, tuple(without))
    models = _models(rig, at, known, x, judge, settings)
    seen = forecasts(every, setting, known, models, problem.room, settings)
    bad = [passed(c, f, setting, settings) for c, f in zip(every, seen, strict=True)]
    left = [k for k in _largest(every, bad)]
    if not left:
        raise UsageError(_nothing(every, bad))
    told = dict(zip(left, beside(problem, [trace_of(every[k].plan, setting) for k in left], x), strict=True))
    chosen = _ordered(every, _chosen(every, told, judge, settings, criterion))
    wide = _widening(at, judge)
    winding = Winding.of(values, settings)
    tests = tuple(_tests(every, seen, chosen, told, judge, wide, winding))
    left_out = tuple((every[k].plan.says, "; ".join(why)) for k, why in enumerate(bad) if why)
    return Campaign(rig, at is not None, known.layout.free, values, setting, tests, left_out, winding, criterion,
                    settings, () if at is None else tuple(at.state.cautions))  # fmt: skip


def _must_be_tests(names: Sequence[str]) -> None:
    if unknown := [name for name in names if name not in TEST_BY_NAME]:
        raise UsageError(f"there is no rig test {unknown[0]}. There are {', '.join(test.name for test in TESTS)}.")


def _setting(rig: Rig, values: dict[str, float], settings: CampaignSettings, supply: float | None) -> Setting:
    setting = Setting.of(rig, values, settings.plan)
    return setting if supply is None else replace(setting, supply=supply)


def _models(
    rig: Rig, at: FitResult | None, known: FreeParameters, x: np.ndarray, judge: Judge, settings: CampaignSettings
) -> np.ndarray:
    """Coordinates of the model believed and of further ones, shape (1 + draws, P)."""
    if at is not None:
        covariance = at.fitted().covariance
    else:
        covariance = judge.covariance() + np.diag((settings.doubt * known.layout.reach(x)) ** 2)
    drawn = Fitted(rig.config, known, x, covariance).laplace(settings.draws, np.random.default_rng(settings.seed))
    return np.vstack((x[None], drawn))


def _largest(every: Sequence[Candidate], bad: Sequence[tuple[str, ...]], most: int = 2) -> Iterator[int]:
    """Of each group the candidates of largest amplitude that pass no limit: a smaller one tells less."""
    groups: dict[tuple[str, float, float], list[int]] = {}
    for k, why in enumerate(bad):
        if not why:
            groups.setdefault(every[k].group, []).append(k)
    for members in groups.values():
        yield from members[-most:]


def _nothing(every: Sequence[Candidate], bad: Sequence[tuple[str, ...]]) -> str:
    nearest = min(range(len(every)), key=lambda k: len(bad[k]))
    return (f"no test keeps within the limits: {every[nearest].plan.says} would have {'; '.join(bad[nearest])}. Fit "
            "the folder first and plan by its RUN, or allow more current or heat.")  # fmt: skip


def _chosen(
    every: Sequence[Candidate],
    told: dict[int, np.ndarray],
    judge: Judge,
    settings: CampaignSettings,
    criterion: Criterion,
) -> list[int]:
    """Indices of the tests, best first."""
    asked = _relative(judge.layout, judge.x, judge.covariance(sum(told.values()))) < settings.told
    if not asked.any():
        asked[:] = True

    def size(more: np.ndarray | float) -> float:
        return criterion.of(_relative(judge.layout, judge.x, judge.covariance(more))[asked])

    chosen: list[int] = []
    more = np.zeros_like(judge.information)
    while len(chosen) < settings.tests:
        left = {k: each for k, each in told.items() if k not in chosen}
        if not left:
            break
        here = size(more)
        drop = {k: here - size(more + each) for k, each in left.items()}
        best = max(drop, key=lambda k: drop[k] / (every[k].seconds + settings.handling))
        if chosen and drop[best] < settings.least:
            break
        chosen.append(best)
        more = more + told[best]
    return chosen


def _relative(layout: Layout, x: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(covariance)) / layout.reach(x)


def _ordered(every: Sequence[Candidate], chosen: Sequence[int]) -> list[int]:
    """By what has to be done to the rig: driven plate, open terminals, held plate, gear apart; then as chosen."""

    def effort(k: int) -> int:
        b = TEST_BY_NAME[every[k].plan.test].boundary
        return 3 if b.gear_apart else 2 if b.plate_held else 1 if b.terminals_open else 0

    return sorted(chosen, key=effort)


def _widening(at: FitResult | None, judge: Judge) -> np.ndarray:
    """Stated standard errors over those of the Fisher information, at least 1, shape (P,)."""
    if at is None:
        return np.ones(judge.x.size)
    return np.maximum(_relative(judge.layout, judge.x, at.taken_as_exact().covariance) / judge.sd, 1.0)


def _tests(
    every: Sequence[Candidate],
    seen: Sequence[Forecast],
    chosen: Sequence[int],
    told: dict[int, np.ndarray],
    judge: Judge,
    wide: np.ndarray,
    winding: Winding,
) -> Iterator[PlannedTest]:
    more = np.zeros_like(judge.information)
    for number, k in enumerate(chosen, 1):
        before = wide * _relative(judge.layout, judge.x, judge.covariance(more))
        more = more + told[k]
        after = wide * _relative(judge.layout, judge.x, judge.covariance(more))
        pause = winding.pause(float(seen[k].warmth[:, -1].max()))
        yield PlannedTest(every[k], seen[k], before, after, pause, f"{every[k].plan.test}/plan_{number}.csv")


def remark(test: PlannedTest, s: Setting) -> str:
    """Channels that this rig has not logged so far and the test needs, or ""."""
    new = [name.replace("_", " ") for name in channels(test.candidate.plan, s) if name in s.assumed]
    return f"{', '.join(new)} not logged so far: noise assumed" if new else ""


_SLACK = 0.03  # of what a quantity does in a test: what no model promises
_NOISE = 3.0  # standard deviations of a sample


def band(test: PlannedTest, s: Setting, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Between what a channel should stay, SI, shape (n,) each: range over the models, noise, and 3 % of its span."""
    values = test.forecast.shown[name]
    slack = _SLACK * float(np.ptp(values[0])) + _NOISE * s.noise[name]
    return values.min(axis=0) - slack, values.max(axis=0) + slack
