"""What a trial is judged by, and which of several models is chosen; verdicts made by hand."""

from __future__ import annotations

import math
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import etcfit.diagnosis as diagnosis
from etcfit.diagnosis import loop, trial
from etcfit.diagnosis.composition import Composition, compose
from etcfit.diagnosis.loop import STRONG, choose
from etcfit.diagnosis.model_discrepancy import blur, spread
from etcfit.diagnosis.trial import CandidateModel, Score, TrialVerdict, bic_change, compare, independent
from etcfit.estimation.identifiability import WIDE
from etcfit.estimation.joint_fit import quiet
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.problem.prediction_error import PredictionError, pooled
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.problem.weights import free_running
from etcfit.rig.base import Rig

LIMP, STRIBECK, GRAVITY, DRAG = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "stribeck_friction", "gravity_load", "quadratic_drag")
)
NEAR: Any = SimpleNamespace(far=False, weighted=SimpleNamespace(samples=1000.0))
FAR: Any = SimpleNamespace(far=True)


def row(n: int, ratio: float, sigma: float = 0.01) -> PredictionError:
    """Free-running error of so many sigma."""
    return PredictionError("response/a.csv", "response", "position", "deg", n, ratio * sigma, sigma)


def scored(chi2: float, count: float = 1000.0, held_out: float | None = None, rms: float = 1.0) -> Score:
    holdout = () if held_out is None else (row(10, rms),)
    return Score(chi2, count, held_out, (row(10, rms),), holdout)


def verdict(effect: type, bic: float, held_out: float | None = -50.0, ratio: float | None = 0.8, on: Any = NEAR,
            chi2: float = 900.0, gain: float = 100.0) -> Any:  # fmt: skip
    return TrialVerdict(effect, on, scored(chi2), 0.7, ratio, held_out, bic, gain, trial.slack_of(on))


# ---- errors of traces and channels together


def test_every_sample_counts_alike_in_its_own_noise() -> None:
    """sqrt((30 2^2 + 10 6^2) / 40), whatever the units."""
    assert pooled((row(30, 2.0), row(10, 6.0, sigma=25.0))) == pytest.approx(math.sqrt(12.0))
    assert pooled((row(7, 3.0),)) == pytest.approx(3.0)


def test_a_score_without_held_out_traces_has_no_error_of_theirs() -> None:
    assert scored(1.0).holdout_rms is None
    assert scored(1.0, held_out=5.0, rms=1.5).holdout_rms == pytest.approx(1.5)
    assert scored(1.0, rms=1.5).fit_rms == pytest.approx(1.5)


# ---- what a parameter costs


def test_bic_is_likelihood_plus_parameters_plus_the_choice_among_variants() -> None:
    change = bic_change(scored(2000.0, 800.0), scored(1000.0, 900.0), 3, 6)
    assert change == pytest.approx(800.0 * math.log(0.5) + 3.0 * math.log(800.0) + 2.0 * math.log(6.0))


def test_a_parameter_that_explains_nothing_costs_the_log_of_the_samples() -> None:
    same = scored(1000.0)
    assert bic_change(same, same, 1, 1) == pytest.approx(math.log(1000.0))
    assert bic_change(same, same, 0, 1) == 0.0
    assert bic_change(same, same, 2, 4) > bic_change(same, same, 2, 1) > bic_change(same, same, 1, 1)
    # a residual of noise falls by one of 1000 for each parameter: nowhere near worth it
    assert bic_change(same, scored(999.0), 1, 1) > 0.0


def test_the_scale_of_the_noise_is_not_trusted() -> None:
    """Weighed by the error left in them, chi2 of all samples may be any size: its logarithm counts."""
    small, large = (bic_change(scored(c), scored(0.9 * c), 1, 1) for c in (1e-3, 1e5))
    assert small == pytest.approx(large)


