"""Several ensembles that know nothing of each other, and the file that keeps them between blocks.

The file is written whole after each block. It holds the random state too: a chain taken up again goes on exactly as if
it had never been interrupted.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..files import whole
from .ensemble import Ensemble, LogProbability
from .settings import SamplingSettings

_SAME = 1e-6  # by which a log-probability may differ when it is computed again, absolute and relative


@dataclass(frozen=True, eq=False)
class Chain:
    """All that was sampled of a target so far.

    Args:
        symbols: of the coordinates.
        mode: x = mode + root u, coordinates, shape (P,).
        root: square root of the covariance at the mode, shape (P, P).
        ensembles: equally long.
    """

    symbols: tuple[str, ...]
    mode: np.ndarray
    root: np.ndarray
    ensembles: tuple[Ensemble, ...]

    @classmethod
    def begin(
        cls,
        target: LogProbability,
        symbols: tuple[str, ...],
        mode: np.ndarray,
        covariance: np.ndarray,
        settings: SamplingSettings = SamplingSettings(),
    ) -> Chain:
        """One ensemble a seed, about the mode.

        Args:
            target: log-probability of coordinates, shape (K, P) -> (K,).
            symbols: of the coordinates, P.
            mode: coordinates, shape (P,).
            covariance: of the coordinates there, shape (P, P).
            settings: seeds and walkers.
        """
        variance, axes = np.linalg.eigh(covariance)
        root = axes * np.sqrt(np.maximum(variance, 0.0))
        bare = cls(symbols, mode, root, ())
        standard = bare.standard(target)
        return replace(
            bare, ensembles=tuple(Ensemble.begin(standard, mode.size, seed, settings) for seed in settings.seeds)
        )

    def standard(self, target: LogProbability) -> LogProbability:
        """The density over standard coordinates u, x = mode + root u; it differs by a constant factor."""
        return lambda u: target(self.mode + u @ self.root.T)

    def advanced(self, target: LogProbability, steps: int) -> Chain:
        """The chain after some more steps. Ensembles run side by side: a log-probability in JAX keeps one core busy."""
        standard = self.standard(target)
        with ThreadPoolExecutor(len(self.ensembles)) as pool:
            later = pool.map(lambda e: e.advanced(standard, steps), self.ensembles)
        return replace(self, ensembles=tuple(later))

    def coordinates(self, burn: int) -> np.ndarray:
        """What was sampled after `burn` steps, shape (E, N, W, P)."""
        kept = np.stack([e.points[burn:] for e in self.ensembles])
        return self.mode + kept @ self.root.T

    def belongs_to(self, target: LogProbability, symbols: tuple[str, ...]) -> bool:
        """False where the data, the model or its fit have changed since the chain was begun."""
        if symbols != self.symbols:
            return False
        e = self.ensembles[0]
        again = self.standard(target)(e.points[-1])
        return bool(np.allclose(again, e.log_probability[-1], rtol=_SAME, atol=_SAME))


def save(path: Path, chain: Chain) -> None:
    """Write a chain whole or not at all."""
    arrays: dict[str, Any] = {"symbols": np.array(chain.symbols, dtype=str), "mode": chain.mode, "root": chain.root}
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
    whole_one = chain.mode.shape == (size,) and chain.root.shape == (size, size) and one[2:] == (size,)
    if not whole_one or not all(e.points.shape == one and e.log_probability.shape == one[:2] for e in ensembles):
        raise ValueError("its arrays do not fit together")
    return chain


def _ensemble(kept: Any, k: int) -> Ensemble:
    position, has_gauss, gauss = kept[f"random{k}"].tolist()
    random = ("MT19937", kept[f"keys{k}"], int(position), int(has_gauss), gauss)
    return Ensemble(kept[f"points{k}"], kept[f"log_probability{k}"], kept[f"accepted{k}"], random)
