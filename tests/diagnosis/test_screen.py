"""The score test on made-up linear problems whose answer least squares gives, and what is tried of each effect."""

from __future__ import annotations

import itertools
import math
import weakref
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import nnls

from etcfit.diagnosis import screen
from etcfit.diagnosis import tangents as tangents_module
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import compose, resting
from etcfit.diagnosis.loop import screened
from etcfit.diagnosis.screen import Background, Signature, bounded, lowest, ranked
from etcfit.diagnosis.tangents import Variant, fitted_samples, in_groups, serves, tangents, tangents_inside, variants
from etcfit.model.effects import COMMANDING, EFFECT_BY_NAME, EFFECTS, PAPER, AbstractEffect, Contribution, Inputs, State
from etcfit.model.parameters import NonNegative, Positive, Real, Scalar, parameter, parameters_of
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.problem.weights import free_running
from etcfit.rig.base import Rig

BEYOND = [e for e in EFFECTS if e not in PAPER]
N, P = 120, 4


class Either(AbstractEffect):
    """Two amplitudes of either sign, two shapes tried and one that is not."""

    name = "either"
    off: ClassVar[Mapping[str, float] | None] = {"a": 0.0, "b": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"p": (1.0, 2.0, 3.0), "q": (10.0, 20.0)}
    a: Scalar = parameter("N*m", Real(0.5), 0.0, "one", "a test")
    b: Scalar = parameter("N*m", Real(20.0), 0.0, "another", "a test")
    p: Scalar = parameter("1", Positive(1.0), 1.0, "shape", "a test")
    q: Scalar = parameter("1", Positive(10.0), 10.0, "shape", "a test")
    r: Scalar = parameter("1", Positive(7.0), 7.0, "shape", "a test")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=self.a + self.b)


class Bounded(AbstractEffect):
    """Two amplitudes that cannot be negative."""

    name = "bounded"
    off: ClassVar[Mapping[str, float] | None] = {"c": 0.0, "d": 0.0}
    c: Scalar = parameter("N*m", NonNegative(0.1), 0.0, "one", "a test")
    d: Scalar = parameter("N*m", NonNegative(3.0), 0.0, "another", "a test")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=self.c + self.d)


class Tried(AbstractEffect):
    """An amplitude that shows nothing while it is small."""

    name = "tried"
    off: ClassVar[Mapping[str, float] | None] = {"e": 0.0}
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"e": (0.6,)}
    e: Scalar = parameter("1", NonNegative(0.3), 0.0, "one", "a test")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(restitution=self.e)


PARAMETERS = {p.symbol: p for e in (Either, Bounded, Tried, *BEYOND) for p in parameters_of(e)}


