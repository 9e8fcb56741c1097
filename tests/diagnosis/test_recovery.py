"""The whole diagnosis on folders from the independent generator: it names what is missing, and nothing where nothing
is. One folder a fixture; every one of them a minute or more."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from etcfit.diagnosis.choice import Choice, Outcome
from etcfit.diagnosis.loop import Round, run_round, screened
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.rounds import find_masked_effect
from etcfit.diagnosis.score import score
from etcfit.diagnosis.trial import run_trial
from etcfit.estimation.free_run import freed
from etcfit.estimation.joint_fit import FitResult, fit, quiet
from etcfit.estimation.rounds import rounds
from etcfit.kernels.loop import Loop
from etcfit.kernels.machine import Kernel
from etcfit.problem import one_pass_kernels
from etcfit.problem.chi2 import chi2_of
from etcfit.problem.lanes import compiled, remembered
from etcfit.problem.prediction_error import pooled
from etcfit.rig.reader import read_folder
from independent import MEDIUM, NONE, STRENGTHS, Effects, Truth, combine, draw_truth, make_folder

pytestmark = pytest.mark.slow
SETTINGS = DiagnosisSettings()


@dataclass(frozen=True)
class Case:
    """A folder, what it was made from, its fit of Eqs. 1-2, and what was found missing in that."""

    truth: Truth
    effects: Effects
    result: FitResult
    diagnosis: Diagnosis


def case(path: Path, seed: int, effects: Effects) -> Case:
    truth = draw_truth(np.random.default_rng(seed))
    make_folder(path, truth, seed, effects, size="small")
    result = fit(read_folder(path))
    return Case(truth, effects, result, diagnose(result))


def folder(seed: int, effects: Effects) -> Callable[..., Case]:
    @pytest.fixture(scope="module")
    def made(tmp_path_factory: pytest.TempPathFactory) -> Case:
        return case(tmp_path_factory.mktemp("rig"), seed, effects)

    return made


clean = folder(1, NONE)
stribeck = folder(11, MEDIUM["stribeck_friction"])
limp_home = folder(21, MEDIUM["limp_home_spring"])
offset = folder(31, MEDIUM["current_sensor_offset"])
pair = folder(41, combine(MEDIUM["limp_home_spring"], MEDIUM["winding_heating"]))
spot = folder(51, STRENGTHS["friction_spot"][2])


def is_found(diagnosis: Diagnosis, name: str) -> bool:
    """By its name, or as one that these data cannot tell from a name."""
    ties = [tie.effects for tie in diagnosis.ties if set(tie.effects) & set(diagnosis.added)]
    return name in diagnosis.added or any(name in tie for tie in ties)


def falls(diagnosis: Diagnosis) -> float:
    """Held-out free-running error over that of Eqs. 1-2."""
    return pooled(diagnosis.after.score_holdout) / pooled(diagnosis.before.score_holdout)


# ---- nothing is missing


def test_nothing_is_found_in_a_clean_folder(clean: Case) -> None:
    found = clean.diagnosis
    assert found.added == ()
    assert found.final == ()
    assert found.unexplained is None
    assert found.ties == ()
    assert [r.added for r in found.rounds] == [None]


def test_the_fit_of_a_clean_folder_stays_what_it_was(clean: Case) -> None:
    """Where nothing is added there is nothing to refit, nor to let run free."""
    assert clean.diagnosis.after is clean.result
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


def test_a_rebound_is_found_though_a_small_one_ends_within_its_step(tmp_path: Path) -> None:
    """A constant restitution here, one that falls with the speed of impact there."""
    truth = draw_truth(np.random.default_rng(61))
    make_folder(tmp_path, truth, 61, MEDIUM["stop_bounce"], size="small")
    found = run_round(start(fit(read_folder(tmp_path)), SETTINGS), quiet)
    assert found.added is not None
    assert found.added.name == "stop_bounce"


def test_a_slow_sensor_is_found_though_a_run_along_its_reading_hides_it(tmp_path: Path) -> None:
    """15 ms, and a second filter of 2 ms behind it: the first fit ends far off, with 29 % more inertia."""
    truth = draw_truth(np.random.default_rng(8111))
    make_folder(tmp_path, truth, 8111, STRENGTHS["position_sensor_lag"][2], size="small")
    result = fit(read_folder(tmp_path))
    assert result.far
    assert abs(result.values["J_L"] / truth.J_L - 1.0) > 0.2
    s = start(result, SETTINGS)
    lag = [e for e in s.composition.candidates if e.hidden]
    far = Choice(Outcome.NO_PROMISE, None, (), "")
    shown = find_masked_effect(result, Round(s, score(s), screened(s, lag), (), far), quiet)
    assert shown is not None
    turned, s = shown
    assert turned.added is not None
    assert turned.added.name == "position_sensor_lag"
    assert not s.far
    assert s.chi2_per_sample < 1.5
    values = s.problem.layout.values(s.x, s.problem.free_parameters.held)
    assert float(values["tau_p"]) == pytest.approx(0.01725, rel=0.1)
    assert float(values["J_L"]) == pytest.approx(truth.J_L, rel=0.1)


# ---- more than one, and what nobody has named


def test_both_of_two_are_found(pair: Case) -> None:
    for name in pair.effects.on:
        assert is_found(pair.diagnosis, name), pair.diagnosis.verdict
    assert falls(pair.diagnosis) < 0.9


def test_what_is_outside_the_catalogue_is_given_no_name_and_traced_to_where_it_enters(spot: Case) -> None:
    """A rough place on the shaft: extra friction within a narrow band of angle."""
    found = spot.diagnosis
    left = found.unexplained
    assert found.added == (), found.verdict
    assert left is not None
    assert (left.enters, left.depends_on) == ("friction", "angle")


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
        values = run_trial(s, g.variant.effect, g.values, before).own_values
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
