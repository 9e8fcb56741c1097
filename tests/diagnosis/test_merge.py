"""One effect is put in place of two that do together what it does alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import compose
from etcfit.diagnosis.exchange import Found, cost, exchange_two_for_one, gave_way_to_one, merged
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.joint_fit import quiet
from etcfit.estimation.result import Termination
from etcfit.model.rig_effects import AbstractRigEffect, rig_effect
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Fixed, Rig


def named(name: str) -> type[AbstractRigEffect]:
    effect = rig_effect(name)
    assert effect is not None
    return effect


GAIN, OFFSET = named("channel_gain[response.position]"), named("channel_offset[response.position]")
ENDS = named("sensor_end_points")
TWO = (GAIN, OFFSET)


@pytest.fixture(scope="module")
def bent(rig: Rig, traces: tuple[Trace, ...]) -> CandidateModel:
    """Responses alone, whose position reads 20 % too much and 0.03 rad besides: what its end points alone may do."""
    known = free_parameters(rig.config).layout.parameters
    held = {p.symbol: Fixed(p.nominal) for p in known if p.symbol not in ("K_s", "T_f")}
    little = replace(rig, config=replace(rig.config, parameters=held))
    response = tuple(t for t in traces if t.test.name == "response")
    composition = compose(little, traces, only=(GAIN, OFFSET, ENDS))  # one test has no gain of its own
    bare = composition.lean(())
    x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
    values = {p: v for e, v in ((GAIN, 0.2), (OFFSET, 0.03)) for p in e.off or {}}

    def of(data: tuple[Trace, ...]) -> CandidateModel:
        problem = EstimationProblem.of(little.config, bare, data)
        weighted, end = problem.weighted(weights.free_running(problem)), Termination(True, "by hand")
        s = CandidateModel(composition, (), problem, weighted, (problem, weighted), x, end, DiagnosisSettings())
        return s.with_effects(TWO, values)

    seen = of(response)  # its formulas make the data: the question is what two of them have in common with a third
    noise = np.random.default_rng(4)
    exact = zip(response, seen.problem.free_run(seen.x), strict=True)
    shown = [replace(t, data=y + t.sigma * noise.standard_normal(y.shape)) for t, y in exact]
    return of(tuple(shown))


def test_what_two_did_one_does_alone(bent: CandidateModel) -> None:
    new, bare = exchange_two_for_one(bent, TWO, ENDS), bent.without(GAIN).without(OFFSET).optimised()
    assert new is not None
    assert new.added == (ENDS,)
    assert new.chi2 - bent.chi2 < 0.1 * (bare.chi2 - bent.chi2)
    assert bent.added == TWO  # as it was


def test_where_the_model_cannot_be_computed_on_the_way_nothing_is_put_in_their_place(bent: CandidateModel) -> None:
    assert exchange_two_for_one(replace(bent, x=np.nan * bent.x), TWO, ENDS) is None


def test_one_that_costs_as_much_as_two_and_does_no_better_leaves_them(bent: CandidateModel) -> None:
    """A gain and a zero in one test, and the same in all tests, have two parameters each."""
    assert cost(bent, TWO, ENDS).parameters == 0
    found = tuple(Found(e, {}, 50.0, {}) for e in TWO)
    assert merged(bent, found, quiet) == (bent, found, ())


def test_nothing_is_tried_of_one_effect_or_far_from_the_data(bent: CandidateModel) -> None:
    alone = bent.without(OFFSET)
    for s in (alone, replace(bent, end=replace(bent.end, far=True))):
        assert merged(s, (), lambda text, share: pytest.fail(text)) == (s, (), ())


def test_the_words_name_all_three(bent: CandidateModel) -> None:
    assert gave_way_to_one(TWO, ENDS, -17.04) == (
        "channel_gain[response.position] and channel_offset[response.position] gave way to sensor_end_points, "
        "which does for both (BIC -17.0)."
    )
