"""What is written to a run folder: the contract's keys, null and not NaN, whole or not at all."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import diagnoses
import results
from etcfit.diagnosis.findings import Diagnosis, RigMistake
from etcfit.estimation.joint_fit import FitResult
from etcfit.files import whole, write_json
from etcfit.rig.base import Finding
from etcfit.run_folder.diagnosis import DIAGNOSIS
from etcfit.run_folder.fit import FIT, readings_of
from golden import check_view
from schemas import validator


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


@pytest.mark.parametrize("kind", ["fit", "diagnosis"])
def test_each_key_of_a_file_is_as_it_was_by_the_schema(
    kind: str, fitted: FitResult, found: Diagnosis, tmp_path: Path
) -> None:
    hum = Finding("hum", 0.02, "A", 1e-9, "50 Hz in the current.", "Twist the leads.", "response", None, "current")
    rig = replace(found.after.rig, findings=(hum,))
    mistake = RigMistake("gear_ratio", "gear_ratio", None, None, 0.05, "", "[rig] gear_ratio: times 1.05", "It is.")
    both = replace(found, after=replace(found.after, rig=rig), rig=(mistake,))
    result = results.compromised(fitted)
    write_json(tmp_path / "it.json", kind, FIT.json(result) if kind == "fit" else DIAGNOSIS.json(both))
    written = strict(tmp_path / "it.json")
    validator(kind).validate(written)
    short = json.loads(json.dumps(written), parse_float=lambda text: float(f"{float(text):.6g}"))
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in short.items()
             if key not in ("versions", "files", "settings")]  # fmt: skip
    check_view(f"json/{kind}.txt", "\n".join(lines), Path(fitted.rig.folder), Path(found.before.rig.folder))


def test_fit_json_has_the_hash_of_each_file_and_the_versions(fitted: FitResult) -> None:
    fit = FIT.json(fitted)
    path = Path(fitted.rig.folder) / "response/1.csv"
    assert fit["files"]["response/1.csv"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert set(fit["versions"]) >= {"etcfit", "jax", "optimistix", "python"}


def test_a_value_assumed_by_a_graph_is_not_a_reading(fitted: FitResult) -> None:
    assert {"K_b", "K_m"} <= set(readings_of(fitted))
    assumed = replace(fitted, readings=replace(fitted.readings, nominal=frozenset({"K_b"})))
    assert {"K_b", "K_m"} & set(readings_of(assumed)) == set()


def test_effects_known_from_the_start_stand_in_every_round(found: Diagnosis) -> None:
    bare = replace(found.rounds[1], effects=())
    known = replace(found, before=found.after, start=found.final, rounds=(bare,))
    assert DIAGNOSIS.json(known)["rounds"][0]["effects"] == DIAGNOSIS.json(known)["start"]["effects"]


def test_where_everything_is_explained_nothing_is_left(found: Diagnosis) -> None:
    none = DIAGNOSIS.json(replace(found, unexplained=None))
    assert none["unexplained"] is None
    assert none["after_with_unknown"] is None


def test_what_cannot_be_computed_is_null(found: Diagnosis, tmp_path: Path) -> None:
    lost = tuple(replace(row, rms=float("nan")) for row in found.before.score_fit)
    odd = replace(found, before=replace(found.before, score_fit=lost, chi2_per_dof=float("inf")))
    write_json(tmp_path / "diagnosis.json", "diagnosis", DIAGNOSIS.json(odd))
    before = strict(tmp_path / "diagnosis.json")["before"]
    assert before["fit"][0]["rms"] is None
    assert before["chi2_per_dof"] is None
