"""The JSON schemas: each is one, asks for what the contract asks for, fits what is written, and is in the docs."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

import campaigns
import diagnoses
import results
import runs
from docs.made.schemas import DECLARED, table, text_of
from etcfit.control.frequency import FrequencyResponse
from etcfit.control.frequency.lag import order_of
from etcfit.control.settings import FrequencySettings
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.settings import FitSettings
from etcfit.experiment.advice import Advice, Option, Pair
from etcfit.experiment.settings import AdviceSettings, CampaignSettings, PlanSettings
from etcfit.model.linear import TransferFunction
from etcfit.ranges import from_json
from etcfit.rig.base import Rig
from etcfit.run_folder.diagnosis import DIAGNOSIS
from etcfit.run_folder.fit import FIT
from etcfit.run_folder.plan import ADVICE, PLAN
from etcfit.run_folder.plant import frequency_json
from schemas import assert_refused, read_valid, validator, written_valid

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "etcfit" / "run_folder" / "schemas"
KINDS = tuple(sorted(file.name.removesuffix(".schema.json") for file in FOLDER.glob("*.schema.json")))
# keys of the contract (formats.md) that are always there; those that later versions add are optional
CONTRACT = {
    "fit": "schema rig synthetic converged reason model parameters influence score settings",
    "diagnosis": "schema start final rounds added ties unexplained before after parameters settings",
    "posterior": "schema parameters settings",
    "transfer_function": "schema input output operating_point num den poles stderr open_loop_dc_gain",
    "frequency_response": "schema points order settings",
    "pid": "schema rule gains ecu linear nonlinear requirements met posterior settings",
    "run": "schema version stages",
    "drive": "schema logs",
    "tune": "schema verdict why_not ecu model checks fit held_out supply_V present unit steps record_next",
    "advice": "schema rig synthetic stderr_now options not_judged settings",
    "plan": "schema rig synthetic model criterion limits stderr tests left_out settings",
    "fleet": "schema version name synthetic units failed not_converged members population correlation odd effects "
    "drift charts capability gauge figures predictions settings",
}
LATER = {"diagnosis": {"rig", "probabilities"}}


def schema(kind: str) -> dict[str, Any]:
    return json.loads((FOLDER / f"{kind}.schema.json").read_text(encoding="utf-8"))


def parts(node: Any) -> list[dict[str, Any]]:
    """Every sub-schema that a key of a file has, depth first."""
    if isinstance(node, list):
        return [part for each in node for part in parts(each)]
    if not isinstance(node, dict):
        return []
    own = list(node["properties"].values()) if isinstance(node.get("properties"), dict) else []
    return own + [part for each in node.values() for part in parts(each)]


def manifest() -> dict[str, Any]:
    """A run.json as the contract has it."""
    fit = {"at": "2026-11-22T17:00:00+00:00", "settings": {}, "inputs": {"rig.toml": "0" * 64},
           "outputs": {"fit.json": "f" * 64}, "exit": 0}  # fmt: skip
    return {"schema": "etcfit.run/1", "version": "0.2.0", "stages": {"fit": fit}}


def test_every_kind_of_the_contract_has_a_schema() -> None:
    assert set(KINDS) == set(CONTRACT)


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_is_one(kind: str) -> None:
    Draft202012Validator.check_schema(schema(kind))


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_asks_for_what_the_contract_asks_for_and_welcomes_more(kind: str) -> None:
    found = schema(kind)
    assert set(CONTRACT[kind].split()) <= set(found["required"])
    assert set(found["required"]) <= set(found["properties"])
    assert LATER.get(kind, set()) <= set(found["properties"])
    assert found["properties"]["schema"]["const"] == f"etcfit.{kind}/1"
    assert found["additionalProperties"] is True


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_is_described(kind: str) -> None:
    described = parts(schema(kind))
    assert described
    assert all(part.get("description") or "$ref" in part for part in described)


@pytest.mark.parametrize("kind", DECLARED)
def test_the_schema_of_a_declared_file_is_up_to_date(kind: str) -> None:
    committed = (FOLDER / f"{kind}.schema.json").read_text(encoding="utf-8")
    assert committed == text_of(kind), "run: python -m docs.made"


def test_what_a_fit_writes_fits_its_schema(tmp_path: Path) -> None:
    written = read_valid(runs.run_folder(tmp_path) / "fit.json")
    influence = {"test": "viscous", "file": None, "parameter": "J_m", "pull": -2.5}
    validator("fit").validate(written | {"influence": [influence], "a_key_of_tomorrow": 1})
    odd = deepcopy(written)
    next(iter(odd["parameters"].values()))["status"] = "perhaps"
    unpulled = written | {"influence": [{"test": "viscous"}]}
    assert_refused("fit", odd, unpulled, written | {"converged": "yes"}, {"schema": "x"})


def advice(rig: Rig, settings: AdviceSettings) -> dict[str, Any]:
    again = Option("viscous", "once more", "noise assumed", np.array([0.5, 1.0]), Pair(("a", "b"), 0.9, 0.1), None)
    apart = Option("response", "a sweep", "", np.array([0.9, 1.0]), None, None)
    return ADVICE.json(Advice(rig, ("a", "b"), np.array([0.1, 0.2]), (again, apart), (("sine", "no ECU"),), settings))


def sines(rig: Rig, settings: FrequencySettings) -> dict[str, Any]:
    """Of a rig whose sine traces say nothing at all."""
    plant = TransferFunction(2e5, 1e3, 9e4, 1e5)
    none = order_of(np.zeros(0), [], settings)
    found = FrequencyResponse((), none, None, (), plant, 0.25, ("sine/1.csv: 1 cycle",), settings)
    return frequency_json(results.result(rig).fitted(), found)


MINE: dict[str, tuple[Any, Callable[[Rig, Any], dict[str, Any]]]] = {
    "fit": (FitSettings(starts=1), lambda rig, mine: FIT.json(results.result(rig, settings=mine))),
    "diagnosis": (
        DiagnosisSettings(rounds=3),
        lambda rig, mine: DIAGNOSIS.json(diagnoses.diagnosis(rig, settings=mine)),
    ),
    "advice": (AdviceSettings(apart=0.7, plan=PlanSettings(lowest=0.5)), advice),
    "plan": (
        CampaignSettings(current=4.0, plan=PlanSettings(lowest=0.5)),
        lambda rig, mine: PLAN.json(campaigns.campaign(rig, mine)),
    ),
    "frequency_response": (FrequencySettings(poor=0.2), sines),
}


@pytest.mark.parametrize("kind", MINE)
def test_what_is_written_fits_its_schema_and_records_what_was_decided_by(kind: str, rig: Rig, tmp_path: Path) -> None:
    mine, make = MINE[kind]
    written = written_valid(tmp_path, kind, make(rig, mine))
    assert from_json(type(mine), written["settings"]) == mine


def test_the_manifest_is_what_the_contract_says() -> None:
    validator("run").validate(manifest())
    unhashed = deepcopy(manifest())
    unhashed["stages"]["fit"]["inputs"]["rig.toml"] = "new"
    without = deepcopy(manifest())
    del without["stages"]["fit"]["exit"]
    assert_refused("run", unhashed, without)


@pytest.mark.parametrize("kind", KINDS)
def test_the_docs_name_every_key(kind: str) -> None:
    page = (ROOT / "docs" / "reference" / "formats.md").read_text(encoding="utf-8")
    section = page.split(f"## {kind}.json", 1)[1].split("\n## ", 1)[0]
    named = re.findall(r"^\| `([^`]+)` \|", section, re.MULTILINE)
    assert set(schema(kind)["properties"]) <= set(named)
    assert len(named) == len(set(named))


def test_the_tables_follow_references_lists_and_mappings() -> None:
    shown = table("fit")
    for path in ("parameters.NAME.ci95", "score.fit[].rms", "influence[].pull", "score.chi2_per_dof"):
        assert f"| `{path}` |" in shown
    assert "influence` | array | " in shown
    assert (
        shown.count("*(optional)*") == 7
    )  # the end's code; a remark of a parameter, of a combination; what is left and
    # what is explained in two lists of rows


def test_the_response_to_sines_carries_the_state_of_the_fit(rig: Rig) -> None:
    assert sines(rig, FrequencySettings())["fit"]["chi2_per_dof"] == 1.02
