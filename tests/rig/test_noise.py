"""The noise estimate against signals whose noise is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from etcfit.rig import noise as module
from etcfit.rig.noise import FLOOR, Texture, pooled, quantum, textures

N = 4000
SIGMA = 0.01
TIME = 1e-3 * np.arange(N)
SIGNALS = {
    "rest": 0 * TIME,
    "ramp": 3 * TIME,
    "sine 10 Hz": np.sin(63 * TIME),
    "steps": np.floor(20 * TIME) % 2,
    "exponential": 1 - np.exp(-TIME / 0.02),
    "release with impact": np.clip(1.5 - 40 * np.clip(TIME - 1, 0, None) ** 2, 0, None),
}


def texture(time: np.ndarray, value: np.ndarray) -> Texture:
    return textures(time, [value])[0]


@pytest.mark.parametrize("signal", SIGNALS.values(), ids=SIGNALS.keys())
@pytest.mark.parametrize("jitter", [0.0, 3e-4])
def test_noise_on_a_moving_signal(signal: np.ndarray, jitter: float) -> None:
    rng = np.random.default_rng(3)
    time = TIME + rng.uniform(-jitter, jitter, N)
    moved = np.interp(time, TIME, signal) + rng.normal(0, SIGMA, N)
    assert texture(time, moved).sigma == pytest.approx(SIGMA, rel=0.15)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 1.0, 2.0, 3.0, 6.0])
@pytest.mark.parametrize("slope", [0.3, 3.0])
def test_noise_of_a_quantised_signal(ratio: float, slope: float) -> None:
    """Rounding adds its own q^2/12, all of which one sample carries."""
    q = ratio * SIGMA
    value = q * np.round((slope * TIME + np.random.default_rng(4).normal(0, SIGMA, N)) / q)
    trace = texture(TIME, value)
    sigma, _ = pooled([trace], [trace])
    assert sigma == pytest.approx(math.hypot(SIGMA, q / math.sqrt(12)), rel=0.15)


@pytest.mark.parametrize("rounded", [1e-12, 1e-4])
def test_the_step_of_a_converter_is_found(rounded: float) -> None:
    """A 10 bit converter over 3.3 V, written in full or to four decimals."""
    q = 3.3 / 1024
    volts = q * np.round((2 + np.sin(6 * TIME) + np.random.default_rng(5).normal(0, 1e-3, N)) / q)
    assert quantum(rounded * np.round(volts / rounded)) == pytest.approx(q, rel=1e-3)


def test_a_quantised_trace_without_noise_has_its_rounding_error() -> None:
    q = 0.01
    trace = texture(TIME, q * np.round(SIGNALS["release with impact"] / q))
    assert pooled([trace], [trace]) == pytest.approx((q / math.sqrt(12), q))


@pytest.mark.parametrize("levels", [2.0 * np.arange(7), np.array([0.0, 5.0]), np.arange(0, 100, 10) / 100])
def test_commanded_levels_are_no_resolution(levels: np.ndarray) -> None:
    value = np.repeat(levels, 200)
    trace = texture(1e-3 * np.arange(len(value)), value)
    sigma, q = pooled([trace], [trace])
    assert q == 0.0
    assert sigma == pytest.approx(FLOOR * np.ptp(value))


def test_toggling_between_two_levels_is_a_resolution_in_a_rig_that_shows_more() -> None:
    rng = np.random.default_rng(6)
    held = texture(TIME, 0.01 * np.round(rng.uniform(0.4, 0.6, N) / 1.0))
    wide = texture(TIME, 3 * TIME + 0 * held.span)
    assert pooled([held], [held, wide])[1] == pytest.approx(0.01)
    assert pooled([held], [held])[1] == 0.0


def test_noise_free_data_still_have_a_noise() -> None:
    for value in (np.full(50, 7.0), np.zeros(50), np.zeros(1), TIME[:50]):
        trace = texture(TIME[: len(value)], value)
        assert pooled([trace], [trace])[0] > 0


def test_traces_are_pooled_robustly() -> None:
    """One trace full of spikes and one frozen do not move what seven agree on; another instrument keeps its own."""
    rng = np.random.default_rng(7)
    same = [texture(TIME, rng.normal(0, SIGMA, N)) for _ in range(7)]
    odd = [texture(TIME, rng.normal(0, 1.5 * SIGMA, N)), texture(TIME, 0 * TIME)]
    assert pooled(odd, [*same, *odd])[0] == pytest.approx(SIGMA, rel=0.05)
    scope = [texture(TIME, rng.normal(0, 10 * SIGMA, N)) for _ in range(2)]
    assert pooled(scope, [*same, *scope])[0] == pytest.approx(10 * SIGMA, rel=0.05)
    assert pooled(same, [*same, *scope])[0] == pytest.approx(SIGMA, rel=0.05)


def test_a_long_trace_in_blocks_is_the_trace_as_a_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    value = np.random.default_rng(5).normal(0, SIGMA, N)
    whole = texture(TIME, value)
    for block in (7, N - 2, N):
        monkeypatch.setattr(module, "BLOCK", block)
        assert texture(TIME, value) == whole


def test_channels_look_the_same_alone_and_together() -> None:
    rng = np.random.default_rng(8)
    time = TIME + rng.uniform(-3e-4, 3e-4, N)
    values = [signal + SIGMA * rng.standard_normal(N) for signal in SIGNALS.values()]
    values.append(0.05 * np.round(values[2] / 0.05))
    assert textures(time, values) == [texture(time, value) for value in values]
