"""The closed loop of the ECU and the linear plant, exact in discrete time: response and stability margins.

    x[k+1] = Phi x[k] + sum_j Gamma_j u[k-j],    y[k] = x_0[k]                       the plant under its hold and delay
    L(z) = C(z) G(z),    z = exp(j w T),    0 < w <= pi / T                          the open loop, for its margins

with Phi = exp(A T), and Gamma_j the integral of exp(A (T - t)) B over the part of a tick in which u[k-j] acts. Period,
delay, derivative filter and setpoint weights of the ECU are included. Limits of the output, of its slew and of the
integral, the dead band, and the steps of converters are not linear: only `ecu.tick` has them.

Source: Astrom and Wittenmark 1997, Computer-Controlled Systems, section 2.3. Differs from source: delays of any number
of ticks share one form, so that plants with different delays can be computed together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ...model.ecu import Ecu
from ...model.linear import TransferFunction
from ...model.pid import Gains
from ..setpoint import Setpoint

_QUICKEST = 1e-4  # ticks: substitute lag of a sensor without one, where other plants have a sensor lag


class SampledPlant(NamedTuple):
    """The plant of the module's equations; its state is the output as the ECU reads it, the lagged signals before it,
    and the derivatives by the tick."""

    phi: Float[np.ndarray, "*plants n n"]  # Phi
    gamma: Float[np.ndarray, "*plants M n"]  # Gamma_j, newest voltage first
    period: float  # T, s

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
    """exp of many matrices together: exp(A) = (exp(A / 2^s))^(2^s), the inner one by its series.

    SciPy's function computes them one by one, and BLAS starts its threads for each.

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
    """((A, B), (0, 0)) with time in ticks; the lags come first, that of the ECU's filter before that of the sensor."""
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


_RUNAWAY = 1e6  # travels beyond which a response counts as diverged


def controller(gains: Gains, ecu: Ecu, z: Complex[np.ndarray, " W"]) -> Complex[np.ndarray, "*gains W"]:
    """C(z) = Kp + Ki T z / (z - 1) + Kd (z - 1) / ((T_f + T) z - T_f), V/rad: the response of `model.pid.tick` to -y.

    The setpoint weights are not included: they change how the setpoint enters the loop, not the loop itself.

    Args:
        gains: shape (...,) each.
        ecu: its period T and the time constant T_f of its derivative's filter.
        z: not 1.
    """
    p, i, d = (np.asarray(g, dtype=float)[..., None] for g in gains)
    T, Tf = ecu.period, ecu.filter
    return p + i * T * z / (z - 1.0) + d * (z - 1.0) / ((Tf + T) * z - Tf)


