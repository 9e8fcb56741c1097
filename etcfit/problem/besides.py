"""What effects that are not in a model would do to its residual, to first order: `etcfit.model.besides`, compiled.

The model is simulated once; its steps are asked what each effect would add to them, which takes no simulation; and the
residual is differentiated along that. What is compiled for an effect serves every model that it is asked about.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..model.besides import StepAsked, added, asked_along
from ..model.effects import AbstractEffect
from ..model.parameters import Scalar
from ..model.stepper import Reset, Step, StepBesides
from .free_parameters import Form
from .program import QUICK, Program
from .residual import WeightedData, residual, run


class Where(NamedTuple):
    """Where the steps of a batch ask the effects, and the batch as it was simulated; entries of shape (T, L)."""

    asked: StepAsked
    steps: Step
    resets: Reset


@Program
def where_asked(form: Form, x: Float[Array, " P"], weighted: WeightedData) -> Where:
    """Where the steps of a model ask the effects; arguments as of `residual`."""
    throttle, path, steps, resets = run(form, x, weighted.pick, weighted)
    return Where(asked_along(throttle, path, steps, resets), steps, resets)


@partial(Program, options=QUICK)
def added_by(
    effect: type[AbstractEffect], values: Mapping[str, Scalar], ways: Mapping[str, Scalar], where: Where
) -> StepBesides:
    """What an effect would add to each step along a direction of its parameters, see `model.besides.added`."""
    return added(effect, values, ways, *where)


@Program
def responses(
    form: Form, x: Float[Array, " P"], weighted: WeightedData, besides: tuple[StepBesides, ...]
) -> Float[Array, "K T L M"]:
    """What the residual does to first order where something acts besides all effects.

    Args:
        form, x, weighted: as of `residual`.
        besides: K of them, entries of shape (T, L).
    Returns:
        shape (K, T, L, M), dimensionless.
    """
    ways: Any = jax.tree.map(lambda *leaves: jnp.stack(leaves), *besides)
    nothing = jax.tree.map(jnp.zeros_like, besides[0])

    def of(acts: StepBesides) -> Float[Array, "T L M"]:
        return residual(form, x, weighted._replace(steps=weighted.steps._replace(besides=acts)))

    return jax.vmap(lambda way: jax.jvp(of, (nothing,), (way,))[1])(ways)
