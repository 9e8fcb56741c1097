"""A trace of another body: set aside where rig.toml says so, found where nobody says so, and left where it belongs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

import results
from etcfit.diagnosis import Diagnosis, diagnose, other_rig
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.other_rig import Strange, differences
from etcfit.diagnosis.settings import DEFAULT
from etcfit.errors import MeasurementError
from etcfit.estimation.intervals import intervals
from etcfit.estimation.joint_fit import fit
from etcfit.estimation.levenberg_marquardt import LATE
from etcfit.estimation.ready import ready
from etcfit.estimation.result import FitResult
from etcfit.estimation.settings import FitSettings
from etcfit.model.rig_effects import OtherRig, Place
from etcfit.rig.base import OTHER_RIG, Rig
from etcfit.rig.paper_readings import read_graphs
from etcfit.rig.reader import read_folder
from etcfit.run_folder.diagnosis import DIAGNOSIS
from independent import CONSISTENT, Truth, draw_truth
from independent.mistakes import Mistake, make_mistaken

SYMBOLS = ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")


def naming(rig: Rig, *places: str) -> Rig:
    """The rig with these set aside in its rig.toml."""
    named = tuple(OtherRig.at(Place.named(place)).name for place in places)
    return replace(rig, config=replace(rig.config, effects=(*rig.config.effects, *named)))


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    return results.rig(tmp_path_factory.mktemp("rig"))


# ---- set aside


def test_what_rig_toml_calls_of_another_rig_is_neither_fitted_nor_predicted(odd: Rig) -> None:
    fitted, held_out, _ = ready(odd)
    files = [trace.measurement.file for trace in fitted]
    left = ready(naming(odd, files[0], held_out[0].measurement.file))
    assert [trace.measurement.file for trace in left.fitted] == files[1:]
    assert left.held_out == ()
    assert any(files[0] in note and "of another rig" in note for note in left.notes)


def test_so_is_a_whole_test_and_the_papers_graphs_do_without_it(odd: Rig) -> None:
    test = next(trace.test.name for trace in ready(odd).fitted)
    left = naming(odd, test)
    assert test not in {trace.test.name for trace in ready(left).fitted}
    assert test in read_graphs(odd).tests
    assert test not in read_graphs(left).tests


def test_a_name_that_no_trace_answers_to_is_refused(odd: Rig) -> None:
    with pytest.raises(MeasurementError, match=r"names 'other_rig\[response/17.csv\]'\. In this folder .*Did you mean"):
        ready(naming(odd, "response/17.csv"))


def test_the_rig_knows_the_effect_by_its_name() -> None:
    assert OtherRig.kind == OTHER_RIG


# ---- what is said of it


def with_values(result: FitResult, **values: float) -> FitResult:
    layout = result.free_parameters.layout
    x = layout.coordinates({**result.values, **values})
    return replace(result, x=x, values={**result.values, **values})


def test_what_differs_is_named_with_its_share_the_surest_first(odd: Rig) -> None:
    rest = results.result(odd)  # every logarithm known to 0.02
    own = with_values(rest, R_a=1.2 * rest.values["R_a"], K_s=0.8 * rest.values["K_s"], T_f=1.05 * rest.values["T_f"])
    told = differences(own, rest)
    assert list(told) == ["K_s", "R_a"]  # T_f is within 3 standard errors
    assert told["R_a"] == pytest.approx(0.2)
    assert told["K_s"] == pytest.approx(-0.2)
    strange = Strange(Place.named("response/1.csv"), rest, own, (), "why")
    mistake = strange.mistake(strange.statement(0.9, DEFAULT))
    assert (mistake.kind, mistake.file, mistake.test) == ("other_rig", "response/1.csv", "response")
    assert mistake.size == pytest.approx(0.2)
    assert "K_s -20 % and R_a +20 %" in mistake.sentence
    assert '[model] effects = ["other_rig[response/1.csv]"]' in mistake.mend


def test_what_cannot_be_told_is_not_said_to_differ(odd: Rig) -> None:
    rest = results.result(odd, lost=("R_a",))
    own = with_values(rest, R_a=2.0 * rest.values["R_a"])
    assert differences(own, rest) == {}
    strange = Strange(Place.named("response/1.csv"), rest, own, (), "why")
    assert "in parameters that it does not determine" in strange.statement(0.9, DEFAULT).sentence


# ---- how far it is looked for


@pytest.mark.parametrize(("near", "gone"), [(1e300, 4), (1e-300, 1)])
def test_a_piece_without_which_the_others_stay_far_is_given_up(
    near: float, gone: int, small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    descents: list[float] = []

    def descended(problem: Any, x: np.ndarray, *given: Any) -> tuple[np.ndarray, int]:
        descents.append(1.0)
        return x, 1

    monkeypatch.setattr(other_rig, "descend", descended)
    place, settings = Place.named("viscous/1.csv"), FitSettings()
    left = other_rig.left_without(small.problem, small.x, LATE, place, settings, near)
    assert len(descents) == gone
    assert np.isfinite(left)


# ---- found


@dataclass(frozen=True)
class Case:
    truth: Truth
    made: Mistake
    found: Diagnosis


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """One trace of a body whose parameters are 5 to 25 % off."""
    truth, folder = draw_truth(np.random.default_rng(7640), CONSISTENT), tmp_path_factory.mktemp("mixed")
    made = make_mistaken(folder, truth, 7640, "other_rig")
    return Case(truth, made, diagnose(fit(read_folder(folder))))


@pytest.mark.slow
def test_the_trace_of_another_body_is_named_alone(mixed: Case) -> None:
    assert mixed.found.added == (f"other_rig[{mixed.made.file}]",)
    (mistake,) = mixed.found.rig
    assert (mistake.kind, mistake.file) == ("other_rig", mixed.made.file)
    assert mixed.found.before.chi2_per_dof > 5.0
    assert mixed.found.after.chi2_per_dof < 1.2
    assert mixed.made.file not in {row.file for row in mixed.found.after.score_fit}
    assert mixed.found.probabilities[f"other_rig[{mixed.made.file}]"] > 0.8


@pytest.mark.slow
def test_the_others_tell_the_truth_without_it(mixed: Case) -> None:
    said = intervals(mixed.found.after)
    errors = {s: (said[s].value - getattr(mixed.truth, s)) / e for s in SYMBOLS if (e := said[s].stderr)}
    assert len(errors) > 8
    assert all(abs(z) < 4.0 for z in errors.values()), errors


@pytest.mark.slow
def test_the_file_of_the_diagnosis_has_the_mistake_and_its_mend(mixed: Case) -> None:
    written = DIAGNOSIS.json(mixed.found)
    assert written["added"][0] == f"other_rig[{mixed.made.file}]"
    entry = written["rig"][0]
    assert (entry["kind"], entry["file"]) == ("other_rig", mixed.made.file)
    assert entry["probability"] > 0.8
    assert written["start"]["effects"] == [e for e in written["final"]["effects"] if not e.startswith("other_rig")]
