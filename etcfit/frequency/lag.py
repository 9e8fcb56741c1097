"""The order of lag that a measured frequency response has, and whether it can tell it.

    H(s) = K exp(-s d) / prod_j (1 + 2 zeta_j s / w_j + s^2 / w_j^2) / (1 + s T),   order 1 to 4, with and without d

The factor 1 + s T is there where the order is odd. Each candidate is the one of highest likelihood,

    ln (H_k / H(i w_k)) = e_k,    cov (Re e_k, Im e_k) = C_k + tau^2 I,

with C_k the covariance of what was measured and tau what the candidate fails to explain, a parameter of its own: a loop
with friction is no lag of any order, and its points are then no more telling than tau lets them be.

    AICc = -2 ln L + 2 p + 2 p (p + 1) / (n - p - 1),    n = 2 x points,    weight ~ exp(-AICc / 2)

Source: Hurvich and Tsai 1989 (AICc); Burnham and Anderson 2002 (weights of models).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import approx_fprime, least_squares, minimize_scalar

from .wave import Ratio

HIGHEST = 4
FEWEST_POINTS = 4
SURE = 0.95  # weight from which on an order is told
_POOR = 0.1  # tau from which on the candidate is no description
_STARTS = (0.3, 1.0, 3.0)  # of its time constants over that of the middle frequency
_TAU = (-14.0, 1.0)  # ln tau
_ROUNDS = 12
_ON_BOUND = 1e-6


@dataclass(frozen=True, eq=False)
class Lag:
    """One candidate at its best.

    Args:
        order: 1 to 4.
        delayed: with a pure delay.
        gain: K, in the unit of the response.
        corners: rad/s, of each factor of second order, then of that of first order.
        damping: zeta of each factor of second order.
        delay: s; 0 where it has none.
        stderr: of (ln K, d, (ln w, zeta) for each factor of second order, ln w of the first); nan on a bound.
        tau: what it fails to explain, relative (and rad).
        aicc: see the module's head.
    """

    order: int
    delayed: bool
    gain: float
    corners: tuple[float, ...]
    damping: tuple[float, ...]
    delay: float
    stderr: np.ndarray
    tau: float
    aicc: float

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Value at complex frequencies, 1/s."""
        out = self.gain * np.exp(-s * self.delay)
        for corner, zeta in zip(self.corners, self.damping, strict=False):
            out = out / (1.0 + 2.0 * zeta * s / corner + (s / corner) ** 2)
        return out / (1.0 + s / self.corners[-1]) if self.order % 2 else out


@dataclass(frozen=True, eq=False)
class Order:
    """What the points say of the order.

    Args:
        best: the candidate of lowest AICc; None with too few points for any.
        weights: of each order, with or without delay, the sum being 1.
        candidates: all that were tried, best first.
        says: the answer in a sentence.
    """

    best: Lag | None
    weights: dict[int, float]
    candidates: tuple[Lag, ...]
    says: str

    @property
    def told(self) -> bool:
        """Whether these points tell the order."""
        return self.best is not None and self.weights[self.best.order] >= SURE and self.best.tau < _POOR


