"""A fit, a diagnosis and a run folder to be, for every test here that needs no other."""

from __future__ import annotations

from pathlib import Path

import pytest

import diagnoses
import results
from etcfit.diagnosis.findings import Diagnosis
from etcfit.estimation.result import FitResult


@pytest.fixture
def fit(tmp_path: Path) -> FitResult:
    return results.result(results.rig(tmp_path / "rig"))


@pytest.fixture
def found(tmp_path: Path) -> Diagnosis:
    return diagnoses.diagnosis(results.rig(tmp_path / "rig"))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"
