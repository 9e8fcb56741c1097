"""Time of an event that was not logged, from the response after it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

SHARES = (0.0, 0.5, 1.0)  # places in the event's window at which it is simulated
_TRIED = np.linspace(-0.25, 1.25, 301)  # places at which the parabola through them is evaluated


def place(seen: Float[np.ndarray, " k"], paths: Sequence[Float[np.ndarray, " k"]], before: int) -> tuple[float, float]:
    """The place at which the parabola through three paths is nearest to the measurement, all in units of the noise, and
    its standard deviation. The measurement's level is a mean of `before` samples, whose error all samples share."""
    y0, y1, y2 = paths
    bend, slope = 2.0 * (y0 - 2.0 * y1 + y2), -3.0 * y0 + 4.0 * y1 - y2
    cost = np.sum((seen - y0 - np.outer(_TRIED, slope) - np.outer(_TRIED**2, bend)) ** 2, axis=1)
    best = int(np.argmin(cost))
    share = float(_TRIED[best])
    rate = slope + 2.0 * share * bend
    power, misfit = float(rate @ rate), max(1.0, float(cost[best]) / seen.size)
    if not power > 0.0:
        return share, np.inf
    return share, float(np.sqrt(misfit * (power + np.sum(rate) ** 2 / before)) / power)
