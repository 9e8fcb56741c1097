"""The way from the present gains to the proposed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import results
from etcfit.control import proposal
from etcfit.control.design import Design, ecu_of, task_of
from etcfit.control.pid import Gains
from etcfit.control.pid.linear_loop import Margins
from etcfit.control.proposal import HALF_WAY, PRESENT, PROPOSED, gain_steps, half_way, safe_half_way
from etcfit.estimation.fitted_model import Fitted


@pytest.fixture(scope="module")
def designed(fitted: Fitted) -> Design:
    task = task_of(fitted, ecu_of(fitted), settings=replace(results.BRIEF, draws=4))
    return results.proposed(fitted, task, "damping_optimum")


def test_half_way_is_the_same_factor_twice() -> None:
    half = half_way(Gains(2.0, 10.0, 0.0), Gains(8.0, 10.0, 0.4))
    assert half == pytest.approx(Gains(4.0, 10.0, 0.2))  # nothing has no factor: half of what is proposed


def test_each_step_is_tried_on_the_same_models(designed: Design) -> None:
    sluggish = Gains(*(0.1 * gain for gain in designed.proposed))
    present, half, proposed = gain_steps(designed, sluggish)
    assert [step.name for step in (present, half, proposed)] == [PRESENT, HALF_WAY, PROPOSED]
    assert present.figures.rmse_pct > half.figures.rmse_pct > proposed.figures.rmse_pct
    assert (present.better, half.better, proposed.better) == (None, 1.0, 1.0)
    assert proposed.gains == pytest.approx(designed.proposed)
    # the same gains on the same model and noise are the design's own figures
    quiet = replace(designed, task=replace(designed.task, ecu=designed.task.ecu._replace(noise=0.0)))
    assert gain_steps(quiet, None)[0].figures.rmse_pct == pytest.approx(designed.chosen.nonlinear.rmse_pct, rel=1e-6)  # pyright: ignore


def test_the_next_log_is_foretold_with_a_range(designed: Design) -> None:
    (step,) = gain_steps(designed, None)
    assert step.name == PROPOSED
    assert step.better is None
    low, middle, high = step.overshoot
    assert 0.0 <= low <= middle <= high
    assert step.time[0] < 0.0 < step.time[-1]
    assert step.position.shape == step.setpoint.shape == step.time.shape
    assert np.ptp(step.setpoint) == pytest.approx(0.6)


def test_a_half_way_step_of_small_margins_is_passed_over(designed: Design, monkeypatch: pytest.MonkeyPatch) -> None:
    """Margins by hand: those at 1/2 are the smallest of all, those at 0.65 are not."""
    gain = np.array([[6.0, 8.0, 2.0, 7.0, 7.0, 7.0, 7.0]])
    monkeypatch.setattr(proposal, "margins", lambda gains, plants, ecu: Margins(gain, 10.0 * gain))
    present = Gains(*(0.5 * each for each in designed.proposed))
    assert safe_half_way(designed, present) == pytest.approx(half_way(present, designed.proposed, 0.65))
