"""Are the residuals independent, and if not, by how much are the intervals too narrow?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from .settings import WhitenessSettings

LAGS = WhitenessSettings().lags


class Widened(NamedTuple):
    """A covariance that allows for residuals that are larger than their noise, or not independent.

    Args:
        covariance: never narrower than the one it was made from, shape (P, P).
        factor: by which each standard error grew, shape (P,).
        count: pieces of the residual that made it grow.
    """

    covariance: np.ndarray
    factor: np.ndarray
    count: int


def autocorrelation(r: np.ndarray, lags: int) -> np.ndarray:
    """rho_1 ... rho_lags of a residual of shape (n,), shape (lags,); zeros where it is constant."""
    r = r - r.mean()
    # by FFT: thousands of lags are asked for, and a product of vectors each would be slower by thousands
    spectrum = np.fft.rfft(r, 2 * r.size)
    sums = np.fft.irfft(spectrum * np.conj(spectrum), 2 * r.size)[: lags + 1]
    return sums[1:] / sums[0] if sums[0] > 0.0 else np.zeros(lags)


def ljung_box(r: np.ndarray, lags: int = LAGS) -> float:
    """p-value of Q = n (n + 2) sum rho_k^2 / (n - k) (Ljung and Box 1978)."""
    n = r.size
    rho = autocorrelation(r, lags)
    q = n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return float(chdtrc(lags, q))


def is_larger(r: np.ndarray, settings: WhitenessSettings = WhitenessSettings()) -> bool:
    """Whether a residual of shape (n,) is larger than its noise:  mean(r^2) - 1 > excess sqrt(2 / n)."""
    return bool(np.mean(r**2) - 1.0 > settings.excess * np.sqrt(2.0 / r.size))


def is_correlated(r: np.ndarray, settings: WhitenessSettings = WhitenessSettings()) -> bool:
    """Whether a residual of shape (n,) is not independent from sample to sample; False where n < 4 lags, too few."""
    return r.size >= 4 * settings.lags and ljung_box(r, settings.lags) <= settings.level


def inflation(r: np.ndarray, settings: WhitenessSettings = WhitenessSettings()) -> float:
    """Variance of a sum of residuals over that of independent standard normal ones.

        f = mean(r^2) (1 + 2 sum rho_k)

    The sum ends before the first rho that is not positive. The mean counts as 1 unless it is significantly larger, and
    the sum as 0 unless the residuals are significantly correlated.

    Source: Geyer 1992, Statistical Science 7(4), for the sum. Differs from source: it is cut by single lags, not pairs.
    Args:
        r: residual, shape (n,).
        settings: what is significant, and how many samples it takes to tell.
    """
    n = r.size
    if n < 4 * settings.lags:
        return 1.0
    size = float(np.mean(r**2)) if is_larger(r, settings) else 1.0
    if not is_correlated(r, settings):
        return size
    rho = autocorrelation(r, n // 4)
    first = int(np.argmax(rho <= 0.0)) if np.any(rho <= 0.0) else rho.size
    return size * max(1.0, 1.0 + 2.0 * float(rho[:first].sum()))


def widen(
    covariance: np.ndarray,
    pieces: Sequence[tuple[np.ndarray, np.ndarray]],
    settings: WhitenessSettings = WhitenessSettings(),
) -> Widened:
    """Covariance for residuals that are larger than, or not as independent as, assumed.

        C' = C (sum_s f_s J_s^T J_s) C + the prior's share of C

    Args:
        covariance: C, shape (P, P).
        pieces: for each channel of each trace its Jacobian (n, P) and residual (n,).
        settings: see `inflation`, which gives f_s.
    """
    extra = np.zeros_like(covariance)
    count = 0
    for jacobian, r in pieces:
        f = inflation(r, settings)
        if f > 1.0:
            extra += (f - 1.0) * jacobian.T @ jacobian
            count += 1
    wide = covariance + covariance @ extra @ covariance
    factor = np.sqrt(np.maximum(np.diag(wide), 1e-300) / np.maximum(np.diag(covariance), 1e-300))
    return Widened(wide, factor, count)