class Case:
    """A linear problem: residual, shape (N,), and Jacobian, shape (N, P)."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        self.r, self.J = self.rng.normal(size=N), self.rng.normal(size=(N, P))
        self.J[:, 2] *= 1e-5  # parameters of all sizes

    def background(self) -> Background:
        return Background.spanned(self.r, self.J)

    def columns(self, k: int) -> np.ndarray:
        return self.rng.normal(size=(self.r.size, k))

    def signature(self, effect: type[AbstractEffect], columns: np.ndarray) -> Signature:
        return self.background().signature(variants(effect)[0], columns, PARAMETERS)

    def chi2(self, *columns: np.ndarray) -> float:
        """Least |r + C a|^2."""
        C = np.column_stack(columns)
        return float(np.sum((self.r + C @ np.linalg.lstsq(C, -self.r, rcond=None)[0]) ** 2))


@pytest.fixture
def case() -> Case:
    return Case()


# ---- what is tried


def test_a_variant_is_a_combination_of_the_shapes_to_be_tried() -> None:
    every = variants(Either)
    assert [(v.shape["p"], v.shape["q"]) for v in every] == [(p, q) for p in (1.0, 2.0, 3.0) for q in (10.0, 20.0)]
    assert all(v.shape["r"] == 7.0 for v in every)
    assert all(v.amplitudes == ("a", "b") for v in every)
    assert all(set(v.shape) == {"p", "q", "r"} for v in every)


@pytest.mark.parametrize("effect", BEYOND, ids=lambda effect: effect.name)
def test_every_effect_is_tried_at_each_of_its_shapes(effect: type[AbstractEffect]) -> None:
    every = variants(effect)
    assert len(every) == math.prod(len(values) for values in effect.scan.values())
    assert len({tuple(v.shape.items()) for v in every}) == len(every)
    for v in every:
        assert {*v.shape, *v.amplitudes} == set(resting(effect))
        assert all(v.shape[s] in values for s, values in effect.scan.items())


# ---- what fitted parameters can do


def test_the_background_is_what_no_fitted_parameter_can_change(case: Case) -> None:
    background = case.background()
    assert background.r.shape == (case.r.size,)
    assert_allclose(background.basis.T @ background.basis, np.eye(P), atol=1e-10)
    assert_allclose(case.J.T @ background.r, 0.0, atol=1e-9)
    assert np.sum(background.r**2) == pytest.approx(case.chi2(case.J), rel=1e-10)


def test_parameters_that_do_the_same_count_once(case: Case) -> None:
    twice = np.column_stack((case.J, case.J[:, 0] - case.J[:, 1], 0.0 * case.J[:, 0]))
    background = Background.spanned(case.r, twice)
    assert background.basis.shape[1] == P
    assert np.sum(background.r**2) == pytest.approx(case.chi2(case.J), rel=1e-8)


# ---- the gain


def test_the_gain_is_what_least_squares_with_the_effect_gains_over_without(case: Case) -> None:
    columns = case.columns(2)
    signature = case.signature(Either, columns)
    assert signature.gain == pytest.approx(case.chi2(case.J) - case.chi2(case.J, columns), rel=1e-9)
    assert signature.gain > 0.1


def test_its_amplitudes_are_those_of_least_squares_in_si_and_its_shape_is_the_variants(case: Case) -> None:
    columns = case.columns(2)
    whole = np.column_stack((case.J, columns))
    a, b = np.linalg.lstsq(whole, -case.r, rcond=None)[0][-2:]
    values = case.signature(Either, columns).values
    assert values == pytest.approx({"a": 0.5 * a, "b": 20.0 * b, "p": 1.0, "q": 10.0, "r": 7.0}, rel=1e-8)


def test_amplitudes_whose_sum_is_a_fitted_parameter_keep_their_gain_and_stay_small(case: Case) -> None:
    """Friction over angle, raised at every angle alike, is dry friction: that direction is nobody's."""
    one = case.columns(1)
    other = case.J[:, :1] - one
    found = case.signature(Either, np.hstack((one, other)))
    assert found.gain == pytest.approx(case.chi2(case.J) - case.chi2(case.J, one), rel=1e-6)
    assert abs(found.values["a"] / 0.5) < 1.0
    assert abs(found.values["b"] / 20.0) < 1.0


def test_what_is_its_own_is_what_is_left_of_it_beside_the_fitted_parameters(case: Case) -> None:
    alone = case.columns(1)
    alone -= case.J @ np.linalg.lstsq(case.J, alone, rcond=None)[0]
    shared = case.J[:, :1] / np.linalg.norm(case.J[:, 0]) * np.linalg.norm(alone)
    mixed = np.column_stack((alone + 2.0 * shared, 0.0 * alone))
    assert case.signature(Either, mixed).own == pytest.approx(1.0 / 5.0, rel=1e-9)
    assert_allclose(case.signature(Either, mixed).columns[:, :1], alone, atol=1e-9)


def test_a_signature_briefly_lets_go_of_what_is_as_long_as_all_samples(case: Case) -> None:
    whole = case.signature(Either, np.column_stack((case.columns(1), np.zeros(N))))
    gone, brief = weakref.ref(whole.columns), whole.briefly()
    assert (brief.gain, brief.own, brief.values, brief.seen) == (whole.gain, whole.own, whole.values, 1)
    del whole
    assert gone() is None


