"""A model with other effects: its unknowns change, its data and its whitening do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.model.effects import EFFECT_BY_NAME

LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))


def nominal(model: CandidateModel) -> CandidateModel:
    layout = model.problem.layout
    return replace(model, x=layout.coordinates({p.symbol: p.nominal for p in layout.parameters}))


def test_another_effect_changes_the_unknowns_and_neither_data_nor_whitening(model: CandidateModel) -> None:
    more = model.with_effects((GRAVITY,), {"T_g": 0.2})
    assert more.added == (GRAVITY,)
    assert more.at_work(GRAVITY)
    assert not more.at_work(LIMP)
    assert model.holdout is not None
    assert more.holdout is not None
    pairs = [(model.problem, model.weighted, more.problem, more.weighted), (*model.holdout, *more.holdout)]
    for problem, weighted, new_problem, new_weighted in pairs:
        assert_array_equal(new_weighted.whitening.weight, weighted.whitening.weight)
        assert new_problem.batch is problem.batch
        assert new_problem.sigma is problem.sigma
        assert tuple(s for s in new_problem.layout.free if s != "T_g") == problem.layout.free
        assert new_weighted.prior_sd.shape == new_weighted.pick.where.shape == (len(problem.layout.free) + 1,)
    shared = [more.problem.layout.free.index(s) for s in model.problem.layout.free]
    assert_array_equal(more.x[shared], model.x)
    assert more.values["T_g"] == pytest.approx(0.2)
    assert more.settings is model.settings


def test_an_effect_taken_away_leaves_the_model_that_was(model: CandidateModel) -> None:
    back = model.with_effects((GRAVITY,), {"T_g": 0.2}).without(GRAVITY)
    assert back.added == ()
    assert_array_equal(back.x, model.x)
    assert back.problem.layout == model.problem.layout
    assert_array_equal(back.weighted.pick.full, model.weighted.pick.full)


def test_a_parameter_that_becomes_free_must_be_given_a_value(model: CandidateModel) -> None:
    with pytest.raises(KeyError, match="T_g"):
        model.with_effects((GRAVITY,), {})


def test_held_out_traces_are_those_beside(model: CandidateModel) -> None:
    assert [t.measurement.file for t in model.held_out] == [model.problem.batch.traces[0].measurement.file]
    assert replace(model, holdout=None).held_out == ()


def test_a_lean_model_has_the_residual_of_the_composed_one(model: CandidateModel) -> None:
    s = nominal(model).with_effects((GRAVITY,), {"T_g": 0.05})
    whole = s.composed(s.composition.inside)
    assert len(whole.problem.layout.types) > len(s.problem.layout.types)
    assert_array_equal(whole.x, s.x)
    assert whole.chi2 == pytest.approx(s.chi2, rel=1e-9)
    assert whole.lean().chi2 == s.chi2
    assert s.chi2_per_sample == pytest.approx(s.chi2 / np.sum(np.asarray(s.weighted.slots.weight) > 0.0))


def test_a_steep_beginning_is_halved_until_the_model_holds(model: CandidateModel) -> None:
    """A torque of some hundred N m carries the plate into its stops; the off value does nothing at all."""
    rest = nominal(model)
    assert rest.trying((GRAVITY,), {"T_g": 0.0}).chi2 == pytest.approx(rest.chi2, rel=1e-9)
    wild = rest.with_effects((GRAVITY,), {"T_g": 400.0})
    assert wild.chi2 > 3.0 * rest.chi2
    begun = rest.trying((GRAVITY,), {"T_g": 400.0})
    assert begun.chi2 < 3.0 * rest.chi2
    assert begun.with_effects((GRAVITY,), {}).values["T_g"] < 400.0
    halvings = np.log2(400.0 / begun.values["T_g"])
    assert halvings == pytest.approx(round(halvings), abs=1e-6)
    # one halving less would still be too steep
    assert rest.with_effects((GRAVITY,), {"T_g": 2.0 * begun.values["T_g"]}).chi2 > 3.0 * rest.chi2


def test_no_more_halvings_are_made_than_allowed(model: CandidateModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("etcfit.diagnosis.candidate_model.START_HALVINGS", 1)
    rest = nominal(model)
    assert rest.trying((GRAVITY,), {"T_g": 400.0}).values["T_g"] == pytest.approx(200.0)


def test_a_population_is_spread_widely_over_the_effect_alone_and_its_end_is_an_optimum(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where it ended is the start of a descent; what it was given is all that decides how far it looks."""
    s, seen = small.with_effects((GRAVITY,), {"T_g": 0.2}).optimised(), {}

    def evolved(cost: Callable[[np.ndarray], np.ndarray], x: np.ndarray, spread: np.ndarray) -> np.ndarray:
        seen.update(cost=cost(np.stack((x, x + spread))), spread=spread)
        return x + 0.5 * spread

    monkeypatch.setattr("etcfit.diagnosis.candidate_model.evolve_population", evolved)
    found = s.searched(GRAVITY)
    own = s.problem.layout.free.index("T_g")
    assert seen["spread"][own] == pytest.approx(0.15 * abs(s.x[own]))
    assert np.all(np.delete(seen["spread"], own) <= 0.1)
    assert seen["cost"][0] == pytest.approx(s.chi2)
    assert found.chi2 == pytest.approx(s.chi2, rel=1e-2)
