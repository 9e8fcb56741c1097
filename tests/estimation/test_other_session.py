"""A held-out trace of another session is told by the scale of its drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driven import SOUGHT, driven, driven_rig, started
from etcfit.estimation.explained import DriveScale, drive_scale, drives_of_another_session
from etcfit.estimation.settings import SessionSettings
from etcfit.problem.prediction_error import PredictionError, rows
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from independent import CONSISTENT, Truth, draw_truth

SETTINGS = SessionSettings()


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
    return rows(traces, problem.beside(traces, x).free_run(x))


def asked(
    problem: EstimationProblem, x: np.ndarray, held_out: Trace, settings: SessionSettings = SETTINGS
) -> tuple[DriveScale, ...]:
    fitted = errors(problem, x, problem.batch.traces)
    return drives_of_another_session(problem, x, (held_out,), (fitted, errors(problem, x, (held_out,))), settings)


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


def test_what_is_far_more_and_what_is_little_are_settings(problem: EstimationProblem, x: np.ndarray) -> None:
    trace = logged_times(problem.batch.traces[0], 1.2)
    assert asked(problem, x, trace, SessionSettings(strange=1e9)) == ()
    assert asked(problem, x, trace, SessionSettings(explained=0.0)) == ()


def test_an_error_that_no_drive_explains_is_not_put_down_to_one(problem: EstimationProblem, x: np.ndarray) -> None:
    """Read in a mirror, as by a sensor turned about."""
    trace = problem.batch.traces[0]
    assert asked(problem, x, replace(trace, data=np.nanmax(trace.data) - trace.data)) == ()


def test_the_drive_as_logged_is_one_of_those_tried(problem: EstimationProblem, x: np.ndarray) -> None:
    found = drive_scale(problem, x, problem.batch.traces[0])
    assert found.after <= found.before
    assert found.factor == pytest.approx(1.0, abs=0.01)