def test_an_effect_that_is_a_shift_of_fitted_parameters_gains_nothing(case: Case) -> None:
    twin = case.signature(Either, case.J @ case.rng.normal(size=(P, 2)))
    assert (twin.own, twin.gain) == (0.0, 0.0)
    assert twin.values == resting(Either)


@pytest.mark.parametrize("effect", [Either, Bounded])
@pytest.mark.parametrize("imitated", [0, 1])
def test_an_amplitude_that_fitted_parameters_have_already_leaves_the_other_its_gain(
    case: Case, effect: type[AbstractEffect], imitated: int
) -> None:
    """As the dry part of friction told apart by direction, which is a preload, beside its viscous part."""
    columns = pushing(case, 1.0, 1.0)
    columns[:, imitated] = case.J[:, 0]
    own = columns[:, [1 - imitated]]
    signature = case.signature(effect, columns)
    first, second = signature.variant.amplitudes
    gaining, none = (second, first) if imitated == 0 else (first, second)
    best = np.linalg.lstsq(np.column_stack((case.J, own)), -case.r, rcond=None)[0][-1]
    assert signature.gain == pytest.approx(case.chi2(case.J) - case.chi2(case.J, own), rel=1e-8)
    assert signature.values[gaining] == pytest.approx(best * PARAMETERS[gaining].domain.scale, rel=1e-6)
    assert signature.values[none] == 0.0


def test_a_signature_that_cannot_be_computed_gains_nothing(case: Case) -> None:
    columns = case.columns(2)
    some = columns.copy()
    some[:, 1] = np.nan
    assert case.signature(Either, np.full_like(columns, np.inf)).gain == 0.0
    assert case.signature(Either, some).gain == pytest.approx(
        case.chi2(case.J) - case.chi2(case.J, columns[:, :1]), rel=1e-9
    )


# ---- amplitudes that cannot be negative


def pushing(case: Case, *signs: float) -> np.ndarray:
    """Columns along each of which the residual asks for an amplitude of this sign; orthogonal to one another."""
    r = case.background().r
    noise = case.columns(len(signs))
    free = np.linalg.qr(np.column_stack((case.J / np.linalg.norm(case.J, axis=0), r, noise)))[0][:, P + 1 :]
    return free - np.array(signs) * (r / np.linalg.norm(r))[:, None]


def test_an_amplitude_that_would_have_to_be_negative_gains_exactly_nothing(case: Case) -> None:
    signature = case.signature(Bounded, np.column_stack((pushing(case, -1.0), 0.0 * case.columns(1))))
    assert signature.own > 0.9
    assert signature.gain == 0.0
    assert signature.values == pytest.approx({"c": 0.0, "d": 0.0}, abs=1e-12)


def test_the_same_amplitude_gains_all_it_can_where_either_sign_is_allowed(case: Case) -> None:
    columns = pushing(case, -1.0, -1.0)
    two, one = case.signature(Either, columns), case.signature(Bounded, -columns)
    assert two.gain == pytest.approx(case.chi2(case.J) - case.chi2(case.J, columns), rel=1e-9)
    assert one.gain == pytest.approx(two.gain, rel=1e-9)
    assert two.values["a"] < 0.0 < one.values["c"]


@pytest.mark.parametrize("signs", [(1.0, -1.0), (-1.0, 1.0), (1.0, 1.0), (-1.0, -1.0)])
@pytest.mark.parametrize("alike", [0.0, 0.9])
def test_bounded_amplitudes_gain_what_non_negative_least_squares_does(signs: tuple, alike: float) -> None:
    """Alike columns too, where the best amplitude of one alone has another sign than beside the other."""
    case = Case(3)
    columns = pushing(case, *signs)
    columns[:, 1] += alike * columns[:, 0]
    background = case.background()
    own = Background.free_of(background.basis, columns)
    amplitudes, left = nnls(own, -background.r)
    signature = case.signature(Bounded, columns)
    assert signature.gain == pytest.approx(float(np.sum(background.r**2)) - left**2, rel=1e-8, abs=1e-9)
    found = [signature.values["c"] / 0.1, signature.values["d"] / 3.0]
    assert_allclose(found, amplitudes, rtol=1e-6, atol=1e-7)
    assert min(found) >= 0.0


