"""Lines at the mains: amplitude, frequency and chance."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.rig.base import Channel
from etcfit.rig.checks.line import Line, line_near, spectrum


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