def test_a_verdict_compares_what_both_models_have() -> None:
    """Held-out errors only where there are any."""
    before, after = scored(2000.0, held_out=900.0, rms=4.0), scored(1000.0, held_out=600.0, rms=3.0)
    stub = pytest.MonkeyPatch()
    with stub.context() as patch:
        patch.setattr("etcfit.diagnosis.trial.score", lambda s: after)
        found = compare(LIMP, before, NEAR, 4, 6)
        alone = compare(LIMP, scored(2000.0, rms=4.0), NEAR, 4, 6)
    assert (found.fit_rms_ratio, found.holdout_rms_ratio) == (0.75, 0.75)
    assert found.holdout_chi2_change == -300.0
    assert found.bic_change == bic_change(before, after, 4, 6)
    assert (alone.holdout_rms_ratio, alone.holdout_chi2_change) == (None, None)


# ---- how many samples there are


def counted(memory: float, n: int = 5_000, size: float = 1.0) -> float:
    """Independent samples of one channel with r_k = memory r_(k-1) + w; every tenth sample was not logged."""
    rng = np.random.default_rng(1)
    w, r = rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        r[k] = memory * r[k - 1] + math.sqrt(1.0 - memory**2) * w[k]
    data = np.where(np.arange(n) % 10 == 5, np.nan, 0.0)[:, None]
    trace = SimpleNamespace(channels=("position",), data=data)
    batch = SimpleNamespace(traces=(trace,), places=((1, 0, np.arange(n)),))
    on_tape = np.zeros((n + 5, 2, 3))
    on_tape[:n, 1, 0] = size * np.where(np.isnan(data[:, 0]), 1e6, r)
    problem: Any = SimpleNamespace(batch=batch)
    return independent(problem, on_tape)


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
def test_white_samples_are_as_many_as_were_logged_however_large(size: float) -> None:
    assert counted(0.0, size=size) == pytest.approx(4_500)


def test_samples_that_repeat_one_another_are_fewer() -> None:
    """f = (1 + rho) / (1 - rho) of them go into one, rho = 0.9."""
    assert counted(0.9) == pytest.approx(4_500 / 19.0, rel=0.25)


# ---- what the held-out traces say


@pytest.mark.parametrize(
    ("held_out", "ratio", "on", "helps"),
    [
        (None, None, NEAR, True),
        (-1.0, 0.9, NEAR, True),
        (1.0, 0.9, NEAR, False),
        (0.9, 0.9, NEAR, True),  # of the 100 that it gains on the fitted ones
        (-1.0, 1.01, NEAR, True),
        (-1.0, 1.03, NEAR, False),
        (-1.0, 2.9, FAR, True),
        (-1.0, 3.1, FAR, False),
        (-1.0, None, NEAR, True),
    ],
)
def test_held_out_traces_must_not_contradict(held_out: float | None, ratio: float | None, on: Any, helps: bool) -> None:
    assert verdict(LIMP, -100.0, held_out, ratio, on).helps_elsewhere() is helps


# ---- the choice


def test_without_a_promise_nothing_is_added() -> None:
    assert choose([]) == (None, (), "No effect of the catalogue promises to explain anything more.")


def test_what_is_not_worth_its_parameters_is_not_added() -> None:
    effect, ties, why = choose([verdict(LIMP, STRONG + 0.1), verdict(GRAVITY, 3.0)])
    assert (effect, ties) == (None, ())
    assert why.startswith("limp_home_spring does best, but is not worth its parameters (BIC -9.9")


def test_what_helps_the_fitted_traces_only_is_not_added() -> None:
    effect, ties, why = choose([verdict(LIMP, -500.0, held_out=20.0), verdict(GRAVITY, -20.0, ratio=1.2)])
    assert (effect, ties) == (None, ())
    assert why == "limp_home_spring helps on the fitted traces only, not on those held out."


def test_the_best_by_bic_is_added_and_what_it_does_is_said() -> None:
    effect, ties, why = choose([verdict(LIMP, -500.0), verdict(GRAVITY, -400.0, chi2=950.0), verdict(DRAG, 1.0)])
    assert effect is LIMP
    assert ties == ()
    assert why == "limp_home_spring explains most: fitted error x 0.700, held-out error x 0.800, BIC -500."


