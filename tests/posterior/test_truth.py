"""Truths of made-up data are read where their maker left them, and never for measured data."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import results
from etcfit.posterior.truth import truths

NOTE = {"parameters": {"R_a": 1.6, "J_m": 1e-6}, "series_ohm": 1.2}


@pytest.mark.parametrize("synthetic", [True, False])
def test_a_note_counts_for_synthetic_data_only(synthetic: bool, tmp_path: Path) -> None:
    rig = results.rig(tmp_path / "rig", synthetic)
    assert truths(rig) == {}
    (tmp_path / "rig" / "truth.json").write_text(json.dumps(NOTE), encoding="utf-8")
    assert truths(rig) == ({"R_a": 1.6, "J_m": 1e-6, "series_ohm.inductance": 1.2} if synthetic else {})
