"""One descent by Levenberg-Marquardt on the whitened residual, and the residual linearised where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix

from ..problem.free_parameters import Form
from ..problem.jacobian import jacobian
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, prior_residual, residual
from .identifiability import WIDE
from .settings import FitSettings

STEPS = FitSettings().steps
_STRETCH = 30.0  # Optimistix damps with the identity: this makes its first damping 1e-3 of the curvature


def _silent(**_: Any) -> None:
    """No report of single steps."""


class _LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """Optimistix's Levenberg-Marquardt with a trust region that grows on good steps, not on perfect ones only."""

    rtol: float
    atol: float
    norm: Callable[[Any], Any] = optimistix.max_norm
    descent: optimistix.DampedNewtonDescent = optimistix.DampedNewtonDescent(lineax.Normal(lineax.Cholesky()))
    search: optimistix.ClassicalTrustRegion = optimistix.ClassicalTrustRegion(
        high_cutoff=0.7, low_cutoff=0.1, high_constant=5.0, low_constant=0.2
    )
    verbose: Callable[..., None] = _silent


def _with_dense_jacobian(function: Callable[[Any], Any], live: Any) -> Callable[[Any], Any]:
    """A function whose Jacobian is computed once a point, by forward mode, and is a matrix from then on.

    Optimistix asks for many products with the Jacobian at one point; tangents of a long simulation are expensive.

    Args:
        function: residual of coordinates, shape (P,) -> (n,).
        live: which coordinates stand for a parameter, shape (P,); the others are padding.
    """
    wrapped = jax.custom_jvp(function)

    @wrapped.defjvp
    def _(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (y,), (dy,) = primals, tangents
        value, columns = jacobian(function, y, live)
        return value, columns @ dy

    return wrapped


class _Task(NamedTuple):
    """One descent, as arrays.

    Args:
        x0: coordinates to start from, shape (P,).
        scale: by which each is stretched, x = x0 + scale y, so that the damping treats all alike, shape (P,).
        anchor: standard deviation of the weak pull back to x0, coordinates, shape (P,).
        weighted: the data.
        tolerance: relative change of chi2, and absolute one of y, that ends the descent.
    """

    x0: Any
    scale: Any
    anchor: Any
    weighted: WeightedData
    tolerance: Any


@partial(jax.jit, static_argnums=(0, 1, 3))
def _minimise(form: Form, circuits: tuple[str, ...], task: _Task, steps: int) -> tuple[Any, Any]:
    """Levenberg-Marquardt in stretched coordinates: the end x, shape (P,), and the number of steps."""
    x0, scale, anchor, weighted, tolerance = task
    root = jnp.sqrt(jnp.sum(weighted.slots.weight))

    def stacked(y: Any) -> Any:
        x = x0 + scale * y
        r = residual(form, circuits, x, weighted)
        # the anchor keeps what the data do not determine from wandering; it weighs nothing beside any datum
        return jnp.concatenate((r.ravel(), prior_residual(x, weighted), (x - x0) / anchor)) / root

    y, taken = least_squares(stacked, jnp.zeros_like(x0), form.live(weighted.pick), tolerance, steps)
    return x0 + scale * y, taken


def least_squares(function: Callable[[Any], Any], y0: Any, live: Any, tolerance: Any, steps: int) -> tuple[Any, Any]:
    """Levenberg-Marquardt on the sum of squares of a function, damped at first by the identity.

    Args:
        function: residual, shape (P,) -> (n,); its columns should have a size of some tens.
        y0: where to start, shape (P,).
        live: which entries of y are not padding, shape (P,).
        tolerance: relative change of the sum, and absolute one of y, that ends it.
        steps: at most.
    Returns:
        where it ended, shape (P,), and the number of steps. A step that raises the sum is never taken.
    """
    dense = _with_dense_jacobian(function, live)
    solver = _LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    solution = optimistix.least_squares(lambda y, _: dense(y), solver, y0, max_steps=steps, throw=False)
    return solution.value, solution.stats["num_steps"]


def _scale(information: np.ndarray, count: float) -> np.ndarray:
    """Stretch of each coordinate, shape (P,): every column of the Jacobian gets the norm `_STRETCH` sqrt(count)."""
    return _STRETCH / np.sqrt(np.maximum(np.diag(information) / count, 1e-12))


def information_of(prior_sd: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Fisher information J^T J of a whitened Jacobian (..., P), and that of the user's priors, shape (P, P)."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return flat.T @ flat + np.diag(1.0 / np.asarray(prior_sd) ** 2)


def minimise(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float, steps: int = STEPS
) -> tuple[np.ndarray, int]:
    """Minimise chi2 from x.

    Args:
        problem, weighted: the residual.
        x: coordinates, shape (P,). Where residual or Jacobian are not finite there, nothing is done.
        tolerance: relative change of chi2, and absolute one of the stretched coordinates, that ends the descent.
        steps: at most.
    Returns:
        coordinates of the end, shape (P,), and the number of steps; x itself and 0 where nothing was done.
    """
    r, _, jacobian = problem.linearise(x, weighted)
    if not np.isfinite(r).all() or not np.isfinite(jacobian).all():
        return x, 0
    layout = problem.layout
    scale = _scale(information_of(weighted.prior_sd[: x.size], jacobian), weighted.samples)
    anchor = WIDE * layout.reach(x)
    stretch = layout.padded(np.minimum(scale, 1e4 * anchor), 1.0)
    start, held_to = layout.padded(x), layout.padded(anchor, 1.0)
    task = _Task(start, stretch, held_to, weighted, tolerance)
    end, taken = _minimise(layout.form, problem.batch.circuits, task, steps)
    return np.asarray(end)[: x.size], int(taken)


def descend(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float, steps: int = STEPS
) -> tuple[np.ndarray, int]:
    """Minimise from x moved off the bounds of its parameters, on which the gradient vanishes.

    An end that is not lower than x is not believed: the descent is made once more from x itself. Arguments and what is
    returned are those of `minimise`.
    """
    start = problem.layout.off_bounds(x)
    end, taken = minimise(problem, start, weighted, tolerance, steps)
    if np.array_equal(start, x):
        return end, taken
    if problem.chi2(end, weighted) < problem.chi2(x, weighted):
        return end, taken
    return minimise(problem, x, weighted, tolerance, steps)


@dataclass(frozen=True, eq=False)
class Local:
    """The problem linearised at a point.

    Args:
        r: whitened residual, shape (T, L, M).
        jacobian: of it in the coordinates, shape (T, L, M, P).
        unit: chi2 per degree of freedom, at least 1: what a difference in chi2 is measured by.
        covariance: of the coordinates, in that unit, shape (P, P).
        gain: chi2 that a full Gauss-Newton step would still gain, g^T F^-1 g, in that unit.
    """

    r: np.ndarray
    jacobian: np.ndarray
    unit: float
    covariance: np.ndarray
    gain: float


def local(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> Local:
    """Linearise at coordinates x, shape (P,). What the data leave open counts as known to `WIDE` reaches."""
    r, prior, jacobian = problem.linearise(x, weighted)
    unit = max(1.0, float(np.sum(r**2)) / max(1.0, weighted.samples - x.size))
    reach = problem.layout.reach(x)
    information = information_of(weighted.prior_sd[: x.size], jacobian) + np.diag(1.0 / (WIDE * reach) ** 2)
    prior_sd = np.asarray(weighted.prior_sd)[: x.size]
    gradient = jacobian.reshape(-1, x.size).T @ r.ravel() + prior / prior_sd
    gain = float(gradient @ np.linalg.solve(information, gradient)) / unit
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))
    covariance = (vectors / np.maximum(values, 1.0 / WIDE**2)) @ vectors.T * np.outer(reach, reach)
    return Local(r, jacobian, unit, unit * covariance, gain)