def test_the_best_of_those_that_help_elsewhere_is_added() -> None:
    effect, ties, _ = choose(
        [verdict(STRIBECK, -503.0, held_out=1.0), verdict(LIMP, -500.0), verdict(DRAG, -30.0, chi2=990.0)]
    )
    assert effect is LIMP
    assert ties == ()


@dataclass(frozen=True)
class Stand:
    """A model of 1000 samples where it stands."""

    x: float = 0.0
    far: bool = False
    weighted: Any = field(default_factory=lambda: NEAR.weighted)


@pytest.mark.parametrize(
    ("on", "first", "full", "asked", "helps"),
    [
        (Stand(), {"ratio": 1.5}, {"ratio": 1.1}, True, True),
        (Stand(), {"held_out": 600.0}, {"ratio": 1.1}, True, True),
        (Stand(), {"ratio": 1.5}, {"ratio": 1.3}, True, False),
        (Stand(), {"ratio": 1.5}, {"held_out": 600.0}, True, False),
        (Stand(), {"ratio": 1.5, "gain": 24_000.0}, {}, False, False),
        (Stand(), {"ratio": 1.01}, {}, False, True),
        (Stand(far=True), {"ratio": 3.5}, {}, False, False),
    ],
    ids=["as well elsewhere", "held out in its whitening", "still worse", "still contradicted", "not most of it",
         "never contradicted", "far from the data"],
)  # fmt: skip
def test_what_explains_most_but_is_contradicted_is_asked_again_where_a_full_refit_ends(
    monkeypatch: pytest.MonkeyPatch, on: Any, first: Any, full: Any, asked: bool, helps: bool
) -> None:
    """50 000 of 51 000 are above the noise; in full a held-out error may rise by a fifth, as where one is added."""
    where: list[float] = []

    def judged(effect: type, before: Score, s: Any) -> TrialVerdict:
        where.append(s.x)
        return verdict(effect, -400.0, on=s, **({"gain": 40_000.0} | full))

    monkeypatch.setattr(loop, "refit_fully", lambda s, report: Stand(x=1.0))
    monkeypatch.setattr(loop, "judged", judged)
    v = verdict(LIMP, -500.0, on=on, **({"gain": 49_000.0} | first))
    found = loop._asked_again(on, v, scored(51_000.0), quiet)
    assert where == ([1.0] if asked else [])
    assert found.helps_elsewhere() is helps
    assert (found is v) is not (asked and helps)


def test_effects_whose_inexact_formulas_could_make_the_difference_are_ties() -> None:
    """2 % of what was explained, squared, and never more than 4 % of the noise's."""
    every = [
        verdict(LIMP, -5000.0, gain=5e4),
        verdict(GRAVITY, -4980.0, chi2=919.0),
        verdict(DRAG, -4970.0, chi2=921.0),
    ]
    assert choose(every)[1] == (GRAVITY,)
    every = [
        verdict(LIMP, -5000.0, gain=5e6),
        verdict(GRAVITY, -4960.0, chi2=939.0),
        verdict(DRAG, -4950.0, chi2=941.0),
    ]
    assert choose(every)[1] == (GRAVITY,)


def test_effects_that_do_as_well_are_ties() -> None:
    """Within 6 of the best's -2 log likelihood, worth their parameters, and not contradicted by held-out traces."""
    every = [
        verdict(LIMP, -500.0),
        verdict(GRAVITY, -490.0),
        verdict(STRIBECK, -498.0, held_out=5.0),
        verdict(EFFECT_BY_NAME["backlash"], -494.1, chi2=905.3),
        verdict(DRAG, -493.9, chi2=905.5),
    ]
    effect, ties, why = choose(every)
    assert effect is LIMP
    assert [e.name for e in ties] == ["gravity_load", "backlash"]
    assert why.endswith("gravity_load and backlash would do as well: these data cannot tell them apart.")


def test_what_is_not_worth_it_is_no_tie() -> None:
    assert choose([verdict(LIMP, -12.0), verdict(GRAVITY, -9.0)])[:2] == (LIMP, ())


