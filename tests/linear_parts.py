"""A linear problem in parts: rig tests of several traces, each with a Jacobian and noise of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from etcfit.estimation.statement import Piece, Statement, prior, statement

P = 3
TESTS = {"alpha": 3, "beta": 2, "gamma": 4}  # traces of each


def jacobians(
    rng: np.random.Generator, n: int = 60, tests: Mapping[str, int] = TESTS
) -> dict[tuple[str, str], np.ndarray]:
    """Of every trace, shape (n, P), by test and file."""
    return {
        (test, f"{test}/{k}.csv"): rng.standard_normal((n, P)) * rng.uniform(0.5, 2.0, P)
        for test, count in tests.items()
        for k in range(count)
    }


def residuals(
    rng: np.random.Generator, every: Mapping[tuple[str, str], np.ndarray], off: Mapping[str, np.ndarray] | None = None
) -> dict[tuple[str, str], np.ndarray]:
    """r = noise - J off at the true coordinates 0: a test that is `off` was measured at other coordinates."""
    moved = off or {}
    return {key: rng.standard_normal(len(J)) - J @ moved.get(key[0], np.zeros(J.shape[1])) for key, J in every.items()}


def optimum(every: Mapping[tuple[str, str], np.ndarray], r: Mapping[tuple[str, str], np.ndarray]) -> np.ndarray:
    """Coordinates of the least squares of these traces, shape (P,)."""
    stacked, left = np.vstack(list(every.values())), np.concatenate([r[key] for key in every])
    return -np.linalg.lstsq(stacked, left, rcond=None)[0]


def pieces(
    every: Mapping[tuple[str, str], np.ndarray], r: Mapping[tuple[str, str], np.ndarray], x: np.ndarray
) -> tuple[Piece, ...]:
    """Linearised at x, shape (P,)."""
    return tuple(Piece(*key, J, r[key] + J @ x) for key, J in every.items())


def said(parts: Sequence[Piece]) -> dict[tuple[str, str], Statement]:
    """What each trace says, its noise as declared."""
    return {(piece.test, piece.file): statement((piece,), (1.0,)) for piece in parts}


def nothing_believed(size: int = P) -> Statement:
    """Priors so wide that they say nothing."""
    return prior(1e-12 * np.eye(size), np.zeros(size))


def without(
    every: Mapping[tuple[str, str], np.ndarray], test: str, file: str | None = None
) -> dict[tuple[str, str], np.ndarray]:
    """The traces that are left where a test, or a file of it, is left out."""
    return {key: J for key, J in every.items() if key[0] != test or (file is not None and key[1] != file)}
