"""What drove the plate: edges where they are, and an error of the denoised input that is as large as stated."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.problem.input_signal import InputSignal, denoise, input_of
from etcfit.rig.base import Channel, Measurement, RigConfig

SIGMA = 0.01
RATE = 1000.0
BLOCK = 100


def logged(true: np.ndarray, seed: int) -> np.ndarray:
    return true + SIGMA * np.random.default_rng(seed).standard_normal(true.size)


def multisine(t: np.ndarray) -> np.ndarray:
    hertz = np.geomspace(0.3, 9.0, 8)
    phase = np.random.default_rng(5).uniform(0.0, 6.3, 8)
    return 2.0 + 0.75 * np.sin(2 * np.pi * np.outer(t, hertz) + phase) @ hertz**-0.5


def chirp(t: np.ndarray, first: float = 0.4, last: float = 8.0) -> np.ndarray:
    rate = np.log(last / first) / t[-1]
    return 2.0 + 1.8 * np.sin(2 * np.pi * first * np.expm1(rate * t) / rate)


T = np.arange(2000) / RATE
SIGNALS = {
    "constant": np.full(T.size, 3.3),
    "ramp": 0.5 * T,
    "triangle": np.interp(T, [0.0, 0.1, 1.0, 1.1, 2.0], [0.0, 0.0, 2.0, 2.0, 0.0]),
    "trapezoid": np.interp(T % 1.0, [0.0, 0.1, 0.5, 0.6, 1.0], [1.0, 4.0, 4.0, 1.0, 1.0]),
    "multisine": multisine(T),
    "chirp": chirp(T),
}
every_signal = pytest.mark.parametrize("true", SIGNALS.values(), ids=SIGNALS)
# a constant or a ramp has one or two errors in all, a curve some forty: the more seeds
SEEDS = {"constant": 200, "ramp": 200, "triangle": 60, "trapezoid": 30, "multisine": 20, "chirp": 20}


# ---- edges


def staircase(levels: list[float], each: int = 80) -> np.ndarray:
    return np.repeat(levels, each).astype(float)


@pytest.mark.parametrize("seed", range(10))
def test_edges_are_found_where_they_are_and_only_there(seed: int) -> None:
    signal = denoise(logged(staircase([0.0, 2.0, 1.7, 4.0, 1.9]), seed), SIGMA)
    assert_array_equal(np.flatnonzero(signal.edge), [79, 159, 239, 319])


@every_signal
def test_a_smooth_input_has_hardly_an_edge(true: np.ndarray) -> None:
    """Fewer than one in 10,000 samples: at a corner between two slopes noise may look like a jump."""
    assert sum(np.count_nonzero(denoise(logged(true, seed), SIGMA).edge) for seed in range(30)) <= 6


def test_a_level_reached_between_samples_is_one_edge_each_side() -> None:
    """An amplifier takes 1.5 samples for a jump: both intervals are uncertain."""
    value = staircase([1.0, 4.0])
    value[80] = 2.4
    signal = denoise(logged(value, 0), SIGMA)
    assert_array_equal(np.flatnonzero(signal.edge), [79, 80])


def test_nothing_is_averaged_across_an_edge() -> None:
    true = staircase([0.0, 2.0, 1.7, 4.0])
    assert all(np.max(np.abs(denoise(logged(true, seed), SIGMA).value - true)) < 4.5 * SIGMA for seed in range(30))


@pytest.mark.parametrize("each", [20, 80, 200])
def test_a_level_between_edges_is_averaged_over_its_whole_length(each: int) -> None:
    """A straight line through n samples is known to sigma^2 2/n in the mean; a few stretches may look curved."""
    true = staircase([0.0, 2.0, 1.0, 4.0], each)
    wrong = [denoise(logged(true, seed), SIGMA).value - true for seed in range(100)]
    assert np.mean(np.square(wrong)) < 3.0 * SIGMA**2 / each


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 9])
def test_short_logs_are_taken_as_they_are(n: int) -> None:
    value = logged(np.linspace(0.0, 3.0, n), 0)
    signal = denoise(value, SIGMA)
    assert signal.value.shape == signal.error.shape == signal.memory.shape == (n,)
    assert signal.edge.shape == (n - 1,)
    assert np.all(signal.error > 0.0)
    assert np.all(np.abs(signal.value - value) < 6.0 * SIGMA)


def test_a_long_log_is_averaged_as_a_short_one_is() -> None:
    """It is cut into stretches time and again, and these are estimated many at once."""
    t = np.arange(200_000) / RATE
    true = multisine(t)
    signal = denoise(logged(true, 0), SIGMA)
    assert np.mean((signal.value - true) ** 2) < SIGMA**2 / 3.0


# ---- honesty


@cache
def errors(name: str) -> tuple[np.ndarray, list[InputSignal]]:
    """Actual errors (seeds, n) and what was stated."""
    true = SIGNALS[name]
    signals = [denoise(logged(true, seed), SIGMA) for seed in range(SEEDS[name])]
    return np.stack([signal.value - true for signal in signals]), signals


def block_variance(signal: InputSignal) -> float:
    """Mean variance of the sum over a block of the stated errors: cov_jk = s_j s_k prod of memories between."""
    total = 0.0
    for start in range(0, signal.value.size, BLOCK):
        part = slice(start, start + BLOCK)
        decay = np.concatenate(([0.0], np.cumsum(np.log(np.maximum(signal.memory[part][1:], 1e-300)))))
        correlation = np.exp(-np.abs(decay[:, None] - decay[None, :]))
        total += float(signal.error[part] @ correlation @ signal.error[part])
    return total * BLOCK / signal.value.size


@pytest.mark.parametrize("name", SIGNALS)
def test_the_stated_error_is_the_actual_one(name: str) -> None:
    """Variance over many seeds: bias, and what the choice of windows adds, included."""
    actual, signals = errors(name)
    ratio = np.mean(actual**2) / np.mean([signal.error**2 for signal in signals])
    assert 0.6 <= ratio <= 1.6


@pytest.mark.parametrize("name", SIGNALS)
def test_the_stated_memory_is_the_actual_one(name: str) -> None:
    """The plate feels 100-sample sums of the error (its time constants), not single samples."""
    actual, signals = errors(name)
    sums = actual.reshape(len(signals), -1, BLOCK).sum(axis=2)
    ratio = np.mean(sums**2) / np.mean([block_variance(signal) for signal in signals])
    assert 0.6 <= ratio <= 1.6


@pytest.mark.parametrize(
    ("name", "gain"), [("constant", 400.0), ("ramp", 300.0), ("triangle", 10.0), ("multisine", 3.0), ("chirp", 3.0)]
)
def test_denoising_is_worth_it(name: str, gain: float) -> None:
    actual, _ = errors(name)
    assert np.mean(actual**2) < SIGMA**2 / gain


def test_a_noise_free_log_comes_back() -> None:
    """With nothing to average away, bias must not come in instead."""
    for true in SIGNALS.values():
        assert np.max(np.abs(denoise(true, 1e-6).value - true)) < 3e-5


# ---- from the log to the input


def measurement(**channels: np.ndarray) -> Measurement:
    time = np.arange(len(next(iter(channels.values())))) / RATE
    made = {name: Channel(time, value, SIGMA, False, name, "", 1.0) for name, value in channels.items()}
    return Measurement("response/a.csv", "response", time, made)


CONFIG = RigConfig("bench", supply_V=12.0)


def test_voltage_comes_before_torque_and_duty() -> None:
    m = measurement(voltage=np.full(50, 3.0), duty=np.full(50, 0.5))
    signal = input_of(m, CONFIG, m.time)
    assert signal is not None
    assert_allclose(signal.value, 3.0)
    assert not signal.held


def test_a_duty_is_held_from_sample_to_sample_and_multiplies_the_supply() -> None:
    duty, supply = np.repeat([0.2, 0.5], 25), np.full(50, 13.5)
    for m, level in ((measurement(duty=duty, supply=supply), 13.5), (measurement(duty=duty), 12.0)):
        signal = input_of(m, CONFIG, m.time)
        assert signal is not None
        assert signal.held
        assert_allclose(signal.value, duty * level)
        assert not signal.edge.any()  # the ECU's own instants are logged


def test_the_noise_of_a_batterys_reading_is_no_voltage_at_the_motor() -> None:
    rng = np.random.default_rng(3)
    read = 13.5 + SIGMA * rng.standard_normal(50)
    m = measurement(duty=np.full(50, 0.8), supply=read)
    signal = input_of(m, CONFIG, m.time)
    assert signal is not None
    assert np.std(signal.value) < 0.4 * 0.8 * np.std(read)
    assert_allclose(signal.value, 0.8 * 13.5, atol=2.0 * SIGMA)


def test_a_duty_on_a_time_base_of_its_own_is_the_latest_one() -> None:
    slow = Channel(np.array([0.0, 0.01, 0.02]), np.array([0.1, 0.2, 0.3]), SIGMA, False, "duty", "", 1.0)
    m = Measurement("response/a.csv", "response", np.arange(30) / RATE, {"duty": slow})
    signal = input_of(m, CONFIG, m.time)
    assert signal is not None
    assert_allclose(signal.value, 12.0 * np.repeat([0.1, 0.2, 0.3], 10))


def test_without_an_input_there_is_no_signal() -> None:
    m = measurement(position=np.zeros(50))
    assert input_of(m, CONFIG, m.time) is None
    assert input_of(measurement(duty=np.zeros(50)), RigConfig("bench"), m.time) is None
