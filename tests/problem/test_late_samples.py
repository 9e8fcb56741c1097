"""Late samples are filtered where they belong: what a late logger wrote is whitened as if it had not been late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.innovations import shifted_samples_jax
from etcfit.problem.lateness import moved_samples
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Channel, Fixed, Measurement
from independent import CONSISTENT
from independent.drives import steps
from measurements import CONFIG, driven, measurement, noisy, prepared

EFFECTS = ("trace_late[response/a.csv]", "channel_late[response.current]")
SYMBOLS = ("late.response/a.csv", "late.response.current")
BY = 6  # samples
INTERVAL = 1e-3


def record() -> Measurement:
    """Jumps of several volts at instants that nobody logged, noisy."""
    drive = steps(np.array([0.0503, 0.0711, 0.0626, 0.0848, 0.1]), np.array([0.0, 6.0, 3.0, 7.5, 2.0]))
    m = driven(drive, 0.0)
    return noisy(measurement("response", m.time, {"voltage": m.voltage, "current": m.current, "position": m.angle}), 3)


def late(whole: Measurement, *channels: str) -> Measurement:
    """The same with some channels `BY` samples later, cut where one of them has nothing."""

    def cut(name: str, c: Channel) -> Channel:
        value = c.value[:-BY] if name in channels else c.value[BY:]
        return replace(c, time=c.time[BY:], value=value)

    cut_off = {name: cut(name, c) for name, c in whole.channels.items()}
    return replace(whole, time=whole.time[BY:], channels=cut_off)


def problem_of(log: Measurement, *seconds: float) -> EstimationProblem:
    """R_a and what is late free, the latter with a start; all else as it is."""
    known = {
        s: Fixed(float(getattr(CONSISTENT, s)))
        for s in ("L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
    }
    held = {symbol: Fixed(by) for symbol, by in zip(SYMBOLS, seconds, strict=True)}
    config = replace(CONFIG, effects=EFFECTS, parameters=known | held)
    trace = prepared(log, config)
    return EstimationProblem.of_traces(config, free_parameters(config), (trace,))


def whitened(problem: EstimationProblem) -> np.ndarray:
    x = problem.layout.coordinates({"R_a": CONSISTENT.R_a})
    problem = problem.refined(x)
    filter_ = problem.kalman(x)
    r = problem.residual(x, problem.weighted(filter_))
    return r[np.asarray(problem.slots.weight) > 0.0]


@pytest.mark.slow
@pytest.mark.parametrize(("channels", "seconds"), [
    (("current", "position"), (BY * INTERVAL, 0.0)), (("current",), (0.0, BY * INTERVAL)),
    (("voltage", "position"), (0.0, -BY * INTERVAL)),
])  # fmt: skip
def test_a_late_log_is_whitened_as_one_that_is_not(channels: tuple[str, ...], seconds: tuple[float, float]) -> None:
    """Of a voltage and a position that are late, the current is early."""
    r = whitened(problem_of(late(record(), *channels), *seconds))
    prompt = whitened(problem_of(record(), 0.0, 0.0))
    assert np.mean(prompt**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(r**2) == pytest.approx(1.0, abs=0.15)
    assert np.abs(r).max() < 5.5


def test_filtered_where_they_were_logged_the_edges_would_be_surprises() -> None:
    """The test above can fail."""
    problem = problem_of(late(record(), "current"), 0.0, BY * INTERVAL)
    x = problem.layout.coordinates({"R_a": CONSISTENT.R_a})
    problem = problem.refined(x)
    elsewhere = problem_of(late(record(), "current"), 0.0, 0.0).refined(x)
    r = problem.residual(x, problem.weighted(elsewhere.kalman(x)))
    assert np.mean(r**2) > 2.0


def test_samples_go_as_far_as_they_are_late_and_come_back() -> None:
    problem = problem_of(record(), 0.0, BY * INTERVAL)
    values = problem.layout.values(problem.layout.coordinates({"R_a": 1.0}), problem.free_parameters.held)
    where = moved_samples(problem.batch, problem.layout.types, values)
    assert where is not None
    (trace,), ((lane, _, marks),) = problem.batch.traces, problem.batch.places
    m, other = trace.channels.index("current"), trace.channels.index("position")
    assert_array_equal(where.forth[marks[:-BY], lane, m], marks[BY:])
    assert_array_equal(where.back[marks[BY:], lane, m], marks[:-BY])
    assert_array_equal(where.forth[marks, lane, other], marks)
    value = np.asarray(problem.slots.value)
    again = np.asarray(shifted_samples_jax(shifted_samples_jax(value, where.forth), where.back))
    assert_array_equal(again[marks[BY:], lane, m], value[marks[BY:], lane, m])
    assert_array_equal(again[marks[:BY], lane, m], 0.0)  # before the first sample there is no place


def test_where_nothing_is_late_nothing_moves() -> None:
    problem = problem_of(record(), 0.0, 0.2 * INTERVAL)
    values = problem.layout.values(problem.layout.coordinates({"R_a": 1.0}), problem.free_parameters.held)
    assert moved_samples(problem.batch, problem.layout.types, values) is None