def order_of(frequencies: np.ndarray, ratios: Sequence[Ratio]) -> Order:
    """Choose the order of lag.

    Args:
        frequencies: Hz, shape (N,).
        ratios: the response at each.
    """
    if len(ratios) < FEWEST_POINTS:
        return Order(
            None, {}, (), f"{len(ratios)} frequencies cannot tell an order of lag: {FEWEST_POINTS} or more can."
        )
    problem = _Problem.of(frequencies, ratios)
    tried = (_best(problem, order, delayed) for order, delayed in product(range(1, HIGHEST + 1), (False, True)))
    candidates = tuple(sorted((lag for lag in tried if lag is not None), key=lambda lag: lag.aicc))
    share = np.exp(-0.5 * np.array([lag.aicc - candidates[0].aicc for lag in candidates]))
    share /= share.sum()
    weights = {order: float(sum(w for w, lag in zip(share, candidates, strict=True) if lag.order == order))
               for order in sorted({lag.order for lag in candidates})}  # fmt: skip
    return Order(candidates[0], weights, candidates, _says(candidates[0], weights, problem))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Points in units of their middle frequency w0 (rad/s), with the eigenvectors and -values of their covariances."""

    w0: float
    s: np.ndarray
    log: np.ndarray  # ln magnitude + i phase
    axes: np.ndarray  # (N, 2, 2)
    variance: np.ndarray  # (N, 2)

    @classmethod
    def of(cls, frequencies: np.ndarray, ratios: Sequence[Ratio]) -> _Problem:
        w = 2.0 * np.pi * np.asarray(frequencies)
        w0 = float(np.exp(np.mean(np.log(w))))
        variance, axes = np.linalg.eigh(np.array([ratio.covariance for ratio in ratios]))
        values = np.array([ratio.value for ratio in ratios])
        return cls(w0, 1j * w / w0, np.log(values), axes, np.maximum(variance, 0.0))

    def errors(self, x: np.ndarray, order: int, delayed: bool) -> np.ndarray:
        """ln (H_k / H) along the axes of each covariance, shape (N, 2)."""
        departure = self.log - _log_value(x, self.s, order, delayed)
        imag = np.angle(np.exp(1j * departure.imag))
        return np.einsum("kji,kj->ki", self.axes, np.stack([departure.real, imag], axis=1))


def _log_value(x: np.ndarray, s: np.ndarray, order: int, delayed: bool) -> np.ndarray:
    """ln H at x = (ln K, [d], (b1, b2) of each 1 + b1 s + b2 s^2, [T]); its phase unwrapped factor by factor."""
    out = x[0] - (x[1] * s if delayed else 0.0)
    first = 1 + delayed
    for k in range(order // 2):
        b1, b2 = x[first + 2 * k : first + 2 * k + 2]
        out = out - np.log(1.0 + b1 * s + b2 * s**2)
    return out - np.log(1.0 + x[-1] * s) if order % 2 else out


def _best(problem: _Problem, order: int, delayed: bool) -> Lag | None:
    """The candidate of highest likelihood; None where there are too few points for its parameters."""
    count, n = order + delayed + 1, 2 * problem.s.size
    p = count + 1  # and tau
    if n - p - 1 < 1:
        return None
    fits = (_likeliest(problem, _start(problem, order, delayed, size), order, delayed) for size in _STARTS)
    x, tau, deviance = min(fits, key=lambda fit: fit[2])
    aicc = deviance + 2.0 * p + 2.0 * p * (p + 1.0) / (n - p - 1.0)
    return _lag(problem, x, tau, aicc, order, delayed)


def _start(problem: _Problem, order: int, delayed: bool, size: float) -> np.ndarray:
    """All of one time constant, damped by 0.7; a second factor twice as fast."""
    gain = float(problem.log.real[int(np.argmin(np.abs(problem.s)))])
    pairs = [part for k in range(order // 2) for part in (1.4 * size / (k + 1.0), (size / (k + 1.0)) ** 2)]
    return np.array([gain, *([0.1] if delayed else []), *pairs, *([size] if order % 2 else [])])


def _likeliest(problem: _Problem, x: np.ndarray, order: int, delayed: bool) -> tuple[np.ndarray, float, float]:
    """Least squares at a tau, the likeliest tau at these errors, and so on; coordinates, tau, -2 ln L."""
    low = np.array([-np.inf, *([0.0] * (x.size - 1))])
    tau, deviance = 0.1, np.inf
    for _ in range(_ROUNDS):
        sd = np.sqrt(problem.variance + tau**2)
        x = least_squares(lambda x: (problem.errors(x, order, delayed) / sd).ravel(), x, bounds=(low, np.inf)).x  # noqa: B023
        squares = problem.errors(x, order, delayed) ** 2
        found = minimize_scalar(_deviance, bounds=_TAU, args=(squares, problem.variance), method="bounded")
        before, tau, deviance = deviance, float(np.exp(found.x)), float(found.fun)
        if before - deviance < 1e-4:
            break
    return x, tau, deviance


def _deviance(log_tau: float, squares: np.ndarray, variance: np.ndarray) -> float:
    """-2 ln L but for a constant."""
    whole = variance + np.exp(2.0 * log_tau)
    return float(np.sum(squares / whole + np.log(whole)))


def _lag(problem: _Problem, x: np.ndarray, tau: float, aicc: float, order: int, delayed: bool) -> Lag:
    w0, first = problem.w0, 1 + delayed
    pairs = x[first : first + 2 * (order // 2)].reshape(-1, 2)
    root = np.sqrt(np.maximum(pairs[:, 1], 1e-24))
    corners = [*(w0 / root).tolist(), *([w0 / max(float(x[-1]), 1e-12)] if order % 2 else [])]
    damping = (0.5 * pairs[:, 0] / root).tolist()
    stderr = _stderr(problem, x, tau, order, delayed)
    return Lag(order, delayed, float(np.exp(x[0])), tuple(corners), tuple(damping),
               float(x[1]) / w0 if delayed else 0.0, stderr, tau, aicc)  # fmt: skip


def _shown(x: np.ndarray, w0: float, order: int, delayed: bool) -> np.ndarray:
    """ln K, d, (ln w, zeta) of each second factor, ln w of the first."""
    first = 1 + delayed
    pairs = x[first : first + 2 * (order // 2)].reshape(-1, 2)
    root = np.sqrt(pairs[:, 1])
    inner = np.stack([np.log(w0 / root), 0.5 * pairs[:, 0] / root], axis=1).ravel()
    return np.array([x[0], x[1] / w0 if delayed else 0.0, *inner, *([np.log(w0 / x[-1])] if order % 2 else [])])


def _stderr(problem: _Problem, x: np.ndarray, tau: float, order: int, delayed: bool) -> np.ndarray:
    """By the delta method; nan where a parameter lies on its bound."""
    blank = np.full(2 + order, np.nan)
    if np.any(x[1:] < _ON_BOUND):
        return blank
    sd = np.sqrt(problem.variance + tau**2)
    jacobian = approx_fprime(x, lambda x: (problem.errors(x, order, delayed) / sd).ravel())
    shown = approx_fprime(x, lambda x: _shown(x, problem.w0, order, delayed))
    covariance = shown @ np.linalg.pinv(jacobian.T @ jacobian) @ shown.T
    return np.sqrt(np.diag(covariance))


_NAMES = {1: "first", 2: "second", 3: "third", 4: "fourth"}


def _says(best: Lag, weights: dict[int, float], problem: _Problem) -> str:
    """The answer, and what stands against it."""
    top, bottom = (float(np.abs(edge)) * problem.w0 / (2.0 * np.pi) for edge in (problem.s[-1], problem.s[0]))
    name = f"a lag of {_NAMES[best.order]} order{' with a delay' if best.delayed else ''}"
    ranked = ", ".join(f"{_NAMES[order]} {100.0 * weight:.0f} %" for order, weight in weights.items())
    span = f"{problem.s.size} frequencies from {bottom:.3g} to {top:.3g} Hz"
    if best.tau >= _POOR:
        return (f"No lag up to {_NAMES[HIGHEST]} order describes these points: the best, {name}, misses them by "
                f"{100.0 * best.tau:.0f} %.")  # fmt: skip
    left = f"; it leaves {100.0 * best.tau:.2g} % unexplained" if best.tau > 1e-3 else ""
    if weights[best.order] < SURE:
        return (f"{span} cannot tell the order of lag (weights: {ranked}). The best is {name}{left}. Faster sines, "
                "or more of them, would tell.")  # fmt: skip
    beyond = max(best.corners) / (2.0 * np.pi)
    far = f" Its fastest corner, {beyond:.3g} Hz, lies above the highest frequency." if beyond > top else ""
    return f"{name[0].upper()}{name[1:]} (weights: {ranked}; {span}){left}.{far}"
