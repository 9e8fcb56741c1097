"""Effects too faint to be named: intervals hold where one may be there or not, and no wider than they must be."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import ndtr

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.faint_effects import PRIOR, SIZES, Linear, Part, faint_parts, mixed, own_ways, parts_of, widening
from etcfit.diagnosis.tangents import Variant
from etcfit.estimation.intervals import Z_95
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.parameters import parameters_of

GRAVITY, LOAD = (EFFECT_BY_NAME[n] for n in ("gravity_load", "load_dependent_friction"))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


# ---- the interval of a mixture


@pytest.mark.parametrize(("weights", "spread"), [([0.3], [5.0]), ([0.02], [400.0]), ([0.2, 0.5], [3.0, 1.5])])
def test_the_interval_holds_95_percent_of_the_mixture(weights: list[float], spread: list[float]) -> None:
    shares, sds = np.array(weights), np.array(spread)
    q = Z_95 * widening(1.0, shares, sds)
    outside = 2.0 * (1.0 - shares.sum()) * ndtr(-q) + 2.0 * shares @ ndtr(-q / sds)
    assert outside == pytest.approx(0.05, rel=1e-3)


def test_what_is_unlikely_widens_little_however_far_it_would_move_a_parameter() -> None:
    assert 1.0 < widening(1.0, np.array([0.02]), np.array([1e6])) < 1.2
    assert widening(1.0, np.array([0.5]), np.array([1.0])) == 1.0
    assert widening(1.0, np.array([]), np.array([])) == 1.0


def test_the_effects_behind_a_wider_interval_are_named_and_the_others_not() -> None:
    wide, narrow = np.array([100.0, 0.0]), np.array([1e-6, 1e-6])
    found = mixed(np.ones(2), [Part("a", 0.0, wide), Part("b", 0.0, narrow), Part("c", -40.0, wide)])
    assert found.behind == ("a",)
    assert found.factor[0] > 3.0
    assert found.factor[0] == pytest.approx(widening(1.0, np.full(2, 1 / 3), np.sqrt([101.0, 1.0])), rel=1e-4)
    assert found.factor[1] == pytest.approx(1.0, abs=1e-4)


# ---- one experiment after the other, in which an effect is there as often as the prior says


class Coverage(NamedTuple):
    """Shares of intervals that hold: of the fit, and widened; and how much wider they are in the mean."""

    fitted: float
    widened: float
    factor: float


def coverage(amplitude: float | None, rng: np.random.Generator, experiments: int = 3000) -> Coverage:
    """Of one parameter, beside an effect that looks much like it.

    Args:
        amplitude: of the effect; None: there or not, and of any size, as the prior says.
    """
    n = 200
    along, other = rng.normal(size=(2, n))
    jacobian, columns = along[:, None], (along + 0.3 * other)[:, None]
    variant, mine = Variant(GRAVITY, {}, ("T_g",)), parameters_of(GRAVITY)
    held = np.zeros(3)
    for _ in range(experiments):
        there = rng.uniform() < PRIOR / (1.0 + PRIOR)
        a = rng.choice(SIZES) * rng.normal() * there if amplitude is None else amplitude
        r = rng.normal(size=n) + columns[:, 0] * a
        x = -float(along @ r) / float(along @ along)
        r = r + along * x
        own = columns - jacobian @ np.linalg.lstsq(jacobian, columns)[0]
        linear = Linear(own.T @ own, own.T @ r, -np.linalg.lstsq(jacobian, columns)[0])
        sd = 1.0 / np.linalg.norm(along)
        parts = parts_of(variant, mine, linear, own_ways(own.T @ own, np.sum(columns**2, axis=0)))
        factor = mixed(np.array([sd]), parts).factor[0]
        held += abs(x) < Z_95 * sd, abs(x) < Z_95 * sd * factor, factor / experiments
    return Coverage(held[0] / experiments, held[1] / experiments, held[2])


def test_intervals_hold_95_percent_where_an_effect_is_there_as_often_as_is_believed(rng: np.random.Generator) -> None:
    """3000 experiments: a rate of 95 % is known to +-1.2 % (3 standard deviations)."""
    found = coverage(None, rng)
    assert found.fitted < 0.93
    assert found.widened == pytest.approx(0.95, abs=0.012)


def test_where_nothing_is_there_intervals_grow_little(rng: np.random.Generator) -> None:
    found = coverage(0.0, rng)
    assert found.fitted == pytest.approx(0.95, abs=0.012)
    assert 0.95 < found.widened < 0.97
    assert found.factor < 1.2


def test_where_the_data_half_show_an_effect_intervals_hold_far_more_often(rng: np.random.Generator) -> None:
    """Its amplitude is 3 standard errors: too little for a name."""
    found = coverage(3.0 / (0.3 * np.sqrt(200.0)), rng, 1000)
    assert found.fitted < 0.01
    assert found.widened > 0.6


# ---- what parameters imitate


def test_an_effect_that_is_a_parameter_by_another_name_widens_nothing() -> None:
    power = np.array([4.0, 9.0])
    assert own_ways(np.zeros((2, 2)), power).shape == (2, 0)
    linear = Linear(np.zeros((1, 1)), np.zeros(1), np.full((3, 1), 1e3))
    assert parts_of(Variant(GRAVITY, {}, ("T_g",)), parameters_of(GRAVITY), linear, np.zeros((1, 0))) == []


def test_of_two_amplitudes_only_the_way_counts_that_no_parameter_imitates() -> None:
    """The sum of both is another name for dry friction, their difference is not."""
    gram = np.array([[1.0, -1.0], [-1.0, 1.0]])
    (way,) = own_ways(gram, np.array([2.0, 2.0])).T
    assert_allclose(np.abs(way), np.full(2, np.sqrt(0.5)))
    assert way.sum() == pytest.approx(0.0, abs=1e-12)


def test_an_amplitude_that_cannot_be_negative_is_half_as_likely_on_the_wrong_side() -> None:
    def logs(side: float) -> np.ndarray:
        linear = Linear(np.array([[100.0]]), np.array([side * -20.0]), np.ones((1, 1)))
        mine = parameters_of(LOAD)
        return np.array([p.log_weight for p in parts_of(Variant(LOAD, {}, (mine[0].symbol,)), mine, linear, np.eye(1))])

    right, wrong = logs(1.0), logs(-1.0)
    size = SIZES[0]
    spread = 1.0 / (100.0 + size**-2)
    expected = np.log(ndtr(20.0 * np.sqrt(spread))) - np.log(ndtr(-20.0 * np.sqrt(spread)))
    assert right[0] - wrong[0] == pytest.approx(expected)


# ---- on a model


def test_every_effect_of_the_throttle_that_is_not_in_the_model_takes_part(small: CandidateModel) -> None:
    parts = faint_parts(small)
    assert {part.effect for part in parts} == {"gravity_load"}
    assert len(parts) == len(SIZES)
    assert all(part.moved.shape == small.x.shape and (part.moved > 0.0).all() for part in parts)
    assert faint_parts(small.with_effects((GRAVITY,), {"T_g": 0.2})) == []
