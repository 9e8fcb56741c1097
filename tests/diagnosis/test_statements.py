"""Mistakes of the rig, made in folders of the independent generator: named, and mended by the line that is told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import diagnoses
import results
from diagnoses import error
from etcfit.diagnosis import Diagnosis, diagnose
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Effect
from etcfit.diagnosis.exchange import Found
from etcfit.diagnosis.findings import RigMistake, Statement
from etcfit.diagnosis.loop import screened
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.score import Apart
from etcfit.diagnosis.settings import DEFAULT, DiagnosisSettings
from etcfit.diagnosis.statements import (
    Named,
    certainty,
    rig_mistakes,
    runs_free_worse,
    statement,
    statements,
    tie,
    verdict,
)
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.model.parameters import parameters_of
from etcfit.model.rig_effects import rig_effect
from etcfit.rig.base import Rig
from etcfit.rig.reader import read_folder
from etcfit.run_folder.diagnosis import DIAGNOSIS
from independent import CONSISTENT, Truth, draw_truth
from independent.mistakes import Mistake, make_mistaken

SYMBOLS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "K_s", "T_PL", "T_f")


@dataclass(frozen=True)
class Case:
    """A folder, what was done to it, its fit, and what was found."""

    folder: Path
    truth: Truth
    made: Mistake
    before: FitResult
    found: Diagnosis


def case(folder: Path, kind: str, seed: int) -> Case:
    truth = draw_truth(np.random.default_rng(seed), CONSISTENT)
    made = make_mistaken(folder, truth, seed, kind)
    before = fit(read_folder(folder))
    return Case(folder, truth, made, before, diagnose(before))


@pytest.fixture(scope="module")
def resistor(tmp_path_factory: pytest.TempPathFactory) -> Case:
    return case(tmp_path_factory.mktemp("resistor"), "series_resistance", 7600)


def scores(result: FitResult, truth: Truth) -> np.ndarray:
    """(value - truth)/s.e. of what is estimated."""
    found = {s: i for s, i in intervals(result).items() if s in SYMBOLS and i.stderr}
    return np.array([(i.value - getattr(truth, s)) / (i.stderr or 1.0) for s, i in found.items()])


@pytest.mark.slow
def test_a_resistor_that_nobody_declared_is_named_with_its_size(resistor: Case) -> None:
    assert resistor.found.added == ("series_resistance[inductance]",)
    (mistake,) = resistor.found.rig
    assert (mistake.kind, mistake.test, mistake.unit) == ("series_resistance", "inductance", "ohm")
    assert mistake.size == pytest.approx(resistor.made.size, rel=0.01)
    assert mistake.sentence in resistor.found.verdict[0]


@pytest.mark.slow
def test_with_it_the_parameters_are_right_and_before_they_were_not(resistor: Case) -> None:
    off = abs(resistor.before.values["L_a"] / resistor.truth.L_a - 1.0)
    assert off > 0.05  # what it would have cost
    assert len(scores(resistor.found.after, resistor.truth)) == len(SYMBOLS)
    assert np.abs(scores(resistor.found.after, resistor.truth)).max() < 4.0
    assert resistor.found.after.chi2_per_dof < 1.1 < resistor.before.chi2_per_dof


@pytest.mark.slow
def test_before_nothing_is_called_estimated_that_the_mistake_moved_far(resistor: Case) -> None:
    stated = intervals(resistor.before)["L_a"]
    wrong = stated.low is not None and stated.high is not None and not stated.low <= resistor.truth.L_a <= stated.high
    assert not (stated.status == "estimated" and wrong and not resistor.before.contradictions)


@pytest.mark.slow
def test_the_line_it_tells_mends_the_folder(resistor: Case) -> None:
    told = next(each for each in DIAGNOSIS.json(resistor.found)["rig"] if each["effect"])
    assert told["mend"] == '[tests.inductance] series_ohm = "free"'
    table, line = told["mend"].split(" ", 1)
    toml = resistor.folder / "rig.toml"
    toml.write_text(f"{toml.read_text(encoding='utf-8')}\n{table}\n{line}\n", encoding="utf-8")
    mended = fit(read_folder(resistor.folder))
    assert mended.chi2_per_dof < 1.1
    assert mended.values["series_ohm.inductance"] == pytest.approx(resistor.made.size, rel=0.01)


@pytest.mark.slow
def test_the_rigs_tangents_are_differences_of_the_residual(resistor: Case) -> None:
    """Where nothing sticks: a difference across a slip is no derivative."""
    s = start(resistor.found.before, DEFAULT).with_the_rig()
    jacobian = s.problem.linearise(s.x, s.weighted).jacobian
    for symbol in ("gain.response.current", "stretch.viscous", "offset.resistance.voltage"):
        k, step = s.problem.layout.free.index(symbol), 1e-4
        r = [s.problem.residual(s.x + way * step * np.eye(s.x.size)[k], s.weighted) for way in (-1.0, 1.0)]
        assert_allclose(jacobian[..., k], (r[1] - r[0]) / (2.0 * step), atol=1e-3 * np.abs(jacobian[..., k]).max())


def stated(effect: Any, value: float, probability: float = 0.9, settings: DiagnosisSettings = DEFAULT) -> RigMistake:
    """The mistake that an effect with one parameter of that value is."""
    values = {parameters_of(effect)[0].symbol: value}
    said = statements([effect], values, {effect.name: probability}, (), (), settings)
    (mistake,) = rig_mistakes([effect], values, said)
    return mistake


def test_what_is_not_the_rigs_is_no_mistake_of_it(small: CandidateModel) -> None:
    inside = small.composition.inside
    assert rig_mistakes(inside, small.values, statements(inside, small.values, {}, (), (), DEFAULT)) == ()


def test_a_mistake_is_told_by_its_size_and_the_line_that_mends_it() -> None:
    mistake = stated(rig_effect("channel_gain[viscous.current]"), -2.0)
    assert mistake.kind == "channel_sign"
    assert mistake.effect == "channel_gain[viscous.current]"
    assert mistake.mend == '[model] effects = ["channel_gain[viscous.current]"]'
    assert mistake.sentence == (
        "Found: a mistake of the rig (0.90): channel_sign in current of the viscous test: -200 %. "
        f"To mend it, change in rig.toml: {mistake.mend}."
    )
    assert not mistake.suspected
    assert mistake.file is None


@pytest.mark.parametrize(("suspicion", "suspected"), [(0.8, True), (0.7, False)])
def test_a_suspicion_says_what_would_tell_and_changes_no_line(suspicion: float, suspected: bool) -> None:
    gain = rig_effect("channel_gain[viscous.current]")
    assert gain is not None
    mistake = stated(gain, 0.1, 0.75, replace(DEFAULT, suspicion=suspicion))
    assert mistake.suspected is suspected
    assert ("rig.toml" in mistake.sentence) is not suspected
    assert mistake.sentence.startswith("Probably a mistake of the rig (0.75): channel_gain in ")
    assert mistake.sentence.endswith(f"A measurement that would decide: {gain.told_by}.")
    assert stated(gain, 0.1, 0.6).sentence.startswith("There may be a mistake of the rig (0.60): ")


@pytest.mark.parametrize(
    ("name", "size", "kind", "channel", "said"),
    [
        ("trace_late[response/drive_3.csv]", 0.012, "trace_late", None, "the trace response/drive_3.csv: 0.012 s"),
        ("channel_gain[response/drive_3.csv.current]", -2.0, "channel_sign", "current",
         "channel_sign in current of the trace response/drive_3.csv: "),
    ],
)  # fmt: skip
def test_a_mistake_of_one_trace_names_its_file_and_its_channel(
    name: str, size: float, kind: str, channel: str | None, said: str
) -> None:
    mistake = stated(rig_effect(name), size)
    assert (mistake.kind, mistake.test, mistake.channel) == (kind, "response", channel)
    assert mistake.file == "response/drive_3.csv"
    assert mistake.mend == f'[model] effects = ["{name}"]'
    assert said in mistake.sentence


@pytest.mark.slow
def test_one_channel_of_one_trace_that_is_late_is_named(tmp_path: Path) -> None:
    """Four samples, in the one of three motor speeds; without this hypothesis it was called a warm winding."""
    late = case(tmp_path, "one_channel_late", 7841)
    (mistake,) = late.found.rig
    assert mistake.effect == "channel_late[viscous/volts_1.csv.motor_speed]"
    assert not mistake.suspected
    assert mistake.size == pytest.approx(late.made.size, rel=0.1)
    config = replace(late.before.rig.config, effects=(*late.before.rig.config.effects, mistake.effect))
    mended = fit(replace(late.before.rig, config=config))
    assert mended.chi2_per_dof < 1.02 < late.before.chi2_per_dof


def wandering(rate: float) -> Rig:
    """A sled without a spring, 1 rad = 1 m, under a commanded force whose zero wanders by `rate` N/s."""
    fine, every, rng = 2e-4, 25, np.random.default_rng(0)

    def force(t: np.ndarray) -> np.ndarray:
        return 60.0 * np.sin(2.0 * np.pi * t / 1.5) + 30.0 * np.sin(2.0 * np.pi * t / 0.41)

    t = fine * np.arange(60_000)
    middle = t[:-1] + 0.5 * fine
    place, speed = np.zeros(t.size), 0.0
    for k, push in enumerate(force(middle) - rate * middle):
        moved = (100.0 - 100.0 * fine) * speed + fine * push  # the trapezoidal rule, 100 kg and 200 N s/m
        now = np.sign(moved) * max(abs(moved) - fine * 20.0, 0.0) / (100.0 + 100.0 * fine)
        place[k + 1] = place[k] + 0.5 * fine * (speed + now)
        speed = now
    logged = slice(None, None, every)
    seen = place[logged] + 1e-6 * rng.standard_normal(t[logged].size)
    frame = pd.DataFrame({"time [s]": t[logged], "torque [N*m]": force(t[logged]), "position [rad]": seen})
    known = {symbol: {"fixed": value} for symbol, value in {"K_s": 0.0, "J_m": 1e-9, "B_m": 0.0}.items()}
    known |= {"J_L": 80.0, "B_L": 150.0, "T_f": 15.0}
    tables = {"rig": {"name": "sled", "travel_deg": [-np.inf, np.inf]}, "parameters": known,
              "noise": {"position_rad": 1e-6, "torque_Nm": 0.001}}  # fmt: skip
    return Rig.from_frames({"response/sled": frame}, tables)


@pytest.mark.slow
def test_a_zero_that_wanders_promises_most_and_a_fit_finds_its_rate() -> None:
    rig, drift = wandering(0.05), rig_effect("channel_drift[response.torque]")
    without = start(fit(rig), DEFAULT)
    assert without.far
    first = screened(without, without.composition.candidates)[0]
    assert first.variant.effect is drift
    found = fit(replace(rig, config=replace(rig.config, effects=("channel_drift[response.torque]",))))
    assert not found.far
    for symbol, truth in (("drift.response.torque", 0.05), ("J_L", 100.0), ("B_L", 200.0), ("T_f", 20.0)):
        assert found.values[symbol] == pytest.approx(truth, rel=0.01)


# ---- The last word of a diagnosis: is the final model kept, and what is said

LIMP, AIR = (EFFECT_BY_NAME[n] for n in ("limp_home_spring", "airflow_torque"))


def fitted(rig: Rig, rms: float, held_out: float | None) -> FitResult:
    """A fit whose free-run errors are so many sigma."""
    return results.result(rig, score_fit=(error(rms),), score_holdout=() if held_out is None else (error(held_out),))


@pytest.mark.parametrize(
    ("after", "before", "worse"),
    [
        ((1.0, 2.5), (9.0, 2.0), True),  # what was held out decides
        ((9.0, 2.3), (1.0, 2.0), False),  # worse by 15 %: a slip may fall elsewhere
        ((2.5, None), (2.0, None), True),
        ((1.9, None), (2.0, None), False),
        ((1.0, float("nan")), (9.0, 2.0), True),  # it diverged
    ],
)
def test_a_model_that_strays_from_what_was_held_out_is_not_kept(
    rig: Rig, after: tuple, before: tuple, worse: bool
) -> None:
    end, beginning = fitted(rig, *after), fitted(rig, *before)
    assert runs_free_worse(end, beginning, DiagnosisSettings()) is worse
    assert not runs_free_worse(replace(end, score_holdout=(), score_fit=(error(1.0),)), fitted(rig, 1.0, None),
                               DiagnosisSettings())  # fmt: skip


# ---- in words


def test_ties_name_the_one_in_the_model_first_and_what_would_separate_them() -> None:
    made = tie(Found(LIMP, {AIR: Apart(0.03, {})}, {}))
    assert made.effects == (LIMP.name, AIR.name)
    assert made.apart == (0.03,)
    assert made.told_by == f"{LIMP.name}: {LIMP.told_by}; {AIR.name}: {AIR.told_by}"


def stated_of(effect: Effect, probability: float = 0.9, **answers: float) -> Statement:
    return statement(effect, Named(effect.name), probability, answers, DEFAULT)


def test_effects_found_ties_and_the_last_reason_are_said(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    made = tie(Found(LIMP, {AIR: Apart(0.03, {})}, {}))
    assert verdict((stated_of(LIMP),), (made,), None, (first, replace(last, candidates=()))) == (
        "Found: the model lacked limp_home_spring (0.90).",
        "limp_home_spring and airflow_torque cannot be told apart by these data: their fits differ by at most 0.03 "
        "times the noise.",
        "cogging_torque is not worth its parameters.",
    )


@pytest.mark.parametrize(
    ("probability", "word", "acted_on"),
    [(0.9 - 1e-12, "found", True), (0.894, "probably", True), (0.8, "probably", True), (0.794, "probably", False),
     (0.7, "probably", False), (0.694, "may be", False)],
)  # fmt: skip
def test_a_name_is_as_sure_as_the_two_digits_that_are_shown(probability: float, word: str, acted_on: bool) -> None:
    made = stated_of(LIMP, probability)
    assert made.certainty == certainty(probability) == word
    assert made.acted_on is acted_on
    assert f"({probability:.2f})" in made.sentence


def test_a_name_that_is_not_sure_says_what_else_could_be_and_what_would_tell() -> None:
    made = stated_of(AIR, 0.55, airflow_torque=0.55, limp_home_spring=0.2, nothing=0.24, backlash=0.01)
    assert made.instead == {"nothing": 0.24, "limp_home_spring": 0.2}
    assert made.sentence == (
        "The model may lack airflow_torque (0.55). Other possible causes: nothing 0.24, limp_home_spring 0.20. "
        f"A measurement that would decide: {AIR.told_by}."
    )
    assert "tell" not in stated_of(AIR, 0.9, limp_home_spring=0.05).sentence


def test_a_mistake_of_the_rig_is_said_before_what_the_model_lacks(rig: Rig) -> None:
    sag = EFFECT_BY_NAME["airflow_torque"]
    mistake = RigMistake(sag.name, "kind", None, None, 1.0, "", "[rig]", "")
    said = verdict((stated_of(LIMP), stated_of(sag)), (), None, diagnoses.rounds(results.result(rig)), (mistake,))
    assert [sentence.split()[4] for sentence in said[:2]] == ["airflow_torque", "limp_home_spring"]


def test_what_is_left_is_said_as_a_curve_or_as_unexplained(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    curve = diagnoses.unexplained(results.result(rig))
    lacked = stated_of(LIMP)
    assert verdict((lacked,), (), curve, (first, last)) == (lacked.sentence, curve.sentence)
    assert verdict((lacked,), (), None, (first, last)) == (lacked.sentence,)  # the last residual is white
    odd = replace(last, evidence=first.evidence)
    assert verdict((lacked,), (), None, (first, odd))[1].startswith("The residual is not all noise, but no effect")


def test_where_nothing_is_added_it_is_said_whether_anything_is_lacking(rig: Rig) -> None:
    first, last = diagnoses.rounds(results.result(rig))
    assert verdict((), (), None, (last,)) == ("The residual is noise: the model lacks nothing that these data show.",)
    assert verdict((), (), None, (replace(first, added=None),))[0] == (
        "No effect of the catalogue is proven by these data."
    )
