"""Effects found are asked again beside the rivals of their round."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from diagnoses import score, verdict
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.choice import Choice, Outcome
from etcfit.diagnosis.composition import compose, resting
from etcfit.diagnosis.exchange import (
    Found,
    compared_in_place,
    exchanged,
    gave_way,
    is_rival,
    preference,
    pruned,
    replaced_in_order,
)
from etcfit.diagnosis.loop import Round
from etcfit.diagnosis.score import Apart
from etcfit.diagnosis.score import score as measured
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.trial import Trial
from etcfit.estimation.joint_fit import quiet
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import AbstractRigEffect, rig_effect
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Fixed, Rig

LIMP, AIR, GRAVITY, HEAT = (
    EFFECT_BY_NAME[n] for n in ("limp_home_spring", "airflow_torque", "gravity_load", "winding_heating")
)
CLOSE = Apart(0.05, {})


def found(effect: type, *rivals: type) -> Found:
    return Found(effect, {}, {rival: {} for rival in rivals})


# ---- which of them is preferred


def test_a_rival_that_explains_more_is_preferred() -> None:
    here, air = verdict(GRAVITY, -500.0, chi2=1100.0), verdict(AIR, -590.0, chi2=1000.0)
    assert preference(here, [verdict(LIMP, -450.0, chi2=1150.0), air]) == (2, ())
    assert gave_way(here, air) == "gravity_load gave way to airflow_torque, which explains more (BIC -90.0)."


def test_a_rival_that_does_as_well_is_a_tie_and_the_effect_stays() -> None:
    here = verdict(GRAVITY, -500.0, chi2=1000.0)
    others = [verdict(AIR, -503.0, chi2=996.0), verdict(LIMP, -400.0, chi2=1100.0)]
    assert preference(here, others) == (0, (1,))


def test_a_rival_that_fits_as_well_with_fewer_parameters_is_preferred_and_stays_tied() -> None:
    """Two parameters less are worth 2 ln n of BIC; the likelihoods differ by hardly anything."""
    here, air = verdict(LIMP, -500.0, chi2=998.0), verdict(AIR, -515.0, chi2=1000.0)
    assert preference(here, [air]) == (1, (0,))


def test_an_effect_may_be_tied_to_the_rival_that_takes_its_place() -> None:
    """Ties are those of the one preferred, whoever it was before."""
    here = verdict(GRAVITY, -400.0, chi2=1100.0)
    others = [verdict(AIR, -590.0, chi2=1000.0), verdict(LIMP, -588.0, chi2=1002.0)]
    assert preference(here, others) == (1, (2,))


def test_without_a_rival_that_stands_the_effect_stays() -> None:
    assert preference(verdict(GRAVITY, -500.0), []) == (0, ())


def test_an_effect_that_takes_anothers_place_is_found_when_that_was() -> None:
    assert replaced_in_order((GRAVITY, HEAT), GRAVITY, AIR) == (AIR, HEAT)
    assert replaced_in_order((HEAT, GRAVITY), GRAVITY, AIR) == (HEAT, AIR)


def test_a_tie_with_an_effect_at_work_is_a_tie_no_longer() -> None:
    tied = Found(GRAVITY, {AIR: CLOSE, LIMP: CLOSE}, {AIR: {}})
    assert tied.without_ties_to([GRAVITY, AIR]).ties == {LIMP: CLOSE}
    assert tied.without_ties_to([GRAVITY]) == tied


# ---- rivals of a round


@pytest.mark.parametrize(("gain", "rival"), [(51.0, True), (49.0, False), (math.nan, False)])
def test_rivals_are_those_that_explained_half_as_much(gain: float, rival: bool) -> None:
    best = verdict(LIMP, -500.0, gain=100.0)
    assert is_rival(verdict(AIR, -9.0, gain=gain), best) is rival
    assert not is_rival(best, best)


def test_what_a_round_found_knows_its_ties_and_where_its_rivals_were(model: CandidateModel) -> None:
    def trial(effect: type, gain: float, **values: float) -> Trial:
        return Trial(model.with_effects((effect,), values), verdict(effect, -5.0 * gain, gain=gain))

    spring = {"T_lh": 0.3, "K_lh": 0.7, "theta_lh": 0.2, "d_lh": 0.02}
    best, rival = trial(LIMP, 100.0, **spring), trial(GRAVITY, 51.0, T_g=-0.4)
    weak = trial(HEAT, 49.0, **resting(HEAT))
    choice = Choice(Outcome.ADDED, LIMP, (), "Because.")
    once = Found.of_round(Round(model, score(1000.0), (), (best, rival, weak), choice))
    assert (once.effect, once.ties) == (LIMP, {})
    assert set(once.rivals) == {GRAVITY}
    assert once.rivals[GRAVITY] == pytest.approx(rival.model.values)


def test_a_tie_of_a_round_knows_how_far_its_fit_is(small: CandidateModel) -> None:
    """Two models of one effect stand for two effects: what counts is whose trial is named a tie."""
    one, two = (small.with_effects((GRAVITY,), {"T_g": value}) for value in (0.1, 0.2))
    trials = Trial(one, verdict(GRAVITY, -500.0)), Trial(two, verdict(AIR, -499.0, gain=1.0))
    once = Found.of_round(Round(small, score(1000.0), (), trials, Choice(Outcome.ADDED, GRAVITY, (AIR,), "Because.")))
    assert set(once.ties) == {AIR}
    assert once.ties[AIR].moved["T_g"] == pytest.approx(two.x[-1] - one.x[-1])
    assert once.ties[AIR].residual > 0.0


# ---- on a model


def test_one_without_rivals_and_rivals_at_work_are_not_asked(model: CandidateModel) -> None:
    s = model.with_effects((GRAVITY, HEAT), resting(GRAVITY) | resting(HEAT))
    tied = Found(GRAVITY, {HEAT: CLOSE}, {HEAT: {}})  # in its round; now both are at work
    said: list[str] = []
    after, left, words, rounds = exchanged(s, (tied, found(HEAT)), lambda text, share: said.append(text))
    assert said == []
    assert (after is s, words, rounds) == (True, (), ())
    assert [f.ties for f in left] == [{}, {}]


def test_an_effect_found_alone_is_not_tried_without(small: CandidateModel) -> None:
    """There is no other that could explain what it does."""
    s = small.with_effects((GRAVITY,), {"T_g": 0.01})
    assert pruned(s, lambda text, share: pytest.fail(text)) == (s, ())
    assert pruned(small, quiet)[0] is small


# ---- A rival in the place of an effect


def named(name: str) -> type[AbstractRigEffect]:
    effect = rig_effect(name)
    assert effect is not None
    return effect


GAIN, OFFSET = named("channel_gain[response.position]"), named("channel_offset[response.position]")
TWO = (GAIN, OFFSET)


@pytest.fixture(scope="module")
def bent(rig: Rig, traces: tuple[Trace, ...]) -> CandidateModel:
    """Responses alone, whose position reads 20 % too much and 0.03 rad besides."""
    known = free_parameters(rig.config).layout.parameters
    held = {p.symbol: Fixed(p.nominal) for p in known if p.symbol not in ("K_s", "T_f")}
    little = replace(rig, config=replace(rig.config, parameters=held))
    response = tuple(t for t in traces if t.test.name == "response")
    composition = compose(little, traces, only=(GAIN, OFFSET))  # one test has no gain of its own
    bare = composition.lean(())
    x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
    values = {p: v for e, v in ((GAIN, 0.2), (OFFSET, 0.03)) for p in e.off or {}}

    def of(data: tuple[Trace, ...]) -> CandidateModel:
        problem = EstimationProblem.of_traces(little.config, bare, data)
        weighted, end = problem.weighted(weights.free_running(problem)), Termination(True, "by hand")
        s = CandidateModel(composition, (), problem, weighted, (problem, weighted), x, end, DiagnosisSettings())
        return s.with_effects(TWO, values)

    seen = of(response)  # its formulas make the data: the question is which of them is there
    noise = np.random.default_rng(4)
    exact = zip(response, seen.problem.free_run(seen.x), strict=True)
    shown = [replace(t, data=y + t.sigma * noise.standard_normal(y.shape)) for t, y in exact]
    return of(tuple(shown))


def test_an_effect_that_gives_way_is_a_round_of_its_own(bent: CandidateModel, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reading that is 20 % and 0.03 rad too large, taken for a wrong zero alone: a gain explains more of it."""
    monkeypatch.setattr("etcfit.diagnosis.exchange.refit_fully", lambda s, report: s)
    s = bent.without(GAIN).optimised()
    rival = dict.fromkeys(GAIN.off or {}, 0.1)
    back = exchanged(s, (Found(OFFSET, {}, {GAIN: rival}),), quiet)
    assert back.model.added == (GAIN,)
    assert [each.effect for each in back.found] == [GAIN]
    (turned,) = back.rounds
    assert (turned.added, turned.before.added) == (GAIN, ())
    assert [t.verdict.effect for t in turned.trials] == [GAIN, OFFSET]
    assert back.changed == (turned.choice.why,)


def test_a_rival_starts_where_its_own_refit_ended(bent: CandidateModel) -> None:
    """Its end lies far from the optimum without it; the start from there needs no way across."""
    s, end = bent.without(GAIN).optimised(), bent.without(OFFSET).optimised()
    astray = replace(s.without(OFFSET), x=s.without(OFFSET).x + 3.0)
    (_, rival) = compared_in_place(s, OFFSET, {GAIN: end.values}, astray, measured(astray))
    assert rival.verdict.score.chi2 < 1.001 * end.chi2
