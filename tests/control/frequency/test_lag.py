"""The order of lag is found where the points tell it, and it is said where they do not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import control
from etcfit.control.frequency import lag
from etcfit.control.frequency.lag import Order, order_of
from etcfit.control.frequency.wave import Ratio
from etcfit.control.settings import FrequencySettings

PAPER = np.arange(0.5, 10.01, 0.5)  # Hz, the paper's Fig. 8
W = 2.0 * np.pi * 3.0  # rad/s
DELAY = 0.008
S: Any = control.tf("s")
PAIR = 1.0 / (1.0 + 2.0 * 0.5 * S / W + (S / W) ** 2)
LAGS: dict[int, Any] = {
    1: 1.05 / (1.0 + S / W),
    2: 1.05 * PAIR,
    3: 1.05 * PAIR / (1.0 + S / (2.5 * W)),
    4: 1.05 * PAIR / (1.0 + 2.0 * 0.8 * S / (2.5 * W) + (S / (2.5 * W)) ** 2),
}


def ratios(lag: Any, frequencies: np.ndarray, delay: float, sd: float, seed: int) -> list[Ratio]:
    """What sines would measure of it, with a relative error of this size and as much in the phase."""
    rng = np.random.default_rng(seed)
    s = 2j * np.pi * frequencies
    noise = np.exp(sd * (rng.standard_normal(s.size) + 1j * rng.standard_normal(s.size)))
    return [Ratio(complex(v), sd**2 * np.eye(2)) for v in lag(s) * np.exp(-delay * s) * noise]


def found(order: int, delay: float = 0.0, sd: float = 0.003, seed: int = 0, frequencies: np.ndarray = PAPER) -> Order:
    return order_of(frequencies, ratios(LAGS[order], frequencies, delay, sd, seed))


@pytest.mark.parametrize("delay", [0.0, DELAY])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_order_is_told(order: int, delay: float) -> None:
    answer = found(order, delay)
    assert answer.is_certain, answer.says
    assert answer.best is not None
    assert (answer.best.order, answer.best.delayed) == (order, delay > 0.0)
    assert answer.best.tau < 0.003


def test_gain_corner_damping_and_delay_lie_within_their_errors() -> None:
    truth = np.array([np.log(1.05), DELAY, np.log(W), 0.5, np.log(2.5 * W)])
    pulls = []
    for seed in range(4):
        best = found(3, DELAY, seed=seed).best
        assert best is not None
        if best.order == 3 and best.delayed:
            mine = [np.log(best.gain), best.delay, np.log(best.corners[0]), best.damping[0], np.log(best.corners[1])]
            pulls.append((np.array(mine) - truth) / best.stderr)
    assert len(pulls) >= 3
    assert np.all(np.abs(pulls) < 4.0)
    assert 0.4 < np.sqrt(np.mean(np.square(pulls))) < 1.7
    assert np.isfinite(pulls).all()


def test_a_true_lag_is_its_own_description() -> None:
    best = found(2, DELAY).best
    assert best is not None
    s = 2j * np.pi * PAPER
    assert np.max(np.abs(best(s) / (LAGS[2](s) * np.exp(-DELAY * s)) - 1.0)) < 0.005


def test_slow_sines_alone_cannot_tell() -> None:
    answer = found(2, frequencies=np.array([0.2, 0.3, 0.4, 0.5]), sd=0.01)
    assert not answer.is_certain
    assert "do not determine the order" in answer.says
    assert "Measure faster sines" in answer.says
    assert "4 frequencies from 0.2 to 0.5 Hz" in answer.says


def test_three_frequencies_are_too_few() -> None:
    answer = found(1, frequencies=np.array([1.0, 3.0, 9.0]))
    assert (answer.best, answer.is_certain) == (None, False)
    assert "3 frequencies do not determine" in answer.says


def test_what_is_no_lag_is_said_to_be_none() -> None:
    """A notch: no cascade of lags has one."""
    notch = (1.0 + 0.1 * S / W + (S / W) ** 2) / (1.0 + 2.0 * S / W + (S / W) ** 2)
    answer = order_of(PAPER, ratios(notch, PAPER, 0.0, 0.002, 0))
    assert not answer.is_certain
    assert "No lag up to fourth order" in answer.says


def test_a_model_error_keeps_small_intervals_from_telling_too_much() -> None:
    """Points a hundred times as far off as their intervals say: what is left is named, the order still found."""
    rough = [Ratio(r.value, 1e-4 * r.covariance) for r in ratios(LAGS[2], PAPER, 0.0, 0.02, 3)]
    answer = order_of(PAPER, rough)
    assert answer.best is not None
    assert answer.best.tau == pytest.approx(0.02, rel=0.4)
    assert answer.best.order == 2


def test_what_is_left_and_how_many_points_there_are_decide_when_an_order_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    points = ratios(LAGS[2], PAPER, 0.0, 0.003, 0)
    assert order_of(PAPER, points).is_certain
    assert not order_of(PAPER, points, FrequencySettings(poor=0.0)).is_certain
    monkeypatch.setattr(lag, "FEWEST_POINTS", 30)
    assert not order_of(PAPER, points).is_certain