class ClosedLoop(NamedTuple):
    """s[k+1] = F s[k] + g r[k],    y[k] = s_0[k].

    The state s contains that of the plant, the delayed voltages, the integral (V), the filtered derivative (rad/s) and
    its last input, c r - y (rad).
    """

    flow: Float[np.ndarray, "*loops S S"]  # F
    entry: Float[np.ndarray, "*loops S"]  # g

    @property
    def spectral_radius(self) -> Float[np.ndarray, "*loops"]:
        """max |eigenvalue of F|: the loop is stable below 1."""
        return np.max(np.abs(np.linalg.eigvals(self.flow)), axis=-1)

    def respond(self, setpoint: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
        """Output at each tick of one loop that begins at rest at 0."""
        state, y = np.zeros(self.entry.shape[-1]), np.empty(setpoint.size)
        for k, wanted in enumerate(setpoint):
            y[k] = state[0]
            state = self.flow @ state + self.entry * wanted
        return y


def closed(gains: Gains, plants: SampledPlant, ecu: Ecu) -> ClosedLoop:
    """The loop of each gains around each plant.

    Args:
        gains: shape (...,) each, broadcast with the plants.
    """
    p, i, d = (np.asarray(g, dtype=float)[..., None] for g in gains)
    n, late, T = plants.phi.shape[-1], plants.gamma.shape[-2] - 1, ecu.period
    size = n + late + 3
    # every signal is a row: its coefficient of each state, and of the setpoint last
    state = np.eye(size + 1)[:size]
    setpoint, position = np.eye(size + 1)[size], state[0]
    error, tracked = setpoint - position, ecu.derivative_weight * setpoint - position
    integral = (i != 0.0) * state[-3] + i * T * error  # without a gain it is 0, and is no mode of the loop
    derivative = (ecu.filter * state[-2] + tracked - state[-1]) / (ecu.filter + T)
    volts = p * (ecu.setpoint_weight * setpoint - position) + integral + d * derivative
    rows = np.zeros((*np.broadcast_shapes(volts.shape[:-1], plants.phi.shape[:-2]), size, size + 1))
    rows[..., :n, :n] = plants.phi
    rows[..., :n, n : n + late] = np.swapaxes(plants.gamma[..., 1:, :], -1, -2)
    rows[..., :n, :] += plants.gamma[..., 0, :, None] * volts[..., None, :]
    if late:
        rows[..., n, :] = volts
        rows[..., n + 1 : n + late, :] = state[n : n + late - 1]
    rows[..., -3, :], rows[..., -2, :], rows[..., -1, :] = integral, derivative, tracked
    return ClosedLoop(rows[..., :size], rows[..., size])


def respond(plant: TransferFunction, gains: Gains, ecu: Ecu, setpoint: Setpoint) -> np.ndarray:
    """Response in the setpoint's own unit at each tick, shape (K,); NaN after an unstable loop has diverged.

    It starts at rest at the first value of the setpoint.
    """
    rest = setpoint.shares[0]
    change = setpoint.at(setpoint.instants(ecu.period)) - rest
    with np.errstate(all="ignore"):
        y = closed(gains, sampled(plant, ecu), ecu).respond(change)
    return rest + np.where(np.maximum.accumulate(np.abs(y)) < _RUNAWAY, y, np.nan)


class Grid(NamedTuple):
    """Frequencies between which crossings are found, evenly spaced in the logarithm; the last is Nyquist's."""

    count: int  # W
    lowest: float  # over Nyquist's

    def frequencies(self, period: float) -> Float[np.ndarray, " W"]:
        """w, rad/s, under a clock of a period (s)."""
        return np.pi / period * np.geomspace(self.lowest, 1.0, self.count)


FINE = Grid(1000, 1e-5)
COARSE = Grid(160, 1e-3)  # margins within 0.1 dB and 0.2 degrees of those of FINE


class Margins(NamedTuple):
    """Stability margins of loops; below 0 where a loop is unstable, infinite where no change makes it unstable."""

    gain_db: Float[np.ndarray, "*loops"]  # smallest change of the gain, up or down, that brings the loop to -1
    phase_deg: Float[np.ndarray, "*loops"]  # smallest rotation of the loop that does


class OpenLoop(NamedTuple):
    """Plants under an ECU, prepared for the margins of any gains."""

    plants: SampledPlant  # in discrete time, shape (...)
    response: Complex[np.ndarray, "*plants W"]  # G at each z, rad/V
    at_rest: Float[np.ndarray, "*plants"]  # G(1), rad/V; infinite without a spring
    z: Complex[np.ndarray, " W"]  # on the unit circle, the last -1
    ecu: Ecu  # the controller

    @classmethod
    def of_plants(cls, plants: TransferFunction, ecu: Ecu, grid: Grid = FINE) -> OpenLoop:
        """Prepare plants whose numbers have one shape."""
        z = np.exp(1j * grid.frequencies(ecu.period) * ecu.period)
        z[-1] = -1.0  # where every loop is real
        under, spring = sampled(plants, ecu), np.asarray(plants.a0, dtype=float)
        at_rest = np.divide(plants.b0, spring, out=np.full(spring.shape, np.inf), where=spring != 0.0)
        return cls(under, under(z), at_rest, z, ecu)

    def margins(self, gains: Gains) -> Margins:
        """Margins of gains of shape (...,) each, broadcast with the plants.

        Source: Astrom and Wittenmark 1997, section 3.5. Differs from source: the phase margin is for either direction.
        """
        loop = controller(gains, self.ecu, self.z) * self.response
        log, turn = np.log(np.abs(loop)), np.angle(-loop)
        sign = np.where(closed(gains, self.plants, self.ecu).spectral_radius < 1.0, 1.0, -1.0)
        # the gain: smallest |log |L|| where the loop passes the negative real axis, and at its real ends L(1) and L(-1)
        passes = _changes_sign(turn) & (np.abs(np.diff(turn, axis=-1)) < np.pi)
        between = _least(passes, np.abs(_at_zero(_ends(turn, passes), *_ends(log, passes))))
        still = np.where(np.asarray(gains.Ki) == 0.0, np.asarray(gains.Kp) * self.at_rest, np.inf)
        gain = np.minimum(between, np.minimum(_gain_at(still), _gain_at(np.real(loop[..., -1]))))
        # the phase: smallest |angle of -L| where it passes the unit circle
        passes = _changes_sign(log)
        first, then = _ends(turn, passes)
        angle = _at_zero(_ends(log, passes), first, first + _wrapped(then - first))
        phase = _least(passes, np.abs(_wrapped(angle)))
        return Margins(sign * 20.0 / np.log(10.0) * gain, sign * np.degrees(phase))


def margins(gains: Gains, plants: TransferFunction, ecu: Ecu, grid: Grid = FINE) -> Margins:
    """Margins of gains around plants, see `OpenLoop.margins`."""
    return OpenLoop.of_plants(plants, ecu, grid).margins(gains)


def _gain_at(value: np.ndarray) -> np.ndarray:
    """|log -L| of a real L; infinite where L is not negative."""
    return np.where(value < 0.0, np.abs(np.log(np.where(value < 0.0, -value, 1.0))), np.inf)


def _changes_sign(value: np.ndarray) -> np.ndarray:
    """Whether a value crosses 0 between adjacent frequencies, shape (..., W - 1)."""
    above = value > 0.0
    return above[..., :-1] != above[..., 1:]


def _ends(value: np.ndarray, passes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A value at both ends of the intervals that are chosen, shape (N,) each."""
    return value[..., :-1][passes], value[..., 1:][passes]


def _at_zero(crossing: tuple[np.ndarray, np.ndarray], first: np.ndarray, then: np.ndarray) -> np.ndarray:
    """Another value where one crosses 0, from their values at both ends of intervals."""
    share = crossing[0] / (crossing[0] - crossing[1])
    return first + share * (then - first)


def _least(passes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The smallest of the values of the chosen intervals, along the frequencies; infinite where none is chosen."""
    every = np.full(passes.shape, np.inf)
    every[passes] = np.where(np.isnan(values), np.inf, values)
    return np.min(every, axis=-1)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """An angle brought into -pi to pi, rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
