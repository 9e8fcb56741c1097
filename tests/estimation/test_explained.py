"""Share of the motion that a free run explains: by its formula, over all traces, in a sentence."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etcfit.estimation.explained import explained, motion_explained, share_of
from etcfit.problem.prediction_error import PredictionError
from etcfit.rig.base import Channel, Measurement

TIME = np.linspace(0.0, 1.0, 400)


def trace(file: str, value: np.ndarray, channel: str = "position", scale: float = math.pi / 180.0) -> Measurement:
    """A trace logged in degrees."""
    return Measurement(
        file, "response", TIME, {channel: Channel(TIME, value * scale, 0.1 * scale, False, "x", "deg", scale)}
    )


def error(file: str, missed: np.ndarray, channel: str = "position") -> PredictionError:
    return PredictionError(file, "response", channel, "deg", missed.size, float(np.sqrt(np.mean(missed**2))), 0.1)


def test_it_is_the_formula_trace_by_trace_and_together() -> None:
    rng = np.random.default_rng(0)
    measured = [10.0 * np.sin(9.0 * TIME), 40.0 + 2.0 * np.cos(5.0 * TIME)]
    model = [each + sd * rng.standard_normal(TIME.size) for each, sd in zip(measured, (1.0, 0.5), strict=True)]
    rows = [error(f"{k}.csv", y - m) for k, (y, m) in enumerate(zip(measured, model, strict=True))]
    traces = [trace(f"{k}.csv", y) for k, y in enumerate(measured)]
    missed = [np.sum((y - m) ** 2) for y, m in zip(measured, model, strict=True)]
    moved = [np.sum((y - y.mean()) ** 2) for y in measured]
    found = explained(rows, traces)
    assert [each.share for each in found] == pytest.approx([1.0 - a / b for a, b in zip(missed, moved, strict=True)])
    assert share_of(found) == pytest.approx(1.0 - sum(missed) / sum(moved))


def test_a_plate_that_stands_still_has_no_share_and_another_channel_is_not_logged() -> None:
    still = explained([error("a.csv", np.full(TIME.size, 0.1))], [trace("a.csv", np.full(TIME.size, 30.0))])
    assert [each.share for each in still] == [None]
    assert share_of(still) is None
    assert explained([error("a.csv", TIME, "current")], [trace("a.csv", TIME)]) == ()
    assert motion_explained([error("a.csv", TIME, "current")], [], [trace("a.csv", TIME)]) == ""


@pytest.mark.parametrize(("sd", "word"), [(0.05, "enough to tune"), (0.5, "too little to tune")])
def test_the_sentence_holds_it_against_the_threshold(sd: float, word: str) -> None:
    measured = np.sin(9.0 * TIME) * 10.0
    said = motion_explained([error("a.csv", sd * measured)], [], [trace("a.csv", measured)])
    assert word in said
    assert "95 %" in said
    assert "assumed" in said


def test_speed_stands_in_where_no_position_was_logged() -> None:
    measured = np.sin(9.0 * TIME) * 10.0
    found = explained([error("a.csv", 0.2 * measured, "motor_speed")], [trace("a.csv", measured, "motor_speed")])
    assert share_of(found) == pytest.approx(1.0 - 0.04 * np.mean(measured**2) / measured.var())
