"""Feed-forward: the voltage that holds each position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from ...model.linear import holding_against
from ...model.throttle import Throttle

POINTS = 8  # of a curve, where no ECU says
PLACES = 20_001  # angles from which they are chosen, where no ECU says
_HALVINGS = 24


@dataclass(frozen=True, eq=False)
class Bias:
    """bias(r): spring, preload and limp-home spring by a curve over the setpoint, linear between its points.

    Source: rusEFI, electronic_throttle.cpp (bias table over the target position). Differs from source: no.

    Args:
        angles: rad, rising, shape (P,).
        hold: V that hold the plate there in the middle of its dry friction, shape (P,).
        closing, opening: V at which it is about to close and to open, shape (P,): what its dry friction leaves open.
    """

    angles: np.ndarray
    hold: np.ndarray
    closing: np.ndarray
    opening: np.ndarray

    def volts(self, setpoint: np.ndarray) -> np.ndarray:
        """At setpoints (rad), shape (K,); V."""
        return np.interp(setpoint, self.angles, self.hold)


@jax.jit
def _holds(throttle: Throttle, angles: np.ndarray, share: float, gear_ratio: float, lower: float, upper: float):
    return jax.vmap(lambda theta: holding_against(throttle, theta, share, gear_ratio, lower, upper)[1])(angles)


class HoldingVoltages(NamedTuple):
    """Voltages that hold a plate at some angles, V, shape (K,) each.

    Args:
        down: at which it is about to close.
        middle: in the middle of its dry friction.
        up: at which it is about to open.
    """

    down: np.ndarray
    middle: np.ndarray
    up: np.ndarray


def hold_curve(
    throttle: Throttle, angles: np.ndarray, gear_ratio: float, lower: float, upper: float
) -> HoldingVoltages:
    """Voltages that hold a plate at these angles (rad), shape (K,), between stops (rad)."""
    down, middle, up = (np.asarray(_holds(throttle, np.asarray(angles), share, gear_ratio, lower, upper))
                        for share in (-1.0, 0.0, 1.0))  # fmt: skip
    return HoldingVoltages(down, middle, up)


def bias_of(
    throttle: Throttle, gear_ratio: float, lower: float, upper: float, points: int = POINTS, places: int = PLACES
) -> Bias:
    """The curve of so many points that misses the holding voltage least, wherever it misses it most.

    The points are chosen from so many places, evenly over the travel: as finely as an ECU's table can name them.

    The least miss is bisected: within one, each straight piece reaches as far as it can (`polygon`). So the points come
    to lie on the corners of the limp-home spring; what is left of them halves the longest pieces.
    """
    fine = np.linspace(lower, upper, places)
    down, middle, up = hold_curve(throttle, fine, gear_ratio, lower, upper)
    least, most = 0.0, float(np.ptp(middle)) + 1e-9
    for _ in range(_HALVINGS):
        within = 0.5 * (least + most)
        least, most = (least, within) if len(polygon(middle, within)) <= points else (within, most)
    chosen = polygon(middle, most)
    while len(chosen) < points:
        k = int(np.argmax(np.diff(chosen)))
        chosen.insert(k + 1, (chosen[k] + chosen[k + 1]) // 2)
    return Bias(fine[chosen], middle[chosen], down[chosen], up[chosen])


def polygon(curve: np.ndarray, within: float) -> list[int]:
    """Places on an evenly spaced curve, both ends among them, between which straight lines miss it by so much at most.

    Source: Imai and Iri 1986, Computer Vision, Graphics, and Image Processing 36 (the longest reach first). Differs
    from source: the miss is that of the value, and where it does not rise with the reach the latter may fall short.
    """
    places = [0]
    while places[-1] < curve.size - 1:
        reaches, fails = places[-1] + 1, curve.size
        while fails - reaches > 1:
            end = (reaches + fails) // 2
            reaches, fails = (end, fails) if _miss(curve[places[-1] : end + 1]) <= within else (reaches, end)
        places.append(reaches)
    return places


def _miss(piece: np.ndarray) -> float:
    """Of the straight line between the ends of a piece."""
    return float(np.max(np.abs(piece - np.linspace(piece[0], piece[-1], piece.size))))
