"""The ECU around the linear plant, tick by tick: no friction, no stops, and of the ECU what is linear.

It knows period, delay, derivative filter and the weights of the setpoint. Limits of the output, of its slew and of the
integral, the dead band, and the steps of converters are not linear: `ecu.tick` alone knows them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ...model.ecu import Ecu
from ...model.linear import TransferFunction
from .gains import Gains
from .sampled_plant import SampledPlant, sampled
from .setpoint import Setpoint

_RUNAWAY = 1e6  # a response beyond this many travels has gone


def controller(gains: Gains, ecu: Ecu, z: Complex[np.ndarray, " W"]) -> Complex[np.ndarray, "*gains W"]:
    """C(z) = Kp + Ki T z / (z - 1) + Kd (z - 1) / ((T_f + T) z - T_f), V/rad: what `ecu.tick` makes of -y.

    The setpoint's weights are not in it: they change how the setpoint enters the loop, not what goes round in it.

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

    The state s holds that of the plant, the voltages still on their way, the integral (V), the filtered derivative
    (rad/s) and what it last differenced, c r - y (rad).

    Args:
        flow: F, shape (..., S, S).
        entry: g, shape (..., S).
    """

    flow: Float[np.ndarray, "*loops S S"]
    entry: Float[np.ndarray, "*loops S"]

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
        plants: sampled by the ECU's clock.
        ecu: the controller.
    """
    p, i, d = (np.asarray(g, dtype=float)[..., None] for g in gains)
    n, late, T = plants.phi.shape[-1], plants.gamma.shape[-2] - 1, ecu.period
    size = n + late + 3
    # every signal is a row: its share of each state, and of the setpoint last
    state = np.eye(size + 1)[:size]
    setpoint, position = np.eye(size + 1)[size], state[0]
    error, tracked = setpoint - position, ecu.derivative_weight * setpoint - position
    integral = (i != 0.0) * state[-3] + i * T * error  # without a gain it holds nothing, and is no mode of the loop
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
    """Response in the setpoint's own unit at each tick, shape (K,); NaN once an unstable loop has gone.

    It starts at rest at the first value of the setpoint.
    """
    rest = setpoint.shares[0]
    change = setpoint.at(setpoint.instants(ecu.period)) - rest
    with np.errstate(all="ignore"):
        y = closed(gains, sampled(plant, ecu), ecu).respond(change)
    return rest + np.where(np.maximum.accumulate(np.abs(y)) < _RUNAWAY, y, np.nan)
