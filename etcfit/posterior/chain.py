"""Several ensembles that know nothing of each other, and the file that keeps them between blocks.

The file is written whole after each block. It holds the random state too: a chain taken up again goes on exactly as if
it had never been interrupted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files import whole
from .approximation import approximate
from .ensemble import Ensemble, LogProbability
from .in_step import in_step
from .settings import SamplingSettings

_SAME = 1e-6  # by which a log-probability may differ when it is computed again, absolute and relative


@dataclass(frozen=True, eq=False)
class Chain:
    """All that was sampled of a target so far.

    Args:
        symbols: of the coordinates.
        centre: x = centre + root u, coordinates, shape (P,): mean of a normal density near the one sampled.
        root: square root of its covariance, shape (P, P).
        ensembles: equally long.
    """

    symbols: tuple[str, ...]
    centre: np.ndarray
    root: np.ndarray
    ensembles: tuple[Ensemble, ...]

    @classmethod
    def begin(
        cls,
        target: LogProbability,
        symbols: tuple[str, ...],
        start: np.ndarray,
        covariance: np.ndarray,
        settings: SamplingSettings = SamplingSettings(),
    ) -> Chain:
        """One ensemble a seed, about the density's own mean as far as it is found.

        Args:
            target: log-probability of coordinates, shape (K, P) -> (K,).
            symbols: of the coordinates, P.
            start: coordinates from which that is sought, shape (P,).
            covariance: first guess of the covariance, shape (P, P).
            settings: seeds, walkers, and how the mean is sought.
        """
        bare = cls(symbols, *approximate(target, start, covariance, settings), ())
        standard = bare.standard(target)
        return replace(
            bare, ensembles=tuple(Ensemble.begin(standard, start.size, seed, settings) for seed in settings.seeds)
        )

    def standard(self, target: LogProbability) -> LogProbability:
        """The density over standard coordinates u, x = centre + root u; it differs by a constant factor."""
        return lambda u: target(self.centre + u @ self.root.T)

    def advanced(self, target: LogProbability, steps: int) -> Chain:
        """The chain after some more steps. Points of all ensembles are computed in one call, so that the processor's
        vectors are full."""
        later = in_step(lambda e, standard: e.advanced(standard, steps), self.ensembles, self.standard(target))
        return replace(self, ensembles=tuple(later))

    def coordinates(self, burn: int) -> np.ndarray:
        """What was sampled after `burn` steps, shape (E, N, W, P)."""
        kept = np.stack([e.points[burn:] for e in self.ensembles])
        return self.centre + kept @ self.root.T

    def belongs_to(self, target: LogProbability, symbols: tuple[str, ...]) -> bool:
        """False where the data, the model or its fit have changed since the chain was begun."""
        if symbols != self.symbols:
            return False
        e = self.ensembles[0]
        again = self.standard(target)(e.points[-1])
        return bool(np.allclose(again, e.log_probability[-1], rtol=_SAME, atol=_SAME))


def save(path: Path, chain: Chain) -> None:
    """Write a chain whole or not at all."""
    arrays: dict[str, Any] = {"symbols": np.array(chain.symbols, dtype=str), "mode": chain.centre, "root": chain.root}
    for k, e in enumerate(chain.ensembles):
        _, keys, position, has_gauss, gauss = e.random
        arrays |= {f"points{k}": e.points, f"log_probability{k}": e.log_probability, f"accepted{k}": e.accepted,
                   f"keys{k}": keys, f"random{k}": np.array([position, has_gauss, gauss])}  # fmt: skip
    with whole(path) as draft:
        np.savez(draft, **arrays)


class Damaged(ValueError):
    """A file that holds no whole chain."""


def load(path: Path) -> Chain | None:
    """The chain that was kept there; None where there is no file.

    Raises:
        Damaged: it is not whole, or something else.
        OSError: it cannot be opened.
    """
    if not path.exists():
        return None
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as kept:
                return _chain(kept)
        except Exception as error:  # whatever a file of any bytes makes zipfile and NumPy say
            raise Damaged(str(error) or type(error).__name__) from error


def _chain(kept: Any) -> Chain:
    count = sum(name.startswith("points") for name in kept.files)
    ensembles = tuple(_ensemble(kept, k) for k in range(count))
    chain = Chain(tuple(map(str, kept["symbols"])), kept["mode"], kept["root"], ensembles)
    size, one = len(chain.symbols), ensembles[0].points.shape
    whole_one = chain.centre.shape == (size,) and chain.root.shape == (size, size) and one[2:] == (size,)
    if not whole_one or not all(e.points.shape == one and e.log_probability.shape == one[:2] for e in ensembles):
        raise ValueError("its arrays do not fit together")
    return chain


def _ensemble(kept: Any, k: int) -> Ensemble:
    position, has_gauss, gauss = kept[f"random{k}"].tolist()
    random = ("MT19937", kept[f"keys{k}"], int(position), int(has_gauss), gauss)
    return Ensemble(kept[f"points{k}"], kept[f"log_probability{k}"], kept[f"accepted{k}"], random)
