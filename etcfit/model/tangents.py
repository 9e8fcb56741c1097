"""Derivatives along what moves, and a barrier against fusion: what keeps a differentiated step small."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero


def forward(function: Callable[..., Any], primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    """`jax.jvp` that computes nothing of arguments whose tangent is a symbolic zero: those are constants.

    Args:
        function: of `primals`.
        primals: its arguments, in any tree.
        tangents: trees of the same structure; a `SymbolicZero` where nothing moves.
    Returns:
        the function's value and its tangent.
    """
    leaves, tree = jax.tree.flatten(primals)
    ways = tree.flatten_up_to(tangents)
    moving = [k for k, way in enumerate(ways) if not isinstance(way, SymbolicZero)]

    def of(moved: list[Any]) -> Any:
        every = dict(enumerate(leaves)) | dict(zip(moving, moved, strict=True))
        return function(*jax.tree.unflatten(tree, every.values()))

    return jax.jvp(of, ([leaves[k] for k in moving],), ([ways[k] for k in moving],))


def instantiated(primals: Any, tangents: Any) -> Any:
    """The tangents with zeros in place of symbolic ones, of the shapes of the primals."""
    return jax.tree.map(lambda p, t: jnp.zeros_like(p) if isinstance(t, SymbolicZero) else t, primals, tangents)


def fusion_barrier(tree: Any) -> Any:
    """The same numbers, computed once.

    XLA's CPU backend fuses a value into every loop that reads it and computes it anew there; for the tangents of a step
    that is the whole step many times over. It never repeats a division: so each value is divided by 1.
    """
    return jax.tree.map(_barrier, tree)


@jax.custom_jvp
def _barrier(leaf: Any) -> Any:
    if jnp.issubdtype(jnp.result_type(leaf), jnp.bool_):
        return leaf
    return leaf / jnp.where(leaf == leaf, 1.0, 2.0)  # by 1, but the compiler does not know


@_barrier.defjvp
def _(primals: Any, tangents: Any) -> Any:
    return _barrier(*primals), _barrier(*tangents)
