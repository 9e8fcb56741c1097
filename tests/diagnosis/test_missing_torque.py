"""What a model lacks along the measured motion, read off its guide: known torque, known voltage, and where none is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from bodies import N, batch, body, path
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Composition
from etcfit.diagnosis.evidence import motions
from etcfit.diagnosis.findings import Motion
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.result import Termination
from etcfit.model.effects import PAPER
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.input_signal import InputSignal
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace, prepare
from etcfit.rig.base import Fixed
from measurements import CONFIG, measurement

LACKED = 0.05  # N m that help the true plate open
OFFSET = 0.03  # A that its current sensor adds
CIRCUITS = (0.0, 0.4)  # ohm of the test's own circuit
DT, SAMPLES = 1e-3, 1200
SLIDES = slice(600, 750)  # samples at which the plate has slid long enough, and is not yet open


# ---- what is missing


def volts(t: np.ndarray) -> np.ndarray:
    """Not enough to open the plate, then enough to slide it open ever more slowly."""
    return np.interp(t, [0.0, 0.2, 0.4, 1.2], [1.0, 1.0, 3.0, 3.6])


def measured(series: float) -> Trace:
    """A plate that is helped by LACKED, its current read OFFSET too high; no noise."""
    t = np.arange(SAMPLES) * DT
    v = volts(t)
    truth = body(T_PL=bodies.NOMINAL["T_PL"] - LACKED)
    at_rest = (float(v[0]) / (1.513 + series), 0.0, 0.0)
    x = path(truth, *batch(np.full(SAMPLES - 1, DT), v[:-1], v[1:], at_rest, series=series))
    m = measurement("response", t, {"voltage": v, "current": x[:, 0] + OFFSET, "position": x[:, 1]})
    trace = prepare(m, CONFIG)
    assert trace is not None
    exact = InputSignal(v, np.full(SAMPLES, 0.01), np.zeros(SAMPLES), np.zeros(SAMPLES - 1, dtype=bool))
    return replace(trace, input=exact, start=replace(trace.start, state=at_rest))


@pytest.fixture(scope="module", params=CIRCUITS, ids=["no series resistance", "a series resistance"])
def series(request: pytest.FixtureRequest) -> float:
    return request.param


@pytest.fixture(scope="module")
def trace(series: float) -> Trace:
    return measured(series)


def candidate(trace: Trace, series: float, preload: float) -> CandidateModel:
    """Eqs. 1-2, all known but the friction of the plate."""
    fixed = {s: Fixed(v) for s, v in bodies.values(T_PL=preload).items() if s not in ("T_f", "K_m")}
    config = replace(CONFIG, parameters=fixed, series_ohm={"response": series})
    known = free_parameters(config)
    problem = EstimationProblem.of(config, known, (trace,))
    x, end = known.layout.coordinates(bodies.NOMINAL), Termination(True, "by hand")
    weighted, composition = problem.weighted(weights.free_running(problem)), Composition(known, PAPER, ())
    return CandidateModel(composition, (), problem, weighted, None, x, end, DiagnosisSettings())


@pytest.fixture(scope="module")
def motion(trace: Trace, series: float) -> Motion:
    """Before: the model without what helps the plate; after: with it."""
    preload = bodies.NOMINAL["T_PL"]
    (found,) = motions(candidate(trace, series, preload), candidate(trace, series, preload - LACKED), False)
    return found


def test_the_missing_torque_is_what_helps_the_plate(motion: Motion) -> None:
    """But for what the guide gives way to: K_s over the guide's stiffness."""
    assert_allclose(motion.torque[SLIDES], LACKED, rtol=0.03)


def test_the_final_model_lacks_nothing(motion: Motion) -> None:
    assert np.nanmax(np.abs(motion.after["torque"][SLIDES])) < 0.01 * LACKED


def test_the_missing_voltage_is_the_resistance_times_the_missing_current(motion: Motion, series: float) -> None:
    """Of armature and circuit: (R_a + R_series) I_0."""
    assert_allclose(motion.after["voltage"][SLIDES], (1.513 + series) * OFFSET, rtol=0.01)


def test_where_the_plate_rests_no_torque_is_read(motion: Motion, trace: Trace) -> None:
    """There dry friction and the stop carry whatever is missing."""
    position = trace.data[:, trace.channels.index("position")]
    assert np.all(position[:200] == 0.0)
    assert np.all(np.isnan(motion.torque[:200]))
    assert np.all(np.isnan(motion.after["torque"][:200]))
    assert np.all(np.isfinite(motion.torque[SLIDES]))
    assert np.all(np.isfinite(motion.voltage))


def test_the_axes_are_those_of_the_measured_motion(motion: Motion, trace: Trace) -> None:
    position = trace.data[:, trace.channels.index("position")]
    assert_allclose(motion.axes["time"], trace.instants, atol=1e-12)
    assert np.max(np.abs(motion.axes["angle"] - position)) < 0.01 * np.ptp(position)
    assert_allclose(motion.axes["speed"][SLIDES], np.gradient(position, DT)[SLIDES], rtol=0.02)
    current = trace.data[:, trace.channels.index("current")]
    assert_allclose(motion.axes["current"][SLIDES], current[SLIDES] - OFFSET, rtol=0.01)
    # what the gear carries: half of the motor's torque and half of what the spring holds against it
    spring = bodies.NOMINAL["T_PL"] - LACKED + 0.150 * motion.axes["angle"]
    assert_allclose(
        motion.axes["load"][SLIDES], 0.5 * (N * 0.0189 * motion.axes["current"] + spring)[SLIDES], rtol=0.05
    )


def test_a_motion_names_its_trace_and_no_effect_that_was_not_added(motion: Motion, trace: Trace) -> None:
    assert (motion.file, motion.test, motion.held_out) == (trace.measurement.file, "response", False)
    assert motion.effects == {}
    assert {v.shape for v in (motion.torque, motion.voltage, *motion.axes.values(), *motion.after.values())} == {
        (SAMPLES,)
    }


def test_where_no_current_was_logged_no_voltage_is_read() -> None:
    trace = measured(0.0)
    k = trace.channels.index("position")
    blind = replace(trace, channels=("position",), data=trace.data[:, [k]], sigma=trace.sigma[[k]])
    preload = bodies.NOMINAL["T_PL"]
    (found,) = motions(candidate(blind, 0.0, preload), candidate(blind, 0.0, preload), False)
    assert_array_equal(found.voltage, np.full(SAMPLES, np.nan))
    assert_allclose(found.torque[SLIDES], LACKED, rtol=0.03)
