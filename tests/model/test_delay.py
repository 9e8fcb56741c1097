"""Signals that are late: exactly themselves without a delay, exactly shifted with one, each trace by itself."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bodies import batch
from etcfit.model.delay import delayed, late_inputs, logged_late
from etcfit.model.stepper import Reset, Step

DELAYS = (3e-4, 1e-3, 0.0123, 0.9)  # within a step, of about one, of many, longer than any trace
LENGTHS = ((30, 25), (50,))  # steps of each trace, lane by lane
ROWS = 64

shifted = jax.jit(delayed)
late = jax.jit(late_inputs)
read_late = jax.jit(logged_late)


class Laid:
    """Three traces of uneven steps on two lanes, the first lane shared by two, and room to spare at the end of both.

    Attributes:
        steps, resets: the batch, entries of shape (ROWS, 2).
        places: lane and rows of each trace.
    """

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        lanes, self.places = [], []
        for lane, lengths in enumerate(LENGTHS):
            pieces, row = [], 0
            for n in lengths:
                pieces.append(batch(rng.uniform(0.5e-3, 1.5e-3, n)))
                self.places.append((lane, slice(row, row + n + 1)))
                row += n + 1
            blank, nothing = batch(np.zeros(ROWS - row - 1))
            pieces.append((blank, nothing._replace(begins=np.zeros((ROWS - row, 1)))))
            lanes.append(jax.tree.map(lambda *c: np.concatenate(c), *pieces))
        self.steps: Step
        self.resets: Reset
        self.steps, self.resets = jax.tree.map(lambda *c: np.concatenate(c, axis=1), *lanes)

    def clock(self, k: int) -> np.ndarray:
        """Time since the k-th trace began at its entries, s."""
        lane, rows = self.places[k]
        return np.cumsum(self.steps.dt[rows, lane])

    def driven(self, begin: np.ndarray, end: np.ndarray) -> Step:
        """The steps with such a voltage, and minus twice that as torque."""
        return self.steps._replace(voltage0=begin, voltage1=end, torque0=-2.0 * begin, torque1=-2.0 * end)


LAID = Laid()
TRACES = range(len(LAID.places))


def everywhere(function: Any) -> np.ndarray:
    """A function of the time in each trace and of its number, along the batch; 99 where there is no trace."""
    out = np.full((ROWS, 2), 99.0)
    for k, (lane, rows) in enumerate(LAID.places):
        out[rows, lane] = function(LAID.clock(k), k)
    return out


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(ROWS, 2))


def held(seed: int) -> Step:
    """A level for each step, jumping in between."""
    level = noise(seed)
    return LAID.driven(level, level)


def bent(seed: int) -> Step:
    """Levels joined by straight lines."""
    end = noise(seed)
    begin = np.concatenate((end[:1], end[:-1]))
    for lane, rows in LAID.places:
        begin[rows.start, lane] = end[rows.start, lane]
    return LAID.driven(begin, end)


def means(steps: Step) -> np.ndarray:
    return 0.5 * np.asarray(steps.voltage0 + steps.voltage1)


def exact_means(steps: Step, k: int, delay: float) -> np.ndarray:
    """Mean over each step of the k-th trace of its voltage at t - delay, by the integral of its straight pieces;
    before the trace began, what its first step begins with."""
    lane, rows = LAID.places[k]
    clock = LAID.clock(k)
    v0, v1 = np.asarray(steps.voltage0)[rows, lane][1:], np.asarray(steps.voltage1)[rows, lane][1:]
    dt = np.diff(clock)
    whole = np.concatenate(([0.0], np.cumsum(0.5 * (v0 + v1) * dt)))

    def integral(t: float) -> float:
        if t <= 0.0:
            return v0[0] * t
        n = min(int(np.searchsorted(clock, t, side="right")) - 1, dt.size - 1)
        share = (t - clock[n]) / dt[n]
        return whole[n] + dt[n] * (v0[n] * share + 0.5 * (v1[n] - v0[n]) * share**2)

    reached = np.array([integral(t - delay) for t in clock])
    return np.diff(reached) / dt


# ---- no delay


def test_a_signal_without_delay_is_itself() -> None:
    signal = noise(1)
    assert_array_equal(shifted(signal, LAID.steps, LAID.resets, 0.0), signal)


@pytest.mark.parametrize("drive", [held, bent])
def test_an_input_without_delay_is_itself(drive: Any) -> None:
    steps = drive(2)
    for name, before, after in zip(Step._fields, steps, late(steps, LAID.resets, 0.0), strict=True):
        assert_array_equal(after, before, err_msg=name)


# ---- a delayed signal


@pytest.mark.parametrize("delay", DELAYS)
def test_a_signal_is_read_off_between_its_samples(delay: float) -> None:
    signal = noise(3)
    moved = np.asarray(shifted(signal, LAID.steps, LAID.resets, delay))
    for k, (lane, rows) in enumerate(LAID.places):
        clock = LAID.clock(k)
        assert_allclose(moved[rows, lane], np.interp(clock - delay, clock, signal[rows, lane]), atol=1e-10)


# ---- a delayed input


@pytest.mark.parametrize("delay", DELAYS)
def test_a_ramped_input_is_shifted_exactly_wherever_it_had_begun(delay: float) -> None:
    def at(t: np.ndarray, k: int) -> np.ndarray:
        return 3.0 + k + (2.0 - 5.0 * k) * t

    end = everywhere(at)
    begin = everywhere(lambda t, k: at(np.concatenate(([0.0], t[:-1])), k))
    out = late(LAID.driven(begin, end), LAID.resets, delay)
    begun = 0
    for k, (lane, rows) in enumerate(LAID.places):
        clock = LAID.clock(k)
        after, before = clock[:-1] >= delay, clock[1:] <= delay
        first, last = (np.asarray(v)[rows, lane][1:] for v in (out.voltage0, out.voltage1))
        assert_allclose(first[after], at(clock[:-1][after] - delay, k), rtol=1e-10)
        assert_allclose(last[after], at(clock[1:][after] - delay, k), rtol=1e-10)
        assert_allclose(np.stack((first, last))[:, before], 3.0 + k, rtol=1e-10)
        begun += int(after.sum())
    assert begun > 60 or delay > 0.06


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("drive", [held, bent])
def test_each_step_keeps_the_mean_of_what_acts_in_it(drive: Any, delay: float) -> None:
    steps = drive(4)
    out = means(late(steps, LAID.resets, delay))
    for k, (lane, rows) in enumerate(LAID.places):
        assert_allclose(out[rows, lane][1:], exact_means(steps, k, delay), atol=1e-10)


def test_torque_is_shifted_as_voltage_is_and_nothing_else_is() -> None:
    steps = bent(5)
    out = late(steps, LAID.resets, 0.0123)
    assert_allclose(out.torque0, -2.0 * np.asarray(out.voltage0), atol=1e-10)
    assert_allclose(out.torque1, -2.0 * np.asarray(out.voltage1), atol=1e-10)
    assert np.max(np.abs(out.voltage1 - steps.voltage1)) > 1.0
    for name in set(Step._fields) - {"voltage0", "voltage1", "torque0", "torque1"}:
        assert_array_equal(getattr(out, name), getattr(steps, name), err_msg=name)


# ---- traces side by side and one after the other


@pytest.mark.parametrize("delay", DELAYS)
@pytest.mark.parametrize("other", TRACES)
def test_no_trace_knows_of_another(other: int, delay: float) -> None:
    lane, rows = LAID.places[other]
    signal, changed = noise(6), noise(6)
    changed[rows, lane] = 1e3 * noise(7)[rows, lane]
    before, after = (np.asarray(shifted(s, LAID.steps, LAID.resets, delay)) for s in (signal, changed))
    acted, acts = (means(late(LAID.driven(s, s), LAID.resets, delay)) for s in (signal, changed))
    for k, (lane, rows) in enumerate(LAID.places):
        same = k != other
        assert np.array_equal(after[rows, lane], before[rows, lane]) is same
        # the integral that means are taken from has gone through the other trace: a rounding of it remains
        assert np.allclose(acts[rows, lane][1:], acted[rows, lane][1:], rtol=0.0, atol=1e-9) is same


# ---- derivatives


@jax.jit
def both(delay: Any) -> Any:
    """A delayed signal, and the begin and the end of a delayed input."""
    steps = bent(8)
    acting = late_inputs(steps, LAID.resets, delay)
    return jnp.stack([delayed(noise(8), steps, LAID.resets, delay), acting.voltage0, acting.voltage1])


slope_of = jax.jit(lambda delay: jax.jvp(both, (delay,), (1.0,))[1])


@pytest.mark.parametrize("delay", DELAYS)
def test_the_derivative_in_the_delay_is_finite_differences(delay: float) -> None:
    slope = np.asarray(slope_of(delay))
    h = 1e-8  # no sample lies so close to one that is looked up
    difference = (np.asarray(both(delay + h)) - np.asarray(both(delay - h))) / (2.0 * h)
    inside = np.zeros((ROWS, 2), dtype=bool)
    for lane, rows in LAID.places:
        inside[rows, lane] = True
    scale = max(1.0, float(np.max(np.abs(difference[:, inside]))))
    assert scale > 100.0 or delay > 0.06
    assert_allclose(slope[:, inside] / scale, difference[:, inside] / scale, atol=1e-6)


# ---- a channel that the rig logs late, or early


def test_a_channel_that_is_not_late_is_itself() -> None:
    moved = np.asarray(read_late(noise(3), LAID.steps, LAID.resets, 0.0))
    for lane, rows in LAID.places:
        assert_allclose(moved[rows, lane], noise(3)[rows, lane], rtol=1e-12)


@pytest.mark.parametrize("by", [*DELAYS, *(-delay for delay in DELAYS)])
def test_a_ramp_is_read_off_exactly_either_way_and_rests_beyond_its_ends(by: float) -> None:
    signal = everywhere(lambda t, k: 3.0 + k + (2.0 - 5.0 * k) * t)
    moved = np.asarray(read_late(signal, LAID.steps, LAID.resets, by))
    for k, (lane, rows) in enumerate(LAID.places):
        clock = LAID.clock(k)
        then = np.clip(clock - by, 0.0, clock[-1])
        assert_allclose(moved[rows, lane], 3.0 + k + (2.0 - 5.0 * k) * then, rtol=1e-12)


@pytest.mark.parametrize("by", [0.0123, -0.0041])
def test_a_parabola_is_read_off_exactly_and_a_wave_to_the_third_order(by: float) -> None:
    parabola = everywhere(lambda t, k: 3.0 + t + 400.0 * t**2)
    wave = everywhere(lambda t, k: np.sin(200.0 * t))
    for signal, true, off in (
        (parabola, lambda t: 3.0 + t + 400.0 * t**2, 1e-12),
        (wave, lambda t: np.sin(200.0 * t), 2e-3),
    ):
        moved = np.asarray(read_late(signal, LAID.steps, LAID.resets, by))
        for k, (lane, rows) in enumerate(LAID.places):
            clock = LAID.clock(k)
            then = clock - by
            inside = (then > clock[2]) & (then < clock[-3])  # at an end the slope is that of the step there
            assert_allclose(moved[rows, lane][inside], true(then[inside]), rtol=1e-10, atol=off)
            straight = np.interp(then, clock, true(clock))[inside]
            assert np.abs(straight - true(then[inside])).max() > 2.0 * off


def test_at_a_bend_it_is_off_by_no_more_than_said() -> None:
    """0.074 h times the jump of slope, for even steps."""
    steps, resets = batch(np.full(40, 1e-3))
    clock = np.cumsum(steps.dt[:, 0])
    bent = np.maximum(clock - 0.02, 0.0)[:, None]
    for by in np.linspace(0.0, 2e-3, 41):
        moved = np.asarray(read_late(bent, steps, resets, by))[:, 0]
        assert np.abs(moved - np.maximum(clock - by - 0.02, 0.0))[3:-3].max() < 0.075e-3


@pytest.mark.slow
def test_it_has_no_kink_where_a_lateness_is_a_whole_number_of_samples() -> None:
    steps, resets = batch(np.full(40, 1e-3))
    wave = np.sin(400.0 * np.cumsum(steps.dt[:, 0]))[:, None]
    slopes = [jax.jvp(lambda by: logged_late(wave, steps, resets, by), (3e-3 + d,), (1.0,))[1] for d in (-1e-9, 1e-9)]
    assert_allclose(slopes[0][6:-3], slopes[1][6:-3], atol=1e-2)


def test_one_trace_is_late_and_the_others_are_not() -> None:
    by = everywhere(lambda t, k: (0.0, 0.004, -0.003)[k])
    moved = np.asarray(read_late(noise(5), LAID.steps, LAID.resets, by))
    for k, (lane, rows) in enumerate(LAID.places):
        alone = np.asarray(read_late(noise(5), LAID.steps, LAID.resets, (0.0, 0.004, -0.003)[k]))
        assert_allclose(moved[rows, lane], alone[rows, lane], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("by", [0.0, 0.0021, -0.0017])
def test_its_derivative_is_minus_the_slope_where_it_is_read_off_also_where_nothing_is_late(by: float) -> None:
    signal = everywhere(lambda t, k: 3.0 + k + (2.0 - 5.0 * k) * t)
    _, slope = jax.jvp(lambda late: logged_late(signal, LAID.steps, LAID.resets, late), (by,), (1.0,))
    for k, (lane, rows) in enumerate(LAID.places):
        assert_allclose(np.asarray(slope)[rows, lane][6:-6], 5.0 * k - 2.0, rtol=1e-9)
