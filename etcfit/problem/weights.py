"""Weights of samples: filters without dynamics, and noise that differs from the declared one.

`free_running` and `forgiving` make filters for `EstimationProblem.weighted` where the Kalman filter would mislead: far
from the data, what the model lacks is larger than all that the filter knows of. `timed`, `outliers_weighed` and
`discounted` give problems whose noise is what the residuals show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import erfcx

from .innovations import InnovationsFilter, plain
from .prediction_error import columns
from .problem import EstimationProblem
from .process_noise import order_of

_TELLING = 1e4  # sum of q^2 below which the jitter is not estimated
_USUAL_JITTER, _MOST_JITTER = 0.02, 0.3  # sample periods, rms
_OUTLIER = 5.0  # robust standard deviations beyond which a sample gets less weight


def free_running(problem: EstimationProblem) -> InnovationsFilter:
    """r = (y - y_hat) / sigma: least squares of the free run, each sample weighted by its own noise."""
    return plain(problem.slots, order_of(problem.layout.types))


def forgiving(problem: EstimationProblem, late: float = 0.0) -> InnovationsFilter:
    """r = (y - y_hat) / sqrt(sigma^2 + (d/2)^2), d the largest distance of a sample from its neighbours in time.

    A simulation that reaches a value a little early or late differs by about d, which this filter tolerates.

    Args:
        late: tolerated error of an instant, s; neighbours are at least one sample away.
    """
    slots = problem.slots
    bend = np.zeros_like(slots.sigma)
    for trace, (lane, _, marks) in zip(problem.batch.traces, problem.batch.places, strict=True):
        reach = max(1, round(late / float(np.median(np.diff(trace.instants)))))
        bend[marks, lane, : len(trace.channels)] = 0.5 * farthest(trace.data, reach)
    return plain(slots._replace(sigma=np.hypot(slots.sigma, bend)), order_of(problem.layout.types))


def farthest(data: Float[np.ndarray, "n M"], reach: int) -> Float[np.ndarray, "n M"]:
    """Distance of each sample, shape (n, M), from the one among its neighbours up to `reach` samples away that differs
    most, in the samples' unit; 0 for NaN."""
    seen = np.isfinite(data)
    high = _highest(np.where(seen, data, -np.inf), reach)
    low = -_highest(np.where(seen, -data, -np.inf), reach)
    return np.where(seen, np.maximum(high - data, data - low), 0.0)


def _highest(data: np.ndarray, reach: int) -> np.ndarray:
    """The maximum of each sample and its neighbours up to `reach` samples away, shape (n, M)."""
    count, width = data.shape[0], 2 * reach + 1
    highest = np.concatenate((np.repeat(data[:1], reach, axis=0), data, np.repeat(data[-1:], reach, axis=0)))
    seen = 1
    while 2 * seen <= width:  # twice as wide each time; two overlapping windows make any width
        highest = np.maximum(highest[:-seen], highest[seen:])
        seen *= 2
    return np.maximum(highest[:count], highest[width - seen : width - seen + count])


def timed(problem: EstimationProblem, x: Float[np.ndarray, " P"], r: Float[np.ndarray, "T L M"]) -> EstimationProblem:
    """The problem with the jitter of the sampling instants that its residuals show where samples change fast.

        a <- a + 1/2 (E[a'] - a),   p(a') ~ N(a'; a + sum q (r^2 - 1) / sum q^2, 2 / sum q^2) exp(-a' / 0.02^2), a' > 0,
        a = jitter^2,   q = (dy/dt dt)^2 / S

    One step of Fisher scoring for a component of variance leads to the centre of the normal distribution. The mean is
    taken, with a jitter of some 0.02 expected: often few samples change fast, the likeliest variance is then 0 as often
    as not, and intervals of L_a come out too narrow. The step is halved because the parameters follow; there is none if
    samples change too slowly.

    Args:
        x: coordinates, shape (P,).
        r: whitened residual at x, shape (T, L, M), dimensionless.
    """
    share = np.asarray(problem.filter_and_timing(x)[1])
    power = float(np.sum(share**2))
    if power < _TELLING:
        return problem
    excess = np.clip(r**2, 0.0, _OUTLIER**2) - (share > 0.0)
    likeliest = problem.jitter**2 + float(np.sum(share * excess)) / power
    error = np.sqrt(2.0 / power)
    centre = likeliest - (error / _USUAL_JITTER) ** 2
    mean = centre + error * np.sqrt(2.0 / np.pi) / erfcx(-centre / (np.sqrt(2.0) * error))
    return replace(problem, jitter=float(np.sqrt(np.clip(0.5 * (problem.jitter**2 + mean), 0.0, _MOST_JITTER**2))))


def outliers_weighed(
    problem: EstimationProblem, whitened: Sequence[Float[np.ndarray, "_ _"]]
) -> tuple[EstimationProblem, int]:
    """The problem with less weight for outliers, sigma <- sigma max(1, |r| / 5 s), s = max(1, 1.4826 median |r|) of a
    channel.

    Source: Huber 1981, Robust statistics, ch. 7. Differs from source: the weight 5 s / |r| multiplies r, not r^2: an
    outlier counts as if it were 5 s away.

    Args:
        problem: the data; its sigma starts from the declared one.
        whitened: residuals r of each trace, shape (n, M) each, dimensionless.
    Returns:
        The problem, and the number of samples with less weight.
    """
    sigma = problem.batch.slots.sigma.copy()
    count = 0
    for trace, (lane, _, marks), part in zip(problem.batch.traces, problem.batch.places, whitened, strict=True):
        spread = np.maximum(1.0, 1.4826 * np.median(np.abs(part), axis=0))
        excess = np.maximum(1.0, np.abs(part) / (_OUTLIER * spread))
        sigma[marks, lane, : len(trace.channels)] *= excess
        count += int(np.sum(excess > 1.0))
    return replace(problem, sigma=sigma), count


def discounted(problem: EstimationProblem, x: Float[np.ndarray, " P"]) -> EstimationProblem:
    """The problem with less weight for channels that the model cannot explain, so that they do not distort the others:

        sigma <- sigma max(1, rms((y - y_hat) / sigma)) of each channel of each trace, y_hat under the problem's guide

    Args:
        problem: the data; its sigma starts from the declared one.
        x: coordinates, shape (P,).
    """
    sigma = problem.batch.slots.sigma.copy()
    predicted = columns(problem.batch, problem.simulated(x, problem.guide_stiffness))
    for trace, (lane, row, marks), model in zip(problem.batch.traces, problem.batch.places, predicted, strict=True):
        rms = np.sqrt(np.nanmean((trace.data - model) ** 2, axis=0)) / trace.sigma
        sigma[row : marks[-1] + 1, lane, : len(trace.channels)] *= np.maximum(1.0, rms)
    return replace(problem, sigma=sigma)
