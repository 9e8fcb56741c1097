"""The order of lag of a measured frequency response, and whether the points determine it.

    H(s) = K exp(-s d) / prod_j (1 + 2 zeta_j s / w_j + s^2 / w_j^2) / (1 + s T),   order 1 to 4, with and without d

The factor 1 + s T is present where the order is odd. Each candidate is the one of highest likelihood,

    ln (H_k / H(i w_k)) = e_k,    cov (Re e_k, Im e_k) = C_k + tau^2 I,

with C_k the covariance of the measured points and tau, a further parameter, the part that the candidate does not
explain: a loop with friction is no lag of any order, and tau then limits the weight of its points.

    AICc = -2 ln L + 2 p + 2 p (p + 1) / (n - p - 1),    n = 2 x points,    weight ~ exp(-AICc / 2)

Source: Hurvich and Tsai 1989 (AICc); Burnham and Anderson 2002 (weights of models).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import approx_fprime, least_squares, minimize_scalar

from ..settings import FrequencySettings
from .wave import Ratio

HIGHEST = 4
FEWEST_POINTS = 4  # frequencies from which on an order of lag is sought
_STARTS = (0.3, 1.0, 3.0)  # starts of the time constants over that of the middle frequency
_TAU = (-14.0, 1.0)  # ln tau
_ROUGH = 0.1  # first value of tau
_ROUNDS = 20
_EVALUATIONS = 60
_SETTLED = 1e-3  # change of -2 ln L that ends the iteration
_VANISHED = -12.0  # logarithm of a time over that of the middle frequency (or of its square) below which it counts as 0
_ENDLESS = 60.0
_EXCLUDED = 0.05  # weight of all lower orders together below which they are excluded
_LIKELY = 0.5  # weight that the order itself must exceed; higher orders, which contain it, always keep some weight


@dataclass(frozen=True, eq=False)
class Lag:
    """One candidate at its optimum."""

    order: int  # 1 to 4
    delayed: bool  # with a pure delay
    gain: float  # K, in the unit of the response
    corners: tuple[float, ...]  # rad/s, of each factor of second order, then of that of first order
    damping: tuple[float, ...]  # zeta of each factor of second order
    delay: float  # s; 0 where it has none
    # standard errors of ln K, d, ln w and zeta of each factor of second order, ln w of the first; NaN if one vanished
    stderr: np.ndarray
    tau: float  # part that it does not explain, relative (and rad)
    aicc: float  # see the module's head

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Value at complex frequencies, 1/s."""
        out = self.gain * np.exp(-s * self.delay)
        for corner, zeta in zip(self.corners, self.damping, strict=False):
            out = out / (1.0 + 2.0 * zeta * s / corner + (s / corner) ** 2)
        return out / (1.0 + s / self.corners[-1]) if self.order % 2 else out


@dataclass(frozen=True, eq=False)
class Order:
    """The order of lag that the points show."""

    best: Lag | None  # the candidate of lowest AICc; None with too few points for any
    weights: dict[int, float]  # weight of each order, with or without delay; their sum is 1
    candidates: tuple[Lag, ...]  # all that were tried, best first
    highest: float  # frequency measured, rad/s
    says: str  # the result in a sentence
    settings: FrequencySettings = FrequencySettings()  # for `poor`

    @property
    def is_certain(self) -> bool:
        """Whether lower orders are excluded, higher ones are not needed, and every corner lies within the points."""
        best = self.best
        if best is None or best.tau >= self.settings.poor or max(best.corners) > self.highest:
            return False
        return _singled_out(best, self.weights)


def _singled_out(best: Lag, weights: Mapping[int, float]) -> bool:
    lower = sum(weight for order, weight in weights.items() if order < best.order)
    return lower < _EXCLUDED and weights[best.order] > _LIKELY