# ---- all candidates


def test_each_candidate_is_its_best_variant_and_the_most_promising_comes_first(case: Case) -> None:
    right = {"p": 2.0, "q": 20.0}
    strong, weak = pushing(case, 1.0, 1.0), pushing(case, 0.3, 0.3)
    background = case.background()
    either = [strong if right.items() <= v.shape.items() else case.columns(2) for v in variants(Either)]
    every = [*zip(variants(Bounded), [weak], strict=True), *zip(variants(Either), either, strict=True)]
    assert len(every) == 7
    signatures = ranked([background.signature(v, columns, PARAMETERS) for v, columns in every])
    assert [s.variant.effect for s in signatures] == [Either, Bounded]
    assert right.items() <= signatures[0].variant.shape.items()
    assert signatures[0].gain > signatures[1].gain > 0.0
    assert_array_equal(background.r, case.background().r)


def test_no_candidate_is_no_signature(small: CandidateModel) -> None:
    assert ranked([]) == ()
    assert tangents_inside(small, [], lambda variant, columns: columns) == []


def test_effects_are_screened_in_groups_that_keep_a_tangent_cheap() -> None:
    """Each in one group; none that delays beside one that does not, none that needs tangents beside one that is only
    tried at some values; many tangents in a model of few effects."""
    groups = in_groups(BEYOND)
    assert sorted(e.name for group in groups for e in group) == sorted(e.name for e in BEYOND)
    assert 2 < len(groups) < len(BEYOND) / 2
    assert all(len({(e.delays, set(e.off or {}) <= set(e.scan)) for e in group}) == 1 for group in groups)
    tangents_of = {e: sum(len(v.amplitudes) for v in variants(e)) for e in BEYOND}
    cost = [len(group) * sum(tangents_of[e] for e in group) for group in groups]
    assert max(c for c, group in zip(cost, groups, strict=True) if len(group) > 1) <= 128
    assert sum(cost) < 0.25 * len(BEYOND) * sum(tangents_of.values())


def test_no_effect_is_no_group() -> None:
    assert in_groups([]) == []


@pytest.mark.slow
def test_a_tangent_is_the_same_in_a_model_of_its_effect_and_beside_others(small: CandidateModel, rig: Rig) -> None:
    names = ("gravity_load", "limp_home_spring", "presliding_friction")
    little, response = replace(rig, config=small.problem.config), small.problem.batch.traces
    s = replace(small, composition=compose(little, response, only=tuple(EFFECT_BY_NAME[name] for name in names)))
    every = s.composition.inside
    assert len(every) == len(names)
    beside = s.composed(every)
    for effect in every:
        alone = s.composed((effect,))
        assert len(alone.problem.layout.types) == len(beside.problem.layout.types) - 2
        of = [tangents(m.problem, m.x, m.weighted, variants(effect)) for m in (alone, beside)]
        assert any(np.nanmax(np.abs(theirs)) > 0.0 for theirs in of[1])
        for mine, theirs in zip(*of, strict=True):
            assert_allclose(mine, theirs, atol=1e-9 * np.nanmax(np.abs(theirs)))


