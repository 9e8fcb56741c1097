"""Points on a circle of one turn: their mean, how far they lie apart, and by what chance they lie so close together.

    z = sum_k w_k exp(2 pi i p_k) / sum_k w_k,   mean = arg z / 2 pi,   spread = sqrt(-2 log |z|) / 2 pi

The phases of edges between two samples are such points: 0 and 1 are the same.
Source: Mardia and Jupp 2000, Directional Statistics, ch. 2 and 6. Differs from source: in turns, not radians.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class OnCircle(NamedTuple):
    """Where points lie.

    Args:
        mean: turns, from -0.5 to 0.5.
        length: of their mean vector: 1 where all are the same, 0 where they cancel.
    """

    mean: float
    length: float

    @property
    def spread(self) -> float:
        """Standard deviation about the mean, turns."""
        return float(np.sqrt(-2.0 * np.log(min(self.length, 1.0 - 1e-12))) / (2.0 * np.pi))


def on_circle(points: Float[np.ndarray, " n"], weights: Float[np.ndarray, " n"] | None = None) -> OnCircle:
    """Where points lie, turns; each counts as its weight, or all alike."""
    z = np.average(np.exp(2j * np.pi * points), weights=weights)
    return OnCircle(float(np.angle(z) / (2.0 * np.pi)), float(abs(z)))


def apart(points: Float[np.ndarray, " n"], mean: float) -> Float[np.ndarray, " n"]:
    """By how much points lie ahead of a mean, the shorter way round, turns."""
    return (points - mean + 0.5) % 1.0 - 0.5


def rayleigh_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = exp(-n |z|^2): that n points at random have a mean vector as long, for n of 5 or more (Rayleigh's test)."""
    return float(np.exp(-points.size * on_circle(points).length ** 2))


def arc_chance(points: Float[np.ndarray, " n"]) -> float:
    """P = n w^(n-1): that n points at random lie within an arc of w <= 1/2 turns (Stevens 1939)."""
    sorted_ = np.sort(points % 1.0)
    gaps = np.diff(sorted_, append=sorted_[0] + 1.0)
    w = 1.0 - float(gaps.max())
    return points.size * w ** (points.size - 1) if w <= 0.5 else 1.0