def order_of(
    frequencies: np.ndarray, ratios: Sequence[Ratio], settings: FrequencySettings = FrequencySettings()
) -> Order:
    """Choose the order of lag.

    Args:
        frequencies: Hz, shape (N,).
    """
    highest = float(2.0 * np.pi * np.max(frequencies, initial=0.0))
    if len(ratios) < FEWEST_POINTS:
        says = f"{len(ratios)} frequencies do not determine an order of lag: {FEWEST_POINTS} or more are needed."
        return Order(None, {}, (), highest, says, settings)
    problem = _Problem.of_ratios(frequencies, ratios)
    tried = (_best(problem, order, delayed) for order, delayed in product(range(1, HIGHEST + 1), (False, True)))
    candidates = tuple(sorted((lag for lag in tried if lag is not None), key=lambda lag: lag.aicc))
    share = np.exp(-0.5 * np.array([lag.aicc - candidates[0].aicc for lag in candidates]))
    share /= share.sum()
    weights = {order: float(sum(w for w, lag in zip(share, candidates, strict=True) if lag.order == order))
               for order in sorted({lag.order for lag in candidates})}  # fmt: skip
    says = _says(candidates[0], weights, problem, settings)
    return Order(candidates[0], weights, candidates, highest, says, settings)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Points in units of their middle frequency w0 (rad/s), with the eigenvectors and -values of their covariances."""

    w0: float
    s: np.ndarray
    log: np.ndarray  # ln magnitude + i phase
    axes: np.ndarray  # (N, 2, 2)
    variance: np.ndarray  # (N, 2)

    @classmethod
    def of_ratios(cls, frequencies: np.ndarray, ratios: Sequence[Ratio]) -> _Problem:
        w = 2.0 * np.pi * np.asarray(frequencies)
        w0 = float(np.exp(np.mean(np.log(w))))
        variance, axes = np.linalg.eigh(np.array([ratio.covariance for ratio in ratios]))
        values = np.array([ratio.value for ratio in ratios])
        return cls(w0, 1j * w / w0, np.log(values), axes, np.maximum(variance, 0.0))

    def errors(self, x: np.ndarray, order: int, delayed: bool) -> np.ndarray:
        """ln (H_k / H) along the axes of each covariance, shape (N, 2)."""
        departure = self.log - _Factors.of_logarithms(x, order, delayed).log_value(self.s)
        turned = np.angle(np.exp(1j * np.imag(departure)))
        return np.einsum("kji,kj->ki", self.axes, np.stack([np.real(departure), turned], axis=1))

    def slopes(self, x: np.ndarray, order: int, delayed: bool) -> np.ndarray:
        """Derivatives of the errors by x, shape (N, 2, P)."""
        columns = np.stack(_Factors.of_logarithms(x, order, delayed).log_slopes(self.s, order, delayed), axis=1)
        return -np.einsum("kji,kjp->kip", self.axes, np.stack([np.real(columns), np.imag(columns)], axis=1))


class _Factors(NamedTuple):
    """A candidate in units of the middle frequency: ln K, d, (b1, b2) of each 1 + b1 s + b2 s^2, T."""

    gain: float
    delay: float
    pairs: np.ndarray  # (order // 2, 2)
    last: float

    @classmethod
    def of_logarithms(cls, x: np.ndarray, order: int, delayed: bool) -> _Factors:
        """From ln K and the logarithms of the other numbers, in this order; a missing delay or odd factor is 0."""
        rest = np.exp(np.clip(x[1:], -_ENDLESS, _ENDLESS))
        pairs = rest[int(delayed) : int(delayed) + 2 * (order // 2)].reshape(-1, 2)
        return cls(x[0], rest[0] if delayed else 0.0, pairs, rest[-1] if order % 2 else 0.0)

    def log_value(self, s: np.ndarray) -> np.ndarray:
        """ln H, its phase unwrapped factor by factor."""
        out = self.gain - self.delay * s - np.log(1.0 + self.last * s)
        for b1, b2 in self.pairs:
            out = out - np.log(1.0 + b1 * s + b2 * s**2)
        return out

    def log_slopes(self, s: np.ndarray, order: int, delayed: bool) -> list[np.ndarray]:
        """Derivatives of ln H by the coordinates, shape (N,) each."""
        out = [np.ones(s.size, dtype=complex), *([-self.delay * s] if delayed else [])]
        for b1, b2 in self.pairs:
            factor = 1.0 + b1 * s + b2 * s**2
            out += [-b1 * s / factor, -b2 * s**2 / factor]
        return [*out, *([-self.last * s / (1.0 + self.last * s)] if order % 2 else [])]

    def corners(self) -> np.ndarray:
        """Corner of each factor, the one of first order last; nearly infinite where a factor has vanished."""
        return 1.0 / np.maximum(np.append(np.sqrt(self.pairs[:, 1]), self.last), 1e-12)

    def damping(self) -> np.ndarray:
        """zeta of each factor of second order."""
        return 0.5 * self.pairs[:, 0] / np.maximum(np.sqrt(self.pairs[:, 1]), 1e-12)


def _best(problem: _Problem, order: int, delayed: bool) -> Lag | None:
    """The candidate of highest likelihood; None where there are too few points for its parameters.

    Least squares at a rough tau from several starts; then, from the best one, tau and least squares alternately.
    """
    count, n = order + delayed + 1, 2 * problem.s.size
    p = count + 1  # including tau
    if n - p - 1 < 1:
        return None
    starts = (_start(problem, order, delayed, size) for size in _STARTS)
    x, tau = min((_squares(problem, x, _ROUGH, order, delayed) for x in starts), key=lambda fit: fit[1])[0], _ROUGH
    deviance = np.inf
    for _ in range(_ROUNDS):
        before = deviance
        tau, deviance = _tau(problem.errors(x, order, delayed) ** 2, problem.variance)
        if before - deviance < _SETTLED:
            break
        x = _squares(problem, x, tau, order, delayed)[0]
    aicc = deviance + 2.0 * p + 2.0 * p * (p + 1.0) / (n - p - 1.0)
    # the candidate in SI
    found = _Factors.of_logarithms(x, order, delayed)
    corners = problem.w0 * found.corners()[: (order + 1) // 2]
    stderr = _stderr(problem, x, tau, order, delayed)
    return Lag(order, delayed, float(np.exp(found.gain)), tuple(corners.tolist()), tuple(found.damping().tolist()),
               float(found.delay) / problem.w0, stderr, tau, aicc)  # fmt: skip


def _start(problem: _Problem, order: int, delayed: bool, size: float) -> np.ndarray:
    """Start with one time constant, damping 0.7; a second factor is twice as fast."""
    gain = float(np.real(problem.log[int(np.argmin(np.abs(problem.s)))]))
    pairs = [part for k in range(order // 2) for part in (1.4 * size / (k + 1.0), (size / (k + 1.0)) ** 2)]
    return np.array([gain, *np.log([*([0.1] if delayed else []), *pairs, *([size] if order % 2 else [])])])


def _squares(problem: _Problem, x: np.ndarray, tau: float, order: int, delayed: bool) -> tuple[np.ndarray, float]:
    """Least squares at a tau: coordinates, and half the sum."""
    sd = np.sqrt(problem.variance + tau**2)

    def errors(x: np.ndarray) -> np.ndarray:
        return (problem.errors(x, order, delayed) / sd).ravel()

    slopes: Any = partial(_whitened_slopes, problem, sd, order, delayed)
    fit = least_squares(errors, x, slopes, method="lm", max_nfev=_EVALUATIONS)
    return fit.x, float(fit.cost)


def _whitened_slopes(problem: _Problem, sd: np.ndarray, order: int, delayed: bool, x: np.ndarray) -> np.ndarray:
    return (problem.slopes(x, order, delayed) / sd[..., None]).reshape(sd.size, -1)


def _tau(squares: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """The likeliest tau at these errors, and -2 ln L there up to a constant."""

    def deviance(log_tau: float) -> float:
        whole = variance + np.exp(2.0 * log_tau)
        return float(np.sum(squares / whole + np.log(whole)))

    found: Any = minimize_scalar(deviance, bounds=_TAU, method="bounded")
    return float(np.exp(found.x)), float(found.fun)


def _stderr(problem: _Problem, x: np.ndarray, tau: float, order: int, delayed: bool) -> np.ndarray:
    """Standard errors by the delta method; NaN where a factor or the delay has vanished."""
    if np.any(x[1:] < _VANISHED):
        return np.full(2 + order, np.nan)
    sd = np.sqrt(problem.variance + tau**2)

    def shown(x: np.ndarray) -> np.ndarray:
        each = _Factors.of_logarithms(x, order, delayed)
        logs = np.log(each.corners())
        pairs = np.stack([logs[: order // 2], each.damping()], axis=1).ravel()
        return np.array([each.gain, each.delay / problem.w0, *pairs, *logs[order // 2 : (order + 1) // 2]])

    jacobian = _whitened_slopes(problem, sd, order, delayed, x)
    slopes = np.asarray(approx_fprime(x, shown))
    covariance = slopes @ np.linalg.pinv(jacobian.T @ jacobian) @ slopes.T
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


_NAMES = {1: "first", 2: "second", 3: "third", 4: "fourth"}


def _says(best: Lag, weights: dict[int, float], problem: _Problem, settings: FrequencySettings) -> str:
    """The result in a sentence, with the weights of the other orders."""
    bottom, top = (float(np.abs(edge)) * problem.w0 / (2.0 * np.pi) for edge in (problem.s[0], problem.s[-1]))
    name = f"a lag of {_NAMES[best.order]} order{' with a delay' if best.delayed else ''}"
    if best.tau >= settings.poor:
        return (f"No lag up to {_NAMES[HIGHEST]} order describes these points: the best, {name}, misses them by "
                f"{100.0 * best.tau:.0f} %.")  # fmt: skip
    ranked = ", ".join(f"{_NAMES[order]} {100.0 * weight:.0f} %" for order, weight in weights.items())
    span = f"{problem.s.size} frequencies from {bottom:.3g} to {top:.3g} Hz"
    left = f" It leaves {100.0 * best.tau:.2g} % unexplained." if best.tau > 1e-3 else ""
    fastest = max(best.corners) / (2.0 * np.pi)
    if not _singled_out(best, weights):
        return f"{span} do not determine the order of lag (weights: {ranked}). The best is {name}.{left}"
    if fastest > top:
        return (f"{span} do not determine the order of lag, only that it is at least the {_NAMES[best.order]}: the "
                f"fastest corner, {fastest:.3g} Hz, lies beyond them. Measure faster sines.{left}")  # fmt: skip
    return (f"{name[0].upper()}{name[1:]}: lower orders do not describe the points, higher orders are not needed "
            f"({ranked}; {span}).{left}")  # fmt: skip
