"""Oscillations at rest of the independent plate: amplitude, period, kind, and that what is proposed stops them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.car_log.limit_cycle import LimitCycle, limit_cycle
from etcfit.car_log.log import Series
from independent import hunting

HELD = 8.0


def logged(
    kind: str, seed: int, rate: float = 200.0
) -> tuple[hunting.Plate, hunting.Pid, np.ndarray, np.ndarray, LimitCycle | None]:
    rng = np.random.default_rng([seed, hunting.KINDS.index(kind)])
    plate, pid = hunting.drawn(kind, rng)
    wanted = hunting.staircase(rng, 2.0 * HELD, HELD)
    true, duty = hunting.run(plate, pid, wanted, 0.02, rng)
    log = hunting.logged(rng, wanted, true, duty, rate, 0.05, 0.1)
    series = [Series(log["time"], log[name]) for name in ("position", "setpoint", "duty")]
    return plate, pid, wanted, true, limit_cycle(*series)


def last(true: np.ndarray) -> np.ndarray:
    return true[-5000:]


@pytest.mark.parametrize("seed", [2, 8, 10])
def test_stick_slip_is_named_and_measured_and_what_is_proposed_stops_it(seed: int) -> None:
    plate, pid, wanted, true, found = logged("stick-slip", seed)
    amplitude, period = hunting.truth(last(true))
    assert found is not None
    assert found.kind == "stick-slip"
    assert found.amplitude == pytest.approx(amplitude, rel=0.1, abs=0.1)
    assert found.period == pytest.approx(period, rel=0.05)
    assert found.dead_zone is not None
    assert found.dither is not None
    assert found.dither == pytest.approx(1.2 * plate.sticking, rel=0.25)
    for cure in ({"dead_zone": found.dead_zone}, {"dither": found.dither}):
        after, _ = hunting.run(plate, replace(pid, **cure), wanted, 0.02, np.random.default_rng(1))
        assert hunting.truth(last(after))[0] < 0.2
    half, _ = hunting.run(plate, replace(pid, dead_zone=0.3 * found.dead_zone), wanted, 0.02, np.random.default_rng(1))
    assert hunting.truth(last(half))[0] > 0.2  # and less than proposed does not


@pytest.mark.parametrize(("seed", "rate"), [(1, 1000.0), (4, 200.0), (3, 100.0)])
def test_instability_is_named_and_measured(seed: int, rate: float) -> None:
    *_, true, found = logged("instability", seed, rate)
    amplitude, period = hunting.truth(last(true))
    assert found is not None
    assert found.kind == "instability"
    assert found.amplitude == pytest.approx(amplitude, rel=0.1)
    assert found.period == pytest.approx(period, rel=0.03)
    assert found.dead_zone is None
    assert "dead zone or dither does not cure it" in found.says


@pytest.mark.parametrize("seed", range(4))
def test_a_plate_that_stands_still_does_not_oscillate(seed: int) -> None:
    assert logged("calm", seed)[-1] is None


def test_an_answer_that_dies_away_is_no_oscillation() -> None:
    time = np.arange(0.0, 12.0, 0.005)
    wanted = np.where(time % 4.0 < 2.0, 20.0, 50.0)
    ringing = wanted + 20.0 * np.exp(-1.0 * (time % 2.0)) * np.cos(25.0 * (time % 2.0))
    assert limit_cycle(Series(time, ringing), Series(time, wanted)) is None


@pytest.mark.parametrize("rate", [100.0, 500.0])
def test_what_stays_after_the_answer_to_a_large_step_is_seen(rate: float) -> None:
    """The answer rings for longer than 0.5 s and is larger than the oscillation that stays."""
    time = np.arange(0.0, 24.0, 1.0 / rate)
    wanted = np.where(time < 2.0, 30.0, 50.0)
    after = np.clip(time - 2.0, 0.0, None)
    answer = 12.0 * np.exp(-1.2 * after) * np.sin(9.0 * after)
    stays = np.clip(6.0 * np.sin(2.0 * np.pi * after / 2.5), -1.0, 1.0) * (after > 0.0)  # flat for most of the period
    noise = 0.03 * np.random.default_rng(3).standard_normal(time.size)
    found = limit_cycle(Series(time, wanted + answer + stays + noise), Series(time, wanted))
    assert found is not None
    assert found.kind == "stick-slip"
    assert found.amplitude == pytest.approx(1.0, rel=0.1)
    assert found.period == pytest.approx(2.5, rel=0.02)
    assert 0.4 < found.share < 0.95
    alone = limit_cycle(Series(time, wanted + answer + noise), Series(time, wanted))
    assert alone is None


def test_a_log_too_slow_for_the_shape_says_so() -> None:
    time = np.arange(0.0, 12.0, 0.02)
    position = 40.0 + 3.0 * np.sin(2.0 * np.pi * 14.3 * time)  # 3.5 samples a period
    found = limit_cycle(Series(time, position), Series(time, np.full(time.size, 40.0)))
    assert found is not None
    assert found.kind == "unknown"
    assert "too slow or too coarse" in found.says
