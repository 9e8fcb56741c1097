"""Minimises chi2 by Levenberg-Marquardt, from one start to one optimum, and linearises the problem at a point.

    least_squares        the bare algorithm, on any sum of squares; `damped_step` makes its steps
    minimise, descend    chi2 of an `EstimationProblem`, from x and from a point away from the bounds
    descend_in_stages    the same from far away: several descents, the first of which tolerate errors of timing
    linearise_at         covariance and the gain of a further step, at a point

The joint fit, diagnosis and posterior call it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from ..problem import weights
from ..problem.free_parameters import Layout
from ..problem.normal_equations import NormalEquations, normal_equations
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData, prior_residual_here
from .identifiability import WIDE
from .settings import FitSettings

STEPS = FitSettings().steps
ROUGH_TOLERANCE = 1e-2
"""A descent from a start ends if neither chi2 (relative) nor any stretched coordinate (absolute) changes by more."""
LATE: tuple[float, ...] = (0.064, 0.016, 0.004, 0.0)
"""Tolerated error of every sampling instant, s, in successive descents: at first a simulated plate may meet its stop a
little early, later less and less."""
_STRETCH = 30.0  # Optimistix damps with the identity: this makes its first damping 1e-3 of the curvature


def least_squares(
    equations: Callable[[np.ndarray], NormalEquations],
    chi2: Callable[[np.ndarray], float],
    y0: np.ndarray,
    tolerance: float,
    steps: int,
) -> tuple[np.ndarray, int]:
    """Levenberg-Marquardt on a sum of squares given by its normal equations, damped at first by the identity.

    If a model is far from its data, more than half of the steps are rejected, and for that the sum alone is enough:
    derivatives are computed only for accepted steps.

    Args:
        equations: normal equations at y, shape (P,); columns of the Jacobian should have a size of some tens.
        chi2: the sum of squares alone, cheaper.
        y0: the start, shape (P,).
        tolerance: relative change of the sum, and absolute change of y, that ends the descent.
    Returns:
        The end, shape (P,), and the number of steps. A step that raises the sum is never accepted.
    """
    from .damped_step import Condensed, begun, next_step, room_of  # brings Optimistix, a third of a second

    size, room = y0.size, room_of(y0.size)

    def known(y: np.ndarray) -> Condensed:
        e = equations(y[:size])
        gradient, information = np.zeros(room), np.zeros((room, room))
        gradient[:size], information[:size, :size] = e.gradient, e.information
        return Condensed.of_equations(NormalEquations(e.chi2, gradient, information))

    def lone_sum(y: np.ndarray) -> Condensed:
        return Condensed.sum_alone(chi2(y[:size]), room)

    y, lowest = np.append(y0, np.zeros(room - size)), np.inf
    state = begun(room, y)
    for taken in range(1, steps + 1):
        here = np.asarray(state.y_eval)
        after, beyond = (here, state) if taken == 1 else next_step(room, y, state, lone_sum(here))
        if not np.array_equal(after, here):  # rejected
            y, state = after, beyond
            continue
        at = known(here)
        after, state = next_step(room, y, state, at)
        accepted = bool(np.array_equal(after, here))  # False if the sum is finite but the derivatives are not
        total, moved = float(np.sum(at.residual**2)), float(np.max(np.abs(here - y)))
        done = accepted and taken > 1 and moved < tolerance and lowest - total < tolerance * lowest
        y, lowest = after, total if accepted else lowest
        if done:
            break
    return y[:size], taken


def _scale(information: np.ndarray, count: float) -> np.ndarray:
    """Stretch of each coordinate, shape (P,): every column of the Jacobian gets the norm `_STRETCH` sqrt(count)."""
    return _STRETCH / np.sqrt(np.maximum(np.diag(information) / count, 1e-12))


def fisher_information(prior_sd: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Fisher information J^T J of a whitened Jacobian (..., P), and that of the user's priors, shape (P, P)."""
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return flat.T @ flat + np.diag(1.0 / np.asarray(prior_sd) ** 2)


def prior_information(layout: Layout, x: np.ndarray, prior_sd: np.ndarray) -> np.ndarray:
    """Information of the priors, (P, P): the user's own, and one of `WIDE` reaches about x for every coordinate."""
    given = 1.0 / np.asarray(prior_sd)[: x.size] ** 2
    return np.diag(given + 1.0 / (WIDE * layout.reach(x)) ** 2)