def test_without_held_out_traces_their_error_is_not_spoken_of() -> None:
    effect, _, why = choose([verdict(LIMP, -500.0, None, None)])
    assert effect is LIMP
    assert "held-out" not in why


# ---- a model with another effect


@pytest.fixture(scope="module")
def composition(rig: Rig, traces: tuple[Trace, ...]) -> Composition:
    return compose(rig, traces)


@pytest.fixture(scope="module")
def standing(rig: Rig, traces: tuple[Trace, ...], composition: Composition) -> CandidateModel:
    """Eqs. 1-2 in the composed model, a held-out trace beside them; nothing is simulated."""
    known = composition.free_parameters(())
    x = np.random.default_rng(0).normal(size=len(known.layout.free))
    problem = EstimationProblem.of(rig.config, known, traces)
    beside = EstimationProblem.of(rig.config, known, traces[:1])
    weighted, holdout = (b.weighted(free_running(b)) for b in (problem, beside))
    return CandidateModel(composition, (), problem, weighted, (beside, holdout), x, Termination(True, "by hand"))


def test_another_effect_changes_the_unknowns_and_neither_data_nor_whitening(standing: CandidateModel) -> None:
    more = standing.with_effects((GRAVITY,), {"T_g": 0.2})
    assert more.added == (GRAVITY,)
    assert more.at_work(GRAVITY)
    assert not more.at_work(LIMP)
    assert standing.holdout is not None
    assert more.holdout is not None
    pairs = [(standing.problem, standing.weighted, more.problem, more.weighted), (*standing.holdout, *more.holdout)]
    for problem, weighted, new_bench, new_problem in pairs:
        assert new_problem.whitening is weighted.whitening
        assert new_bench.batch is problem.batch
        assert new_bench.sigma is problem.sigma
        assert tuple(s for s in new_bench.layout.free if s != "T_g") == problem.layout.free
        assert new_problem.prior_sd.shape == weighted.prior_sd.shape
        assert new_problem.pick.where.shape == weighted.pick.where.shape
    shared = [more.problem.layout.free.index(s) for s in standing.problem.layout.free]
    assert_array_equal(more.x[shared], standing.x)
    assert float(more.problem.layout.values(more.x, more.problem.free_parameters.held)["T_g"]) == pytest.approx(0.2)


def test_an_effect_taken_away_again_leaves_the_model_as_it_was(standing: CandidateModel) -> None:
    back = standing.with_effects((GRAVITY,), {"T_g": 0.2}).with_effects((), {})
    assert_array_equal(back.x, standing.x)
    assert back.problem.layout == standing.problem.layout
    assert_array_equal(back.weighted.pick.full, standing.weighted.pick.full)


@pytest.mark.parametrize(
    ("far", "left", "before_far", "before_left", "spoilt"),
    [
        (False, 1.49, False, 1.0, False),
        (False, 1.51, False, 1.0, True),
        (False, np.nan, False, 1.0, True),
        (True, 1.0, False, 1.0, True),
        (False, 30.0, True, 1.0, False),
        (True, 1.0, True, 1.0, False),
    ],
)
def test_a_refit_that_ends_further_from_the_data_is_spoilt(
    far: bool, left: float, before_far: bool, before_left: float, spoilt: bool
) -> None:
    """Far from the data chi2 is by construction 1 a sample, and compares with nothing."""
    new, before = (SimpleNamespace(far=f, left=n) for f, n in ((far, left), (before_far, before_left)))
    assert CandidateModel.spoilt(cast(Any, new), cast(Any, before)) is spoilt


def test_an_effect_that_spoils_the_refit_is_not_added(monkeypatch: pytest.MonkeyPatch) -> None:
    at: Any = SimpleNamespace(far=False, left=1.0)
    refitted: Any = SimpleNamespace(far=False, left=20.0, holds=lambda before, was: before is not at)
    found = replace(verdict(LIMP, -500.0), standing=refitted)
    turned = loop.Round(at, scored(1000.0), (), (found,), LIMP, (GRAVITY,), "limp_home_spring explains most.")
    monkeypatch.setattr(diagnosis, "refit_fully", lambda standing, report: standing)
    after, stands = diagnosis._settled(turned, quiet)
    assert stands is at
    assert (after.added, after.ties) == (None, ())
    assert after.why.endswith("it is not added.")
    refitted.holds = lambda before, was: True
    assert diagnosis._settled(turned, quiet) == (turned, refitted)


