"""What a diagnosis decides by: documented, within bounds, and each obeyed by the decision that it names."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import diagnoses
from diagnoses import score, verdict
from etcfit.diagnosis import (
    DiagnosisSettings,
    candidate_model,
    choice,
    credit,
    evidence,
    exchange,
    formula_errors,
    free_sets,
    probabilities,
    random_curves,
    refit,
    rig_screen,
    settings,
    trial,
    unexplained,
)
from etcfit.diagnosis import score as score_module
from etcfit.diagnosis.choice import choose, promising
from etcfit.diagnosis.evidence import Place, shares, whiteness
from etcfit.diagnosis.findings import RigMistake
from etcfit.diagnosis.score import groups_of
from etcfit.diagnosis.screen import Signature
from etcfit.diagnosis.statements import rig_mistakes, statements
from etcfit.diagnosis.tangents import variants
from etcfit.diagnosis.trial import Cost
from etcfit.files import plain
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import rig_effect
from etcfit.ranges import from_json
from etcfit.rig.base import Rig
from etcfit.run_folder.diagnosis import DIAGNOSIS

DEFAULT = DiagnosisSettings()
NAMES = [each.name for each in fields(DiagnosisSettings)]
LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))


def with_(**changes: Any) -> DiagnosisSettings:
    return replace(DEFAULT, **changes)


# ---- the object


def test_the_defaults_are_those_of_the_recorded_folders() -> None:
    """Results of many folders are on record with these: a change of one makes them void."""
    assert plain(DEFAULT) == {
        "rounds": 8, "refits": 4, "rig_refits": 3, "refits_side_by_side": 2, "strong_bic_change": -10.0,
        "refit_rise": 0.2, "folds": 3, "free_pool": 6, "orders": 2,
        "pieces": 3, "single_traces": 8, "lapse": 0.1, "missed": 0.1, "slow_log": 0.5, "suspicion": 0.8,
    }  # fmt: skip


CONSTANTS: dict[ModuleType, dict[str, float]] = {
    candidate_model: {"TRIAL_TOLERANCE": 1e-3, "STEEPEST_START": 3.0, "SEARCH_SPREAD": 0.15, "START_HALVINGS": 8},
    choice: {"LEAST_PROMISE": 0.5, "RIVAL_PROMISE": 0.3, "RIVAL_PROMISE_FAR": 0.1, "LEAST_PART": 0.2,
             "LEAST_PART_OF_ONE": 1.0, "TIED_LIKELIHOOD": 6.0},
    evidence: {"EVENT": 0.1, "WHITE_P": 1e-5, "LARGE_RMS": 0.03, "LARGE_RMS_DEVIATIONS": 5.0, "SHARE_BINS": 24,
               "SHARE_SAMPLES": 200, "SHARE_NAMED": 0.05},
    exchange: {"EXCHANGE_RIVAL": 0.5},
    free_sets: {"FREE_SPREAD": 0.1},
    formula_errors: {"ERROR_STRETCHES": 20, "FORMULA_STRETCHES": 6, "FORMULA_CEILING": 0.04},
    random_curves: {"CURVE_LENGTH": 3.0, "CURVE_EVIDENCE": 10.0, "LARGE_CURVE": 0.05, "CURVE_STRETCHES": 20},
    credit: {"LEAST_CREDIT": 0.5, "LEAST_CREDIT_OF_A_MISTAKE": 0.7, "LARGE_MISFIT": 3.0, "BESIDE_A_LARGE_MISFIT": 0.7,
             "STRAYING": 5.0},
    probabilities: {"BIC_TEMPER": 10.0, "BESIDE_FORMULAS": 7.0},
    refit: {"REFIT_TOLERANCE": 1e-4, "NEAR_CHI2_PER_DOF": 10.0, "WHITENING_ROUNDS": 10, "STILL": 0.2,
            "REWEIGHINGS": 2, "WORSE_CHI2": 1.5},
    rig_screen: {"LATE_STRETCHES": 20},
    score_module: {"FOLD_TOLERANCE": 1e-3},
    settings: {"TRIAL_RISE": 0.02, "FAR_RISE": 2.0},
    trial: {"SPARED_GAIN": 0.01},
    unexplained: {"CURVE_REFITS": 1},
}  # fmt: skip


@pytest.mark.parametrize("module", CONSTANTS, ids=lambda module: module.__name__)
def test_the_thresholds_are_those_of_the_recorded_folders(module: ModuleType) -> None:
    assert {name: getattr(module, name) for name in CONSTANTS[module]} == CONSTANTS[module]


def test_every_setting_is_explained() -> None:
    (body,) = (n.body for n in ast.walk(ast.parse(inspect.getsource(settings)))
               if isinstance(n, ast.ClassDef) and n.name == "DiagnosisSettings")  # fmt: skip
    told = {
        here.target.id: after.value.value
        for here, after in pairwise(body)
        if isinstance(here, ast.AnnAssign) and isinstance(here.target, ast.Name)
        and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    }  # fmt: skip
    assert set(told) == set(NAMES)
    assert all(isinstance(words, str) and len(words) > 20 for words in told.values())


def test_diagnosis_json_records_what_was_decided_by(rig: Rig) -> None:
    mine = with_(rounds=3, refit_rise=0.05)
    recorded = DIAGNOSIS.json(diagnoses.diagnosis(rig, settings=mine))["settings"]
    assert from_json(DiagnosisSettings, json.loads(json.dumps(recorded))) == mine


# ---- each is obeyed by the decision that it names; the constants by the tests of their own files


def added(settings: DiagnosisSettings, **how: Any) -> bool:
    return choose([verdict(LIMP, -15.0, **how)], settings, noise=900.0).effect is LIMP


def added_of_one(settings: DiagnosisSettings) -> bool:
    """Of one channel of one trace: it gains 100 and leaves 50 above the noise."""
    one = rig_effect("channel_offset[viscous/volts_1.csv.current]")
    assert one is not None
    return choose([verdict(one, -15.0, chi2=950.0)], settings, noise=900.0).effect is one


def chosen(count: int, **changes: Any) -> int:
    """How many of so many candidates, each of gain 0.8 of the one before, are worth a refit."""
    every = [Signature(variants(LIMP)[0], np.zeros((1, 2)), 100.0 * 0.8**k, {}, 1.0) for k in range(count)]
    far = changes.pop("far", False)
    return len(promising(every, score(1000.0), far, lambda _: Cost(2, 1), with_(**changes)))


def likely(probability: float, **changes: Any) -> RigMistake:
    """A mistake of the rig of that probability."""
    gain = rig_effect("channel_gain[viscous.current]")
    assert gain is not None
    values = {"gain.viscous.current": 0.1}
    stated = statements([gain], values, {gain.name: probability}, (), (), with_(**changes))
    (mistake,) = rig_mistakes([gain], values, stated)
    return mistake


def is_white(size: float) -> bool:
    rng = np.random.default_rng(0)
    along = {name: rng.normal(size=2000) for name in ("input", "speed", "angle", "current", "time")}
    r = rng.normal(size=2000)
    r *= size / np.sqrt(np.mean(r**2))
    return whiteness(Place("a.csv", "response", "position"), r, np.ones(2000, dtype=bool), along).white


def read() -> int:
    along = [{name: np.arange(150.0) for name in ("angle", "speed", "current", "load", "time")}]
    return len(shares("torque", along, [np.arange(150.0)]))


CASES: dict[str, tuple[Callable[..., Any], Any, dict[str, float], Any]] = {
    "strong_bic_change": (lambda **c: added(with_(**c)), True, {"strong_bic_change": -20.0}, False),
    "least_part_of_one": (lambda **c: added_of_one(with_(**c)), True, {"LEAST_PART_OF_ONE": 2.5}, False),
    "trial_rise": (lambda: DEFAULT.rise_in_trial(False), 0.02, {"TRIAL_RISE": 0.1}, 0.1),
    "refit_rise": (lambda **c: with_(**c).rise_in_refit(False), 0.2, {"refit_rise": 0.1}, 0.1),
    "far_rise": (lambda: (DEFAULT.rise_in_trial(True), DEFAULT.rise_in_refit(True)), (2.0, 2.0),
                 {"FAR_RISE": 1.0}, (1.0, 1.0)),
    "refits": (lambda **c: chosen(9, **c), 4, {"refits": 2}, 2),
    "folds": (lambda **c: len(groups_of(range(9), with_(**c).folds)), 3, {"folds": 5}, 5),
    "suspicion": (lambda **c: likely(0.75, **c).suspected, True, {"suspicion": 0.7}, False),
    "large_rms": (lambda: is_white(1.15), False, {"LARGE_RMS": 0.1}, True),
    "large_rms_deviations": (lambda: is_white(1.10), True, {"LARGE_RMS_DEVIATIONS": 1.0}, False),
    "share_samples": (read, 0, {"SHARE_SAMPLES": 100}, 5),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_threshold_changes_the_decision_that_it_names(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    decide, by_default, changes, otherwise = CASES[name]
    assert decide() == by_default
    for module, constants in CONSTANTS.items():
        for constant in constants.keys() & changes.keys():
            monkeypatch.setattr(module, constant, changes[constant])
    assert decide(**{key: value for key, value in changes.items() if key in NAMES}) == otherwise
