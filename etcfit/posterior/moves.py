"""How walkers move: differential evolution, a snooker now and then, and leaps by the fit's own covariance."""

from __future__ import annotations

from typing import Any

import emcee
import numpy as np

_FREEDOM = 10.0  # degrees of freedom of the leaps' tails


class Snooker(emcee.moves.RedBlueMove):
    """A walker moves on the line through it and another walker, by what two more differ along that line.

        x' = x + 1.7 e (e . (z1 - z2)),    e = (x - z) / |x - z|
        accepted with probability min(1, p(x') |x' - z|^(P-1) / (p(x) |x - z|^(P-1)))

    Source: ter Braak and Vrugt 2008, eqs. 3 and 4. Differs from source: no. emcee 3.1.6's own DESnookerMove divides by
    the root of the distance where it should divide by the distance, which breaks detailed balance: the variance of a
    standard normal in 8 dimensions comes out as 0.63 (tests/posterior/test_moves.py).
    """

    def get_proposal(self, sample: np.ndarray, complement: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        """Proposals for the walkers of one half from those of the other, and the logarithms of their factors."""
        others = np.concatenate(complement)
        drawn = np.argsort(random.uniform(size=(len(sample), len(others))), axis=1)  # three that differ
        z, first, second = (others[drawn[:, k]] for k in range(3))
        away = sample - z
        distance = np.linalg.norm(away, axis=1)
        along = away / distance[:, None]
        moved = sample + 1.7 * along * np.sum(along * (first - second), axis=1)[:, None]
        stretch = np.log(np.linalg.norm(moved - z, axis=1) / distance)
        return moved, (sample.shape[1] - 1.0) * stretch


class Laplace(emcee.moves.RedBlueMove):
    """A walker leaps to a point that does not depend on where it is, drawn about the mode.

        u' ~ t_10(0, 1),    accepted with probability min(1, p(u') t_10(u) / (p(u) t_10(u')))

    In standard coordinates this is the fit's own normal approximation with heavier tails: where that is nearly right,
    most leaps are accepted and walkers forget at once where they were; where it is not, they are refused and the other
    moves do the work. Source: Tierney 1994, sec. 2.3.3 (independence chains).
    """

    def get_proposal(self, sample: np.ndarray, complement: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        """Proposals for the walkers of one half, and the logarithms of their factors."""
        scale = np.sqrt(_FREEDOM / random.chisquare(_FREEDOM, len(sample)))
        moved = scale[:, None] * random.standard_normal(sample.shape)
        return moved, _log_t(sample) - _log_t(moved)


def _log_t(u: np.ndarray) -> np.ndarray:
    """log density of a multivariate t, to a constant, shape (K, P) -> (K,)."""
    return -0.5 * (_FREEDOM + u.shape[1]) * np.log1p(np.sum(u**2, axis=1) / _FREEDOM)


def moves() -> list[tuple[Any, float]]:
    """Differential evolution (ter Braak 2006), at times by a whole difference, which leaps from mode to mode; snooker;
    and leaps by the fit's covariance."""
    return [(emcee.moves.DEMove(), 0.5), (emcee.moves.DEMove(gamma0=1.0), 0.05), (Snooker(), 0.05), (Laplace(), 0.4)]
