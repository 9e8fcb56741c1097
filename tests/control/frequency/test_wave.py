"""Sine fits against responses known from python-control: exact without noise, covered by their intervals with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import control
from etcfit.control.frequency import wave
from etcfit.control.frequency.wave import (
    Ratio,
    Signal,
    Waves,
    common,
    fit_waves,
    frequency_of,
    fundamental,
    moving,
    settled,
)

DELAY = 0.012
LOOP: Any = control.tf([1.1], [0.03, 1.0])


def response(frequency: float) -> complex:
    """1.1 exp(-0.012 s) / (0.03 s + 1)."""
    s = 2j * np.pi * frequency
    return complex(LOOP(s)) * np.exp(-DELAY * s)


def pair(time: np.ndarray, frequency: float, drift: float = 0.0) -> dict[str, Signal]:
    """A setpoint and what a loop that has settled makes of it."""
    wave = 0.2 * np.exp(2j * np.pi * frequency * time + 0.7j)
    position = 0.5 + drift * time + (response(frequency) * wave).real
    return {"setpoint": Signal(time, 0.6 + wave.real), "position": Signal(time, position)}


def closed_loop(waves: Waves) -> Ratio:
    return waves.ratio({"position": 1.0}, {"setpoint": 1.0})


def even(frequency: float, cycles: float = 6.0, rate: float = 200.0) -> np.ndarray:
    return np.arange(int(cycles / frequency * rate)) / rate


@pytest.mark.parametrize("frequency", [0.5, 2.0, 10.0])
def test_without_noise_the_response_is_exact(frequency: float) -> None:
    waves = fit_waves(pair(even(frequency), frequency), 1.01 * frequency, 3)
    assert_allclose(waves.frequency, frequency, rtol=1e-8)
    assert_allclose(closed_loop(waves).value, response(frequency), rtol=1e-7)
    assert waves.offsets["position"] == pytest.approx(0.5, abs=1e-8)
    assert waves.outside["position"] < 1e-12


@pytest.mark.parametrize("gap", [False, True])
def test_jittered_and_broken_time_change_nothing(gap: bool) -> None:
    rng = np.random.default_rng(4)
    time = np.sort(even(2.0) + rng.uniform(0.0, 0.004, even(2.0).size))
    signals = pair(time, 2.0)
    if gap:
        holes = (time > 0.8) & (time < 1.5)
        signals["position"] = Signal(time[~holes][::3], signals["position"].value[~holes][::3])
    assert_allclose(closed_loop(fit_waves(signals, 1.98, 3)).value, response(2.0), rtol=1e-7)


def test_harmonics_and_drift_are_told_from_the_fundamental() -> None:
    time = even(1.0)
    signals = pair(time, 1.0, drift=0.01)
    size = abs(0.2 * response(1.0))
    third = 0.1 * size * np.cos(2.0 * np.pi * 3.0 * time)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(time.size)
    waves = fit_waves(signals | {"position": Signal(time, signals["position"].value + third + noise)}, 1.0, 5)
    assert_allclose(closed_loop(waves).value, response(1.0), rtol=1e-3)
    assert waves.outside["position"] == pytest.approx(0.01 / 1.01, rel=0.01)
    assert_allclose(waves.in_harmonics["position"], [0.0, 0.01 / 1.01, 0.0, 0.0], atol=1e-4)


def test_the_fundamental_of_another_signal_refers_to_the_same_instant() -> None:
    time = even(3.0)
    waves = fit_waves(pair(time, 3.0), 3.0)
    late = Signal(time, np.cos(2.0 * np.pi * 3.0 * (time - waves.middle) - 0.4))
    assert fundamental(late, 3.0, waves.middle, 1) == pytest.approx(np.exp(-0.4j))


Spoilt = Callable[[np.random.Generator, np.ndarray, dict[str, Signal]], dict[str, Signal]]


def white(rng: np.random.Generator, time: np.ndarray, signals: dict[str, Signal]) -> dict[str, Signal]:
    return {name: Signal(time, s.value + 0.01 * rng.standard_normal(time.size)) for name, s in signals.items()}


def correlated(rng: np.random.Generator, time: np.ndarray, signals: dict[str, Signal]) -> dict[str, Signal]:
    """First order, with a memory of ten samples."""
    noise = np.zeros(time.size)
    for k, shock in enumerate(rng.standard_normal(time.size)):
        noise[k] = 0.9 * noise[k - 1] + shock
    return signals | {"position": Signal(time, signals["position"].value + 0.01 * noise)}


def quantised(rng: np.random.Generator, time: np.ndarray, signals: dict[str, Signal]) -> dict[str, Signal]:
    return {name: Signal(time, 0.004 * np.round(s.value / 0.004 + 0.4 * rng.standard_normal(time.size)))
            for name, s in signals.items()}  # fmt: skip


def jittered(rng: np.random.Generator, time: np.ndarray, signals: dict[str, Signal]) -> dict[str, Signal]:
    """The position is sampled at instants that scatter by a third of a sample."""
    true = pair(time + 0.0016 * rng.standard_normal(time.size), 2.0)["position"].value
    return signals | {"position": Signal(time, true + 1e-4 * rng.standard_normal(time.size))}


def wandering(rng: np.random.Generator, time: np.ndarray, signals: dict[str, Signal]) -> dict[str, Signal]:
    """Every cycle has an amplitude of its own, as with friction that varies."""
    cycle = np.floor((time - time[0]) * 2.0).astype(int)
    factor = (1.0 + 0.05 * rng.standard_normal(cycle[-1] + 1))[cycle]
    swing = factor * (signals["position"].value - 0.5) + 1e-3 * rng.standard_normal(time.size)
    return signals | {"position": Signal(time, 0.5 + swing)}


@pytest.mark.slow
@pytest.mark.parametrize(("cycles", "wide"), [(3.0, 3.0), (10.0, 1.5)])
@pytest.mark.parametrize("spoil", [white, correlated, quantised, jittered, wandering])
def test_intervals_cover_the_truth(spoil: Spoilt, cycles: float, wide: float) -> None:
    """95 % of 160 intervals, less three standard errors of such a count; and they are no wider than it takes.

    Three cycles say little of how they scatter: there Student's t makes intervals twice as wide.
    """
    time = even(2.0, cycles)
    truth, held, widths = response(2.0), [], []
    for seed in range(80):
        found = closed_loop(fit_waves(spoil(np.random.default_rng(seed), time, pair(time, 2.0)), 2.0, 3))
        low, high = found.magnitude_ci95
        turned = abs(np.angle(found.value / truth))
        held += [low < abs(truth) < high, turned < found.phase_margin]
        widths.append(
            [np.log(found.value / truth).real ** 2, found.covariance[0, 0], turned**2, found.covariance[1, 1]]
        )
    assert np.mean(held) > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / len(held))
    spread = np.mean(widths, axis=0)
    assert np.all(spread[1::2] < wide**2 * spread[::2])


RATE, HERTZ = 500.0, 2.0


def sine(cycles: float, lead: float = 0.0, fading: float = 0.0) -> Signal:
    """At rest for `lead` s, then so many cycles; `fading` is the size of a transient of 0.3 s time constant."""
    time = np.arange(round((lead + cycles / HERTZ) * RATE)) / RATE
    since = np.maximum(time - lead, 0.0)
    return Signal(time, 0.5 + np.sin(2.0 * np.pi * HERTZ * since) + fading * (since > 0.0) * np.exp(-since / 0.3))


def test_a_setpoint_at_rest_before_and_after_is_cut_off() -> None:
    still = sine(3.0, lead=0.4)
    found = moving(Signal(np.append(still.time, still.time[-1] + 1.0), np.append(still.value, still.value[-1])))
    assert found.time[0] == pytest.approx(0.4, abs=2.0 / RATE)
    assert found.time[-1] == pytest.approx(still.time[-1])
    assert moving(Signal(still.time, np.ones(still.time.size))).time.size == 0


@pytest.mark.parametrize("cycles", [3.0, 7.3, 40.0])
def test_the_frequency_is_found_between_the_bins(cycles: float) -> None:
    assert frequency_of(sine(cycles)) == pytest.approx(HERTZ, rel=1e-6)


def test_both_must_have_been_logged() -> None:
    begin, end = common(
        Signal(np.arange(0.0, 2.0, 0.1), np.zeros(20)), Signal(np.arange(0.5, 3.0, 0.01), np.zeros(250))
    )
    assert (begin, end) == (0.5, pytest.approx(2.0))


def test_a_window_is_whole_cycles_up_to_the_end_without_the_transient() -> None:
    for fading, fewest in ((0.0, 1.0), (0.5, 2.0)):
        found = settled(sine(8.4), sine(8.4, fading=fading), HERTZ, 1)
        assert found.end - found.begin == pytest.approx(found.cycles / HERTZ)
        assert found.skipped >= fewest
        assert found.cycles + found.skipped == pytest.approx(8.4)


def test_what_is_alike_enough_is_a_share_of_the_swing(monkeypatch: pytest.MonkeyPatch) -> None:
    fading, cycles = sine(8.4, fading=0.5), list[int]()
    for same in (1e-6, 1.0):
        monkeypatch.setattr(wave, "SAME", same)
        cycles.append(settled(sine(8.4), fading, HERTZ, 1).cycles)
    strict, lax = cycles
    assert strict < lax == 7  # the very first one is always left out
