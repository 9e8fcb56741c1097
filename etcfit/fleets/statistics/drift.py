"""Whether a line changed: by a step since one unit, or by a trend over all of them.

    step:  T_k^2 = (n - 2) B_k / (S - B_k) of the best k,   trend: t of the slope over the units' order

on scores weighed by 1 / (sd^2 + stderr_u^2), S their sum of squares about the mean and B_k what two means explain of
it. Scores beyond some standard deviations are clipped: an odd unit is no drift. The chance that the largest of all
|T_k| is as large without any change is that of an Ornstein-Uhlenbeck process to be as far out at any of its instants,

    P = 2 sum_k b phi(b) D_k nu(b sqrt(2 D_k)) + 2 Phi(-b),   D_k = n / (2 k (n - k)),   nu(x) = exp(-0.583 x)

with b the normal score of T_k. A symbol's p is twice the smaller of both, then Holm over the symbols.

Source: Siegmund 1985, Sequential Analysis, ch. IV, for nu; Csorgo and Horvath 1997, sec. 1.3. Differs from source: T is
made normal through Student's t, so that few units do not raise false alarms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import stats

from .charts import short_term, weighed_median
from .multiplicity import holm
from .settings import DEFAULT, ChartSettings


@dataclass(frozen=True)
class Drift:
    """Of one symbol.

    Args:
        symbol: its name.
        since: place in the order of the first unit after the change; of a trend the first unit of all.
        size: SI: after less before; of a trend over all units.
        size_sd: the same in short-term standard deviations between units; infinite where units do not differ.
        p: of no change, for all symbols at once.
        kind: "step" or "trend".
    """

    symbol: str
    since: int
    size: float
    size_sd: float
    p: float
    kind: str


@dataclass(frozen=True)
class _Change:
    since: int
    size: float
    p: float
    kind: str


def drifts(
    series: Mapping[str, tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]],
    settings: ChartSettings = DEFAULT.charts,
) -> tuple[Drift, ...]:
    """Those at the level of the settings, surest first.

    Args:
        series: value and standard error by symbol, SI, units in order; a place without a finite value is passed over.
        settings: level, clip, fewest units.
    """
    looked = {symbol: _seen(*both) for symbol, both in series.items()}
    looked = {symbol: each for symbol, each in looked.items() if len(each[0]) >= settings.fewest}
    if not looked:
        return ()
    changes = [_change(value, stderr, settings.clip) for _, value, stderr in looked.values()]
    sure = holm(np.array([c.p for c in changes]))
    out = []
    for (symbol, (place, value, stderr)), c, p in zip(looked.items(), changes, sure, strict=True):
        sd = short_term(value, stderr)
        if p <= settings.level:
            far = c.size / sd if sd > 0.0 else float(np.copysign(np.inf, c.size))
            out.append(Drift(symbol, int(place[c.since]), c.size, far, float(p), c.kind))
    return tuple(sorted(out, key=lambda d: d.p))


def _seen(value: np.ndarray, stderr: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    place = np.flatnonzero(np.isfinite(value) & np.isfinite(stderr))
    return place, value[place], stderr[place]


def _change(value: np.ndarray, stderr: np.ndarray, clip: float) -> _Change:
    """The likelier of step and trend."""
    rough = np.maximum(np.hypot(1.4826 * np.median(np.abs(value - np.median(value))), stderr), 1e-150)
    centre = weighed_median(value, rough**-2)
    width = np.maximum(np.hypot(short_term(value, stderr), stderr), 1e-150)
    reach = clip * np.maximum(rough, width)
    x, w = np.clip(value - centre, -reach, reach), width**-2 / np.max(width**-2)
    x = x - np.sum(w * x) / np.sum(w)
    whole = float(np.sum(w * x**2))
    if whole <= 0.0:
        return _Change(0, 0.0, 1.0, "step")
    step, trend = _step(x, w, whole), _trend(x, w, whole)
    best = min(step, trend, key=lambda c: c.p)
    return _Change(best.since, best.size, min(1.0, 2.0 * best.p), best.kind)


def _step(x: np.ndarray, w: np.ndarray, whole: float) -> _Change:
    n = len(x)
    before, sums = np.cumsum(w)[:-1], np.cumsum(w * x)[:-1]
    after = np.sum(w) - before
    explained = sums**2 * (1.0 / before + 1.0 / after)
    # the best step at all, and at least two units on either side: one is an odd unit
    k = 1 + int(np.argmax(explained[1:-1])) if n > 4 else int(np.argmax(explained))
    t = np.sqrt((n - 2) * explained[k] / max(whole - explained[k], 1e-14 * whole))
    b = float(stats.norm.isf(max(stats.t.sf(t, n - 2), 1e-300)))
    share = before / np.sum(w)
    gap = np.diff(0.5 * np.log(share / (1.0 - share)))
    rate = b * stats.norm.pdf(b) * np.sum(gap * np.exp(-0.583 * b * np.sqrt(2.0 * gap)))
    p = min(1.0, max(2.0 * rate, 0.0) + 2.0 * float(stats.norm.sf(b)))
    return _Change(k + 1, float(-sums[k] / after[k] - sums[k] / before[k]), p, "step")


def _trend(x: np.ndarray, w: np.ndarray, whole: float) -> _Change:
    n = len(x)
    order = np.arange(n) - np.sum(w * np.arange(n)) / np.sum(w)
    square = float(np.sum(w * order**2))
    slope = float(np.sum(w * order * x)) / square
    left = max(whole - slope**2 * square, 1e-14 * whole)
    t = abs(slope) * np.sqrt(square * (n - 2) / left)
    return _Change(0, slope * (n - 1), max(2.0 * float(stats.t.sf(t, n - 2)), 1e-300), "trend")