@pytest.mark.slow
def test_a_real_signature_is_what_a_little_of_the_effect_does_beyond_the_fitted_parameters(
    small: CandidateModel,
) -> None:
    """d residual / d amplitude by finite differences, one column of it, and its score test by least squares."""
    s = small.composed(small.composition.inside)
    gravity = s.composition.candidates
    (found,) = screened(small, gravity)
    seen = np.asarray(s.weighted.slots.weight) > 0.0
    scale, step = s.problem.layout.parameter("T_g").domain.scale, 1e-6
    up, down = (s.with_effects(gravity, {"T_g": sign * step * scale}) for sign in (1.0, -1.0))
    change = (up.problem.residual(up.x, up.weighted) - down.problem.residual(down.x, down.weighted)) / (2.0 * step)
    (column,) = tangents(s.problem, s.x, s.weighted, variants(gravity[0]))
    assert_allclose(column[:, 0], change[seen], atol=1e-3 * np.max(np.abs(change)))
    here = s.problem.linearise(s.x, s.weighted)
    r, few = here.r[seen], here.jacobian[seen]
    more = np.column_stack((few, column))
    left = [np.sum((r + J @ np.linalg.lstsq(J, -r, rcond=None)[0]) ** 2) for J in (few, more)]
    assert found.gain == pytest.approx(left[0] - left[1], rel=1e-6)


def test_the_names_used_here_are_not_those_of_the_catalogue() -> None:
    assert not {Either.name, Bounded.name} & set(EFFECT_BY_NAME)
    assert not {*resting(Either), *resting(Bounded)} & {p.symbol for e in EFFECTS for p in parameters_of(e)}


@pytest.mark.parametrize("share", [0.4, -0.1, 3.0])
def test_a_scanned_amplitude_promises_what_its_own_value_does_and_no_more(case: Case, share: float) -> None:
    """At twice its scale the residual loses this share of itself; a smaller value of it promises nothing."""
    r = case.background().r
    signature = case.signature(Tried, -0.5 * share * r[:, None])
    assert signature.values == {"e": pytest.approx(0.6)}
    assert signature.gain == pytest.approx(max(0.0, 1.0 - (1.0 - share) ** 2) * float(r @ r))


