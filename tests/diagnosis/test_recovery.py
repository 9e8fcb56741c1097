"""The whole diagnosis on folders from the independent generator: it names what is missing, and nothing where nothing
is. One folder a fixture; every one of them a minute or more."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis import DiagnosisSettings
from etcfit.diagnosis.composition import compose, resting
from etcfit.diagnosis.loop import screened
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.score import score
from etcfit.diagnosis.trial import run_trial
from etcfit.estimation.free_run import freed
from etcfit.estimation.rounds import rounds
from etcfit.kernels.loop import Loop
from etcfit.kernels.machine import Kernel
from etcfit.problem import one_pass_kernels
from etcfit.problem.chi2 import chi2_of
from etcfit.problem.lanes import compiled, remembered
from independent import MEDIUM, NONE
from recoveries import Case, falls, folder

pytestmark = pytest.mark.slow
SETTINGS = DiagnosisSettings()

clean = folder(1, NONE)
stribeck = folder(11, MEDIUM["stribeck_friction"])
limp_home = folder(21, MEDIUM["limp_home_spring"])
offset = folder(31, MEDIUM["current_sensor_offset"])


# ---- nothing is missing


def test_nothing_is_found_in_a_clean_folder(clean: Case) -> None:
    found = clean.diagnosis
    assert found.added == ()
    assert found.final == ()
    assert found.rig == ()
    assert len(compose(clean.result.rig, clean.result.problem.batch.traces).of_the_rig) > 30  # each was a candidate
    assert found.unexplained is None
    assert found.ties == ()
    assert [r.added for r in found.rounds] == [None]


def test_the_fit_of_a_clean_folder_stays_what_it_was(clean: Case) -> None:
    """Where nothing is added there is nothing to refit, nor to let run free; intervals allow for what is too faint."""
    after, before = clean.diagnosis.after, clean.result
    assert after.values == before.values
    assert after.chi2_per_dof == before.chi2_per_dof
    assert (np.diag(after.covariance) >= np.diag(before.covariance)).all()
    assert clean.result.converged
    assert clean.result.formulas == ()


def test_every_trace_has_its_motion(clean: Case) -> None:
    motions = clean.diagnosis.motions
    assert {m.file for m in motions if not m.held_out} == {row.file for row in clean.result.score_fit}
    assert {m.file for m in motions if m.held_out} == {row.file for row in clean.result.score_holdout}
    assert all(not m.effects for m in motions)
    torque = np.concatenate([m.torque for m in motions])
    assert np.isfinite(torque).mean() > 0.1
    assert np.nanmedian(np.abs(torque)) < 0.05 * clean.truth.T_f


# ---- one thing is missing


@pytest.mark.parametrize("name", ["stribeck", "limp_home", "offset"])
def test_what_is_missing_is_found_first_and_predicts_what_was_held_out(
    name: str, request: pytest.FixtureRequest
) -> None:
    one: Case = request.getfixturevalue(name)
    (effect,) = one.effects.on
    found = one.diagnosis
    assert found.added
    assert found.added[0] == effect
    assert found.rounds[0].added == effect
    assert falls(found) < 0.9
    assert set(found.after.free_parameters.layout.free) > set(found.before.free_parameters.layout.free)
    assert found.after.formulas == found.final  # no formula is taken as exact
    assert all(effect in m.effects for m in found.motions)


def test_the_default_position_and_the_torque_of_its_spring_are_the_generators(limp_home: Case) -> None:
    """Below it the generator's plate feels -(preload + k d), the model's T_PL + K_s theta - T_lh - K_lh d, d how far
    below: T_lh = preload + T_PL + K_s theta_lh."""
    made, values, truth = limp_home.effects.limp_home_spring, limp_home.diagnosis.after.values, limp_home.truth
    assert values["theta_lh"] == pytest.approx(made.angle, rel=0.05)
    assert values["T_lh"] == pytest.approx(made.preload + truth.T_PL + truth.K_s * made.angle, rel=0.1)


def test_the_offset_is_the_generators(offset: Case) -> None:
    """Each trace has its own, 2 % apart."""
    assert offset.diagnosis.after.values["I_0"] == pytest.approx(offset.effects.current_sensor_offset.amps, rel=0.1)


def test_friction_falls_with_speed_as_the_generators_does(stribeck: Case) -> None:
    """From standstill to 2 rad/s, by T_s exp(-(w/w_s)^d) or by a Lorentzian; beyond, it is Coulomb's."""
    made, values = stribeck.effects.stribeck_friction, stribeck.diagnosis.after.values

    def model(speed: float) -> float:
        return values["T_s"] * math.exp(-((speed / values["omega_s"]) ** values["delta_s"]))

    fall = made.excess - made.excess / (1.0 + (2.0 / made.speed) ** 2)
    assert model(0.0) - model(2.0) == pytest.approx(fall, rel=0.3)


# ---- few kernels for each candidate


def test_a_candidate_makes_six_kernels_and_none_when_it_is_tried_again(
    clean: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sum and samples of the fitted traces and of those held out, the slopes of the former, and samples run free, which
    read no filter. Effects of one to four parameters, with memory and without."""
    made: list[Loop] = []

    def counted(loop: Loop) -> Kernel:
        made.append(loop)
        return compiled(loop)

    monkeypatch.setattr(one_pass_kernels, "compiled", counted)
    # other tests of this process may have made the same kernels
    monkeypatch.setattr(one_pass_kernels, "kernel", remembered(64)(inspect.unwrap(one_pass_kernels.kernel)))
    s = start(clean.result, SETTINGS)
    before = score(s)
    s.problem.chi2(s.x, s.weighted)  # with which a candidate is compared
    by_name = {g.variant.effect.name: g for g in screened(s, s.composition.candidates)}
    for name in ("gravity_load", "limp_home_spring", "winding_heating"):
        g = by_name[name]
        made.clear()
        refitted = run_trial(s, g.variant.effect, g.values, before).model.values
        values = {symbol: refitted[symbol] for symbol in resting(g.variant.effect)}
        assert len(made) == 6
        made.clear()
        run_trial(s, g.variant.effect, values, before)
        assert made == []


# ---- rounds and searches


def test_rounds_end_as_soon_as_nothing_moves_by_more_than_what_counts(clean: Case) -> None:
    """The first may move from another whitening; the second is the first that can be the last."""
    said: list[str] = []
    problem, x = clean.result.problem, clean.result.x
    _, _, there, end = rounds(problem, x, lambda text, share: said.append(text), still=1e9, most=10)
    assert [text.split(":")[0] for text in said] == ["whitening 1", "whitening 2"]
    assert "inf" not in " ".join(said)
    assert end.converged
    assert_allclose((there - x) / np.sqrt(np.diag(clean.result.covariance)), 0.0, atol=0.5)


def test_a_free_run_that_was_searched_for_is_no_worse_than_where_the_search_began(clean: Case) -> None:
    problem, x = replace(clean.result.problem, guide_stiffness=0.0), clean.result.x + 0.05
    weighed, weighted, there, _ = freed(problem, x, 0.05)
    begun, ended = chi2_of(weighed, np.stack((x, there)), weighted)
    assert ended < 0.5 * begun
    assert np.all(weighed.sigma >= problem.batch.slots.sigma)
