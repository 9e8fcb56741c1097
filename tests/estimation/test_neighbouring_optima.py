"""Which of several optima that lie side by side is kept, and what the others say of the parameters."""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import pytest

from etcfit.estimation import rounds
from etcfit.estimation.levenberg_marquardt import LinearisedProblem
from etcfit.estimation.result import Reason, Termination
from etcfit.estimation.rounds import Reached, likeliest_nearby
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
    samples: float = 2.0


class Coordinates:
    """Each of which changes by a hundred percent over 1."""

    def reach(self, x: np.ndarray) -> np.ndarray:
        return np.ones(x.size)

    def off_bounds(self, x: np.ndarray) -> np.ndarray:
        return x

    def log_distance(self, x: np.ndarray, other: np.ndarray) -> np.ndarray:
        return other - x


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
    """chi2 with the prior of what only stands for a problem; of real ones: tests/problem/test_residual_kernels.py."""

    def chi2_of(problem: Any, points: np.ndarray, weighted: Any) -> np.ndarray:
        priors = np.sum(((points - weighted.prior_mean) / weighted.prior_sd) ** 2, axis=1)
        return np.array([problem.chi2(x, weighted) for x in points]) + priors

    monkeypatch.setattr(rounds, "chi2_of", chi2_of)
    monkeypatch.setattr(rounds, "descend_in_stages", lambda problem, x, *_: (x, 1))
    monkeypatch.setattr(rounds, "with_lag_of_start", lambda start, problem, x: x)


@pytest.mark.parametrize("sd", [0.2, 0.5, 2.0])
def test_the_deviance_is_that_of_normal_samples_and_of_the_prior(sd: float) -> None:
    x = 1.3
    by_hand = sum(((y - x) / sd) ** 2 + np.log(sd**2) for y in (1.0, 2.0)) + ((x - 1.0) / 0.1) ** 2
    assert end(x, sd, prior_sd=0.1).deviance == pytest.approx(by_hand, rel=1e-12)


def test_a_filter_that_expects_large_errors_is_not_likelier_for_its_small_chi2() -> None:
    near, lax = end(1.5, 0.5), end(1.5, 50.0)
    assert lax.problem.chi2(lax.x, None) < near.problem.chi2(near.x, None)
    assert lax.deviance > near.deviance


# ---- rounds that do not settle


class Alternating(Line):
    """Two optima take turns, whatever the filter: the data are likeliest half way."""

    def __init__(self) -> None:
        super().__init__(0.5)
        self.batch = None

    def kalman(self, about: np.ndarray) -> Any:
        return None

    def weighted(self, whitening: Any) -> Any:
        return end(1.0, self.sd).weighted


