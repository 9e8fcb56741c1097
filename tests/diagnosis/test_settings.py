"""What a diagnosis decides by: documented, within bounds, and each obeyed by the decision that it names."""

from __future__ import annotations

import ast
import inspect
import json
import math
from collections.abc import Callable
from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import diagnoses
from diagnoses import score, verdict
from etcfit.diagnosis import DiagnosisSettings, settings
from etcfit.diagnosis.choice import alike, choose, deserves_second_trial, promising
from etcfit.diagnosis.evidence import Place, shares, whiteness
from etcfit.diagnosis.exchange import is_rival
from etcfit.diagnosis.findings import RigMistake
from etcfit.diagnosis.model_discrepancy import chi2_left_by_formula
from etcfit.diagnosis.refit import further_from_data
from etcfit.diagnosis.score import groups_of
from etcfit.diagnosis.screen import Signature
from etcfit.diagnosis.statements import rig_mistakes, statements
from etcfit.diagnosis.tangents import variants
from etcfit.diagnosis.unexplained import in_doubt, much_is_left, one_curve_does_more, questioned
from etcfit.files import plain
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.rig_effects import rig_effect
from etcfit.ranges import from_json
from etcfit.rig.base import Rig
from etcfit.run_folder.diagnosis import diagnosis_json

DEFAULT = DiagnosisSettings()
NAMES = [each.name for each in fields(DiagnosisSettings)]
LIMP, GRAVITY = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "gravity_load"))
VALUES = {"J_m": 5e-6, "J_L": 1e-4, "T_f": 0.1, "R_a": 1.5, "K_b": 0.02, "L_a": 8e-4, "K_m": 0.02}


def with_(**changes: Any) -> DiagnosisSettings:
    return replace(DEFAULT, **changes)


# ---- the object


def test_the_defaults_are_those_of_the_recorded_folders() -> None:
    """Results of many folders are on record with these: a change of one makes them void."""
    assert plain(DEFAULT) == {
        "rounds": 8, "refits": 4, "rig_refits": 3, "refits_side_by_side": 2,
        "least_promise": 0.3, "rival_promise": 0.3, "rival_promise_far": 0.1,
        "strong_bic_change": -10.0, "least_part": 0.2, "least_part_of_one": 1.0, "tied_likelihood": 6.0,
        "trial_rise": 0.02, "refit_rise": 0.2, "far_rise": 2.0, "spared_gain": 0.01, "folds": 3, "fold_tolerance": 1e-3,
        "trial_tolerance": 1e-3, "steepest_start": 3.0, "start_halvings": 8, "second_trial_share": 0.5,
        "refit_tolerance": 1e-4, "near_chi2_per_dof": 10.0, "whitening_rounds": 10, "still": 0.2, "reweighings": 2,
        "worse_chi2": 1.5, "exchange_rival": 0.5,
        "imitated": 0.05, "merges": 2, "handing_over": 8, "pair_refits": 2, "pieces": 3, "single_traces": 8,
        "late_stretches": 20,
        "formula_ceiling": 0.04, "formula_stretches": 6,
        "curve_length": 3.0, "curve_evidence": 10.0, "large_curve": 0.05, "curve_stretches": 20,
        "white_p": 1e-4, "large_rms": 0.03, "large_rms_deviations": 5.0, "share_bins": 24, "share_samples": 200,
        "share_told": 0.05, "guide": {"give": 0.01, "bandwidth": 15.0, "bandwidth_of_rate": 0.1, "least": 0.003,
        "stable": 0.3, "shares": [1.0, 0.3, 0.1, 0.03, 0.01, 0.003]},
        "free_pool": 6, "curve_refits": 1, "name_keeps": 0.9, "names_hold": 0.8, "curve_asked": 1.5, "bic_temper": 10.0,
        "lapse": 0.1, "least_credit": 0.5, "missed": 0.1, "slow_log": 0.5, "suspicion": 0.8,
        "free_spread": 0.1,
    }  # fmt: skip


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


@pytest.mark.parametrize("name", [name for name in NAMES if not is_dataclass(getattr(DEFAULT, name))])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "3", None, True])
def test_what_is_no_number_is_refused_with_name_and_value(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"DiagnosisSettings\.{name} = {value!r}: it must be a"):
        with_(**{name: value})


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("rounds", 0, "a whole number, 1 or more"),
        ("refits", 2.5, "a whole number, 1 or more"),
        ("strong_bic_change", 0.1, "a number, 0 or less"),
        ("least_promise", 1.1, "a number, from 0 to 1"),
        ("trial_rise", -0.01, "a number, 0 or more"),
        ("refit_tolerance", 0.0, "a number, greater than 0"),
        ("worse_chi2", 0.99, "a number, 1 or more"),
        ("white_p", 1.0, "a number, greater than 0 and less than 1"),
        ("name_keeps", 1.0, "a number, greater than 0 and less than 1"),
        ("share_bins", 1, "a whole number, 2 or more"),
        ("start_halvings", -1, "a whole number, 0 or more"),
    ],
)
def test_a_value_out_of_its_range_is_refused_with_the_range(name: str, value: float, allowed: str) -> None:
    with pytest.raises(ValueError, match=rf"{name} = .*: it must be {allowed}\."):
        with_(**{name: value})


def test_settings_cannot_be_changed_afterwards() -> None:
    with pytest.raises(FrozenInstanceError):
        DEFAULT.rounds = 3  # pyright: ignore[reportAttributeAccessIssue]


def test_a_whole_number_may_stand_for_a_real_one() -> None:
    assert with_(far_rise=3).far_rise == 3


