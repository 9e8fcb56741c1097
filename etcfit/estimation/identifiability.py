"""What the data can tell: singular values of the scaled Jacobian, and the parameters each weak direction mixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem.free_parameters import Layout
from .settings import IdentifiabilitySettings

# standard deviation of what is believed of a parameter that no prior is given for, in reaches of its coordinate: about
# a factor of 20 either way. Part of the definition of covariance and posterior, hence no setting
WIDE = 3.0


@dataclass(frozen=True, eq=False)
class Direction:
    """A combination of parameters that the data determine badly or not at all.

    Args:
        symbols: the parameters it mixes, largest share first.
        shares: their components, in coordinates (relative changes for positive parameters).
        sd: standard deviation along it, reaches; inf where the data say nothing.
        unknown: standard deviation above which it counts as not determined at all, reaches.
    """

    symbols: tuple[str, ...]
    shares: tuple[float, ...]
    sd: float
    unknown: float = IdentifiabilitySettings().unknown

    @property
    def null(self) -> bool:
        """Whether the data do not determine it at all, rather than badly."""
        return self.sd > self.unknown


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Verdict on one model and one set of traces.

    Args:
        symbols: free parameters, P.
        singular_values: of the whitened Jacobian in coordinates, falling, shape (P,).
        directions: the null and the weak ones, worst first.
        covariance: of the coordinates, with what is believed beforehand (`WIDE`) where the data say nothing, (P, P).
        lost: symbols that are not identifiable.
    """

    symbols: tuple[str, ...]
    singular_values: np.ndarray
    directions: tuple[Direction, ...]
    covariance: np.ndarray
    lost: tuple[str, ...]


def analyse(
    layout: Layout,
    x: np.ndarray,
    information: np.ndarray,
    settings: IdentifiabilitySettings = IdentifiabilitySettings(),
) -> Identifiability:
    """Judge a Fisher information F by the eigenvalues of R F R, R the diagonal matrix of reaches.

        sd_k = 1 / sqrt(eigenvalue_k)

    Args:
        layout: which parameters x stands for.
        x: coordinates, shape (P,).
        information: J^T J of the whitened residual and the priors that the user gave, shape (P, P).
        settings: from when on a direction or a parameter counts as not known.
    """
    reach = layout.reach(x)
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))  # relative changes
    values = np.maximum(values, 0.0)
    sd = 1.0 / np.sqrt(np.maximum(values, 1e-300))
    null = sd > settings.unknown
    directions = [*_readable(layout.free, vectors[:, null], sd[null], settings)]
    for k in np.flatnonzero(~null & (sd > settings.weak)):
        directions.append(_direction(layout.free, vectors[:, k], sd[k], settings))
    # by eigenvectors: an inverse would drown the null directions in rounding
    relative = (vectors / (values + 1.0 / WIDE**2)) @ vectors.T
    lost = tuple(s for s, c in zip(layout.free, np.diag(relative), strict=True) if c**0.5 > settings.unknown)
    covariance = relative * np.outer(reach, reach)
    return Identifiability(layout.free, np.sqrt(values[::-1]), tuple(directions), covariance, lost)


def _direction(symbols: tuple[str, ...], vector: np.ndarray, sd: float, settings: IdentifiabilitySettings) -> Direction:
    """A direction from its unit vector, shape (P,), with the symbols of large enough shares, largest first."""
    vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
    order = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > settings.named_share * np.abs(vector).max()]
    shares = tuple(float(vector[k]) for k in order)
    return Direction(tuple(symbols[k] for k in order), shares, float(sd), settings.unknown)


def _readable(
    symbols: tuple[str, ...], basis: np.ndarray, sd: np.ndarray, settings: IdentifiabilitySettings
) -> list[Direction]:
    """Directions that span a null space, chosen so that each is led by a symbol that leads no other.

    Args:
        symbols: free parameters, P.
        basis: orthonormal, any basis of the space, shape (P, K).
        sd: standard deviations along it, shape (K,).
        settings: see `analyse`.
    """
    out, rest = [], basis.copy()
    leaders: list[int] = []
    for _ in range(basis.shape[1]):
        weight = np.where(np.isin(np.arange(len(symbols)), leaders), -1.0, np.linalg.norm(rest, axis=1))
        leaders.append(int(np.argmax(weight)))
        row = rest[leaders[-1]] / np.linalg.norm(rest[leaders[-1]])
        rest = rest - np.outer(rest @ row, row)
    if leaders:
        sparse = basis @ np.linalg.inv(basis[leaders])
        for k in range(sparse.shape[1]):
            unit = sparse[:, k] / np.linalg.norm(sparse[:, k])
            out.append(_direction(symbols, unit, float(np.max(sd)), settings))
    return out
