"""What is written to a run folder: the contract's keys, null and not NaN, whole or not at all."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import results

from etcfit.errors import UsageError
from etcfit.fit import FitResult
from etcfit.run_folder import fit_json, read_state, readings_of, whole, write_json, write_state

PARAMETERS = ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f", "N")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m", "J_L"))


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
    assert {"rig", "synthetic", "converged", "reason", "model", "parameters", "score"} <= set(fit)
    assert (fit["rig"], fit["synthetic"], fit["converged"]) == ("bench", True, True)
    assert set(fit["score"]) == {"fit", "holdout", "chi2_per_dof"}
    for row in (*fit["score"]["fit"], *fit["score"]["holdout"]):
        assert set(row) == {"file", "test", "channel", "unit", "n", "rms", "sigma"}
    assert {row["file"] for row in fit["score"]["holdout"]} == {"response/2.csv"}
    assert {*PARAMETERS, "series_ohm.inductance"} == set(fit["parameters"])
    for entry in fit["parameters"].values():
        assert {"value", "unit", "stderr", "ci95", "status", "reading", "meaning"} <= set(entry)
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


def test_the_state_of_a_fit_comes_back(fitted: FitResult, tmp_path: Path) -> None:
    write_state(tmp_path / "run", fitted)
    state = read_state(tmp_path / "run")
    assert state.folder.samefile(fitted.rig.folder)
    assert state.symbols == fitted.unknowns.layout.free
    np.testing.assert_array_equal(state.x, fitted.x)
    np.testing.assert_array_equal(state.covariance, fitted.covariance)


def test_no_state_no_traceback(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no fit"):
        read_state(tmp_path)