def test_diagnosis_json_records_what_was_decided_by(rig: Rig) -> None:
    mine = with_(rounds=3, trial_rise=0.05)
    recorded = diagnosis_json(diagnoses.diagnosis(rig, settings=mine))["settings"]
    assert from_json(DiagnosisSettings, json.loads(json.dumps(recorded))) == mine


# ---- each is obeyed by the decision that it names


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
    return len(promising(every, score(1000.0), far, with_(**changes)))


def likely(probability: float, **changes: Any) -> RigMistake:
    """A mistake of the rig of that probability."""
    gain = rig_effect("channel_gain[viscous.current]")
    assert gain is not None
    values = {"gain.viscous.current": 0.1}
    stated = statements([gain], values, {gain.name: probability}, (), (), with_(**changes))
    (mistake,) = rig_mistakes([gain], values, stated)
    return mistake


def is_white(size: float, **changes: Any) -> bool:
    rng = np.random.default_rng(0)
    along = {name: rng.normal(size=2000) for name in ("input", "speed", "angle", "current", "time")}
    r = rng.normal(size=2000)
    r *= size / np.sqrt(np.mean(r**2))
    return whiteness(
        Place("a.csv", "response", "position"), r, np.ones(2000, dtype=bool), along, with_(**changes)
    ).white


def read(**changes: Any) -> int:
    along = [{name: np.arange(150.0) for name in ("angle", "speed", "current", "load", "time")}]
    return len(shares("torque", along, [np.arange(150.0)], with_(**changes)))


CASES: dict[str, tuple[Callable[..., Any], Any, dict[str, float], Any]] = {
    "strong_bic_change": (lambda **c: added(with_(**c)), True, {"strong_bic_change": -20.0}, False),
    "least_part": (lambda **c: added(with_(**c), chi2=1300.0), True, {"least_part": 0.3}, False),
    "least_part_of_one": (lambda **c: added_of_one(with_(**c)), True, {"least_part_of_one": 2.5}, False),
    "spared_gain": (lambda **c: added(with_(**c), holdout_chi2_change=3.0), False, {"spared_gain": 0.05}, True),
    "tied_likelihood": (
        lambda **c: alike(verdict(LIMP, -9.0, chi2=905.0), verdict(GRAVITY, -40.0), with_(**c)),
        True, {"tied_likelihood": 5.0}, False,
    ),
    "formula_ceiling": (lambda **c: chi2_left_by_formula(0.5, 1000.0, 1000.0, with_(**c)), 40.0,
                        {"formula_ceiling": 0.1}, 100.0),
    "trial_rise": (lambda **c: with_(**c).rise_in_trial(False), 0.02, {"trial_rise": 0.1}, 0.1),
    "refit_rise": (lambda **c: with_(**c).rise_in_refit(False), 0.2, {"refit_rise": 0.1}, 0.1),
    "far_rise": (lambda **c: (with_(**c).rise_in_trial(True), with_(**c).rise_in_refit(True)), (2.0, 2.0),
                 {"far_rise": 1.0}, (1.0, 1.0)),
    "worse_chi2": (lambda **c: further_from_data(1.6, 1.0, with_(**c)), True, {"worse_chi2": 1.7}, False),
    "refits": (lambda **c: chosen(9, **c), 4, {"refits": 2}, 2),
    "rival_promise": (lambda **c: chosen(9, refits=9, **c), 6, {"rival_promise": 0.7}, 2),
    "rival_promise_far": (lambda **c: chosen(9, far=True, refits=9, **c), 9, {"rival_promise_far": 0.7}, 2),
    "least_promise": (lambda **c: chosen(1, **c), 1, {"least_promise": 1.0, "strong_bic_change": -200.0}, 0),
    "second_trial_share": (
        lambda **c: deserves_second_trial(
            verdict(LIMP, -99.0, gain=600.0, holdout_rms_ratio=2.0), score(2000.0), False, with_(**c)
        ),
        True, {"second_trial_share": 0.7}, False,
    ),
    "exchange_rival": (
        lambda **c: is_rival(verdict(LIMP, -9.0, gain=60.0), verdict(GRAVITY, -9.0, gain=100.0), with_(**c)),
        True, {"exchange_rival": 0.7}, False,
    ),
    "folds": (lambda **c: len(groups_of(range(9), with_(**c).folds)), 3, {"folds": 5}, 5),
    "name_keeps": (lambda **c: in_doubt(1000.0, 130.0, 100.0, with_(**c)), True, {"name_keeps": 0.8}, False),
    "surely_named": (lambda **c: questioned([LIMP], {LIMP: 400.0}, -50.0, with_(**c)), [LIMP],
                     {"name_keeps": 0.8}, []),
    "names_hold": (lambda **c: one_curve_does_more(1000.0, 50.0, 10.0, with_(**c)), True, {"names_hold": 0.6}, False),
    "curve_asked": (lambda **c: much_is_left(1.6, with_(**c)), True, {"curve_asked": 1.7}, False),
    "suspicion": (lambda **c: likely(0.75, **c).suspected, True, {"suspicion": 0.7}, False),
    "large_rms": (lambda **c: is_white(1.15, **c), False, {"large_rms": 0.1}, True),
    "large_rms_deviations": (lambda **c: is_white(1.10, **c), True, {"large_rms_deviations": 1.0}, False),
    "share_samples": (read, 0, {"share_samples": 100}, 5),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_setting_changes_the_decision_that_it_names(name: str) -> None:
    decide, by_default, changes, otherwise = CASES[name]
    assert decide() == by_default
    assert decide(**changes) == otherwise
