"""The next best test: what one more trace of each kind would do to the intervals, before anybody measures it.

    F' = F + J_k^T J_k,    sd' / sd = sqrt((F'^-1)_ss / (F^-1)_ss)

J_k is the whitened Jacobian of a trace that does not exist yet, simulated as planned with the rig's own noise, or that
of a trace that is there, measured once more.
Source: optimal experiment design by Fisher information, Ljung 1999, ch. 13. Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..estimation.identifiability import analyse
from ..estimation.levenberg_marquardt import fisher_information
from ..estimation.ready import ready, start_values
from ..estimation.result import FitResult
from ..problem import weights
from ..problem.free_parameters import FreeParameters, Layout, free_parameters
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from ..rig import TESTS
from ..rig.base import Rig
from ..rig.paper_readings import read_graphs
from .plan import PLANS, Plan, Setting, remark, sweeps, trace_of
from .settings import AdviceSettings

_ENTANGLED = 0.5  # rho^2 above which two parameters are said to be entangled


@dataclass(frozen=True)
class Pair:
    """Two parameters and the correlation of their estimates, now and after one more trace."""

    symbols: tuple[str, str]
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Option:
    """One more trace."""

    test: str  # rig test
    says: str  # how it is made
    remark: str  # what was assumed, or ""
    shrinks: np.ndarray  # width of each interval after it as a share of what it is now, shape (P,)
    separates: Pair | None  # the pair that it tells apart best; None where it tells none apart
    plan: Plan | None  # what is driven and when; None where it is a trace that is there, made once more

    @property
    def again(self) -> bool:
        """Whether it repeats a trace that was measured already."""
        return self.plan is None

    @property
    def mean(self) -> float:
        """Geometric mean of the shares: the volume of what is not known, one dimension of it."""
        return float(np.exp(np.mean(np.log(self.shrinks))))


@dataclass(frozen=True, eq=False)
class Advice:
    """What to measure next."""

    rig: Rig  # the measurements
    symbols: tuple[str, ...]  # free parameters, P
    sd: np.ndarray  # standard errors now, relative (of a factor, where a parameter is positive), shape (P,)
    options: tuple[Option, ...]  # best first
    not_judged: tuple[tuple[str, str], ...]  # tests that no trace can be simulated of, with the reason
    settings: AdviceSettings = AdviceSettings()  # what it was decided by


def advise(rig: Rig, at: FitResult | None = None, settings: AdviceSettings = AdviceSettings()) -> Advice:
    """Judge one more trace of each rig test, and of a driven response that is chosen for what it adds.

    Args:
        at: the fit to judge at, of this rig, with its effects; None: Eqs. 1-2 and what rig.toml names, at the paper's
            graph readings.
    Raises:
        MeasurementError: nothing can be fitted.
    """
    known, x = judged_at(rig, at)
    fitted, _, _ = ready(rig)
    problem = EstimationProblem.of_traces(rig.config, known, fitted).refined(x)
    judge, now = judge_of(problem, known.layout, x, settings)
    again = [_again(test.name, fitted, now, judge) for test in TESTS if test.name in {t.test.name for t in fitted}]
    planned = list(_planned(problem, x, Setting.of_rig(rig, known.values(x), settings.plan), judge))
    options = sorted((*again, *planned), key=lambda option: option.mean)
    unknown = "what the ECU does is not known before it is logged"
    judged = {option.test for option in options}
    not_judged = [(test.name, "no plan for it" if test.name in PLANS else unknown) for test in TESTS
                  if test.name not in judged]  # fmt: skip
    return Advice(rig, known.layout.free, judge.sd(), tuple(options), tuple(not_judged), settings)


def judged_at(rig: Rig, at: FitResult | None) -> tuple[FreeParameters, np.ndarray]:
    """What is free in the model that is judged, and its coordinates, shape (P,)."""
    if at is not None:
        return at.free_parameters, at.x
    known = free_parameters(rig.config)
    return known, known.layout.coordinates(start_values(known, read_graphs(rig)))


@dataclass(frozen=True, eq=False)
class Judge:
    """What is known now, and what would be known with more."""

    layout: Layout  # which parameters x stands for
    x: np.ndarray  # coordinates, shape (P,)
    information: np.ndarray  # Fisher information of all that is there, shape (P, P)
    settings: AdviceSettings = AdviceSettings()  # see `separated`

    def covariance(self, more: np.ndarray | float = 0.0) -> np.ndarray:
        """Covariance of the coordinates with further information, shape (P, P)."""
        return analyse(self.layout, self.x, self.information + more).covariance

    def sd(self, more: np.ndarray | float = 0.0) -> np.ndarray:
        """Relative standard errors with further information, shape (P,)."""
        return self.relative(self.covariance(more))

    def relative(self, covariance: np.ndarray) -> np.ndarray:
        """Relative standard errors of a covariance of the coordinates, shape (P,)."""
        return np.sqrt(np.diag(covariance)) / self.layout.reach(self.x)

    def gain(self, more: np.ndarray) -> tuple[np.ndarray, Pair | None]:
        """What further information, shape (P, P), does.

        Returns:
            width of each interval as a share of what it is now, shape (P,), and the pair it tells apart, or None.
        """
        before, after = self.covariance(), self.covariance(more)
        return np.sqrt(np.diag(after) / np.diag(before)), separated(self.layout.free, before, after, self.settings)


def judge_of(
    problem: EstimationProblem, layout: Layout, x: np.ndarray, settings: AdviceSettings
) -> tuple[Judge, list[np.ndarray]]:
    """Information of a problem's priors and traces, and of each trace, shape (P, P)."""
    now = informations(problem, x)
    prior_sd = problem.weighted(weights.free_running(problem)).prior_sd[: x.size]
    return Judge(layout, x, fisher_information(prior_sd, np.zeros((0, x.size))) + sum(now), settings), now


