"""Share of the motion that a free run explains: by its formula, over all traces, in a sentence."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from driven import SOUGHT, driven, driven_rig, started
from etcfit.estimation.explained import (
    DriveScale,
    drive_scale,
    drives_of_another_session,
    explained,
    motion_explained,
    sentence,
    share_of,
)
from etcfit.problem.prediction_error import PredictionError, rows
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Channel, Measurement
from independent import CONSISTENT, Truth, draw_truth

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


@pytest.mark.parametrize(("share", "said"), [(0.99998, "over 99.99 %"), (1.0, "100.00 %"), (0.9987, "99.87 %")])
def test_a_motion_that_is_not_explained_whole_is_not_said_to_be(share: float, said: str) -> None:
    assert f"explains {said} of the motion" in sentence(share)


def test_speed_stands_in_where_no_position_was_logged() -> None:
    measured = np.sin(9.0 * TIME) * 10.0
    found = explained([error("a.csv", 0.2 * measured, "motor_speed")], [trace("a.csv", measured, "motor_speed")])
    assert share_of(found) == pytest.approx(1.0 - 0.04 * np.mean(measured**2) / measured.var())


# ---- A held-out trace of another session is told by the scale of its drive


@pytest.fixture(scope="module")
def truth() -> Truth:
    return draw_truth(np.random.default_rng(1), CONSISTENT)


@pytest.fixture(scope="module")
def problem(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> EstimationProblem:
    return driven(driven_rig(truth, tmp_path_factory.mktemp("sessions")), started(truth))


@pytest.fixture(scope="module")
def x(problem: EstimationProblem, truth: Truth) -> np.ndarray:
    return problem.layout.coordinates({s: getattr(truth, s) for s in SOUGHT})


def logged_times(trace: Trace, factor: float) -> Trace:
    """Logged as `factor` times what acted."""
    assert trace.input is not None
    return replace(trace, input=replace(trace.input, value=factor * trace.input.value))


def errors(problem: EstimationProblem, x: np.ndarray, traces: tuple[Trace, ...]) -> tuple[PredictionError, ...]:
    return rows(traces, problem.for_traces(traces, x).free_run(x))


def asked(problem: EstimationProblem, x: np.ndarray, held_out: Trace) -> tuple[DriveScale, ...]:
    fitted = errors(problem, x, problem.batch.traces)
    return drives_of_another_session(problem, x, (held_out,), (fitted, errors(problem, x, (held_out,))))


@pytest.mark.parametrize("factor", [1.0 / 0.88, 0.9])
def test_the_scale_of_the_drive_is_found(factor: float, problem: EstimationProblem, x: np.ndarray) -> None:
    trace = logged_times(problem.batch.traces[0], factor)
    (found,) = asked(problem, x, trace)
    assert found.factor == pytest.approx(1.0 / factor, rel=0.01)
    assert found.before > 10.0 * found.after
    side = "weaker" if factor > 1.0 else "stronger"
    assert f"{trace.measurement.file} is held out" in found.words
    assert f"% {side} than logged" in found.words


def test_a_trace_of_the_same_session_is_not_asked(problem: EstimationProblem, x: np.ndarray) -> None:
    assert asked(problem, x, problem.batch.traces[0]) == ()


def test_what_is_far_more_and_what_is_little_decide(
    problem: EstimationProblem, x: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    trace = logged_times(problem.batch.traces[0], 1.2)
    for name, value in (("STRANGE", 1e9), ("OTHER_DRIVE", 0.0)):
        with monkeypatch.context() as patch:
            patch.setattr(f"etcfit.estimation.explained.{name}", value)
            assert asked(problem, x, trace) == ()


def test_an_error_that_no_drive_explains_is_not_put_down_to_one(problem: EstimationProblem, x: np.ndarray) -> None:
    """Read in a mirror, as by a sensor turned about."""
    trace = problem.batch.traces[0]
    assert asked(problem, x, replace(trace, data=np.nanmax(trace.data) - trace.data)) == ()


def test_the_drive_as_logged_is_one_of_those_tried(problem: EstimationProblem, x: np.ndarray) -> None:
    found = drive_scale(problem, x, problem.batch.traces[0])
    assert found.after <= found.before
    assert found.factor == pytest.approx(1.0, abs=0.01)
