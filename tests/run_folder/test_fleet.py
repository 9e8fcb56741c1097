"""Figures of a line as fleet.json has them."""

from __future__ import annotations

import json

import pytest

import fleets
from etcfit.fleets.line import FIGURES, Condition, measured, predict
from etcfit.run_folder.fleet import figures_json, predictions_json


def test_figures_and_predictions_are_plain_json_with_null_for_what_is_not_told() -> None:
    model = fleets.of(fleets.truths(6, 31))
    found = measured(model)
    figures = json.loads(json.dumps(figures_json(model.units, found), allow_nan=False))
    assert list(figures) == [figure.name for figure in FIGURES]
    opening = figures["opening_time"]
    assert opening["value"] == pytest.approx(dict(zip(model.units, found["opening_time"].value.tolist(), strict=True)))
    assert opening["low"] <= opening["mean"] <= opening["high"]
    assert (opening["unit"], opening["why"]) == ("s", "")
    bent = figures["sensor_linearity"]
    assert bent["value"] == {}
    assert bent["mean"] is None
    assert "not modelled" in bent["why"]
    told = predictions_json(predict(model, (Condition("hot, 9 V", 9.0, 100.0),)))
    (row,) = json.loads(json.dumps(told, allow_nan=False))
    assert (row["condition"], row["winding_C"], row["supply_V"]) == ("hot, 9 V", 100.0, 9.0)
    assert row["figures"]["opening_time"]["mean"] > opening["mean"]
