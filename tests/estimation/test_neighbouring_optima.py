"""Which of several optima that lie side by side is kept, and what the others say of the parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from etcfit.estimation import neighbouring_optima
from etcfit.estimation.neighbouring_optima import deepest_nearby, deviance
from etcfit.estimation.result import Termination
from etcfit.estimation.rounds import Reached
from etcfit.estimation.settings import FitSettings


class Samples(NamedTuple):
    """What counts of each sample: whether it was logged, or 1 / sqrt(S)."""

    weight: np.ndarray


class Weighted(NamedTuple):
    """Data, filter and prior."""

    slots: Samples
    whitening: Samples
    prior_mean: np.ndarray
    prior_sd: np.ndarray


class Known(NamedTuple):
    """What a linearisation tells."""

    covariance: np.ndarray


class Coordinates:
    """Each of which changes by a hundred percent over 1."""

    def reach(self, x: np.ndarray) -> np.ndarray:
        return np.ones(x.size)


class Line:
    """A straight line through the origin: residual (y - x) / sd for each of three samples, the last not logged."""

    def __init__(self, sd: float) -> None:
        self.y, self.sd = np.array([1.0, 2.0, np.nan]), sd
        self.layout = Coordinates()

    def residual(self, x: np.ndarray, weighted: Any) -> np.ndarray:
        return np.nan_to_num((self.y - x[0]) / self.sd)

    def chi2(self, x: np.ndarray, weighted: Any) -> float:
        return float(np.sum(self.residual(x, weighted) ** 2)) if x[0] > 0.0 else np.inf

    def with_instants(self, x: np.ndarray) -> Line:
        return self


def end(x: float, sd: float = 0.5, prior_sd: float = np.inf, wander: np.ndarray | None = None) -> Any:
    seen = np.array([1.0, 1.0, 0.0])
    weighted: Any = Weighted(Samples(seen), Samples(seen / sd), np.array([1.0]), np.array([prior_sd]))
    line: Any = Line(sd)
    return Reached(line, weighted, np.array([x]), Termination(True, "", wander=wander))


@pytest.fixture(autouse=True)
def _a_line_for_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    """chi2 with the prior of what only stands for a problem; of real ones: tests/problem/test_chi2.py."""

    def chi2_of(problem: Any, points: np.ndarray, weighted: Any) -> np.ndarray:
        priors = np.sum(((points - weighted.prior_mean) / weighted.prior_sd) ** 2, axis=1)
        return np.array([problem.chi2(x, weighted) for x in points]) + priors

    monkeypatch.setattr(neighbouring_optima, "chi2_of", chi2_of)


@pytest.mark.parametrize("sd", [0.2, 0.5, 2.0])
def test_the_deviance_is_that_of_normal_samples_and_of_the_prior(sd: float) -> None:
    x = 1.3
    by_hand = sum(((y - x) / sd) ** 2 + np.log(sd**2) for y in (1.0, 2.0)) + ((x - 1.0) / 0.1) ** 2
    assert deviance(end(x, sd, prior_sd=0.1)) == pytest.approx(by_hand, rel=1e-12)


def test_a_filter_that_expects_large_errors_is_not_likelier_for_its_small_chi2() -> None:
    near, lax = end(1.5, 0.5), end(1.5, 50.0)
    assert lax.problem.chi2(lax.x, None) < near.problem.chi2(near.x, None)
    assert deviance(lax) > deviance(near)


def test_the_likeliest_end_is_kept_and_the_others_widen_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = iter([end(1.5, wander=np.array([[0.01]])), end(1.2), end(-9.0)])
    monkeypatch.setattr(neighbouring_optima, "rounds", lambda *_: next(found))
    monkeypatch.setattr(neighbouring_optima, "local", lambda *_: Known(np.array([[0.01]])))
    first = end(1.9)
    kept = deepest_nearby(first, lambda *_: None, FitSettings(neighbours=2))
    assert kept.x[0] == 1.5
    weight = np.exp([-0.5 * (deviance(each) - deviance(end(1.5))) for each in (first, end(1.5), end(1.2), end(-9.0))])
    expected = 0.01**2 + np.sum(weight / weight.sum() * np.array([0.4, 0.0, -0.3, -10.5]) ** 2)
    assert kept.end.wander is not None
    assert float(np.sum(kept.end.wander**2)) == pytest.approx(expected, rel=1e-12)


def test_none_is_looked_for_where_none_is_asked_for() -> None:
    first = end(1.9)
    assert deepest_nearby(first, lambda *_: None, FitSettings(neighbours=0)) is first


def test_no_point_is_begun_from_that_the_model_cannot_compute(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[float] = []

    def rounds(problem: Any, x: np.ndarray, *_: Any) -> Any:
        begun.append(float(x[0]))
        return end(1.5)

    monkeypatch.setattr(neighbouring_optima, "rounds", rounds)
    monkeypatch.setattr(neighbouring_optima, "local", lambda *_: Known(np.array([[100.0]])))
    settings = FitSettings(neighbours=40, neighbourhood=(1.0,), within=2.0)
    deepest_nearby(end(1.5), lambda *_: None, settings)
    assert begun[0] == 1.5
    assert 1 < len(begun) < 41
    assert min(begun) > 0.0
    assert np.std(begun) < 2.0  # drawn no wider than `within` of a reach, though the covariance is wide
