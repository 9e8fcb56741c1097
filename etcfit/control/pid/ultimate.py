"""The ultimate gain: the proportional gain at which a linear plant swings on for ever."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from ...model.linear import TransferFunction
from .base import Refusal

_SCAN = np.geomspace(1e-2, 1e5, 4000)  # rad/s


@dataclass(frozen=True)
class Ultimate:
    """Ultimate gain (V/rad) and period (s)."""

    gain: float
    period: float


def ultimate(plant: TransferFunction, late: float = 0.0) -> Ultimate | Refusal:
    """Where the phase of the plant first passes -180 degrees: K_u = 1/|G(j w_u)|, P_u = 2 pi / w_u.

    Without lag and delay w_u = sqrt(a1) and K_u = (a2 a1 - a0) / b0 (Routh).

    Args:
        plant: rad/V.
        late: further delay, of an ECU's hold say, s.
    """
    swing = np.unwrap(np.angle(plant.bare()(1j * _SCAN)))
    phase = swing - np.arctan(plant.lag * _SCAN) - (plant.delay + late) * _SCAN
    beyond = np.flatnonzero(phase < -math.pi)
    if beyond.size == 0 or beyond[0] == 0:
        return Refusal("the plant's phase never passes -180 degrees: it has no ultimate gain")

    def beyond_180(w: float) -> float:
        value = plant(1j * w) * np.exp(-1j * w * late)
        return float((np.angle(value) + 2.0 * math.pi) % (2.0 * math.pi) - math.pi)

    k = int(beyond[0])
    w = float(brentq(beyond_180, _SCAN[k - 1], _SCAN[k], xtol=1e-13, rtol=1e-14))  # type: ignore[arg-type]
    return Ultimate(1.0 / abs(complex(plant(1j * w))), 2.0 * math.pi / w)
