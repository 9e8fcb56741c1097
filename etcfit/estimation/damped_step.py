"""One step of Levenberg-Marquardt by Optimistix, compiled, on a residual that is already computed.

This is a module of its own so that Optimistix is imported only when a descent begins.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix
from jaxtyping import Float

from ..model.parameters import AnyArray
from ..problem.normal_equations import NormalEquations

_ROOM = 8  # the solver's program has a multiple of so many parameters, so that few programs are compiled
_TINY = 1e-12  # singular values below this share of the largest count as zero


def room_of(size: int) -> int:
    """Number of coordinates of the program for a problem of this size."""
    return _ROOM * -(-size // _ROOM)


def _silent(**_: Any) -> None:
    """No report of single steps."""


class _LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """Optimistix's Levenberg-Marquardt with a trust region that grows on good steps, not on perfect ones only."""

    rtol: float = 1.0  # `least_squares` decides itself when to stop
    atol: float = 1.0
    norm: Callable[[Any], Any] = optimistix.max_norm
    descent: optimistix.DampedNewtonDescent = optimistix.DampedNewtonDescent(lineax.Normal(lineax.Cholesky()))
    search: optimistix.ClassicalTrustRegion = optimistix.ClassicalTrustRegion(
        high_cutoff=0.7, low_cutoff=0.1, high_constant=5.0, low_constant=0.2
    )
    verbose: Callable[..., None] = _silent


_SOLVER = _LevenbergMarquardt()
_BACKWARD = {"jac": "bwd"}  # a Jacobian that is a plain matrix


class Condensed(NamedTuple):
    """A residual of P + 1 entries with the chi2, gradient and curvature of a residual of any length.

        rho = [D^-1/2 V^T g, sqrt(chi2 - |D^-1/2 V^T g|^2)],    K = [D^1/2 V^T, 0],    J^T J = V D V^T,    g = J^T r

    so that rho^T rho = chi2, K^T rho = g and K^T K = J^T J: every step of Gauss-Newton or Levenberg-Marquardt is
    unchanged.
    """

    residual: Float[AnyArray, " R"]  # rho, shape (P + 1,)
    jacobian: Float[AnyArray, "R P"]  # K, shape (P + 1, P)

    @classmethod
    def sum_alone(cls, chi2: float, size: int) -> Condensed:
        """For a point whose derivatives are unknown: enough to reject it; NaN if the sum is not finite."""
        rest = np.sqrt(chi2) if np.isfinite(chi2) else np.nan
        return cls(np.append(np.zeros(size), rest), np.zeros((size + 1, size)))

    @classmethod
    def of_equations(cls, e: NormalEquations) -> Condensed:
        """From normal equations; NaN if they are not finite, so that no step to that point is accepted."""
        size = e.gradient.size
        if not e.finite:
            return cls(np.full(size + 1, np.nan), np.full((size + 1, size), np.nan))
        values, vectors = np.linalg.eigh(e.information)
        root = np.sqrt(np.maximum(values, 0.0))
        seen = root > _TINY * root[-1]
        top = np.where(seen, vectors.T @ e.gradient / np.where(seen, root, 1.0), 0.0)
        rest = np.sqrt(max(float(e.chi2) - float(top @ top), 0.0))
        return cls(np.append(top, rest), np.vstack((root[:, None] * vectors.T, np.zeros(size))))


@jax.custom_vjp
def _known(y: Any, at: Condensed) -> Any:
    """The residual at y, already computed."""
    return at.residual


_known.defvjp(
    lambda y, at: (at.residual, at), lambda at, cotangent: (at.jacobian.T @ cotangent, jax.tree.map(jnp.zeros_like, at))
)


@cache
def _first(room: int) -> Any:
    """Optimistix's state before the first step at y = 0, for a problem of that size."""
    y, at = np.zeros(room), Condensed(np.zeros(room + 1), np.zeros((room + 1, room)))
    shape = jax.eval_shape(_known, y, at)
    return _SOLVER.init(lambda y, at: (_known(y, at), None), y, at, _BACKWARD, shape, None, frozenset())


@partial(jax.jit, static_argnums=0)
def _stepped(room: int, y: Any, leaves: list[Any], at: Condensed) -> Any:
    """One step: the lowest point so far, and the leaves of the state with the next trial point."""
    state = jax.tree.unflatten(jax.tree.structure(_first(room)), leaves)
    after, state = _SOLVER.step(lambda y, at: (_known(y, at), None), y, at, _BACKWARD, state, frozenset())[:2]
    return after, jax.tree.leaves(state)


def begun(room: int, y: np.ndarray) -> Any:
    """Optimistix's state before the first step at y, shape (room,)."""
    return eqx.tree_at(lambda state: state.y_eval, _first(room), y)


def next_step(room: int, y: np.ndarray, state: Any, at: Condensed) -> tuple[np.ndarray, Any]:
    """The lowest point so far, and the state with the next trial point."""
    after, leaves = _stepped(room, y, jax.tree.leaves(state), at)
    return np.asarray(after), jax.tree.unflatten(jax.tree.structure(state), leaves)


def compile_step(size: int) -> None:
    """Compile the step of a descent with this number of coordinates, which takes a second the first time."""
    room = room_of(size)
    at = Condensed(np.zeros(room + 1), np.zeros((room + 1, room)))
    _stepped.lower(room, np.zeros(room), jax.tree.leaves(_first(room)), at).compile()
