"""Sets of effects beside what the rounds found: which pairs are worth a refit, which of two models is better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import ClassVar

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from diagnoses import score
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import resting
from etcfit.diagnosis.loop import ScoredCandidates
from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.sets import Pair, Promise, compared_with, in_place_of, is_open, pairs, promising, rivals
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import Variant, variants
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME, AbstractEffect
from etcfit.model.parameters import NonNegative, Positive, Real, Scalar, parameter, parameters_of
from etcfit.problem import weights
from etcfit.problem.problem import EstimationProblem

LIMP, AIR, GRAVITY, HEAT, DRAG = (
    EFFECT_BY_NAME[name]
    for name in ("limp_home_spring", "airflow_torque", "gravity_load", "winding_heating", "quadratic_drag")
)
SETTINGS = DiagnosisSettings(pair_refits=2)
ALONE = {LIMP: 900.0, AIR: 700.0, GRAVITY: 600.0, HEAT: 300.0, DRAG: 5.0}


def pair(a: type, b: type, gain: float) -> Pair:
    return Pair((a, b), gain, resting(a) | resting(b))


def promise() -> Promise:
    """Ten of BIC an effect, one for each unit of chi2."""
    return Promise(1.0, dict.fromkeys(ALONE, 10.0), ALONE)


def names(pairs: Sequence[Pair]) -> list[set[type]]:
    return [set(p.effects) for p in pairs]


@pytest.mark.parametrize(
    ("added", "white", "expected"),
    [(0, True, False), (1, True, False), (0, False, True), (1, False, True), (2, True, True)],
)
def test_other_sets_are_asked_for_where_more_than_noise_is_left_or_several_were_found(
    added: int, white: bool, expected: bool
) -> None:
    assert is_open(added, white) is expected


def test_pairs_that_promise_more_than_what_the_rounds_found_are_refitted() -> None:
    every = [pair(AIR, HEAT, 1500.0), pair(GRAVITY, HEAT, 1300.0), pair(LIMP, HEAT, 1200.0), pair(LIMP, DRAG, 910.0)]
    assert names(promising(every, promise(), (LIMP, HEAT), SETTINGS)) == [{AIR, HEAT}, {GRAVITY, HEAT}]


def test_what_the_rounds_found_is_not_refitted_nor_what_promises_less() -> None:
    every = [pair(LIMP, HEAT, 1500.0), pair(AIR, HEAT, 1490.0)]
    assert promising(every, promise(), (LIMP, HEAT), SETTINGS) == []
    assert promising(every[1:], promise(), (LIMP,), SETTINGS) == every[1:]


def test_a_pair_whose_second_effect_is_not_worth_its_price_is_not_refitted() -> None:
    """11 more than alone are worth 1 beyond their price; a second effect must promise 10."""
    assert promising([pair(LIMP, DRAG, 911.0)], promise(), (), SETTINGS) == []
    assert names(promising([pair(LIMP, DRAG, 921.0)], promise(), (), SETTINGS)) == [{LIMP, DRAG}]


def test_no_more_pairs_are_refitted_than_the_settings_allow() -> None:
    every = [pair(AIR, HEAT, 1500.0), pair(GRAVITY, HEAT, 1400.0), pair(GRAVITY, AIR, 1300.0)]
    assert promising(every, promise(), (), DiagnosisSettings(pair_refits=1)) == every[:1]
    assert promising(every, promise(), (), DiagnosisSettings(pair_refits=0)) == []


def test_effects_cost_their_parameters_and_the_variants_they_were_chosen_from(model: CandidateModel) -> None:
    signatures = [Signature(v, np.zeros((1, 1)), 5.0, {}, 0.5) for e in (LIMP, GRAVITY) for v in variants(e)]
    data = ScoredCandidates(Background.spanned(np.zeros(1), np.zeros((1, 0))), signatures)
    before = score(1000.0)
    told = Promise.of_candidates(before, data, model.composition)
    assert told.price[GRAVITY] == pytest.approx(np.log(before.count))
    several = len(resting(LIMP)) * np.log(before.count) + 2.0 * np.log(len(variants(LIMP)))
    assert told.price[LIMP] == pytest.approx(several)
    gain = 100.0 * before.count / before.chi2
    assert told.worth((LIMP, GRAVITY), 100.0) == pytest.approx(gain - told.price[LIMP] - told.price[GRAVITY])


def test_rivals_of_one_of_a_pair_explain_half_of_it_beside_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    best = pair(AIR, HEAT, 1500.0)
    every = [best, pair(LIMP, HEAT, 1400.0), pair(GRAVITY, HEAT, 850.0), pair(AIR, LIMP, 1450.0)]
    assert rivals(AIR, best, every, promise(), SETTINGS) == {LIMP: resting(LIMP)}
    assert rivals(HEAT, best, every, promise(), SETTINGS) == {LIMP: resting(LIMP)}
    monkeypatch.setattr("etcfit.diagnosis.sets.EXCHANGE_RIVAL", 0.4)
    assert rivals(AIR, best, every, promise(), SETTINGS).keys() == {LIMP, GRAVITY}


def test_what_gave_way_is_said_and_that_nothing_did() -> None:
    assert in_place_of((LIMP,), (AIR, HEAT)) == (
        "limp_home_spring gave way to airflow_torque and winding_heating, scored together."
    )
    assert in_place_of((), (AIR, HEAT)).startswith("Nothing was found one by one")


# ---- of two models


def test_a_model_near_the_data_is_better_than_one_that_is_far(small: CandidateModel) -> None:
    far = replace(small, end=Termination(True, "by hand", far=True))
    assert compared_with(small, far) == (None, True, None)
    assert compared_with(far, small) == (None, False, None)
    assert compared_with(far, far) == (None, False, None)


def near(small: CandidateModel, gravity: float) -> CandidateModel:
    """On data that the model predicts with a gravity load, and noise: far from the data there are many minima, and two
    models that end in different ones do not compare."""
    truth = small.with_effects((GRAVITY,), {"T_g": gravity})
    bare = small.problem
    rng = np.random.default_rng(5)
    traces = tuple(
        replace(t, data=predicted + t.sigma * rng.standard_normal(predicted.shape))
        for t, predicted in zip(bare.batch.traces, truth.problem.free_run(truth.x), strict=True)
    )
    problem = EstimationProblem.of_traces(bare.config, bare.free_parameters, traces)
    weighted = problem.weighted(weights.free_running(problem))
    return replace(small, problem=problem, weighted=weighted, holdout=(problem, weighted))


@pytest.mark.slow
@pytest.mark.parametrize(("gravity", "better"), [(0.0, False), (0.15, False), (0.4, True)])
def test_of_two_models_near_the_data_bic_decides(small: CandidateModel, gravity: float, better: bool) -> None:
    bare = near(small, gravity).optimised()
    more = bare.with_effects((GRAVITY,), {"T_g": 0.02}).optimised()
    there, back = compared_with(more, bare), compared_with(bare, more)
    assert there.bic_change is not None
    assert back.bic_change is not None
    assert there.bic_change == pytest.approx(-back.bic_change, rel=0.05, abs=0.5)
    assert (there.better, back.better) == (better, False)
    assert (there.apart is not None) == (abs(there.bic_change) < 6.0)


# ---- Pairs scored together, against least squares with bounds on made-up problems

N = 200


class First(AbstractEffect):
    """One amplitude of either sign, of which two shapes are tried."""

    name = "first"
    off: ClassVar[Mapping[str, float] | None] = {"a": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"p": (1.0, 2.0)}
    a: Scalar = parameter("N*m", Real(0.5), 0.0, "one", "a test")
    p: Scalar = parameter("1", Positive(1.0), 1.0, "shape", "a test")


class Second(AbstractEffect):
    """Two amplitudes that cannot be negative."""

    name = "second"
    off: ClassVar[Mapping[str, float] | None] = {"c": 0.0, "d": 0.0}
    c: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "one", "a test")
    d: Scalar = parameter("N*m", NonNegative(3.0), 0.0, "another", "a test")


class Third(AbstractEffect):
    """One amplitude that does a little of what the two others do."""

    name = "third"
    off: ClassVar[Mapping[str, float] | None] = {"e": 0.0}
    e: Scalar = parameter("N*m", Real(2.0), 0.0, "one", "a test")


class Tried(AbstractEffect):
    """An amplitude that shows nothing while it is small: it is tried at one value."""

    name = "tried"
    off: ClassVar[Mapping[str, float] | None] = {"f": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"f": (0.6,)}
    f: Scalar = parameter("1", NonNegative(0.3), 0.0, "one", "a test")


PARAMETERS = {p.symbol: p for e in (First, Second, Third, Tried) for p in parameters_of(e)}
VARIANTS = (
    Variant(First, {"p": 1.0}, ("a",)),
    Variant(First, {"p": 2.0}, ("a",)),
    Variant(Second, {}, ("c", "d")),
    Variant(Third, {}, ("e",)),
    Variant(Tried, {"f": 0.6}, ("f",)),
)


@pytest.fixture(params=range(6))
def case(request: pytest.FixtureRequest) -> tuple[Background, list[Signature]]:
    """The residual lacks First at its second shape and Second; Third is half of each."""
    rng = np.random.default_rng(request.param)
    columns = [rng.normal(size=(N, len(v.amplitudes))) for v in VARIANTS]
    columns[3] = columns[1] + columns[2][:, :1] + 0.1 * rng.normal(size=(N, 1))
    r = 0.1 * rng.normal(size=N) - columns[1][:, 0] - columns[2] @ [1.0, 0.4]
    background = Background.spanned(r, rng.normal(size=(N, 3)))
    return background, [background.signature(v, c, PARAMETERS) for v, c in zip(VARIANTS, columns, strict=True)]


def gain(a: Signature, b: Signature, r: np.ndarray) -> float:
    """By least squares with bounds over all samples; what is tried at one value stays there."""
    target, free, low = -r, [], []
    for s in (a, b):
        domains = [PARAMETERS[symbol].domain for symbol in s.variant.amplitudes]
        if s.variant.effect is Tried:
            target = target - s.columns @ np.array([0.6 / domains[0].scale])
        else:
            free.append(s.columns)
            low += [0.0 if isinstance(d, NonNegative) else -np.inf for d in domains]
    columns = np.concatenate(free, axis=1)
    left = lsq_linear(columns, target, bounds=(low, np.inf)).x
    return float(r @ r - np.sum((columns @ left - target) ** 2))


def test_every_pair_is_what_bounded_least_squares_gives_at_its_best_shapes(
    case: tuple[Background, list[Signature]],
) -> None:
    background, signatures = case
    expected: dict[frozenset[type], float] = {}
    for a, b in combinations(signatures, 2):
        if a.variant.effect is not b.variant.effect:
            key = frozenset((a.variant.effect, b.variant.effect))
            expected[key] = max(expected.get(key, 0.0), gain(a, b, background.r))
    found = pairs(signatures, background.r, 100)
    assert {frozenset(p.effects): p.gain for p in found} == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert [p.gain for p in found] == sorted((p.gain for p in found), reverse=True)


def best(case: tuple[Background, list[Signature]]) -> Pair:
    return pairs(case[1], case[0].r, 1)[0]


def test_two_that_are_missing_come_before_one_that_does_half_of_each(case: tuple[Background, list[Signature]]) -> None:
    """Alone, the third explains most: round by round it would be the first."""
    assert max(case[1], key=lambda s: s.gain).variant.effect is Third
    found = best(case)
    assert set(found.effects) == {First, Second}
    assert found.values["p"] == 2.0
    told = [found.values[s] / PARAMETERS[s].domain.scale for s in ("a", "c", "d")]
    assert told == pytest.approx([1.0, 1.0, 0.4], abs=0.05)


def test_only_as_many_as_asked_and_those_are_the_best(case: tuple[Background, list[Signature]]) -> None:
    background, signatures = case
    every = pairs(signatures, background.r, 100)
    assert [frozenset(p.effects) for p in pairs(signatures, background.r, 2)] == [
        frozenset(p.effects) for p in every[:2]
    ]


def test_what_parameters_imitate_wholly_makes_no_pair(case: tuple[Background, list[Signature]]) -> None:
    background, signatures = case
    hidden = background.signature(VARIANTS[3], background.basis[:, :1], PARAMETERS)
    assert hidden.own == 0.0
    assert not any(Third in p.effects for p in pairs([*signatures[:3], hidden], background.r, 9))
    assert pairs([hidden], background.r, 9) == ()