def minimise(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float, steps: int = STEPS
) -> tuple[np.ndarray, int]:
    """Minimise chi2 from x.

    Args:
        x: coordinates, shape (P,). If residual or Jacobian are not finite there, there is no descent.
        tolerance: relative change of chi2, and absolute change of the stretched coordinates, that ends the descent.
    Returns:
        Coordinates of the end, shape (P,), and the number of steps; x itself and 0 without a descent.
    """
    layout, count = problem.layout, weighted.samples
    compute = normal_equations(layout.form, weighted, x.size + layout.spare)
    prior_mean, prior_sd = (np.asarray(each)[: x.size] for each in (weighted.prior_mean, weighted.prior_sd))

    @cache
    def of_data(at: bytes) -> NormalEquations:
        e = compute(layout.padded(np.frombuffer(at)))
        return NormalEquations(e.chi2, e.gradient[: x.size], e.information[: x.size, : x.size])

    first = of_data(x.tobytes())
    if not first.finite:
        return x, 0
    anchor = WIDE * layout.reach(x)
    scale = np.minimum(_scale(first.information + np.diag(1.0 / prior_sd**2), count), 1e4 * anchor)

    def prior_and_anchor(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of the priors and of the anchor: a weak pull back to x, which keeps undetermined parameters from
        drifting and is negligible compared with any datum."""
        return (at - prior_mean) / prior_sd, (at - x) / anchor

    def sum_alone(y: np.ndarray) -> float:
        at = x + scale * y
        prior, away = prior_and_anchor(at)
        with np.errstate(over="ignore"):  # a simulation that diverges is rejected
            return (problem.chi2(at, weighted) + float(prior @ prior + away @ away)) / count

    def equations(y: np.ndarray) -> NormalEquations:
        """In stretched coordinates, over the number of samples, with the priors and the anchor."""
        at = x + scale * y
        e, (prior, away) = of_data(at.tobytes()), prior_and_anchor(at)
        chi2 = e.chi2 + prior @ prior + away @ away
        gradient = e.gradient + prior / prior_sd + away / anchor
        information = e.information + np.diag(1.0 / prior_sd**2 + 1.0 / anchor**2)
        return NormalEquations(chi2 / count, scale * gradient / count, scale * information * scale[:, None] / count)

    y, taken = least_squares(equations, sum_alone, np.zeros(x.size), tolerance, steps)
    return x + scale * y, taken


def descend(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, tolerance: float, steps: int = STEPS
) -> tuple[np.ndarray, int]:
    """Minimise from x moved away from the bounds of its parameters, where the gradient vanishes.

    If the end is not lower than x, the descent is repeated from x itself. Arguments and return value are those of
    `minimise`.
    """
    start = problem.layout.off_bounds(x)
    end, taken = minimise(problem, start, weighted, tolerance, steps)
    if np.array_equal(start, x):
        return end, taken
    if problem.chi2(end, weighted) < problem.chi2(x, weighted):
        return end, taken
    return minimise(problem, x, weighted, tolerance, steps)


@dataclass(frozen=True, eq=False)
class LinearisedProblem:
    """The problem linearised at a point."""

    unit: float  # chi2 per degree of freedom, at least 1: the unit of differences in chi2
    covariance: np.ndarray  # covariance of the coordinates, in that unit, shape (P, P)
    gain: float  # fall of chi2 by a full Gauss-Newton step, g^T C g, C the covariance in units of noise, in that unit
    step: np.ndarray  # that step, -C g, shape (P,)


def linearise_at(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> LinearisedProblem:
    """Linearise at coordinates x, shape (P,). Undetermined parameters count as known to `WIDE` reaches; if the
    simulation diverges, all parameters do, and the gain is infinite."""
    padded, size = problem.layout.padded(x), x.size
    of_data = normal_equations(problem.layout.form, weighted, padded.size)(padded)
    unit = max(1.0, float(of_data.chi2) / max(1.0, weighted.samples - size))
    reach, prior_sd = problem.layout.reach(x), np.asarray(weighted.prior_sd)[:size]
    information = np.asarray(of_data.information)[:size, :size] + prior_information(problem.layout, x, prior_sd)
    gradient = np.asarray(of_data.gradient)[:size] + prior_residual_here(padded, weighted)[:size] / prior_sd
    if not (np.isfinite(information).all() and np.isfinite(gradient).all()):
        return LinearisedProblem(unit, np.diag((WIDE * reach) ** 2), np.inf, np.zeros(size))
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))
    covariance = (vectors / np.maximum(values, 1.0 / WIDE**2)) @ vectors.T * np.outer(reach, reach)
    step = -covariance @ gradient
    return LinearisedProblem(unit, unit * covariance, -float(gradient @ step) / unit, step)


# ---- From far away to an optimum: errors of timing count little at first; a parameter that absorbed them is reset


def descend_in_stages(
    problem: EstimationProblem,
    x: np.ndarray,
    tolerance: float,
    settings: FitSettings = FitSettings(),
    hopeless: float = np.inf,
) -> tuple[np.ndarray, int]:
    """Descend several times, each from the last end, with less and less tolerated error of the sampling instants.

    If the simulated plate hits its stop a little early, all samples up to the true impact are wrong, by an amount
    that no small step of a parameter changes.

    Args:
        tolerance: relative change of chi2 that ends each descent.
        hopeless: chi2 above which a descent is the last: stricter timing would only increase it.
    Returns:
        Coordinates of the end, shape (P,), and the number of Levenberg-Marquardt steps.
    """
    steps = 0
    for late in LATE:
        problem = problem.with_integrator_states(x)
        weighted = problem.weighted(weights.forgiving(problem, late))
        x, more = descend(problem, x, weighted, tolerance, settings.steps)
        steps += more
        if np.isfinite(hopeless) and problem.chi2(x, weighted) > hopeless:
            break
    return x, steps


def with_lag_of_start(start: np.ndarray, problem: EstimationProblem, x: np.ndarray) -> np.ndarray:
    """Coordinates x, shape (P,), with the L_a/R_a of the start if the setpoint of an ECU in the model has jumps.

    Until the instants of these jumps are fitted, the circuit's lag compensates their errors and may fall to zero. No
    descent brings it back from there, because its gradient vanishes.
    """
    layout, held = problem.layout, problem.free_parameters.held
    if "L_a" not in layout.free or not problem.sees_jumps:
        return x
    first, now = layout.values(start, held), layout.values(x, held)
    at = layout.free.index("L_a")
    out = x.copy()
    out[at] = layout.parameter("L_a").domain.coordinate(float(first["L_a"] / first["R_a"] * now["R_a"]))
    return out
