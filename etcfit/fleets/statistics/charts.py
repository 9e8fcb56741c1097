"""Control charts and tests of drift: has a production line changed? Units are taken in the order of date or serial.

`study` calls it for every parameter of the units, `run_folder.fleet` writes what it returns.

    individuals: centre +- w sqrt(sd^2 + stderr_u^2)
    CUSUM: z_u = (x_u - centre) / sqrt(sd^2 + stderr_u^2),   high_u = max(0, high_u-1 + z_u - k),
           low_u = max(0, low_u-1 - z_u - k),   alarm where either exceeds h

sd is the short-term standard deviation, from neighbours: the spread of all units would grow with a drift and hide it.
The centre is the median of the units, each weighed by its precision.

    median over u of (x_u+1 - x_u)^2 / (2 sd^2 + stderr_u^2 + stderr_u+1^2) = 0.4549

Average run length until a false alarm of the two-sided CUSUM, Siegmund 1985: with b = h + 1.166,
(exp(2 k b) - 2 k b - 1) / (4 k^2): 469 units at k = 0.5, h = 5.

Source: Montgomery, Introduction to Statistical Quality Control, 6th ed., secs. 6.4 and 9.1. Differs from source: limits
by unit, neighbours' median instead of the mean moving range, so that one odd unit does not widen the limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy import stats

from ..settings import DEFAULT
from .population import holm
from .stack import sd_between

WIDTH = 3.0  # w: of the control limits, standard deviations on either side
ALLOWANCE = 0.5  # k of the CUSUM, standard deviations: half the shift that it is to find
DECISION = 5.0  # h of the CUSUM, standard deviations: with k = 0.5 a false alarm every 470 units
CLIP = 3.0  # standard deviations to which scores are clipped before a drift is sought: odd units are no drift
FEWEST = 8  # least number of units for which a drift is sought


@dataclass(frozen=True, eq=False)
class Chart:
    """The control chart of one parameter, N units in order, SI."""

    units: tuple[str, ...]  # their names
    # value, stderr: the units' own estimates and standard errors, shape (N,)
    value: Float[np.ndarray, " N"]
    stderr: Float[np.ndarray, " N"]
    centre: float  # centre line: the weighed median
    sd: float  # short-term standard deviation between units, without their own uncertainty
    # lower, upper: limits of each unit, shape (N,)
    lower: Float[np.ndarray, " N"]
    upper: Float[np.ndarray, " N"]
    # cusum_high, cusum_low: in standard deviations, shape (N,); an alarm where one exceeds `DECISION`
    cusum_high: Float[np.ndarray, " N"]
    cusum_low: Float[np.ndarray, " N"]


def chart(units: tuple[str, ...], value: Float[np.ndarray, " N"], stderr: Float[np.ndarray, " N"]) -> Chart:
    """The control chart of units in order, from their own values and standard errors (0 where exact), SI.

    Raises:
        ValueError: fewer than two units, or an entry that is not finite.
    """
    if len(value) < 2 or not (np.all(np.isfinite(value)) and np.all(np.isfinite(stderr))):
        raise ValueError("a chart needs two units or more, each with a finite value and standard error.")
    sd = short_term_sd(value, stderr)
    width = np.sqrt(sd**2 + stderr**2)
    centre = weighed_median(value, 1.0 / np.maximum(width, 1e-150) ** 2)
    z = (value - centre) / np.maximum(width, 1e-150)
    limits = centre - WIDTH * width, centre + WIDTH * width
    return Chart(units, value, stderr, centre, sd, *limits, _sums(z, ALLOWANCE), _sums(-z, ALLOWANCE))


def short_term_sd(value: Float[np.ndarray, " N"], stderr: Float[np.ndarray, " N"]) -> float:
    """Standard deviation between neighbours without their own uncertainty; 0 where that explains all differences."""
    return sd_between(0.5 * np.diff(value) ** 2, 0.5 * (stderr[1:] ** 2 + stderr[:-1] ** 2))


def weighed_median(value: Float[np.ndarray, " N"], weight: Float[np.ndarray, " N"]) -> float:
    """The value with half the weight on either side."""
    order = np.argsort(value)
    share = (np.cumsum(weight[order]) - 0.5 * weight[order]) / np.sum(weight)
    return float(np.interp(0.5, share, value[order]))


def run_length() -> float:
    """Average number of units until a false alarm of the two-sided CUSUM: see above."""
    b = 2.0 * ALLOWANCE * (DECISION + 1.166)
    return float((np.exp(b) - b - 1.0) / (4.0 * ALLOWANCE**2))


def _sums(z: np.ndarray, k: float) -> np.ndarray:
    """max(0, previous + z - k) is the running sum less its lowest value so far."""
    total = np.concatenate([[0.0], np.cumsum(z - k)])
    return (total - np.minimum.accumulate(total))[1:]


@dataclass(frozen=True)
class Drift:
    """A change of the line in one parameter."""

    symbol: str  # its name
    since: int  # place in the order of the first unit after the change; for a trend the first unit of all
    size: float  # SI: after less before; for a trend over all units
    size_sd: float  # the same in short-term standard deviations between units; infinite where units do not differ
    p: float  # p value of no change, for all symbols together
    kind: str  # "step" or "trend"


class _Change(NamedTuple):
    p: float
    since: int
    size: float
    kind: str


def drifts(
    series: Mapping[str, tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]], level: float = DEFAULT.drift_level
) -> tuple[Drift, ...]:
    """Test whether a line changed: by a step at one unit, or by a trend over all of them.

        step:  T_k^2 = (n - 2) B_k / (S - B_k) of the best k,   trend: t of the slope over the units' order

    on scores weighed by 1 / (sd^2 + stderr_u^2), S their sum of squares about the mean and B_k the part of it that two
    means explain. Scores are clipped to `CLIP` standard deviations: an odd unit is no drift. Without a change, the
    probability that the largest of all |T_k| is as large is that of an Ornstein-Uhlenbeck process to be as far out at
    any instant,

        P = 2 sum_k b phi(b) D_k nu(b sqrt(2 D_k)) + 2 Phi(-b),   D_k = n / (2 k (n - k)),   nu(x) = exp(-0.583 x)

    with b the normal score of T_k. A symbol's p is twice the smaller of both, then Holm over the symbols.

    Source: Siegmund 1985, Sequential Analysis, ch. IV, for nu; Csorgo and Horvath 1997, sec. 1.3. Differs from source:
    T is made normal through Student's t, so that few units do not raise false alarms.

    Args:
        series: value and standard error by symbol, SI, units in order; a unit without a finite value is skipped.
        level: p up to which a change is reported.
    Returns:
        surest first.
    """
    seen: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    for symbol, (value, stderr) in series.items():
        place = np.flatnonzero(np.isfinite(value) & np.isfinite(stderr))
        if len(place) >= FEWEST:
            seen[symbol] = place, value[place], stderr[place]
    if not seen:
        return ()
    changes = [_change(value, stderr) for _, value, stderr in seen.values()]
    out = []
    for (symbol, (place, value, stderr)), c, p in zip(
        seen.items(), changes, holm(np.array([c.p for c in changes])), strict=True
    ):
        sd = short_term_sd(value, stderr)
        if p <= level:
            far = c.size / sd if sd > 0.0 else float(np.copysign(np.inf, c.size))
            out.append(Drift(symbol, int(place[c.since]), c.size, far, float(p), c.kind))
    return tuple(sorted(out, key=lambda d: d.p))


def _change(value: np.ndarray, stderr: np.ndarray) -> _Change:
    """The likelier of step and trend."""
    rough = np.maximum(np.hypot(1.4826 * np.median(np.abs(value - np.median(value))), stderr), 1e-150)
    centre = weighed_median(value, rough**-2)
    width = np.maximum(np.hypot(short_term_sd(value, stderr), stderr), 1e-150)
    reach = CLIP * np.maximum(rough, width)
    x, w = np.clip(value - centre, -reach, reach), width**-2 / np.max(width**-2)
    x = x - np.sum(w * x) / np.sum(w)
    whole = float(np.sum(w * x**2))
    if whole <= 0.0:
        return _Change(1.0, 0, 0.0, "step")
    best = min(_step(x, w, whole), _trend(x, w, whole), key=lambda c: c.p)
    return best._replace(p=min(1.0, 2.0 * best.p))


def _step(x: np.ndarray, w: np.ndarray, whole: float) -> _Change:
    n = len(x)
    before, sums = np.cumsum(w)[:-1], np.cumsum(w * x)[:-1]
    after = np.sum(w) - before
    explained = sums**2 * (1.0 / before + 1.0 / after)
    # the best step, with at least two units on either side: one unit would be an odd unit
    k = 1 + int(np.argmax(explained[1:-1])) if n > 4 else int(np.argmax(explained))
    t = np.sqrt((n - 2) * explained[k] / max(whole - explained[k], 1e-14 * whole))
    b = float(stats.norm.isf(max(stats.t.sf(t, n - 2), 1e-300)))
    share = before / np.sum(w)
    gap = np.diff(0.5 * np.log(share / (1.0 - share)))
    rate = b * stats.norm.pdf(b) * np.sum(gap * np.exp(-0.583 * b * np.sqrt(2.0 * gap)))
    p = min(1.0, max(2.0 * rate, 0.0) + 2.0 * float(stats.norm.sf(b)))
    return _Change(p, k + 1, float(-sums[k] / after[k] - sums[k] / before[k]), "step")


def _trend(x: np.ndarray, w: np.ndarray, whole: float) -> _Change:
    n = len(x)
    order = np.arange(n) - np.sum(w * np.arange(n)) / np.sum(w)
    square = float(np.sum(w * order**2))
    slope = float(np.sum(w * order * x)) / square
    left = max(whole - slope**2 * square, 1e-14 * whole)
    t = abs(slope) * np.sqrt(square * (n - 2) / left)
    return _Change(max(2.0 * float(stats.t.sf(t, n - 2)), 1e-300), 0, slope * (n - 1), "trend")
