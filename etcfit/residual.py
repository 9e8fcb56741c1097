"""THE residual: measured minus simulated, whitened. Nobody else subtracts y - y_hat for a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from .effects import State
from .parameters import Scalar
from .simulate import Reset, Step, simulate
from .tape import KINDS, Slots
from .throttle import Throttle
from .unknowns import SERIES, Layout
from .whitening import Whitening, whiten


class Problem(NamedTuple):
    """What the residual needs besides the coordinates: data, whitening and prior, all arrays.

    Args:
        steps, resets, slots, circuit_of: the tape.
        whitening: frozen filter.
        held: values of the parameters that are not fitted, shape (H,).
        prior_mean, prior_sd: Gaussian priors on the coordinates, shape (P,); sd is inf where there is none.
    """

    steps: Step
    resets: Reset
    slots: Slots
    circuit_of: Any
    whitening: Whitening
    held: Any
    prior_mean: Any
    prior_sd: Any


def with_circuits(steps: Step, circuit_of: Any, tape_circuits: tuple[str, ...], values: Mapping[str, Scalar]) -> Step:
    """Put each test's own series resistance on the tape."""
    series = jnp.zeros_like(steps.dt)
    for k, name in enumerate(tape_circuits):
        series = jnp.where(circuit_of == k + 1, values[SERIES + name], series)
    return steps._replace(series=series)


def predict(throttle: Throttle, path: tuple[State, Any], steps: Step, slots: Slots) -> Any:
    """What each slot ought to show, SI, shape (T, L, M)."""
    seen = throttle.observe(path[0], steps.inputs(1.0))
    y = jnp.zeros_like(slots.value)
    for k, name in enumerate(KINDS):
        y = jnp.where(slots.kind == k, seen[name][..., None], y)
    return y


def run(
    layout: Layout, circuits: tuple[str, ...], x: Any, held: Any, steps: Step, resets: Reset, circuit_of: Any
) -> tuple[Throttle, tuple[State, Any], Step]:
    """Simulate a tape at coordinates x: the model, its path, and the tape with its circuits."""
    values = layout.values(x, held)
    throttle = Throttle.build(layout.types, values)
    steps = with_circuits(steps, circuit_of, circuits, values)
    return throttle, simulate(throttle, steps, resets), steps


def residual(layout: Layout, circuits: tuple[str, ...], x: Any, problem: Problem) -> tuple[Any, Any]:
    """Whitened residual of all traces, and of the priors.

        r = W (y - y_hat(x)),    r_prior = (x - mean) / sd

    Source: generalised least squares; see `whitening`.
    Args:
        layout: which parameters x stands for.
        circuits: tests with a series resistance of their own, as on the tape.
        x: coordinates, shape (P,).
        problem: data.
    Returns:
        shape (T, L, M), 0 where there is no sample, standard normal where the model is right; and shape (P,).
    """
    throttle, path, steps = run(layout, circuits, x, problem.held, problem.steps, problem.resets, problem.circuit_of)
    seen = predict(throttle, path, steps, problem.slots)
    error = problem.slots.weight * (problem.slots.value - seen)
    return whiten(problem.whitening, error, problem.resets.begins), (x - problem.prior_mean) / problem.prior_sd
