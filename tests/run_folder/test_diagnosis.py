"""Rounds of a diagnosis under way are kept, and taken up again by a diagnosis of the same fit alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import diagnoses
import results
from equality import equal
from etcfit.diagnosis.composition import resting
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.rounds import Progress
from etcfit.diagnosis.settings import DEFAULT
from etcfit.estimation.result import FitResult
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.run_folder.diagnosis import KeptRounds
from etcfit.run_folder.state import save_fit

LIMP, AIR = (EFFECT_BY_NAME[name] for name in ("limp_home_spring", "airflow_torque"))


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), far=True)


@pytest.fixture(scope="module")
def progress(fit: FitResult) -> Progress:
    """After one round, which added the spring; another effect of the rig stands among its rivals."""
    s = start(fit, DEFAULT)
    rig_effect = s.composition.of_the_rig[0]
    found = Found(LIMP, {}, {AIR: {"T_air": 0.1}, rig_effect: {"x": 1.0}})
    return Progress(s.with_effects((LIMP,), {**fit.values, **resting(LIMP)}), (found,), diagnoses.rounds(fit)[:1])


def test_what_was_kept_comes_back_whole(fit: FitResult, progress: Progress, tmp_path: Path) -> None:
    save_fit(tmp_path, fit)
    assert KeptRounds(tmp_path, fit).read() is None
    KeptRounds(tmp_path, fit).keep(progress)
    again = KeptRounds(tmp_path, fit).read()
    assert again is not None
    assert equal(again, progress)
    assert again.model.chi2 == progress.model.chi2


def test_rounds_of_another_fit_or_of_other_settings_are_not_taken_up(
    fit: FitResult, progress: Progress, tmp_path: Path
) -> None:
    save_fit(tmp_path, fit)
    other = replace(progress.model, settings=replace(DEFAULT, refits=DEFAULT.refits + 1))
    KeptRounds(tmp_path, fit).keep(replace(progress, model=other))
    assert KeptRounds(tmp_path, fit).read() is None
    KeptRounds(tmp_path, fit).keep(progress)
    save_fit(tmp_path, replace(fit, reason="fitted again"))
    assert KeptRounds(tmp_path, fit).read() is None


def test_a_file_that_is_cut_off_is_no_begin(fit: FitResult, progress: Progress, tmp_path: Path) -> None:
    save_fit(tmp_path, fit)
    kept = KeptRounds(tmp_path, fit)
    kept.keep(progress)
    file = tmp_path / "diagnosis_rounds.npz"
    file.write_bytes(file.read_bytes()[:-40])
    assert KeptRounds(tmp_path, fit).read() is None


def test_an_interrupted_diagnosis_says_what_it_found_and_how_to_go_on(
    fit: FitResult, progress: Progress, tmp_path: Path
) -> None:
    save_fit(tmp_path, fit)
    kept = KeptRounds(tmp_path, fit)
    assert "before the first round" in kept.when_interrupted()
    kept.keep(progress)
    said = kept.when_interrupted()
    assert "after round 1" in said
    assert LIMP.name in said
    assert f"etcfit diagnose {tmp_path}" in said
