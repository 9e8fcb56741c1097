"""What is written to a run folder: the contract's keys, null and not NaN, whole or not at all."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import diagnoses
import results
from etcfit.diagnosis.findings import Diagnosis, RigMistake
from etcfit.estimation.joint_fit import FitResult
from etcfit.files import whole, write_json
from etcfit.rig.base import Finding
from etcfit.run_folder.diagnosis import diagnosis_json
from etcfit.run_folder.fit import fit_json, readings_of

PARAMETERS = ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f", "N")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m", "J_L"))


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnoses.diagnosis(results.rig(tmp_path_factory.mktemp("rig")))


def _half(draft: Path) -> None:
    """Writes a part, then fails."""
    with draft.open("w", encoding="ascii") as out:
        out.write("a whole line\n")
        out.flush()
        out.write("Ω")


def strict(path: Path) -> dict:
    """Read JSON as a strict reader does: NaN and Infinity are no JSON."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_json_has_its_schema_full_precision_and_null_for_the_unknown(tmp_path: Path) -> None:
    third = 1.0 / 3.0
    write_json(tmp_path / "a.json", "fit", {"x": third, "n": np.int64(3), "bad": [np.nan, np.float64("inf")], "u": "Ω"})
    assert strict(tmp_path / "a.json") == {
        "schema": "etcfit.fit/1", "x": third, "n": 3, "bad": [None, None], "u": "Ω"
    }  # fmt: skip
    assert "Ω" in (tmp_path / "a.json").read_text(encoding="utf-8")


def test_a_failure_midway_leaves_the_old_file_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_json(path, "fit", {"x": 1})
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_json(path, "fit", {"x": object()})
    with pytest.raises(UnicodeEncodeError), whole(path) as draft:
        _half(draft)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_fit_json_holds_what_the_contract_names(fitted: FitResult, tmp_path: Path) -> None:
    write_json(tmp_path / "fit.json", "fit", fit_json(fitted))
    fit = strict(tmp_path / "fit.json")
    assert fit["schema"] == "etcfit.fit/1"
    assert (fit["rig"], fit["synthetic"], fit["converged"]) == ("bench", True, True)
    assert all("left" in row for row in fit["score"]["fit"])
    assert not any("left" in row for row in fit["score"]["holdout"])
    assert {row["file"] for row in fit["score"]["holdout"]} == {"response/2.csv"}
    assert {*PARAMETERS, "series_ohm.inductance"} == set(fit["parameters"])
    for entry in fit["parameters"].values():
        assert entry["status"] in {"estimated", "fixed", "tied", "not identifiable"}
        assert (entry["ci95"] is None) == (entry["stderr"] is None)
    assert "armature" in fit["model"]["effects"]


def test_fit_json_by_status(fitted: FitResult) -> None:
    parameters = fit_json(fitted)["parameters"]
    assert parameters["J_m"]["status"] == "not identifiable"
    assert parameters["J_m"]["stderr"] is None
    assert (parameters["N"]["value"], parameters["N"]["unit"], parameters["N"]["status"]) == (20.68, "1", "fixed")
    low, high = parameters["R_a"]["ci95"]
    assert low < parameters["R_a"]["value"] < high
    assert parameters["R_a"]["reading"] == pytest.approx(1.513, rel=0.01)


