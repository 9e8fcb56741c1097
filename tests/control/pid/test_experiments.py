"""The rules that experiment on the nonlinear model: the manual procedure and the relay."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rigs
from bodies import NOMINAL, OPEN
from etcfit.control.pid import Gains, Refusal, Requirements, Task, experiments
from etcfit.control.pid.experiments import experiment, manual
from etcfit.control.pid.formulas import Ultimate
from etcfit.control.setpoint import trapezoid
from etcfit.control.settings import DesignSettings, ManualSettings
from etcfit.model.ecu import Ecu
from independent.effects import NONE
from independent.kernel import at_rest, mode_at_rest, record, step
from independent.simulate import throttle
from independent.truth import Truth


def task(settings: ManualSettings) -> Task:
    loop = rigs.loop(ecu=Ecu())
    return Task(rigs.plant(loop), Ecu(), Requirements(), loop, settings=DesignSettings(manual=settings))


@pytest.mark.slow
def test_its_proportional_gain_is_near_the_best_and_not_where_the_gains_tried_end() -> None:
    tried = task(ManualSettings())
    found = manual(tried)
    assert isinstance(found, Gains)
    every = np.linspace(5.0, 1500.0, 300)
    none = np.zeros(every.size)
    rmse = np.asarray(tried.loop.figures(Gains(every, none, none), trapezoid()).rmse_pct)[0]
    best = float(every[np.argmin(rmse)])
    assert best > 150.0
    assert 0.5 * best < found.Kp <= best
    at_found, at_120 = np.interp((float(found.Kp), 120.0), every, rmse)
    assert at_found < 1.15 * rmse.min() < 0.7 * at_120


def test_it_refuses_where_the_gains_tried_end_too_soon() -> None:
    refused = manual(task(ManualSettings(highest=(120.0, 5000.0, 3.0))))
    assert isinstance(refused, Refusal)
    assert "120 V/rad: raise highest" in refused.why


NAMES = ("R_a", "L_a", "K_b", "K_m", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")
PLATE = throttle(Truth(**{name: NOMINAL[name] for name in NAMES}), NONE)
MIDDLE, SPAN = 0.25 * OPEN, 0.005 * OPEN
HOLD = PLATE.R * (PLATE.T_PL + PLATE.K_s * MIDDLE) / PLATE.k_t


def swung(swing: float, period: float, hold: float = 2.0, parts: int = 20) -> np.ndarray:
    """Angle at each tick under a relay of so many V about the voltage that holds the plate, rad."""
    p, x = record(PLATE), at_rest(PLATE, MIDDLE)
    mode, side, out = mode_at_rest(p, x), 1.0, []
    for _ in range(round(hold / period)):
        out.append(x.theta)
        error = MIDDLE - x.theta
        side = 1.0 if error > SPAN else -1.0 if error < -SPAN else side
        for _ in range(parts):
            mode, x = step(p, HOLD + side * swing, 0.0, mode, x, period / parts)
    return np.array(out)


@cache
def ultimate_by_relay(period: float) -> tuple[float, float]:
    """Of the smallest of the amplitudes that keeps the plate swinging: 4 d / (pi sqrt(a^2 - e^2)), and its period."""
    for swing in 12.0 * np.geomspace(0.06, 0.9, 12):
        angle = swung(float(swing), period)
        angle = angle[angle.size // 2 :]
        amplitude = 0.5 * np.ptp(angle)
        above = angle > 0.5 * (angle.max() + angle.min())
        rises = np.flatnonzero(~above[:-1] & above[1:])
        if rises.size >= 4 and amplitude > 1.2 * SPAN:
            turn = period * (rises[-1] - rises[0]) / (rises.size - 1)
            return 4.0 * swing / (np.pi * np.sqrt(amplitude**2 - SPAN**2)), turn
    raise AssertionError("no relay keeps the plate swinging")


def found(period: float) -> Ultimate:
    ecu = Ecu(period=period, resolution=0.0)
    loop = rigs.loop(ecu=ecu)
    result = experiment(Task(rigs.plant(loop), ecu, Requirements(), loop))
    assert isinstance(result, Ultimate)
    return result


@pytest.mark.slow
@pytest.mark.parametrize("period", [1e-3, 2e-3])
def test_the_ultimate_gain_is_that_of_the_generator(period: float) -> None:
    gain, turn = ultimate_by_relay(period)
    here = found(period)
    assert here.gain == pytest.approx(gain, rel=5e-3)
    assert here.period == pytest.approx(turn, rel=5e-3)


@pytest.mark.slow
def test_long_steps_would_be_far_off(monkeypatch: pytest.MonkeyPatch) -> None:
    gain, _ = ultimate_by_relay(1e-3)
    monkeypatch.setattr(experiments, "LONGEST_STEP", 5e-4)
    assert abs(found(1e-3).gain / gain - 1.0) > 0.04