def test_effects_of_the_rig_are_screened_some_at_a_time(
    small: CandidateModel, rig: Rig, traces: tuple[Trace, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains are those of the whole Jacobian, which is as large as all samples times all of them."""
    composition = compose(replace(rig, config=small.problem.config), traces)
    problem = EstimationProblem.of_traces(small.problem.config, composition.lean(()), traces)
    weighted = problem.weighted(free_running(problem))
    s = replace(small, composition=composition, problem=problem, weighted=weighted, holdout=None)
    rigged, background = s.with_the_rig(), Background.of_model(s.problem, s.x, s.weighted)
    every = [e for e in composition.of_the_rig if not e.delays and e.scope != "trace"][:4]
    slope, layout = rigged.problem.layout.numbers(rigged.x)[1], rigged.problem.layout
    _, jacobian = fitted_samples(rigged.problem, rigged.x, rigged.weighted)
    asked: list[int] = []
    once = tangents_module.slopes_of

    def counted(*args: Any) -> Any:
        asked.append(len(args[-1]))
        return once(*args)

    monkeypatch.setattr(tangents_module, "slopes_of", counted)
    monkeypatch.setattr(screen, "RIGS_AT_ONCE", 2)
    found = screen.screen_of_the_rig(
        background, tangents_module.Tangents.of_model(rigged.problem, rigged.x, rigged.weighted), every
    )
    assert len(found) == len(every)
    assert max(asked) < sum(asked)
    for g in found:
        places = [layout.free.index(symbol) for symbol in g.variant.amplitudes]
        scale = [layout.parameter(symbol).domain.scale for symbol in g.variant.amplitudes]
        columns = jacobian[:, places] * scale / slope[places]
        expected = background.signature(g.variant, columns, {p.symbol: p for p in layout.parameters})
        assert g.gain == pytest.approx(expected.gain, rel=1e-9)
        assert_allclose(g.columns, expected.columns, rtol=1e-9, atol=1e-9 * np.max(np.abs(columns)))


# ---- Amplitudes within their bounds, against the search over which of them rest at a bound

LOW = np.array([0.0, -np.inf, 0.0, 0.0])


def test_only_what_cannot_be_negative_has_a_bound() -> None:
    assert lowest([NonNegative(1.0), Real(2.0), Positive(1.0)]).tolist() == [0.0, -np.inf, -np.inf]


@pytest.mark.parametrize("seed", range(8))
def test_no_other_choice_of_amplitudes_at_rest_fits_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, target = rng.normal(size=(30, 4)), rng.normal(size=30)
    columns /= np.linalg.norm(columns, axis=0)
    found = bounded(columns, target, LOW)
    assert np.all(found >= LOW)
    best = np.inf
    for at_work in itertools.product((False, True), repeat=4):
        some = np.flatnonzero(at_work)
        a = np.zeros(4)
        a[some] = np.linalg.lstsq(columns[:, some], target, rcond=None)[0]
        if np.all(a >= LOW):
            best = min(best, float(np.sum((columns @ a - target) ** 2)))
    assert_allclose(np.sum((columns @ found - target) ** 2), best, rtol=1e-8)


def test_of_two_that_do_the_same_both_stay_small() -> None:
    column = np.ones((9, 1)) / 3.0
    found = bounded(np.hstack((column, column)), 2.0 * column[:, 0], np.array([-np.inf, -np.inf]))
    assert_allclose(found, 1.0, rtol=1e-5)


# ---- What effects inside the throttle do to a residual: along the path of the model, or in models that have them


def columns(variant: Variant, each: np.ndarray) -> np.ndarray:
    return each


def with_candidates(s: CandidateModel, rig: Rig, *names: str) -> CandidateModel:
    little = replace(rig, config=s.problem.config)
    composition = compose(little, s.problem.batch.traces, only=tuple(EFFECT_BY_NAME[name] for name in names))
    return replace(s, composition=composition)


def test_where_an_ecu_in_the_model_reads_the_sensor_none_goes_along_the_path(small: CandidateModel) -> None:
    layout = small.problem.layout
    commanded = replace(layout, types=(*layout.types, *COMMANDING))
    driven = replace(small.problem, free_parameters=replace(small.problem.free_parameters, layout=commanded))
    gravity = EFFECT_BY_NAME["gravity_load"]
    assert serves(small.problem, gravity)
    assert not serves(driven, gravity)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "apart"),
    [
        ("gravity_load", 1e-9),
        ("cogging_torque", 1e-9),
        ("current_sensor_offset", 1e-9),
        ("asymmetric_friction", 1e-9),
        ("channel_delay", 1e-9),
        ("actuation_delay", 2e-3),  # a thousandth off zero a jump of the input comes within a step: another path
    ],
)
def test_along_the_path_a_tangent_is_that_of_a_model_with_the_effect(
    small: CandidateModel, rig: Rig, name: str, apart: float
) -> None:
    """To rounding, but where an amplitude that cannot be negative is taken a thousandth off zero there."""
    s = with_candidates(small, rig, name)
    effect: type[AbstractEffect] = EFFECT_BY_NAME[name]
    every = variants(effect)
    whole = s.composed((effect,))
    ours, theirs = tangents_inside(s, every, columns), tangents(whole.problem, whole.x, whole.weighted, every)
    assert serves(s.problem, effect)
    for mine, its in zip(ours, theirs, strict=True):
        assert np.max(np.abs(its)) > 0.0
        assert_allclose(mine, its, atol=apart * np.max(np.abs(its)))


@pytest.mark.slow
def test_each_variant_gets_its_own_columns_whichever_way_they_come(small: CandidateModel, rig: Rig) -> None:
    """A rebound is tried at values, gravity and a delay along the path; asked in any order."""
    names = ("stop_bounce", "gravity_load", "actuation_delay")
    s = with_candidates(small, rig, *names)
    every = [variant for name in names for variant in variants(EFFECT_BY_NAME[name])]
    asked = [*every[::2], *every[1::2]]
    found = dict(zip(asked, tangents_inside(s, asked, columns), strict=True))
    for variant in every:
        (alone,) = tangents_inside(s, [variant], columns)
        assert alone.shape == (int(s.weighted.samples), len(variant.amplitudes))
        assert_allclose(found[variant], alone, rtol=1e-9, atol=1e-9 * np.max(np.abs(alone)))
