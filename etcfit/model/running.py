"""Running sums and maxima along the first axis, by a loop.

JAX's own functions (`jnp.cumsum`, `lax.cummax`) become trees of slices, which XLA's CPU backend compiles for seconds,
once for every length.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .parameters import AnyArray


def running_sum(x: Float[AnyArray, "T ..."], xp: Any = jnp) -> Float[AnyArray, "T ..."]:
    """sum_{j <= k} x_j along the first axis, unit and shape of x; by NumPy if xp is NumPy."""
    if xp is np:
        return np.cumsum(x, axis=0)

    def add(total: Array, each: Array) -> tuple[Array, Array]:
        return (total := total + each), total

    return jax.lax.scan(add, jnp.zeros_like(x[0]), x)[1]


def running_max(x: Float[AnyArray, "T ..."], xp: Any = jnp) -> Float[AnyArray, "T ..."]:
    """max_{j <= k} x_j along the first axis, unit and shape of x; by NumPy if xp is NumPy."""
    if xp is np:
        return np.maximum.accumulate(x, axis=0)

    def higher(most: Array, each: Array) -> tuple[Array, Array]:
        return (most := jnp.maximum(most, each)), most

    return jax.lax.scan(higher, jnp.full_like(x[0], -jnp.inf), x)[1]
