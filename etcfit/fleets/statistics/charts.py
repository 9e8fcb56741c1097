"""Control charts: whether a line is where it was, unit by unit in the order of date or serial.

    individuals: centre +- w sqrt(sd^2 + stderr_u^2)
    CUSUM: z_u = (x_u - centre) / sqrt(sd^2 + stderr_u^2),   high_u = max(0, high_u-1 + z_u - k),
           low_u = max(0, low_u-1 - z_u - k),   alarm where either exceeds h

sd is the short-term one, from neighbours: with the spread of all units a line that drifts would be judged by its own
drift. The centre is the median of the units, each weighed by what it is worth.

    median over u of (x_u+1 - x_u)^2 / (2 sd^2 + stderr_u^2 + stderr_u+1^2) = 0.4549

Average run length until a false alarm of the two-sided CUSUM, Siegmund 1985: with b = h + 1.166,
(exp(2 k b) - 2 k b - 1) / (4 k^2): 469 units at k = 0.5, h = 5.

Source: Montgomery, Introduction to Statistical Quality Control, 6th ed., secs. 6.4 and 9.1. Differs from source: limits
by unit, neighbours' median instead of the mean moving range, so that one odd unit widens nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from .scaled import MEDIAN_CHI2
from .settings import DEFAULT, ChartSettings


@dataclass(frozen=True, eq=False)
class Chart:
    """Of one symbol, N units in order, SI.

    Args:
        centre: weighed median.
        sd: short-term, between units, own uncertainty taken off.
        lower, upper: limits of each unit, shape (N,).
        outside: units beyond them, shape (N,).
        cusum_high, cusum_low: in standard deviations, shape (N,).
        decision: h.
        run_length: units until a false alarm of the CUSUM, on average.
        alarms: units at which a sum exceeds h, shape (N,).
    """

    centre: float
    sd: float
    lower: Float[np.ndarray, " N"]
    upper: Float[np.ndarray, " N"]
    outside: Bool[np.ndarray, " N"]
    cusum_high: Float[np.ndarray, " N"]
    cusum_low: Float[np.ndarray, " N"]
    decision: float
    run_length: float
    alarms: Bool[np.ndarray, " N"]


def chart(
    value: Float[np.ndarray, " N"], stderr: Float[np.ndarray, " N"], settings: ChartSettings = DEFAULT.charts
) -> Chart:
    """Units in order, all finite.

    Args:
        value: SI.
        stderr: of each unit's own, 0 where exact.
    Raises:
        ValueError: fewer than two units, or an entry that is not finite.
    """
    if len(value) < 2 or not (np.all(np.isfinite(value)) and np.all(np.isfinite(stderr))):
        raise ValueError("a chart needs two units or more, each with a finite value and standard error.")
    sd = short_term(value, stderr)
    width = np.sqrt(sd**2 + stderr**2)
    centre = weighed_median(value, 1.0 / np.maximum(width, 1e-150) ** 2)
    z = (value - centre) / np.maximum(width, 1e-150)
    high, low = _sums(z, settings.allowance), _sums(-z, settings.allowance)
    lower, upper = centre - settings.width * width, centre + settings.width * width
    alarms = (high > settings.decision) | (low > settings.decision)
    length = run_length(settings.allowance, settings.decision)
    outside = (value < lower) | (value > upper)
    return Chart(centre, sd, lower, upper, outside, high, low, settings.decision, length, alarms)


def short_term(value: Float[np.ndarray, " N"], stderr: Float[np.ndarray, " N"]) -> float:
    """Standard deviation between neighbours, their own uncertainty taken off; 0 where it explains all."""
    square, noise = np.diff(value) ** 2, stderr[1:] ** 2 + stderr[:-1] ** 2
    low, high = 0.0, 2.0 * float(np.max(np.abs(np.diff(value)))) + 1e-150
    if np.median(square) <= 0.0:
        return 0.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        under = np.median(square / (2.0 * middle**2 + noise)) > MEDIAN_CHI2
        low, high = (middle, high) if under else (low, middle)
    return 0.0 if high < 1e-12 * np.max(np.abs(np.diff(value))) else 0.5 * (low + high)


def weighed_median(value: Float[np.ndarray, " N"], weight: Float[np.ndarray, " N"]) -> float:
    """The value with half the weight on either side."""
    order = np.argsort(value)
    share = (np.cumsum(weight[order]) - 0.5 * weight[order]) / np.sum(weight)
    return float(np.interp(0.5, share, value[order]))


def run_length(k: float, h: float) -> float:
    """Units until a false alarm of the two-sided CUSUM, on average: see above."""
    b = 2.0 * k * (h + 1.166)
    return float((np.exp(b) - b - 1.0) / (4.0 * k**2))


def _sums(z: np.ndarray, k: float) -> np.ndarray:
    """max(0, previous + z - k) is the running sum less its lowest value so far."""
    total = np.concatenate([[0.0], np.cumsum(z - k)])
    return (total - np.minimum.accumulate(total))[1:]
