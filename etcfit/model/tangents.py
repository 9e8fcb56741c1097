"""Derivatives along the arguments that vary, and a barrier against fusion; they keep a differentiated step small."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


def forward(function: Callable[..., Any], primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    """`jax.jvp` that treats arguments with a symbolic zero as tangent as constants.

    Args:
        function: function of `primals`.
        primals: its arguments, in any tree.
        tangents: trees of the same structure; a `SymbolicZero` for a constant.
    Returns:
        The function's value and its tangent.
    """
    leaves, tree = jax.tree.flatten(primals)
    ways = tree.flatten_up_to(tangents)
    moving = [k for k, way in enumerate(ways) if not isinstance(way, SymbolicZero)]

    def of_varying(varying: list[Any]) -> Any:
        every = dict(enumerate(leaves)) | dict(zip(moving, varying, strict=True))
        return function(*jax.tree.unflatten(tree, every.values()))

    return jax.jvp(of_varying, ([leaves[k] for k in moving],), ([ways[k] for k in moving],))


def instantiated(primals: Any, tangents: Any) -> Any:
    """The tangents with arrays of zeros in place of symbolic zeros, in the shapes of the primals."""
    return jax.tree.map(lambda p, t: jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t, primals, tangents)


def fusion_barrier(tree: Any) -> Any:
    """The same numbers, but computed only once.

    XLA's CPU backend fuses a value into every loop that reads it and computes it again there; for the tangents of a
    step it would compute the whole step many times. It never repeats a division, so each value is divided by 1.
    """
    return jax.tree.map(_barrier, tree)


@jax.custom_jvp
def _barrier(leaf: Any) -> Any:
    if jnp.issubdtype(jnp.result_type(leaf), jnp.bool_):
        return leaf
    return leaf / jnp.where(leaf == leaf, 1.0, 2.0)  # division by 1, which the compiler does not recognise


@_barrier.defjvp
def _(primals: Any, tangents: Any) -> Any:
    return _barrier(*primals), _barrier(*tangents)
