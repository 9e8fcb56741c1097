"""Parameters of a model that is far from its data, or of tests that contradict each other: the range that subsets give.

    [min, max] over the fits to all tests but one of x_g -+ 1.96 sd_g, and over what one test alone says, x_g

Only subsets that know a parameter speak of it; the interval stated for all the data is always inside. It is no
statistical interval: errors that all tests share, a wrong angle scale say, move every subset alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .settings import FitSettings

Z_95 = 1.96  # half width of a 95 % interval, standard deviations


@dataclass(frozen=True, eq=False)
class Compromise:
    """What subsets of the data give.

    Args:
        why: in words.
        without: tests left out, G.
        points: coordinates of the fits without them, shape (G, P).
        covariances: of those coordinates, shape (G, P, P).
        alone: coordinates by one test alone, in one linearised step, NaN where it does not know them, shape (S, P).
    """

    why: str
    without: tuple[str, ...]
    points: np.ndarray
    covariances: np.ndarray
    alone: np.ndarray

    def ends(self, half: float, low: np.ndarray, high: np.ndarray, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Range of each coordinate, shape (P,) each.

        Args:
            half: half width of an interval, standard deviations.
            low, high: the interval stated for all the data, shape (P,).
            most: standard deviation above which a subset does not know a coordinate, shape (P,).
        """
        sd = np.sqrt(np.maximum(np.diagonal(self.covariances, axis1=1, axis2=2), 0.0))
        told = sd < most
        lows = np.where(told, self.points - half * sd, np.inf)
        highs = np.where(told, self.points + half * sd, -np.inf)
        alone = np.where(np.isnan(self.alone), np.inf, self.alone), np.where(np.isnan(self.alone), -np.inf, self.alone)
        return (np.min(np.vstack((low, lows, alone[0])), axis=0), np.max(np.vstack((high, highs, alone[1])), axis=0))

    def covariance(self, half: float, stated: np.ndarray, x: np.ndarray, most: np.ndarray) -> np.ndarray:
        """The covariance whose intervals reach as far as the ranges, correlations kept, shape (P, P).

        Args:
            half: half width of an interval, standard deviations.
            stated: covariance for all the data, shape (P, P).
            x: coordinates, shape (P,).
            most: as in `ends`.
        """
        variance = np.diag(stated)
        known = np.isfinite(variance) & (variance > 0.0)
        sd = np.sqrt(np.where(known, variance, 1.0))
        low, high = self.ends(half, x - half * sd, x + half * sd, most)
        wider = np.where(known, np.maximum(high - x, x - low) / (half * sd), 1.0)
        return stated * np.outer(wider, wider)


def reason(far: bool, chi2: float, contradicting: Iterable[str], settings: FitSettings) -> str | None:
    """Why the parameters are a compromise; None where they are not.

    Args:
        far: the model is far from the data.
        chi2: per degree of freedom.
        contradicting: tests that contradict the others.
        settings: what decides.
    """
    if far or chi2 >= settings.contradiction.compromise:
        return f"the model is far from the data (chi2/dof {chi2:.3g})"
    if names := tuple(contradicting):
        return f"{' and '.join(names)} contradict{'s' if len(names) == 1 else ''} the other tests"
    return None
