"""One descent: Levenberg-Marquardt on the whitened residual, and the residual linearised where it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

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

_STEPS = 40  # of Levenberg-Marquardt in one go
_STRETCH = 30.0  # Optimistix damps with the identity: this makes its first damping 1e-3 of the curvature


def _silent(**_: Any) -> None:
    """Optimistix reports every step; the rounds report enough."""


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
    """The same function, its Jacobian computed once a point by forward mode and then a matrix: a long loop's tangents
    are dear, and Optimistix asks for many products at one point."""
    wrapped = jax.custom_jvp(function)

    @wrapped.defjvp
    def _(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (y,), (dy,) = primals, tangents
        value, columns = jacobian(function, y, live)
        return value, columns @ dy

    return wrapped


@partial(jax.jit, static_argnums=(0, 1))
def _minimise(
    form: Form, circuits: tuple[str, ...], x0: Any, scale: Any, anchor: Any, weighted: WeightedData, tolerance: Any
) -> tuple[Any, Any]:
    """Levenberg-Marquardt from x0, in coordinates stretched by `scale` so that its damping treats all alike."""
    root = jnp.sqrt(jnp.sum(weighted.slots.weight))

    def stacked(y: Any) -> Any:
        x = x0 + scale * y
        r = residual(form, circuits, x, weighted)
        # the anchor keeps what the data do not determine from wandering; it weighs nothing beside any datum
        return jnp.concatenate((r.ravel(), prior_residual(x, weighted), (x - x0) / anchor)) / root

    dense = _with_dense_jacobian(stacked, form.live(weighted.pick))
    y0 = jnp.zeros_like(x0)
    solver = _LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    solution = optimistix.least_squares(lambda y, _: dense(y), solver, y0, max_steps=_STEPS, throw=False)
    return x0 + scale * solution.value, solution.stats["num_steps"]


def _scale(information: np.ndarray, count: float) -> np.ndarray:
    """Stretch of the coordinates that makes all columns of the Jacobian alike."""
    return _STRETCH / np.sqrt(np.maximum(np.diag(information) / count, 1e-12))


def information_of(prior_sd: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Fisher information J^T J of a whitened Jacobian (..., P), and that of the user's priors, shape (P, P)."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return flat.T @ flat + np.diag(1.0 / np.asarray(prior_sd) ** 2)


def minimise(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float
) -> tuple[np.ndarray, int]:
    """Minimise from x; a point where the model cannot be computed stays where it is."""
    r, _, jacobian = problem.linearise(x, weighted)
    if not np.isfinite(r).all() or not np.isfinite(jacobian).all():
        return x, 0
    layout = problem.layout
    scale = _scale(information_of(weighted.prior_sd[: x.size], jacobian), weighted.samples)
    anchor = WIDE * layout.reach(x)
    stretch = layout.padded(np.minimum(scale, 1e4 * anchor), 1.0)
    start, held_to = layout.padded(x), layout.padded(anchor, 1.0)
    end, steps = _minimise(layout.form, problem.batch.circuits, start, stretch, held_to, weighted, tolerance)
    return np.asarray(end)[: x.size], int(steps)


def descend(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float
) -> tuple[np.ndarray, int]:
    """Minimise from x moved off its bounds, on which the gradient vanishes; from x itself where that leads astray."""
    start = problem.layout.off_bounds(x)
    end, steps = minimise(problem, start, weighted, tolerance)
    if np.array_equal(start, x):
        return end, steps
    if problem.chi2(end, weighted) < problem.chi2(x, weighted):
        return end, steps
    return minimise(problem, x, weighted, tolerance)


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
