"""The whole diagnosis on folders from the independent generator: what is hidden, two effects at once, and what nobody
has named. A file of its own beside test_recovery: each file stays with one process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etcfit.diagnosis import Diagnosis, DiagnosisSettings
from etcfit.diagnosis.choice import Choice, Outcome
from etcfit.diagnosis.loop import Round, run_round, screened
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.rounds import find_masked_effect
from etcfit.diagnosis.score import score
from etcfit.estimation.joint_fit import fit, quiet
from etcfit.rig.reader import read_folder
from independent import MEDIUM, STRENGTHS, combine, draw_truth, make_folder
from recoveries import Case, falls, folder

pytestmark = pytest.mark.slow
SETTINGS = DiagnosisSettings()

pair = folder(41, combine(MEDIUM["limp_home_spring"], MEDIUM["winding_heating"]))
spot = folder(51, STRENGTHS["friction_spot"][2])


def is_found(diagnosis: Diagnosis, name: str) -> bool:
    """By its name, or as one that these data cannot tell from a name."""
    ties = [tie.effects for tie in diagnosis.ties if set(tie.effects) & set(diagnosis.added)]
    return name in diagnosis.added or any(name in tie for tie in ties)


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
