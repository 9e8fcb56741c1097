"""Many p values at once, and scores whose null distribution is not quite the one in the book."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy import stats

LEAST = 1e-300  # a p value below is not told from it
MANY = 100  # scores without which a quantile of the tail is noise


def found(p: Float[np.ndarray, " N"], rate: float) -> Bool[np.ndarray, " N"]:
    """Reject all p <= p_(k), k the largest with p_(k) <= k rate / N.

    Source: Benjamini and Hochberg 1995 (JRSS B 57), eq. 1. Differs from source: no.

    Args:
        p: of N hypotheses.
        rate: false ones among those rejected, expected; the chance of any where all are true.
    """
    order = np.sort(p)
    under = np.flatnonzero(order <= rate * np.arange(1, len(p) + 1) / max(len(p), 1))
    return p <= order[under[-1]] if under.size else np.zeros(len(p), dtype=bool)


def adjusted(p: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """The least rate at which each would be rejected by `found`."""
    order = np.argsort(p)
    ratio = p[order] * len(p) / np.arange(1, len(p) + 1)
    out = np.empty(len(p))
    out[order] = np.minimum(1.0, np.minimum.accumulate(ratio[::-1])[::-1])
    return out


def holm(p: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """p values that hold for all N at once, under any dependence: Holm 1979."""
    order = np.argsort(p)
    out = np.empty(len(p))
    out[order] = np.minimum(1.0, np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)))
    return out


def null_scale(score: Float[np.ndarray, " N"], tail: float) -> float:
    """How much wider than N(0, 1) the scores of the ordinary units are, at least 1.

        max(1, median |z| / 0.6745, quantile_tail |z| / the normal's)

    Covariances of fits are not exact and errors have tails. Most units are ordinary, so the fleet's own middle says how
    scores are distributed where nothing is odd: the median for the scale, a higher quantile for the tail. Never below
    1: where the stated covariances are too wide, nothing is made odd by that.

    Source: Devlin and Roeder 1999 (genomic control); Efron 2004 (empirical null). Differs from source: the tail, and
    never below 1.

    Args:
        score: standard normal if all were as in the book, either sign; at least one.
        tail: quantile of |score|; used for 100 scores or more, as a few odd ones reach into that of a dozen.
    """
    size = np.abs(score)
    wide = float(np.median(size)) / stats.norm.ppf(0.75)
    if len(size) >= MANY:
        wide = max(wide, float(np.quantile(size, tail)) / stats.norm.ppf(0.5 + 0.5 * tail))
    return float(max(1.0, wide))