def test_fit_json_says_what_cannot_be_told_and_what_was_read(fitted: FitResult) -> None:
    fit = fit_json(fitted)
    assert fit["not_identifiable"][0]["symbols"] == ["J_m", "J_L"]
    assert fit["not_identifiable"][0]["sd"] is None
    assert "motor-alone" in fit["not_identifiable"][0]["says"]
    assert fit["starts"][1]["chi2_before"] is None  # it was infinite
    assert fit["lumped"]["J_eq"]["unit"] == "kg*m2"
    assert {entry["origin"] for entry in fit["noise"]} == {"estimated"}
    path = Path(fitted.rig.folder) / "response/1.csv"
    assert fit["files"]["response/1.csv"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert set(fit["versions"]) >= {"etcfit", "jax", "optimistix", "python"}


def test_a_value_assumed_by_a_graph_is_not_a_reading(fitted: FitResult) -> None:
    assert {"K_b", "K_m"} <= set(readings_of(fitted))
    assumed = replace(fitted, readings=replace(fitted.readings, nominal=frozenset({"K_b"})))
    assert {"K_b", "K_m"} & set(readings_of(assumed)) == set()


def test_diagnosis_json_holds_what_the_contract_names(found: Diagnosis, tmp_path: Path) -> None:
    write_json(tmp_path / "diagnosis.json", "diagnosis", diagnosis_json(found))
    written = strict(tmp_path / "diagnosis.json")
    assert written["schema"] == "etcfit.diagnosis/1"
    start, final = written["start"]["effects"], written["final"]["effects"]
    assert start == fit_json(found.before)["model"]["effects"]
    assert final == [*start, diagnoses.FOUND]
    assert written["added"] == [diagnoses.FOUND]
    assert written["ties"] == [[diagnoses.FOUND, "airflow_torque"]]
    assert written["ties_apart"] == [list(found.ties[0].apart)]
    assert written["ties_told_by"] == [found.ties[0].told_by]
    assert written["parameters"].keys() == fit_json(found.after)["parameters"].keys() > {"T_lh", "N"}
    for which in ("before", "after", "after_with_unknown"):
        assert {row["file"] for row in written[which]["holdout"]} == {"response/2.csv"}
    assert (written["synthetic"], written["name"], written["rig"]) == (True, "bench", [])
    assert written["verdict"] == list(found.verdict)


def test_diagnosis_json_round_by_round(found: Diagnosis) -> None:
    written = diagnosis_json(found)
    first, last = written["rounds"]
    assert (first["effects"], first["added"], first["white"]) == (written["start"]["effects"], diagnoses.FOUND, False)
    assert (last["effects"], last["added"], last["white"]) == (written["final"]["effects"], None, True)
    assert first["candidates"][-1]["bic_change"] is None  # not refitted
    assert first["evidence"][0]["strongest"] == "angle"


def test_effects_known_from_the_start_stand_in_every_round(found: Diagnosis) -> None:
    bare = replace(found.rounds[1], effects=())
    known = replace(found, before=found.after, start=found.final, rounds=(bare,))
    assert diagnosis_json(known)["rounds"][0]["effects"] == diagnosis_json(known)["start"]["effects"]


def test_diagnosis_json_shows_what_is_left_or_null(found: Diagnosis) -> None:
    left = diagnosis_json(found)["unexplained"]
    assert len(left["shape"]["axis"]) == len(left["shape"]["curve"]) == len(left["shape"]["sd"]) == 60
    none = diagnosis_json(replace(found, unexplained=None))
    assert none["unexplained"] is None
    assert none["after_with_unknown"] is None


def test_what_cannot_be_computed_is_null(found: Diagnosis, tmp_path: Path) -> None:
    lost = tuple(replace(row, rms=float("nan")) for row in found.before.score_fit)
    odd = replace(found, before=replace(found.before, score_fit=lost, chi2_per_dof=float("inf")))
    write_json(tmp_path / "diagnosis.json", "diagnosis", diagnosis_json(odd))
    before = strict(tmp_path / "diagnosis.json")["before"]
    assert before["fit"][0]["rms"] is None
    assert before["chi2_per_dof"] is None


def test_what_is_wrong_with_the_rig_is_told_whoever_found_it(found: Diagnosis, tmp_path: Path) -> None:
    hum = Finding("hum", 0.02, "A", 1e-9, "50 Hz in the current.", "Twist the leads.", "response", None, "current")
    rig = replace(found.after.rig, findings=(hum,))
    mistake = RigMistake("gear_ratio", "gear_ratio", None, None, 0.05, "", "[rig] gear_ratio: times 1.05", "It is.")
    both = replace(found, after=replace(found.after, rig=rig), rig=(mistake,))
    write_json(tmp_path / "diagnosis.json", "diagnosis", diagnosis_json(both))
    written = strict(tmp_path / "diagnosis.json")
    schema = files("etcfit.run_folder") / "schemas" / "diagnosis.schema.json"
    Draft202012Validator(json.loads(schema.read_text(encoding="utf-8"))).validate(written)
    fitted, before = written["rig"]
    assert (fitted["effect"], fitted["kind"], fitted["chance"]) == ("gear_ratio", "gear_ratio", None)
    assert (before["effect"], before["kind"], before["test"], before["chance"]) == (None, "hum", "response", 1e-9)
    assert before["mend"] == "Twist the leads."
