"""The linear plant as an ECU's clock sees it: what its hold and any delay make of it, exactly, at each tick.

    x[k+1] = Phi x[k] + sum_j Gamma_j u[k-j],    y[k] = x_0[k]

with Phi = exp(A T), and Gamma_j the integral of exp(A (T - t)) B over the part of a tick in which u[k-j] acts.

Source: Astrom and Wittenmark 1997, Computer-Controlled Systems, section 2.3. Differs from source: delays of any number
of ticks share one form, so that plants of different delay stand side by side.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ...model.ecu import Ecu
from ...model.linear import TransferFunction

_QUICKEST = 1e-4  # ticks: the lag that a sensor without one is given beside plants whose sensor has one


class SampledPlant(NamedTuple):
    """See the module; its state is the output as the ECU reads it, what lags behind it, its derivatives by the tick.

    Args:
        phi: Phi, shape (..., n, n).
        gamma: Gamma_j, newest voltage first, shape (..., M, n).
        period: T, s.
    """

    phi: Float[np.ndarray, "*plants n n"]
    gamma: Float[np.ndarray, "*plants M n"]
    period: float

    def __call__(self, z: Complex[np.ndarray, " W"]) -> Complex[np.ndarray, "*plants W"]:
        """G(z) = e_0 (z - Phi)^-1 sum_j Gamma_j z^-j, rad/V."""
        states = self.phi.shape[-1]
        powers = z[:, None] ** -np.arange(self.gamma.shape[-2], dtype=float)
        driven = (powers @ self.gamma.astype(complex))[..., None]
        resolvent = z[:, None, None] * np.eye(states) - self.phi[..., None, :, :]
        return np.linalg.solve(resolvent, driven)[..., 0, 0]


def sampled(plants: TransferFunction, ecu: Ecu) -> SampledPlant:
    """The plants under a clock, a hold, the lags of sensor and ECU, and the delays of plant and ECU together.

    Args:
        plants: rad/V, numbers of one shape (...).
        ecu: its period, its delay and what filters its input.
    """
    flow = _flow(plants, ecu)
    late = np.asarray((plants.delay + ecu.delay) / ecu.period, dtype=float)
    late = np.where(np.abs(late - np.round(late)) < 1e-9, np.round(late), late)
    ticks = math.ceil(float(np.max(late))) + 1
    # voltage j acts in a tick from late - j to late - j + 1
    edges = np.clip(late[..., None] + 1.0 - np.arange(ticks + 1), 0.0, 1.0)
    remains = _exponential((1.0 - edges)[..., None, None] * flow[..., None, :, :])[..., :-1, -1]
    return SampledPlant(_exponential(flow)[..., :-1, :-1], np.diff(remains, axis=-2), ecu.period)


def _exponential(matrices: Float[np.ndarray, "*plants N N"]) -> Float[np.ndarray, "*plants N N"]:
    """exp of each matrix, all at once: exp(A) = (exp(A / 2^s))^(2^s), the inner one by its series.

    SciPy's takes them one by one, and BLAS wakes its threads for each.

    Source: Golub and Van Loan 2013, Matrix computations, 9.3.1. Differs from source: Taylor's series to the 16th power,
    enough to the last digit for a norm of 1/2.
    """
    norm = float(np.max(np.sum(np.abs(matrices), axis=-1), initial=0.0))
    halvings = max(0, math.ceil(math.log2(max(norm, 1e-300) / 0.5)))
    small, eye = matrices / 2.0**halvings, np.eye(matrices.shape[-1])
    total = np.broadcast_to(eye, matrices.shape)
    for k in range(16, 0, -1):
        total = eye + small @ total / k
    for _ in range(halvings):
        total = total @ total
    return total


def _flow(plants: TransferFunction, ecu: Ecu) -> Float[np.ndarray, "*plants N N"]:
    """((A, B), (0, 0)) with time in ticks; what lags comes first, the ECU's own filter before the sensor."""
    b0, a2, a1, a0, sensor, own, _ = np.broadcast_arrays(
        plants.b0, plants.a2, plants.a1, plants.a0, plants.lag, ecu.lag, np.asarray(plants.delay)
    )
    lags, period = [lag for lag in (own, sensor) if np.any(lag > 0.0)], ecu.period
    n = 3 + len(lags)
    flow = np.zeros((*b0.shape, n + 1, n + 1))
    flow[..., n - 3, n - 2] = flow[..., n - 2, n - 1] = 1.0
    flow[..., n - 1, n - 3 :] = np.stack((-a0 * period**3, -a1 * period**2, -a2 * period, b0 * period**3), axis=-1)
    for k, lag in enumerate(lags):
        quick = period / np.maximum(lag, _QUICKEST * period)
        flow[..., k, k], flow[..., k, k + 1] = -quick, quick
    return flow