@pytest.mark.parametrize(
    ("left", "rms", "holds"), [(1.4, 1.1, True), (1.6, 1.1, False), (1.4, 1.3, False)]
)  # further from the data than half as much again; a fifth further from what was held out
def test_a_refit_holds_where_it_is_neither_spoilt_nor_astray(
    left: float, rms: float, holds: bool, standing: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CandidateModel, "left", left)
    monkeypatch.setattr(trial, "score", lambda s: scored(1.0, held_out=1.0, rms=rms))
    before: Any = SimpleNamespace(far=False, left=1.0)
    assert standing.holds(before, scored(1.0, held_out=1.0, rms=1.0)) is holds


@pytest.mark.parametrize(
    ("rms", "before", "far", "strays"),
    [
        (1.19, 1.0, False, False),
        (1.21, 1.0, False, True),
        (np.nan, 1.0, False, True),
        (2.9, 1.0, True, False),
        (3.1, 1.0, True, True),
        (None, 1.0, False, False),
        (5.0, None, False, False),
    ],
)
def test_a_refit_that_predicts_the_held_out_traces_clearly_worse_strays(
    rms: float | None, before: float | None, far: bool, strays: bool
) -> None:

    def held_out(error: float | None) -> Score:
        return scored(1.0) if error is None else scored(1.0, held_out=1.0, rms=error)

    assert held_out(rms).strays(held_out(before), far) is strays


def test_a_steep_beginning_is_halved_until_the_model_holds(standing: CandidateModel) -> None:
    """A spring torque of some N m carries the plate into its stops; the off value does nothing at all."""
    rest = replace(
        standing,
        x=standing.problem.layout.coordinates({p.symbol: p.nominal for p in standing.problem.layout.parameters}),
    )
    assert rest.trying(GRAVITY, {"T_g": 0.0}).chi2 == pytest.approx(rest.chi2, rel=1e-9)
    wild = rest.with_effects((GRAVITY,), {"T_g": 400.0})
    assert wild.chi2 > 3.0 * rest.chi2
    begun = rest.trying(GRAVITY, {"T_g": 400.0})
    assert begun.chi2 < 3.0 * rest.chi2
    halvings = np.log2(400.0 / float(begun.problem.layout.values(begun.x, begun.problem.free_parameters.held)["T_g"]))
    assert halvings == pytest.approx(round(halvings), abs=1e-6)


def test_held_out_traces_are_those_beside(standing: CandidateModel) -> None:
    assert [t.measurement.file for t in standing.held_out] == [standing.problem.batch.traces[0].measurement.file]
    assert replace(standing, holdout=None).held_out == ()


def test_what_an_inexact_formula_could_have_left_is_not_proven() -> None:
    """The verdicts of these tests leave a chi2 of 900."""
    every = [verdict(LIMP, -500.0), verdict(GRAVITY, -499.0)]
    assert choose(every, 900.1)[:2] == (LIMP, (GRAVITY,))
    effect, ties, why = choose(every, 900.0)
    assert (effect, ties) == (None, ())
    assert why.startswith("limp_home_spring would explain a little more (BIC -500), but no more than")


@pytest.mark.parametrize(("noise", "added"), [(401.0, LIMP), (399.0, None)])
def test_an_effect_that_explains_a_fifth_of_what_it_leaves_is_the_most_that_imitates(noise: float, added: Any) -> None:
    """It gains 100 and leaves 900; another that gains more helps on the fitted traces only."""
    every = [replace(verdict(GRAVITY, -600.0, held_out=500.0), gain=400.0), verdict(LIMP, -500.0)]
    assert every[1].gain == 100.0
    effect, ties, why = choose(every, noise=noise)
    assert (effect, ties) == (added, ())
    if added is None:
        assert why.startswith("limp_home_spring does best, but explains less than 20 % of what it leaves")