def separated(
    symbols: Sequence[str], before: np.ndarray, after: np.ndarray, settings: AdviceSettings = AdviceSettings()
) -> Pair | None:
    """The pair whose entanglement 1 / (1 - rho^2) shrinks most, of those that are entangled now; None if none does.

    Args:
        symbols: free parameters, P.
        before, after: covariances of their coordinates now and with one more trace, shape (P, P).
        settings: what counts as apart.
    """
    was, then = _correlation(before), _correlation(after)
    pairs = [(i, j) for i, j in combinations(range(len(symbols)), 2) if was[i, j] ** 2 > _ENTANGLED]
    left = {(i, j): (1.0 - was[i, j] ** 2) / max(1.0 - then[i, j] ** 2, 1e-12) for i, j in pairs}
    if not left or min(left.values()) > settings.apart:
        return None
    i, j = min(left, key=lambda pair: left[pair])
    return Pair((symbols[i], symbols[j]), float(was[i, j]), float(then[i, j]))


def _correlation(covariance: np.ndarray) -> np.ndarray:
    sd = np.sqrt(np.diag(covariance))
    return np.clip(covariance / np.outer(sd, sd), -1.0, 1.0)


def informations(problem: EstimationProblem, x: np.ndarray) -> list[np.ndarray]:
    """J_k^T J_k of each trace of a problem at coordinates x, shape (P, P) each."""
    jacobian = problem.linearise(x, problem.weighted(problem.kalman(x))).jacobian
    out = []
    for trace, (lane, _, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        rows = jacobian[marks, lane, : len(trace.channels)].reshape(-1, x.size)
        rows = rows[np.isfinite(rows).all(axis=1)]
        out.append(rows.T @ rows)
    return out


def _again(test: str, traces: Sequence[Trace], informations: Sequence[np.ndarray], judge: Judge) -> Option:
    """The trace of a test that adds most, made once more."""
    options = [
        Option(test, f"once more, as {trace.measurement.file}", "", *judge.gain(more), None)
        for trace, more in zip(traces, informations, strict=True)
        if trace.test.name == test
    ]
    return min(options, key=lambda option: option.mean)


def _planned(problem: EstimationProblem, x: np.ndarray, setting: Setting, judge: Judge) -> Iterator[Option]:
    """A trace of each test that was not made yet, and the best of the driven responses."""
    if any(trace.torque_driven for trace in problem.batch.traces):
        return  # no supply is known, and no amplifier to drive it with
    made = {trace.test.name for trace in problem.batch.traces}
    absent = [plan(setting) for name, plan in PLANS.items() if name not in made]
    responses = sweeps(setting)
    plans = [*absent, *responses]
    traces = tuple(trace_of(plan, setting) for plan in plans)
    options = [
        Option(plan.test, plan.says, remark(plan, setting), *judge.gain(more), plan)
        for plan, more in zip(plans, informations_of_others(problem, traces, x), strict=True)
    ]
    yield from options[: len(absent)]
    yield min(options[len(absent) :], key=lambda option: option.mean)


def informations_of_others(problem: EstimationProblem, traces: Sequence[Trace], x: np.ndarray) -> Iterator[np.ndarray]:
    """J_k^T J_k of other traces, shape (P, P) each, batched in the shape of the problem so that what was compiled for
    it serves again."""
    most = problem.batch.steps.dt.shape[1]
    for some in (tuple(traces[k : k + most]) for k in range(0, len(traces), most)):
        other = EstimationProblem.of_traces(problem.config, problem.free_parameters, some, None, problem.room).refined(
            x
        )
        yield from informations(replace(other, jitter=problem.jitter), x)
