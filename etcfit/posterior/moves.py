"""How walkers move: leaps by the normal density near the one sampled, differential evolution, a snooker at times."""

from __future__ import annotations

from typing import Any

import emcee
import numpy as np

from .approximation import drawn_t, log_t


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


class Leap(emcee.moves.RedBlueMove):
    """A walker leaps to a point that does not depend on where it is.

        u' ~ t_10(0, 1),    accepted with probability min(1, p(u') t_10(u) / (p(u) t_10(u')))

    In standard coordinates this is the normal density of `approximation` with heavier tails: where that is nearly
    right, half of the leaps are accepted and walkers forget at once where they were; where it is not, they are refused
    and the other moves do the work. Source: Tierney 1994, sec. 2.3.3 (independence chains).
    """

    def get_proposal(self, sample: np.ndarray, complement: Any, random: Any) -> tuple[np.ndarray, np.ndarray]:
        """Proposals for the walkers of one half, and the logarithms of their factors."""
        moved = drawn_t(len(sample), sample.shape[1], random)
        return moved, log_t(sample) - log_t(moved)


def moves() -> list[tuple[Any, float]]:
    """Leaps; differential evolution (ter Braak 2006), at times by a whole difference, which leads from mode to mode;
    and snooker."""
    return [(Leap(), 0.7), (emcee.moves.DEMove(), 0.2), (emcee.moves.DEMove(gamma0=1.0), 0.05), (Snooker(), 0.05)]
