"""The chunked Jacobian is that of JAX, and dead columns are not computed."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit.problem.jacobian import AT_ONCE, jacobian


def curve(x: jax.Array) -> jax.Array:
    return jnp.stack([jnp.sin(x).sum() * x[:3], jnp.cumsum(x**2)[-3:]], axis=1)


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, AT_ONCE, AT_ONCE + 3, 3 * AT_ONCE])
def test_value_and_jacobian_are_those_of_jax(count: int) -> None:
    x = jnp.asarray(np.random.default_rng(1).standard_normal(count))
    value, columns = jacobian(curve, x, jnp.ones(count, dtype=bool))
    assert_allclose(value, curve(x), rtol=1e-14)
    assert_allclose(columns, jax.jacfwd(curve)(x), rtol=1e-12, atol=1e-14)


def test_a_chunk_that_stands_for_nothing_is_zero_without_being_computed() -> None:
    """The derivative along dead coordinates would be NaN here."""
    x = jnp.concatenate((jnp.ones(AT_ONCE), jnp.zeros(AT_ONCE)))
    live = jnp.arange(x.size) < AT_ONCE
    _, columns = jacobian(lambda x: jnp.sqrt(x), x, live)
    assert_array_equal(columns[:, AT_ONCE:], 0.0)
    assert_allclose(columns[:AT_ONCE, :AT_ONCE], 0.5 * np.eye(AT_ONCE))
