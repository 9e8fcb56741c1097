"""Evaluation of the residual: correlation, widening of intervals, and whether a channel fits."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from ..errors import first_names
from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from .settings import FitSettings

# ---- Are the residuals independent, and if not, by how much are the intervals too narrow?


LAGS = 12  # lags of the Ljung-Box test, samples; a trace shorter than 4 times as much is not tested
CORRELATED = 1e-4  # p-value of that test at or below which residuals are called correlated
EXCESS = 4.0  # standard errors by which the mean square must exceed 1 to count as larger than noise


class Widened(NamedTuple):
    """A covariance widened for residuals that are larger than their noise, or not independent."""

    covariance: np.ndarray  # never narrower than the one it was made from, shape (P, P)
    factor: np.ndarray  # factor by which each standard error grew, shape (P,)
    count: int  # number of pieces of the residual that made it grow


def autocorrelation(r: np.ndarray, lags: int) -> np.ndarray:
    """rho_1 ... rho_lags of a residual of shape (n,), shape (lags,); zeros where it is constant."""
    r = r - r.mean()
    # by FFT: callers need thousands of lags, and one product of vectors per lag would be a thousand times slower
    spectrum = np.fft.rfft(r, 2 * r.size)
    sums = np.fft.irfft(spectrum * np.conj(spectrum), 2 * r.size)[: lags + 1]
    return sums[1:] / sums[0] if sums[0] > 0.0 else np.zeros(lags)


def ljung_box(r: np.ndarray, lags: int = LAGS) -> float:
    """p-value of Q = n (n + 2) sum rho_k^2 / (n - k) (Ljung and Box 1978)."""
    n = r.size
    rho = autocorrelation(r, lags)
    q = n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    return float(chdtrc(lags, q))


def is_larger(r: np.ndarray) -> bool:
    """Whether a residual of shape (n,) is larger than its noise:  mean(r^2) - 1 > excess sqrt(2 / n)."""
    return bool(np.mean(r**2) - 1.0 > EXCESS * np.sqrt(2.0 / r.size))


def is_correlated(r: np.ndarray) -> bool:
    """Whether a residual of shape (n,) is not independent from sample to sample; False where n < 4 lags, too few."""
    return r.size >= 4 * LAGS and ljung_box(r, LAGS) <= CORRELATED


def inflation(r: np.ndarray) -> float:
    """Variance of a sum of residuals over that of independent standard normal ones.

        f = mean(r^2) (1 + 2 sum rho_k)

    The sum ends before the first rho that is not positive. The mean counts as 1 unless it is significantly larger, and
    the sum as 0 unless the residuals are significantly correlated.

    Source: Geyer 1992, Statistical Science 7(4), for the sum. Differs from source: it is cut by single lags, not pairs.
    """
    n = r.size
    if n < 4 * LAGS:
        return 1.0
    size = float(np.mean(r**2)) if is_larger(r) else 1.0
    if not is_correlated(r):
        return size
    rho = autocorrelation(r, n // 4)
    first = int(np.argmax(rho <= 0.0)) if np.any(rho <= 0.0) else rho.size
    return size * max(1.0, 1.0 + 2.0 * float(rho[:first].sum()))


def widen(covariance: np.ndarray, pieces: Sequence[tuple[np.ndarray, np.ndarray]]) -> Widened:
    """Covariance for residuals that are larger, or less independent, than assumed.

        C' = C (sum_s f_s J_s^T J_s) C + the prior's share of C

    Args:
        covariance: C, shape (P, P).
        pieces: for each channel of each trace its Jacobian (n, P) and residual (n,).
    """
    extra = np.zeros_like(covariance)
    count = 0
    for jacobian, r in pieces:
        f = inflation(r)
        if f > 1.0:
            extra += (f - 1.0) * jacobian.T @ jacobian
            count += 1
    wide = covariance + covariance @ extra @ covariance
    factor = np.sqrt(np.maximum(np.diag(wide), 1e-300) / np.maximum(np.diag(covariance), 1e-300))
    return Widened(wide, factor, count)


# ---- Whether a channel of a trace fits: ONE rule for the warnings of a fit, the lights of the interactive page, and
# verdicts.
#
#     fits      the whitened residual r is neither larger than its noise nor correlated (`is_correlated`),
#               and the free run is off by at most 3 sigma, rms
#     strays    r is noise, but the free run is further off
#     more      r is larger than its noise, or correlated
#     far       r is larger than its noise, and mean r^2 >= 2, where parameters become a compromise
#
# A trace, and a whole fit, has the verdict of its worst channel.

_FILES = 3  # largest number of files that a warning names
_WIDER = 1.05  # factor above which a wider interval is reported
STRAYS = 3.0  # largest free-running error of a channel that fits, in times its noise


class Left(StrEnum):
    """Verdicts on the residual of a channel, the best first."""

    FITS = "fits"
    STRAYS = "strays"
    MORE = "more"
    FAR = "far"


@dataclass(frozen=True)
class Goodness:
    """The residual of one channel of one trace."""

    # file, channel: the channel
    file: str
    channel: str
    left: Left  # verdict by the rule above
    rms: float  # rms of the whitened residual; 1 if it is noise, not finite if the model could not be simulated
    correlated: bool  # the whitened residual is not independent from sample to sample
    free: float  # free-running error, rms, over the noise of one sample

    @property
    def off(self) -> float:
        """The larger of both errors, in times the noise; infinite if the model could not be simulated."""
        return max(self.rms, self.free) if np.isfinite([self.rms, self.free]).all() else np.inf

    @property
    def says(self) -> str:
        """One sentence on the residual; "" if the channel fits."""
        name = self.channel.replace("_", " ")
        if self.left is Left.FITS:
            return ""
        if not np.isfinite(self.off):
            return f"The {name} could not be simulated."
        if self.left is Left.STRAYS:
            return (
                f"The {name} is noise from sample to sample, but the free run is {self.free:.3g} times the noise off: "
                "most often the instant of an edge of the input, between two samples, is not known well enough."
            )
        size = f"The residual of the {name} is {self.rms:.3g} times its noise (rms)"
        return f"{size} and not independent from sample to sample." if self.correlated else f"{size}."


def goodness_of(
    traces: Sequence[Trace],
    residuals: Sequence[np.ndarray],
    free_run: Iterable[PredictionError],
    settings: FitSettings = FitSettings(),
) -> tuple[Goodness, ...]:
    """Goodness of every channel of these traces.

    Args:
        residuals: whitened residuals, shape (n, M) each; for a model too far from the data to whiten, the free-running
            errors over the sensors' noise.
        free_run: errors of the free run of these traces, and possibly of others.
    """
    free = {(row.file, row.channel): row.rms / row.sigma for row in free_run}
    out = []
    for trace, r in zip(traces, residuals, strict=True):
        for m, channel in enumerate(trace.channels):
            own, file = np.asarray(r)[np.isfinite(trace.data[:, m]), m], trace.measurement.file
            out.append(_of_channel(file, channel, own, free.get((file, channel), np.nan), settings))
    return tuple(out)


def _of_channel(file: str, channel: str, r: np.ndarray, free: float, settings: FitSettings) -> Goodness:
    if not r.size or not np.isfinite(r).all() or not np.isfinite(free):
        return Goodness(file, channel, Left.FAR, np.nan, False, free)
    larger, correlated = is_larger(r), is_correlated(r)
    size = float(np.mean(r**2))
    left = Left.STRAYS if free > STRAYS else Left.FITS
    if larger or correlated:
        left = Left.FAR if larger and size >= settings.contradiction.compromise else Left.MORE
    return Goodness(file, channel, left, float(np.sqrt(size)), correlated, free)


def worst(found: Iterable[Goodness]) -> Goodness:
    """The worst channel: the worst verdict, and among equal verdicts the largest error."""
    return max(found, key=lambda each: (list(Left).index(each.left), each.off))


def _named(found: Sequence[Goodness]) -> str:
    """Their files, the one with the largest error first."""
    files = list(dict.fromkeys(each.file for each in sorted(found, key=lambda each: -each.rms)))
    return first_names(files, _FILES)


def warnings_of(found: Sequence[Goodness], widened: float) -> list[str]:
    """Warnings about the residuals of a fit.

    Args:
        found: goodness of every fitted channel.
        widened: largest factor by which they widened a standard error; below 1.05 it is not reported.
    """
    more = [each for each in found if each.left in (Left.MORE, Left.FAR)]
    strays = [each for each in found if each.left is Left.STRAYS]
    out = []
    if more:
        wider = f"Intervals are widened for it (up to {widened:.1f} times), but widening does not remove a bias"
        if widened < _WIDER:
            wider = "No interval becomes wider by 5 % for it, but there may still be a bias"
        out.append(
            f"{len(more)} of {len(found)} residuals are larger than their noise or not independent: the model lacks "
            f"something there. {wider}; look at {_named(more)} in the page of `etcfit report`."
        )
    if strays:
        most = max(strays, key=lambda each: each.free)
        verb = "is" if len(strays) == 1 else "are"
        out.append(
            f"{len(strays)} of {len(found)} residuals {verb} noise from sample to sample, but the free run strays, "
            f"by up to {most.free:.3g} times the noise ({most.channel} in {most.file}): most often the instant of an "
            "edge of the input, between two samples, is not known well enough."
        )
    return out
