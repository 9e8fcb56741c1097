"""Local parabolas and zero-phase low-passes; SciPy has them too, but its import takes a second.

Smoothing and derivative by a parabola through the samples about each one:

    y(t + k step) ~ c_0 + c_1 k + c_2 k^2,   |k| <= window // 2,   least squares;   y ~ c_0,   dy/dt ~ c_1 / step

Source: Savitzky and Golay 1964 (Anal. Chem. 36), eq. 11. Differs from source: within half a window of an end the
parabola of the window at the end is evaluated off its middle. It is SciPy's `savgol_filter(y, window, 2)`.

Low passes without phase: a recursive filter of even order run forwards, then backwards.

    H(z) = g prod_k s_k (1 + z^-1)^2 / (1 - 2 Re p_k z^-1 + |p_k|^2 z^-2),    s_k: a constant passes each factor

The same numbers as `butter`, `cheby1` and `sosfiltfilt` of SciPy.
Source: analogue prototypes and bilinear transform, Oppenheim and Schafer, Discrete-Time Signal Processing, 3rd ed.,
ch. 7. Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_FADED = np.log(1e-16)  # of an impulse response


def smoothed(y: Float[np.ndarray, " n"], window: int) -> Float[np.ndarray, " n"]:
    """Smooth samples on an even grid.

    Args:
        y: n >= window samples.
        window: odd.
    """
    return _read_off(y, window, lambda c, k: c[0] + c[1] * k + c[2] * k**2)


def slope(y: Float[np.ndarray, " n"], window: int, step: float) -> Float[np.ndarray, " n"]:
    """dy/dt on an even grid; arguments as for `smoothed`, step in s."""
    return _read_off(y, window, lambda c, k: (c[1] + 2.0 * c[2] * k) / step)


def _read_off(
    y: np.ndarray, window: int, at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Float[np.ndarray, " n"]:
    """`at` of coefficients (3, ...) and places k: in the middle of each window, and at all places of the first and
    last."""
    half = window // 2
    k = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.vander(k, 3, increasing=True))
    middle = np.convolve(y, at(fit, np.zeros(1))[::-1], "valid")
    begin, end = fit @ y[:window], fit @ y[len(y) - window :]
    return np.concatenate([at(begin, k[:half]), middle, at(end, k[half + 1 :])])


@dataclass(frozen=True)
class LowPass:
    """A filter."""

    poles: tuple[complex, ...]  # p_k in the z plane, one of each conjugate pair
    gain: float = 1.0  # g, gain of a constant

    @property
    def pad(self) -> int:
        """Number of samples by which both ends are extended; more samples are needed for filtering."""
        return 3 * (2 * len(self.poles) + 1)

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Filter forwards, then backwards, along the first axis.

        Both ends are extended by their reflection through the end point.

        Raises:
            ValueError: n is not larger than pad.
        """
        pad = self.pad
        if len(x) <= pad:
            raise ValueError(f"more than {pad} samples are needed, and there are {len(x)}")
        longer = np.concatenate((2 * x[0] - x[pad:0:-1], x, 2 * x[-1] - x[-2 : -pad - 2 : -1]))
        memory = int(np.ceil(_FADED / np.log(max(map(abs, self.poles)))))  # samples after which an impulse has decayed
        size = 1 << (len(longer) + memory - 1).bit_length()  # so long that the circular convolution has no overlap
        z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)  # z^-1 at the frequencies of a real transform
        response = np.ones_like(z)  # H/g
        for pole in self.poles:
            a1, a2 = -2.0 * pole.real, abs(pole) ** 2
            response *= 0.25 * (1.0 + a1 + a2) * (1.0 + z) ** 2 / (1.0 + z * (a1 + a2 * z))

        def one_way(x: np.ndarray) -> np.ndarray:
            """y = x_0 + h * (x - x_0), shape (n,): samples before the first are assumed equal to it."""
            return x[0] + np.fft.irfft(response * np.fft.rfft(x - x[0], size), size)[: len(x)]

        forwards = np.apply_along_axis(one_way, 0, longer)
        return self.gain**2 * np.apply_along_axis(one_way, 0, forwards[::-1])[::-1][pad:-pad]


def butterworth(order: int, cutoff: float) -> LowPass:
    """Flat below the cutoff.

        s_k = Omega exp(j (pi/2 + pi (2 k + 1) / (2 n)))

    Args:
        order: n, even.
        cutoff: frequency of gain 1/sqrt(2), share of half the sampling rate.
    """
    return LowPass(_bilinear(1j * np.exp(1j * _angles(order)), cutoff))


def chebyshev(order: int, ripple: float, cutoff: float) -> LowPass:
    """Steeper, with ripples below the cutoff.

        s_k = -Omega sinh(asinh(1/e) / n + j theta_k),    e^2 = 10^(ripple/10) - 1

    Args:
        order: n, even.
        ripple: dB.
        cutoff: end of the ripples, share of half the sampling rate.
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