@pytest.mark.parametrize(("before", "share"), [(51.0, 0.02), (2.0, 0.0004), (1001.0, 0.04), (0.9, 0.0)])
def test_an_effect_found_may_leave_its_inexactness_squared_of_what_it_explained(before: float, share: float) -> None:
    """Of its chi2 above the noise's, and 4 % of the noise's at most."""
    first: Any = SimpleNamespace(chi2_per_dof=before)
    found: Any = SimpleNamespace(added=(LIMP,), far=False, weighted=SimpleNamespace(samples=500.0))
    assert blur(first, found) == pytest.approx(500.0 * share)


def test_nothing_is_put_down_to_formulas_without_one_or_far_from_the_data() -> None:
    first: Any = SimpleNamespace(chi2_per_dof=1001.0)
    none: Any = SimpleNamespace(added=(), far=False, weighted=SimpleNamespace(samples=500.0))
    far: Any = SimpleNamespace(added=(LIMP,), far=True, weighted=SimpleNamespace(samples=500.0))
    assert blur(first, none) == 0.0
    assert blur(first, far) == 0.0


def test_a_formula_that_is_off_in_one_stretch_of_a_trace_moves_parameters_as_far_as_their_intervals_allow(
    standing: CandidateModel,
) -> None:
    """Each stretch in turn is off by as much, and what least squares then make of it is found by least squares."""
    found = standing.with_effects((GRAVITY,), {"T_g": 0.2}).lean()
    layout = found.problem.layout
    nominal = {p.symbol: p.nominal for p in layout.parameters} | {"T_g": 0.2}
    found = replace(found, x=layout.coordinates(nominal))
    step = found.x.copy()
    step[layout.free.index("T_g")] = layout.parameter("T_g").domain.coordinate(1.001 * 0.2)
    r, _, jacobian = found.problem.linearise(found.x, found.weighted)
    share = 1000.0 * (found.problem.residual(step, found.weighted) - r)
    held = np.diag(1.0 / (WIDE * layout.reach(found.x)))  # what the data do not tell is kept where it is
    rows = np.vstack((jacobian.reshape(r.size, -1), held))
    expected = np.zeros((found.x.size, found.x.size))
    for lane, _, marks in found.problem.batch.places:
        for stretch in np.array_split(marks, 6):
            off = np.zeros_like(r)
            off[stretch, lane] = GRAVITY.inexact * share[stretch, lane]
            moved = np.linalg.lstsq(rows, np.append(off.ravel(), np.zeros(len(held))), rcond=1e-12)[0]
            expected += np.outer(moved, moved)
    known = [layout.free.index(s) for s in ("R_a", "K_b", "T_f", "T_PL", "T_g")]
    assert_allclose(np.diag(spread(found))[known], np.diag(expected)[known], rtol=0.02)
    assert np.all(np.diag(expected)[known] > 0.0)
    assert_array_equal(spread(standing), np.zeros((standing.x.size, standing.x.size)))


@pytest.mark.parametrize(("excess", "looks"), [(9.9, False), (10.1, True)])
def test_a_round_looks_no_further_within_what_formulas_leave(
    excess: float, looks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Screening is what it costs to look."""
    weighted, composition = SimpleNamespace(samples=1000.0), SimpleNamespace(candidates=())
    at: Any = SimpleNamespace(weighted=weighted, added=(LIMP,), composition=composition)

    class Looked(Exception):
        pass

    def screened(*at: Any) -> Any:
        raise Looked

    monkeypatch.setattr(loop, "screened", screened)
    monkeypatch.setattr(loop, "score", lambda s: scored(1000.0 + excess))
    with pytest.raises(Looked) if looks else nullcontext():
        turned = loop.turn(at, quiet, 10.0)
        assert turned.added is None
        assert turned.why.startswith(
            "What is left adds 0.99 % to the noise, no more than a formula of limp_home_spring"
        )