@pytest.mark.parametrize(("optima", "kept"), [((1.2, 1.8), 1.5), ((1.5, 1.5), 1.5), ((1.49, 1.9), 1.49)])
def test_rounds_that_alternate_end_where_the_data_are_likeliest(
    optima: tuple[float, float], kept: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    turns = itertools.cycle(optima)
    for way in ("descend", "minimise"):
        monkeypatch.setattr(rounds, way, lambda *_: (np.array([next(turns)]), 1))
    monkeypatch.setattr(rounds, "columns", lambda *_: [])
    monkeypatch.setattr(rounds.weights, "timed", lambda problem, *_: problem)
    monkeypatch.setattr(rounds.weights, "outliers_weighed", lambda problem, _: (problem, 0))
    here = LinearisedProblem(1.0, np.array([[0.01]]), 0.0, np.zeros(1))
    monkeypatch.setattr(rounds, "linearise_at", lambda *_: here)
    line: Any = Alternating()
    reached = rounds.rounds(line, np.array([3.0]), lambda *_: None, 0.05, 10)
    assert reached.x[0] == pytest.approx(kept, abs=0.02)
    assert reached.end.wander is not None
    moved = float(np.max(np.abs(reached.end.wander))) / 0.1
    assert (reached.end.reason_code is Reason.OPTIMUM) is (moved < 1.0)


class Rounds:
    """Rounds that lead to given places in turn, wherever they begin, and then to the last of them."""

    def __init__(self, *places: float) -> None:
        self.places, self.begun, self.most = list(places), list[float](), list[int]()

    def __call__(self, problem: Any, x: np.ndarray, report: Any, still: float, most: int, settings: Any) -> Any:
        self.begun.append(float(x[0]))
        self.most.append(most)
        place = self.places.pop(0) if len(self.places) > 1 else self.places[0]
        return end(place, wander=np.array([[0.01]]))


def nearby(first: Any, follow: Rounds, monkeypatch: pytest.MonkeyPatch, **settings: Any) -> Any:
    monkeypatch.setattr(rounds, "rounds", follow)
    monkeypatch.setattr(rounds, "concurrently", lambda work, of: [work(each) for each in of])
    for constant in [name for name in settings if name.isupper()]:
        monkeypatch.setattr(rounds, constant, settings.pop(constant))
    return likeliest_nearby(first, np.array([1.0]), lambda *_: None, FitSettings(**settings))


def test_the_likeliest_end_is_kept_and_the_others_widen_it(monkeypatch: pytest.MonkeyPatch) -> None:
    first = end(1.9)
    kept = nearby(first, Rounds(1.5, 1.2, 1.5, 1.2), monkeypatch, neighbours=2, SEARCHES=1)
    assert kept.x[0] == 1.5
    less = [each.deviance - end(1.5).deviance for each in (first, end(1.5), end(1.2))]
    weight = np.exp(-0.5 / rounds.ROUGHNESS * np.array(less))
    expected = 0.01**2 + np.sum(weight / weight.sum() * np.array([0.4, 0.0, -0.3]) ** 2)
    assert kept.end.wander is not None
    assert float(np.sum(kept.end.wander**2)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("neighbours", [0, 3])
def test_none_is_looked_for_where_none_is_asked_for_or_nothing_can_be_computed(
    neighbours: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, rounds = end(1.9 if neighbours == 0 else -1.0), Rounds(1.5)
    assert nearby(first, rounds, monkeypatch, neighbours=neighbours) is first
    assert not rounds.begun


def test_an_end_far_from_the_likeliest_after_the_first_rounds_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    rounds = Rounds(1.6, 4.0, 1.5)
    settings = {"neighbours": 2, "SEARCHES": 1, "HOPEFUL": 4.0, "FIRST_ROUNDS": 3, "rounds": 12}
    assert nearby(end(1.9), rounds, monkeypatch, **settings).x[0] == 1.5
    assert rounds.most == [3, 3, 9]
    assert rounds.begun[2] == 1.6


@pytest.mark.parametrize(("explained", "about", "spread"), [(1e9, 4.0, 0.05), (1e-9, 1.0, 0.35)])
def test_points_are_drawn_about_an_end_that_explains_the_data_or_else_about_the_start(
    explained: float, about: float, spread: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = {"neighbours": 40, "NEIGHBOURHOOD": (0.05,), "spread": 0.35, "SEARCHES": 1, "FIRST_ROUNDS": 1}
    nearby(end(4.0), follow := Rounds(1.5), monkeypatch, EXPLAINED=explained, **settings)
    drawn = np.array([x for x, most in zip(follow.begun, follow.most, strict=True) if most == 1])
    assert drawn.size == 40
    assert abs(drawn.mean() - about) < 4.0 * spread / np.sqrt(40.0)
    assert 0.6 * spread < drawn.std() < 1.4 * spread


def test_points_are_drawn_again_about_a_likelier_end_until_nothing_is_gained(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"neighbours": 4, "NEIGHBOURHOOD": (0.05,), "EXPLAINED": 1e9, "FIRST_ROUNDS": 1, "HOPEFUL": 0.0}
    places = [*[3.0] * 4, *[2.5] * 4, 1.5]
    for searches, times in ((9, 4), (2, 2)):
        kept = nearby(end(4.0), follow := Rounds(*places), monkeypatch, SEARCHES=searches, **settings)
        drawn = np.array([x for x, most in zip(follow.begun, follow.most, strict=True) if most == 1])
        assert drawn.size == 4 * times  # about 4.0, 3.0, 2.5 and 1.5; from there on nothing is gained
        assert np.all(np.abs(drawn.reshape(times, 4).mean(axis=1) - [4.0, 3.0, 2.5, 1.5][:times]) < 0.1)
        assert kept.x[0] == [4.0, 3.0, 2.5, 1.5][min(times, 3)]


def test_ends_are_sought_often_enough_where_nothing_is_gained(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"neighbours": 4, "FIRST_ROUNDS": 1, "EXPLAINED": 1e9, "HOPEFUL": 0.0}
    nearby(end(1.5), follow := Rounds(1.5), monkeypatch, **settings)
    assert follow.most.count(1) == 4 * rounds.ENOUGH


def test_the_search_goes_on_while_nothing_explains_the_data(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"neighbours": 4, "SEARCHES": 3, "FIRST_ROUNDS": 1, "EXPLAINED": 1e-9}
    nearby(end(1.5), follow := Rounds(1.5), monkeypatch, **settings)
    assert follow.most.count(1) == 3 * 4
