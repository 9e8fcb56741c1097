"""Whether a loop bears what its model misses: a plate whose gain is not the model's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from etcfit.control.borne import Borne, borne
from etcfit.control.pid import Gains
from etcfit.control.pid.linear_loop import margins
from etcfit.model.ecu import Ecu
from etcfit.model.linear import TransferFunction

PLANT = TransferFunction(1.7e5, 1200.0, 8.0e4, 1.2e5)  # rad/V: a throttle of 1 ms electrical time constant
ECU = Ecu(period=2e-3, supply=12.0)
GAINS = Gains(20.0, 60.0, 0.3)
TIME = np.arange(0.0, 20.0, 2e-3)


def moved(hertz: float) -> np.ndarray:
    """Motion up to a frequency, rad."""
    rng = np.random.default_rng(2)
    tones = np.arange(0.2, hertz, 0.2)
    return 0.02 * np.sin(2 * np.pi * np.outer(TIME, tones) + rng.uniform(0, 6.28, tones.size)).sum(axis=1)


def judged(share: float, hertz: float = 60.0, present: Gains | None = None, noise: float = 1e-4) -> Borne:
    predicted = moved(hertz)
    return borne([(TIME, (1.0 + share) * predicted, predicted)], noise, PLANT, ECU, GAINS, present)


def test_a_model_whose_gain_is_off_misses_that_share() -> None:
    found = judged(0.1)
    assert found.missed == pytest.approx(0.1, rel=0.05)
    assert found.enough
    assert judged(0.2).worst == pytest.approx(2.0 * found.worst, rel=0.05)


def test_what_is_not_borne_may_turn_the_loop_unstable() -> None:
    """At |Delta T| = 1 some plant within Delta has no margin left, and no other has less than 1/max|T|."""
    share = 1.0 / (judged(0.1).worst / 0.1)
    assert margins(GAINS, PLANT, ECU).gain_db > 20.0 * np.log10(1.0 + 0.99 * share)
    assert not judged(share).enough
    assert "quick steps" in judged(share).says


def test_rows_too_few_for_the_new_loop_ask_for_a_faster_log_and_for_no_more_motion() -> None:
    found, few = judged(0.01), moved(4.0)[::100]
    slow = borne([(TIME[::100], few, few)], 1e-4, PLANT, ECU, GAINS, None)
    assert slow.rows == pytest.approx(5.0)
    assert slow.crossover == found.crossover
    assert not slow.enough
    assert "5 rows a second" in slow.says
    assert f"log at {4.0 * slow.crossover:.0f} Hz" in slow.says


def test_a_slow_motion_does_not_tell() -> None:
    found = judged(0.01, hertz=0.5, noise=2e-3)
    assert not found.enough
    assert "no motion near" in found.says


def test_an_error_under_feedback_was_larger_without_it() -> None:
    assert judged(0.1, present=GAINS).missed != pytest.approx(judged(0.1).missed, rel=0.05)


def test_a_model_that_misses_no_more_than_noise_is_borne_and_says_so() -> None:
    found = judged(0.0)
    assert found.enough
    assert "the error of the model is below the sensor's noise" in replace(found, worst=0.0, missed=0.0).says
