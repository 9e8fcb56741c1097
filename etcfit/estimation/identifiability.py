"""What the data can tell: singular values of the scaled Jacobian, and the parameters each weak direction mixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..problem.free_parameters import Layout

WIDE = 3.0  # relative change: what is believed of a parameter beforehand, about a factor of 20 either way
UNKNOWN = 0.3  # what is known no better than to 30 % counts as not identifiable
_WEAK = 0.1  # a direction less well known than to 10 %
_SHARE = 0.1  # a symbol with a smaller share in a direction is not named


@dataclass(frozen=True, eq=False)
class Direction:
    """A combination of parameters that the data determine badly or not at all.

    Args:
        symbols: the parameters it mixes, largest share first.
        shares: their components, in coordinates (relative changes for positive parameters).
        sd: standard deviation along it, coordinates; inf where the data say nothing.
    """

    symbols: tuple[str, ...]
    shares: tuple[float, ...]
    sd: float

    @property
    def null(self) -> bool:
        return self.sd > UNKNOWN


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Verdict on one model and one set of traces.

    Args:
        symbols: free parameters, P.
        singular_values: of the whitened Jacobian in coordinates, falling, shape (P,).
        directions: the null and the weak ones, worst first.
        covariance: of the coordinates where all directions that are not null are determined by the data, (P, P).
        lost: symbols that are not identifiable.
    """

    symbols: tuple[str, ...]
    singular_values: np.ndarray
    directions: tuple[Direction, ...]
    covariance: np.ndarray
    lost: tuple[str, ...]


def analyse(layout: Layout, x: np.ndarray, information: np.ndarray) -> Identifiability:
    """Judge a Fisher information.

    Args:
        layout: which parameters x stands for.
        x: coordinates, shape (P,).
        information: J^T J of the whitened residual and the priors that the user gave, shape (P, P).
    """
    reach = layout.reach(x)
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))  # relative changes
    values = np.maximum(values, 0.0)
    sd = 1.0 / np.sqrt(np.maximum(values, 1e-300))
    null = sd > UNKNOWN
    directions = [*_readable(layout.free, vectors[:, null], sd[null])]
    for k in np.flatnonzero(~null & (sd > _WEAK)):
        directions.append(_direction(layout.free, vectors[:, k], sd[k]))
    # by eigenvectors: an inverse would drown the null directions in rounding
    relative = (vectors / (values + 1.0 / WIDE**2)) @ vectors.T
    lost = tuple(s for s, c in zip(layout.free, np.diag(relative), strict=True) if c**0.5 > UNKNOWN)
    covariance = relative * np.outer(reach, reach)
    return Identifiability(layout.free, np.sqrt(values[::-1]), tuple(directions), covariance, lost)


def _direction(symbols: tuple[str, ...], vector: np.ndarray, sd: float) -> Direction:
    vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
    order = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > _SHARE * np.abs(vector).max()]
    return Direction(tuple(symbols[k] for k in order), tuple(float(vector[k]) for k in order), float(sd))


def _readable(symbols: tuple[str, ...], basis: np.ndarray, sd: np.ndarray) -> list[Direction]:
    """A null space has no basis of its own: choose one in which each direction is led by a symbol of its own."""
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
            out.append(_direction(symbols, unit, float(np.max(sd))))
    return out
