"""The circuit read off windows, against numbers put in by hand; lines at the mains."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.rig.base import Channel, Measurement, RigConfig
from etcfit.rig.checks.circuit import read_circuit
from etcfit.rig.checks.line import Line, line_near, spectrum

R, L, K, DROP = 1.6, 1.4e-3, 0.38, 0.25
CONFIG = RigConfig("by hand", gear_ratio=20.68)
TIME = np.arange(0.0, 2.0, 1e-3)


def made(test: str, current: np.ndarray, angle: np.ndarray | None = None, drop: float = 0.0, noise: float = 1e-4):
    """A trace whose voltage is what the circuit's equation asks for."""
    rng = np.random.default_rng(0)
    speed = np.zeros(TIME.size) if angle is None else np.gradient(angle, TIME)
    volts = R * current + L * np.gradient(current, TIME) + K * speed + drop * np.sign(current)
    values = {"voltage": volts, "current": current} | ({} if angle is None else {"position": angle})
    channels = {
        name: Channel(TIME, value + noise * rng.standard_normal(TIME.size), noise, False, name, "", 1.0)
        for name, value in values.items()
    }
    return Measurement(f"{test}/1.csv", test, TIME, channels)


def test_resistance_inductance_and_back_emf_of_a_moving_plate() -> None:
    found = read_circuit([made("response", 1.5 + np.sin(40 * TIME), 0.7 + 0.4 * np.sin(7 * TIME))], CONFIG)
    assert found is not None
    for value, true, near in ((found.R, R, 1e-3), (found.L, L, 0.02), (found.k, K, 3e-3)):
        assert value is not None
        assert value.value == pytest.approx(true, rel=near)
        assert abs(value.value - true) < 6 * value.error + near * true


def test_brushes_are_told_from_resistance_where_the_current_has_levels() -> None:
    levels = np.repeat([0.4, 1.0, 2.0, 3.0], TIME.size // 4)
    found = read_circuit([made("resistance", levels, drop=DROP)], CONFIG)
    assert found is not None
    assert found.R is not None
    assert found.R.value == pytest.approx(R, rel=2e-3)
    assert found.drop == pytest.approx(DROP, rel=0.02)
    assert found.k is None


def test_one_level_cannot_tell_them() -> None:
    found = read_circuit([made("resistance", np.full(TIME.size, 2.0), drop=DROP)], CONFIG)
    assert found is not None
    assert found.R is not None
    assert found.R.value == pytest.approx(R + DROP / 2.0, rel=2e-3)
    assert found.drop == 0.0


def test_without_a_current_there_is_no_circuit() -> None:
    trace = made("response", 1.5 + np.sin(40 * TIME), 0.7 + 0.4 * np.sin(7 * TIME))
    bare = {name: channel for name, channel in trace.channels.items() if name != "current"}
    assert read_circuit([Measurement(trace.file, trace.test, TIME, bare)], CONFIG) is None


def line(hertz: float, amplitude: float, seed: int = 0, duration: float = 2.0, motion: bool = False) -> Line:
    rng, time = np.random.default_rng(seed), np.arange(0.0, duration, 1e-3)
    value = 0.01 * rng.standard_normal(time.size) + amplitude * np.sin(2 * np.pi * hertz * time + 1.0)
    if motion:
        value += np.where(time > 0.7, 2.0, 0.0) + np.sin(2 * np.pi * 3.0 * time)
    known = spectrum(Channel(time, value, 0.01, False, "x", "V", 1.0), 50.0)
    assert known is not None
    return line_near(known, 50.0, 0.06)


@pytest.mark.parametrize("hertz", [48.6, 50.0, 51.3])
@pytest.mark.parametrize("motion", [False, True])
def test_a_line_is_measured(hertz: float, motion: bool) -> None:
    found = line(hertz, 0.02, motion=motion)
    assert found.chance < 1e-8
    assert found.frequency == pytest.approx(hertz, abs=max(4 * found.error, 0.1))
    assert found.amplitude == pytest.approx(0.02, rel=0.25)


def test_noise_is_called_a_line_as_rarely_as_it_says() -> None:
    chances = [line(50.0, 0.0, seed).chance for seed in range(200)]
    assert sum(chance < 0.01 for chance in chances) <= 8
    assert min(chances) > 1e-6


def test_a_short_or_slow_trace_tells_nothing() -> None:
    for time in (np.arange(0.0, 0.05, 1e-3), np.arange(0.0, 20.0, 0.01)):
        assert spectrum(Channel(time, np.sin(time), 0.01, False, "x", "V", 1.0), 50.0) is None
