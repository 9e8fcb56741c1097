"""How much of something is a function of one quantity, what a residual correlates with, and whether it is noise."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bodies
from bodies import N, batch, body, path
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Composition
from etcfit.diagnosis.evidence import (
    SHARE_BINS,
    WHITE_P,
    Place,
    correlation,
    evidence,
    explained,
    is_larger_than_noise,
    is_white,
    motions,
    rows_of,
    sentences,
    shares,
    strongest,
    white_but_for_one_event,
    whiteness,
)
from etcfit.diagnosis.findings import Motion, Share, Whiteness
from etcfit.diagnosis.formula_errors import EXACT
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.result import Termination
from etcfit.model.effects import PAPER
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.input_signal import InputSignal
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Fixed
from measurements import CONFIG, measurement, prepared

COUNT = 6000
BINS = SHARE_BINS


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


# ---- a share of the variance


@pytest.mark.parametrize("curve", [np.sin, np.sign, np.square, lambda a: np.exp(-((a / 0.3) ** 2))])
def test_a_function_of_the_axis_is_explained_by_it(rng: np.random.Generator, curve: Any) -> None:
    axis = rng.uniform(-2.0, 2.0, COUNT)
    assert explained(axis, curve(axis), BINS) > 0.95
    assert explained(axis, 1e3 - 1e-4 * curve(axis), BINS) == pytest.approx(
        explained(axis, curve(axis), BINS), abs=1e-6
    )


def test_noise_is_not(rng: np.random.Generator) -> None:
    """Nor does chance count: on average over many draws nothing is left of what 24 bins take."""
    shares = [explained(rng.normal(size=500), rng.normal(size=500), BINS) for _ in range(40)]
    assert max(shares) < 0.08
    assert np.mean(shares) < 0.015


def test_a_share_is_that_of_the_variance(rng: np.random.Generator) -> None:
    axis, noise = rng.uniform(-3.0, 3.0, COUNT), rng.normal(size=COUNT)
    curve = np.sin(axis)
    size = float(np.std(curve))
    for level in (0.5, 1.0, 2.0):
        expected = size**2 / (size**2 + level**2)
        assert explained(axis, curve + level * noise, BINS) == pytest.approx(expected, abs=0.03)


def test_a_function_of_another_quantity_is_not_explained(rng: np.random.Generator) -> None:
    assert explained(rng.normal(size=COUNT), np.sin(rng.normal(size=COUNT)), BINS) < 0.01


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_an_axis_that_rests_half_of_the_time_has_fewer_bins(rng: np.random.Generator, rest: float) -> None:
    """A plate lies on its stop: many samples share one angle."""
    axis = np.where(rng.uniform(size=COUNT) < rest, 0.0, rng.uniform(0.0, 1.5, COUNT))
    assert explained(axis, np.cos(axis), BINS) > 0.95
    assert explained(axis, rng.normal(size=COUNT), BINS) < 0.01


def test_what_does_not_vary_explains_nothing_and_is_not_explained(rng: np.random.Generator) -> None:
    noise = rng.normal(size=COUNT)
    assert explained(np.full(COUNT, 0.3), noise, BINS) == 0.0
    assert explained(noise, np.full(COUNT, 0.3), BINS) == 0.0


def test_shares_are_of_all_traces_and_only_where_something_is_known(rng: np.random.Generator) -> None:
    along = [{name: rng.normal(size=COUNT) for name in ("angle", "speed", "current", "load", "time")} for _ in range(2)]
    missing = [np.sin(a["speed"]) for a in along]
    missing[0][::2] = np.nan
    found = {s.axis: s for s in shares("torque", along, missing)}
    assert set(found) == {"angle", "speed", "current", "load", "time"}
    assert found["speed"].share > 0.95
    assert max(found[a].share for a in ("angle", "current", "load", "time")) < 0.01
    assert {s.axis for s in shares("voltage", along, missing)} == {"current", "speed", "angle", "time"}
    assert shares("torque", along, [np.full(COUNT, np.nan)] * 2) == []


# ---- what a residual correlates with


def test_the_strongest_is_the_one_it_correlates_with_most_whatever_the_sign(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=COUNT), 50.0 + 7.0 * rng.normal(size=COUNT)
    r = rng.normal(size=COUNT) + 0.1 * a - 0.05 * (b - 50.0)
    name, rho = strongest(r, {"angle": a, "speed": b, "time": np.linspace(0.0, 1.0, COUNT)})
    assert name == "speed"
    assert rho == pytest.approx(float(np.corrcoef(r, b)[0, 1]))
    assert rho < -0.2


def test_a_signal_that_does_not_vary_correlates_with_nothing(rng: np.random.Generator) -> None:
    assert correlation(rng.normal(size=COUNT), np.full(COUNT, 3.0)) == 0.0
    assert correlation(np.zeros(COUNT), rng.normal(size=COUNT)) == 0.0


# ---- is it noise?


def judged(r: np.ndarray, **signals: np.ndarray) -> Whiteness:
    """One channel of one trace, half of its instants without a sample."""
    n = r.size
    logged = np.arange(2 * n) % 2 == 0
    whole = np.full(2 * n, 1e9)
    whole[logged] = r
    still = {name: np.zeros(2 * n) for name in ("input", "speed", "angle", "current", "time")}
    along = still | {name: np.repeat(value, 2) for name, value in signals.items()}
    return whiteness(Place("response/a.csv", "response", "position"), whole, logged, along)


def test_noise_is_called_white(rng: np.random.Generator) -> None:
    every = [judged(rng.normal(size=2000), angle=rng.normal(size=2000)) for _ in range(20)]
    assert all(row.white for row in every)
    assert all(row.n == 2000 for row in every)
    assert all(0.9 < row.rms < 1.1 for row in every)


def test_a_residual_that_is_too_large_is_not_white(rng: np.random.Generator) -> None:
    row = judged(1.2 * rng.normal(size=2000))
    assert not row.white
    assert row.ljung_box > WHITE_P
    assert row.rms == pytest.approx(1.2, abs=0.05)


def test_a_residual_that_repeats_itself_is_not_white(rng: np.random.Generator) -> None:
    w = rng.normal(size=2001)
    row = judged((w[1:] + 0.3 * w[:-1]) / np.sqrt(1.09))
    assert not row.white
    assert row.ljung_box < WHITE_P


@pytest.mark.parametrize("name", ["speed", "angle", "current", "input", "time"])
def test_a_residual_that_goes_along_with_what_the_plate_did_is_not_white(rng: np.random.Generator, name: str) -> None:
    signal = rng.normal(size=2000)
    row = judged(0.15 * signal + 0.98 * rng.normal(size=2000), **{name: signal})
    assert not row.white
    assert row.ljung_box > WHITE_P
    assert row.strongest == name
    assert row.p < WHITE_P


def test_a_residual_that_goes_along_with_the_direction_says_so(rng: np.random.Generator) -> None:
    speed = rng.normal(size=2000) ** 3
    row = judged(0.3 * np.sign(speed) + 0.95 * rng.normal(size=2000), speed=speed)
    assert row.strongest == "sign of speed"
    assert not row.white


# ---- one event of one trace

QUIET = {name: np.zeros(COUNT) for name in ("input", "speed", "angle", "current", "time")}


def bent(r: np.ndarray, begin: int, end: int) -> np.ndarray:
    """Where an edge came at another instant than was thought, all is off by as much until the plate rests."""
    out = r.copy()
    out[begin:end] += 1.0
    return out


@pytest.fixture(scope="module")
def long() -> Trace:
    """A plate that rests, as long as the noise that stands for its residual."""
    time = np.arange(COUNT) * 1e-3
    still = {"voltage": np.zeros(COUNT), "current": np.zeros(COUNT), "position": np.zeros(COUNT)}
    return prepared(measurement("response", time, still))


@pytest.mark.parametrize("begin", [0, 333, COUNT - COUNT // 12])
def test_what_one_event_shows_is_no_evidence_and_what_two_show_is(
    long: Trace, rng: np.random.Generator, begin: int
) -> None:
    once = bent(rng.normal(size=long.data.shape), begin, begin + COUNT // 12)
    assert not all(row.white for row in rows_of(long, once, QUIET))
    assert white_but_for_one_event(long, once, QUIET)
    assert not white_but_for_one_event(long, bent(once, COUNT // 2, COUNT // 2 + COUNT // 12), QUIET)


def test_an_event_that_is_larger_than_noise_is_evidence(small: CandidateModel) -> None:
    """The trace of the small model was drawn by hand: most of it is far off."""
    assert any(is_larger_than_noise(row.rms, row.n) for row in evidence(small, EXACT).rows)
    assert not is_white(small)
    assert is_larger_than_noise(1.2, 2000)
    assert not is_larger_than_noise(1.1, 2000)


def test_an_event_is_a_tenth_of_a_trace_and_not_half_of_it(long: Trace, rng: np.random.Generator) -> None:
    assert not white_but_for_one_event(long, bent(rng.normal(size=long.data.shape), 0, COUNT // 2), QUIET)


# ---- in words


def row(rms: float, white: bool, channel: str = "position") -> Whiteness:
    return Whiteness("response/a.csv", "response", channel, 100, rms, 0.5, "angle", -0.4, 0.5, white)


def test_the_sentences_name_the_largest_residual_and_every_share_worth_it() -> None:
    rows = [row(1.0, True), row(3.0, False), row(20.0, False, "current")]
    found = [Share("torque", "angle", 0.62), Share("voltage", "current", 0.3), Share("torque", "speed", 0.04)]
    assert sentences(rows, found, noise=False) == [
        "2 of 3 residuals are not white; the largest, current in response/a.csv, is 20 times its noise and correlates "
        "with angle (correlation -0.40).",
        "Of the missing torque, a curve over one quantity explains: angle 62 %.",
        "Of the missing voltage, a curve over one quantity explains: current 30 %.",
    ]


def test_where_all_is_noise_nothing_else_is_said() -> None:
    found = [Share("torque", "angle", 0.9)]
    said = sentences([row(1.0, True)] * 4, found, noise=True)
    assert said == ["All 4 residuals are white: noise, as far as these tests see."]
    assert sentences([row(1.0, True), row(1.1, False)], found, noise=True) == [
        "All 2 residuals are noise but for one moment in response/a.csv. One moment of one trace is no evidence: most "
        "often it is the instant of an edge that was not logged."
    ]


# ---- on a model


def test_every_channel_of_every_trace_is_tested_where_it_was_logged(small: CandidateModel) -> None:
    """Its trace was drawn by hand and is no throttle's."""
    found = evidence(small, EXACT)
    (trace,) = small.problem.batch.traces
    assert [(r.file, r.test, r.channel) for r in found.rows] == [
        (trace.measurement.file, "response", channel) for channel in trace.channels
    ]
    assert [r.n for r in found.rows] == np.isfinite(trace.data).sum(axis=0).tolist()
    assert not found.white
    assert found.sentences[0].startswith(f"{sum(not r.white for r in found.rows)} of {len(found.rows)} residuals")
    assert found.shares == ()  # 60 samples are too few


