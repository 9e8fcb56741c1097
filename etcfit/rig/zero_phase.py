"""Low passes without phase: a recursive filter of even order run forwards, then backwards.

    H(z) = g prod_k s_k (1 + z^-1)^2 / (1 - 2 Re p_k z^-1 + |p_k|^2 z^-2),    s_k: a constant passes each factor

The same numbers as `butter`, `cheby1` and `sosfiltfilt` of SciPy, whose `scipy.signal` takes longer to import than a
folder to be read and judged.
Source: analogue prototypes and bilinear transform, Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed.,
ch. 7. Differs from source: no.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

_BLOCK = 128  # samples that are filtered by one product of matrices


@dataclass(frozen=True)
class LowPass:
    """A filter.

    Args:
        poles: p_k in the z plane, one of each conjugate pair.
        gain: g, by which it passes a constant.
    """

    poles: tuple[complex, ...]
    gain: float = 1.0

    @property
    def pad(self) -> int:
        """Samples by which both ends are continued; fewer cannot be filtered."""
        return 3 * (2 * len(self.poles) + 1)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Forwards, then backwards, along the first axis.

        Both ends are continued by their own reflection through the end point, and the filter begins at rest there.

        Args:
            x: shape (n, ...).
        Raises:
            ValueError: n is not larger than pad.
        """
        pad = self.pad
        if len(x) <= pad:
            raise ValueError(f"more than {pad} samples are needed, and there are {len(x)}")
        longer = np.concatenate((2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]))
        forwards = self._run(longer.reshape(len(longer), -1))
        both = self._run(forwards[::-1])[::-1]
        return self.gain**2 * both[pad:-pad].reshape(x.shape)

    def _run(self, x: np.ndarray) -> np.ndarray:
        for pole in self.poles:
            x = _section(pole, x)
        return x


def butterworth(order: int, cutoff: float) -> LowPass:
    """Flat below the cutoff.

        s_k = Omega exp(j (pi/2 + pi (2 k + 1) / (2 n)))

    Args:
        order: n, even.
        cutoff: where it passes 1/sqrt(2), in parts of half the sampling rate.
    """
    return LowPass(_bilinear(1j * np.exp(1j * _angles(order)), cutoff))


def chebyshev(order: int, ripple: float, cutoff: float) -> LowPass:
    """Steeper, with ripples below the cutoff.

        s_k = -Omega sinh(asinh(1/e) / n + j theta_k),    e^2 = 10^(ripple/10) - 1

    Args:
        order: n, even.
        ripple: dB.
        cutoff: where it leaves the ripples, in parts of half the sampling rate.
    """
    e = np.sqrt(10.0 ** (0.1 * ripple) - 1.0)
    theta = np.pi / 2 - _angles(order)
    return LowPass(_bilinear(-np.sinh(np.arcsinh(1.0 / e) / order + 1j * theta), cutoff), 1.0 / np.sqrt(1.0 + e**2))


def _angles(order: int) -> np.ndarray:
    """pi (2 k + 1) / (2 n) of the poles above the real axis, shape (n/2,)."""
    return np.pi * (2 * np.arange(order // 2) + 1) / (2 * order)


def _bilinear(prototype: np.ndarray, cutoff: float) -> tuple[complex, ...]:
    """p = (1 + s)/(1 - s), s = tan(pi cutoff / 2) times the pole of the filter whose cutoff is 1 rad/s."""
    s = np.tan(0.5 * np.pi * cutoff) * prototype
    return tuple(complex(p) for p in (1 + s) / (1 - s))


class _Block(NamedTuple):
    """A factor of H over a block, a row each: y = x within + z seen, z_after = x carried + z over."""

    within: np.ndarray
    seen: np.ndarray
    carried: np.ndarray
    over: np.ndarray
    rest: np.ndarray  # z at which a constant 1 is passed as it is


@lru_cache(maxsize=128)  # the same few filters meet every trace
def _block(pole: complex) -> _Block:
    """Of the recursion y_i = b_0 x_i + z_0, z' = A z + B x_i."""
    a1, a2 = -2.0 * pole.real, abs(pole) ** 2
    b0 = 0.25 * (1.0 + a1 + a2)
    step, enters = np.array([[-a1, 1.0], [-a2, 0.0]]), b0 * np.array([2.0 - a1, 1.0 - a2])
    powers = [np.eye(2)]
    for _ in range(_BLOCK):
        powers.append(step @ powers[-1])
    seen = np.array([power[0] for power in powers[:-1]])
    response = np.concatenate(([b0], seen[:-1] @ enters))
    lag = np.subtract.outer(np.arange(_BLOCK), np.arange(_BLOCK))
    carried = np.array([power @ enters for power in powers[-2::-1]]).T
    within = np.where(lag >= 0, response[lag], 0.0)
    return _Block(within.T, seen.T, carried.T, powers[-1].T, np.array([1.0 - b0, b0 - a2]))


def _section(pole: complex, x: np.ndarray) -> np.ndarray:
    """One factor of H, which was at rest at the first sample; shape (n, m)."""
    (n, m), block = x.shape, _block(pole)
    whole = np.concatenate((x, np.zeros((-n % _BLOCK, m)))).reshape(-1, _BLOCK, m)
    rows = whole.swapaxes(1, 2).reshape(-1, _BLOCK)  # a block of a signal each
    state, states = np.outer(x[0], block.rest), []
    for comes in (rows @ block.carried).reshape(-1, m, 2):
        states.append(state)
        state = state @ block.over + comes
    y = rows @ block.within + np.reshape(states, (-1, 2)) @ block.seen
    return y.reshape(-1, m, _BLOCK).swapaxes(1, 2).reshape(-1, m)[:n]
