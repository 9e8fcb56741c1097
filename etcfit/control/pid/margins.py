"""Stability margins of the sampled loop, of many gains and plants at once.

    L(z) = C(z) G(z),    z = exp(j w T),    0 < w <= pi / T

C is what the ECU computes and G the plant under its hold, both exact; whether the closed loop is stable its spectral
radius says.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from ...model.ecu import Ecu
from ...model.linear import TransferFunction
from .gains import Gains
from .linear_loop import closed, controller
from .sampled_plant import SampledPlant, sampled


class Grid(NamedTuple):
    """Frequencies between which crossings are found, evenly spaced in the logarithm, the last at Nyquist's.

    Args:
        count: W.
        lowest: over Nyquist's.
    """

    count: int
    lowest: float

    def frequencies(self, period: float) -> Float[np.ndarray, " W"]:
        """w, rad/s, under a clock of a period (s)."""
        return np.pi / period * np.geomspace(self.lowest, 1.0, self.count)


FINE = Grid(1000, 1e-5)
COARSE = Grid(160, 1e-3)  # margins within 0.1 dB and 0.2 degrees of those of FINE


class Margins(NamedTuple):
    """How far loops are from where they turn unstable; below 0 where they are, infinite where nothing turns them.

    Args:
        gain_db: the smallest change of the gain, up or down, that brings the loop to -1.
        phase_deg: the smallest turn of the loop that does.
    """

    gain_db: Float[np.ndarray, "*loops"]
    phase_deg: Float[np.ndarray, "*loops"]


class OpenLoop(NamedTuple):
    """Plants under an ECU, prepared once for the margins of any gains.

    Args:
        plants: as its clock sees them, shape (...).
        response: G at each z, rad/V, shape (..., W).
        at_rest: G(1), rad/V, shape (...); infinite without a spring.
        z: on the unit circle, the last -1, shape (W,).
        ecu: the controller.
    """

    plants: SampledPlant
    response: Complex[np.ndarray, "*plants W"]
    at_rest: Float[np.ndarray, "*plants"]
    z: Complex[np.ndarray, " W"]
    ecu: Ecu

    @classmethod
    def of(cls, plants: TransferFunction, ecu: Ecu, grid: Grid = FINE) -> OpenLoop:
        """Of plants whose numbers have one shape."""
        z = np.exp(1j * grid.frequencies(ecu.period) * ecu.period)
        z[-1] = -1.0  # where every loop is real
        under, spring = sampled(plants, ecu), np.asarray(plants.a0, dtype=float)
        at_rest = np.divide(plants.b0, spring, out=np.full(spring.shape, np.inf), where=spring != 0.0)
        return cls(under, under(z), at_rest, z, ecu)

    def margins(self, gains: Gains) -> Margins:
        """Of gains of shape (...,) each, broadcast with the plants.

        Source: Astrom and Wittenmark 1997, section 3.5. Differs from source: the phase margin is of a turn either way.
        """
        loop = controller(gains, self.ecu, self.z) * self.response
        log, turn = np.log(np.abs(loop)), np.angle(-loop)
        sign = np.where(closed(gains, self.plants, self.ecu).spectral_radius < 1.0, 1.0, -1.0)
        gain = np.minimum(_gain_between(log, turn), np.minimum(*map(_gain_at, self._ends(gains, loop))))
        return Margins(sign * 20.0 / np.log(10.0) * gain, sign * np.degrees(_turn_between(log, turn)))

    def _ends(self, gains: Gains, loop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """L(1) and L(-1), both real."""
        still = np.where(np.asarray(gains.Ki) == 0.0, np.asarray(gains.Kp) * self.at_rest, np.inf)
        return still, np.real(loop[..., -1])


def margins(gains: Gains, plants: TransferFunction, ecu: Ecu, grid: Grid = FINE) -> Margins:
    """Margins of gains around plants, see `OpenLoop.margins`."""
    return OpenLoop.of(plants, ecu, grid).margins(gains)


def _gain_at(value: np.ndarray) -> np.ndarray:
    """|log -L| of a real L; infinite where L is not negative."""
    return np.where(value < 0.0, np.abs(np.log(np.where(value < 0.0, -value, 1.0))), np.inf)


def _gain_between(log: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Smallest |log |L|| where the loop passes the negative real axis, linear between frequencies."""
    share = _crossing(turn, np.abs(np.diff(turn, axis=-1)) < np.pi)
    return _least(np.abs(log[..., :-1] + share * np.diff(log, axis=-1)))


def _turn_between(log: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Smallest |angle of -L| (rad) where the loop passes the unit circle, linear between frequencies."""
    share = _crossing(log, np.ones(1, dtype=bool))
    return _least(np.abs(_wrapped(turn[..., :-1] + share * _wrapped(np.diff(turn, axis=-1)))))


def _crossing(value: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Where a value passes 0 either way between two frequencies that are near: the share of the way, else NaN."""
    first, then = value[..., :-1], value[..., 1:]
    passes = ((first > 0.0) != (then > 0.0)) & near
    return np.where(passes, first / np.where(passes, first - then, 1.0), np.nan)


def _least(value: np.ndarray) -> np.ndarray:
    """The smallest along the frequencies; infinite where all are NaN."""
    return np.min(np.where(np.isnan(value), np.inf, value), axis=-1)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """In -pi to pi, rad."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