def test_whether_all_is_white_is_told_without_what_it_goes_along_with(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The evidence of a candidate that only its whiteness decides on."""
    module = importlib.import_module("etcfit.diagnosis.evidence")
    missing_voltage = module.missing_voltage
    for limits, white in (({}, False), ({"LARGE_RMS": 1e9, "WHITE_P": 1e-300}, True)):
        for name, value in limits.items():
            monkeypatch.setattr(module, name, value)
        monkeypatch.setattr(module, "missing_voltage", missing_voltage)
        assert evidence(small, EXACT).white is white
        monkeypatch.setattr(module, "missing_voltage", lambda *_: pytest.fail("nobody reads it"))
        assert is_white(small) is white


def test_far_from_the_data_a_residual_is_judged_by_its_noise_not_by_its_weight(small: CandidateModel) -> None:
    problem = weights.discounted(small.problem, small.x)
    far = replace(small, problem=problem, weighted=problem.weighted(weights.free_running(problem)),
                  end=Termination(True, "far", far=True))  # fmt: skip
    assert far.chi2 < 0.5 * small.chi2
    assert [r.rms for r in evidence(far, EXACT).rows] == pytest.approx([r.rms for r in evidence(small, EXACT).rows])


# ---- What a model lacks along the measured motion, read off its guide: known torque, known voltage, and where none is.

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
    trace = prepared(m)
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
    problem = EstimationProblem.of_traces(config, known, (trace,))
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
