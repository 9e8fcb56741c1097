"""Figures of a line as fleet.json has them."""

from __future__ import annotations

import json
from typing import Any

import pytest

import fleets
from etcfit.files import plain
from etcfit.fleets.line import FIGURES, Condition, measured, predict
from etcfit.run_folder.fleet import STUDY, figures_over


def written(name: str, found: Any) -> Any:
    """A key of fleet.json as a strict reader finds it."""
    return json.loads(json.dumps(plain(STUDY.keys[name].taken_from("").value(found)), allow_nan=False))


def test_figures_and_predictions_are_plain_json_with_null_for_what_is_not_told() -> None:
    model = fleets.of(fleets.truths(6, 31))
    found = measured(model)
    figures = written("figures", figures_over(model.units, found))
    assert list(figures) == [figure.name for figure in FIGURES]
    opening = figures["opening_time"]
    assert opening["value"] == pytest.approx(dict(zip(model.units, found["opening_time"].value.tolist(), strict=True)))
    assert opening["low"] <= opening["mean"] <= opening["high"]
    assert (opening["unit"], opening["why"]) == ("s", "")
    bent = figures["sensor_linearity"]
    assert bent["value"] == {}
    assert bent["mean"] is None
    assert "not modelled" in bent["why"]
    (row,) = written("predictions", predict(model, (Condition("hot, 9 V", 9.0, 100.0),)))
    assert (row["condition"], row["winding_C"], row["supply_V"]) == ("hot, 9 V", 100.0, 9.0)
    assert row["figures"]["opening_time"]["mean"] > opening["mean"]
