"""Derivatives on the graph are those of JAX, where a formula bends too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.backend import compiled_quickly
from etcfit.kernels.derivatives import backward, forward
from etcfit.kernels.graph import Graph
from etcfit.kernels.loop import Across, Loop
from etcfit.kernels.lowering import lowered
from etcfit.kernels.machine import LANES, Kernel

FUNCTIONS: dict[str, Callable[[Any, Any], Any]] = {
    "arithmetic": lambda a, b: a * b - a / b + (a - b) * (-a),
    "largest": jnp.maximum,
    "smallest": jnp.minimum,
    "clamp": lambda a, b: jnp.clip(a, b, 1.5) ** 2,
    "choice": lambda a, b: jnp.where(a > b, jnp.sin(a), jnp.cos(b)),
    "sizes": lambda a, b: jnp.abs(a) * jnp.sign(b) + jnp.floor(a) * b,
    "powers": lambda a, b: jnp.abs(a) ** b + a**-3 + jnp.sqrt(jnp.abs(b)) + jnp.cbrt(a),
    "exponentials": lambda a, b: jnp.exp(a) * jnp.expm1(b) + jnp.log(a * a) - jnp.log1p(b * b),
    "hyperbolic": lambda a, b: jnp.tanh(a) * jnp.cosh(b) - jnp.sinh(a * b) + jnp.arcsinh(a),
    "inverse": lambda a, b: jnp.arctan2(a, b) + jnp.arctan(a) + jnp.arccosh(2.0 + b * b) + jnp.arctanh(0.1 * a),
    "angles": lambda a, b: jnp.tan(a) + jnp.arcsin(0.1 * b) * jnp.arccos(0.1 * a),
    "error function": lambda a, b: jax.scipy.special.erf(a) * jax.scipy.special.erfc(b),
    "small arrays": lambda a, b: jnp.sum(jnp.stack([a, b]) @ jnp.array([[1.0, 2.0], [3.0, a]])),
    "a short loop": lambda a, b: jax.lax.scan(lambda c, x: (c * x + a, None), b, jnp.array([0.5, 2.0, a]))[0],
}
POINTS = ((0.7, -1.3), (-0.4, 0.9), (1.2, 1.2), (2.0, 0.3))


def value(graph: Graph, nodes: list[int], at: tuple[float, float]) -> np.ndarray:
    """Values of nodes, by machine code."""
    fixed = tuple(graph.input(name) for name in "ab")
    kernel = Kernel.made(Loop(graph, Across.LANES, ((),), fixed, (), stored=tuple(nodes)), LANES)
    out = np.empty((1, len(nodes), LANES))
    kernel.run(1, LANES, [out.ctypes.data], np.array(at), np.zeros((0, LANES)), out)
    assert np.ptp(out, axis=2).max() == 0.0
    return out[0, :, 0]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_both_modes_are_the_derivative_of_the_function(name: str) -> None:
    function, graph = FUNCTIONS[name], Graph()
    a, b = graph.input("a"), graph.input("b")
    result = int(lowered(function, graph, (a, b)))
    nodes = graph.needed([result])
    ways = [forward(graph, nodes, {each: graph.constant(1.0)}).get(result, graph.constant(0.0)) for each in (a, b)]
    stored = [result, *ways, *backward(graph, nodes, result, (a, b))]
    theirs = compiled_quickly(jax.value_and_grad(function, argnums=(0, 1)))
    for at in POINTS:
        found = value(graph, stored, at)
        wanted, slopes = theirs(*at)
        assert_allclose(found, [wanted, *slopes, *slopes], rtol=1e-12, atol=1e-14, err_msg=str(at))


def test_what_moves_by_itself_is_not_asked_what_it_is_computed_from() -> None:
    graph = Graph()
    a = graph.input("a")
    inner = graph.make("exp", a)
    outer = graph.make("mul", inner, graph.constant(3.0))
    moved = forward(graph, graph.needed([outer]), {inner: graph.constant(2.0)})
    assert graph.known(moved[outer]) == 6.0
    assert a not in moved


def test_a_sum_and_a_product_are_the_same_either_way_round() -> None:
    graph = Graph()
    a, b = graph.input("a"), graph.input("b")
    for name in ("add", "mul"):
        assert graph.make(name, a, b) == graph.make(name, b, a)
    assert graph.make("sub", a, b) != graph.make("sub", b, a)
