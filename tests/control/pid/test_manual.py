"""The manual procedure goes on until more gain no longer helps, and says so where it may not."""

from __future__ import annotations

import numpy as np
import pytest

import rigs
from etcfit.control.pid import Gains, Refusal, Requirements, Task
from etcfit.control.pid.manual import manual
from etcfit.control.pid.setpoint import trapezoid
from etcfit.control.settings import DesignSettings, ManualSettings
from etcfit.model.ecu import Ecu


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
    rmse = np.asarray(tried.loop.judged(Gains(every, none, none), trapezoid()).rmse_pct)[0]
    best = float(every[np.argmin(rmse)])
    assert best > 150.0
    assert 0.5 * best < found.Kp <= best
    at_found, at_120 = np.interp((float(found.Kp), 120.0), every, rmse)
    assert at_found < 1.15 * rmse.min() < 0.7 * at_120


def test_it_refuses_where_the_gains_tried_end_too_soon() -> None:
    refused = manual(task(ManualSettings(highest=(120.0, 5000.0, 3.0))))
    assert isinstance(refused, Refusal)
    assert "120 V/rad: raise highest" in refused.why
