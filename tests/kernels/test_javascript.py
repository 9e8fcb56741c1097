"""What is printed as JavaScript is what the graph computes; what JavaScript lacks is refused by name."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from etcfit.kernels.graph import CONDITIONS, OPERATIONS, Graph
from etcfit.kernels.infix import NotWrittenError
from etcfit.kernels.javascript import PRELUDE, WRITTEN, literal, method, program
from etcfit.kernels.lowering import NotScalarError, lowered

NODE = shutil.which("node")
in_node = pytest.mark.skipif(NODE is None, reason="no node on PATH")
LACKING = {"erf", "erfc"}
POINTS = ((0.3, 0.7), (0.9, 0.2), (0.5, 0.5))  # where every function is real
FROM_ONE_ON = {"acosh"}


def run(graph: Graph, nodes: list[int], at: dict[str, float]) -> list[float]:
    """Values of nodes by their JavaScript, whose inputs are x.NAME."""
    words = f"{PRELUDE} const m = {{ {method('f', ['x'], graph, nodes)} }}; const out = []; m.f({json.dumps(at)}, out);"
    words += "console.log(JSON.stringify(out.map((each) => String(Number(each)))));"
    done = subprocess.run([NODE or "node", "-e", words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return [float(each) for each in json.loads(done.stdout)]


@in_node
@pytest.mark.parametrize("at", POINTS)
def test_every_operation_is_what_the_graph_takes_it_for(at: tuple[float, float]) -> None:
    graph = Graph()
    inputs, shift = [graph.input("x.a"), graph.input("x.b")], graph.constant(1.0)
    names, nodes, wanted = [], [], []
    for name, function in OPERATIONS.items():
        if name in LACKING:
            continue
        operands, values = _operands(graph, name, inputs, at, shift)
        names.append(name)
        nodes.append(graph.make(name, *operands))
        wanted.append(float(function(*values)))
    assert len(names) == len(WRITTEN)
    got = run(graph, nodes, {"a": at[0], "b": at[1]})
    assert dict(zip(names, got, strict=True)) == pytest.approx(dict(zip(names, wanted, strict=True)), rel=1e-14)


def _operands(
    graph: Graph, name: str, inputs: list[int], at: tuple[float, float], shift: int
) -> tuple[list[int], list[Any]]:
    a, b = inputs
    less, is_less = graph.make("lt", a, b), at[0] < at[1]
    if name in ("not", "number"):
        return [less], [is_less]
    if name in ("and", "or"):
        more = graph.make("gt", a, graph.constant(0.4))
        return [less, more], [is_less, at[0] > 0.4]
    if name == "choose":
        return [less, a, b], [is_less, *at]
    if name == "clamp":
        return [a, shift, b], [at[0], 1.0, at[1]]
    if name in FROM_ONE_ON:
        return [graph.make("add", a, shift)], [at[0] + 1.0]
    two = name in CONDITIONS - {"is_finite"} or name in ("add", "sub", "mul", "div", "max", "min", "pow", "atan2")
    return (inputs, list(at)) if two else ([a], [at[0]])


def wild(a: Any, b: Any) -> Any:
    bent = jnp.where(a > b, jnp.sin(a) ** 3, jnp.clip(b, -0.5, 0.5)) / (1.0 + a * a)
    nested = jnp.where((a > b) == (b > 0.0), -(a - b), jnp.where(a < 0.0, a, b)) - -2.0
    return bent - -b, nested, jnp.abs(a) ** 1.5, a**-2 - (b - (a - b)), jax.nn.sigmoid(a * b), 2.0 - a / b * b


@in_node
@pytest.mark.parametrize("at", [(0.3, 0.7), (2.0, -1.5), (-0.4, 0.9), (1.1, 1.1)])
def test_an_expression_keeps_its_order(at: tuple[float, float]) -> None:
    graph = Graph()
    nodes = jax.tree.leaves(lowered(wild, graph, (graph.input("x.a"), graph.input("x.b"))))
    assert run(graph, nodes, {"a": at[0], "b": at[1]}) == pytest.approx([float(v) for v in wild(*at)], rel=1e-14)


@in_node
def test_the_nearest_whole_number_of_a_half_is_the_even_one() -> None:
    graph = Graph()
    below_half = 0.5 - 2.0**-54
    values = [0.5, 1.5, 2.5, -0.5, -1.5, -2.5, 0.3, -0.7, below_half, 1.0 - 2.0**-53, 1e300, -3.0, 2.0**52 + 1.0]
    node = lowered(jnp.round, graph, (graph.input("x.a"),))
    assert [run(graph, [node], {"a": value})[0] for value in values] == np.round(values).tolist()


def test_another_rounding_is_refused() -> None:
    graph = Graph()
    with pytest.raises(NotScalarError, match="round"):
        lowered(lambda a: jax.lax.round(a, jax.lax.RoundingMethod.AWAY_FROM_ZERO), graph, (graph.input("x.a"),))


@pytest.mark.parametrize("name", sorted(LACKING))
def test_what_javascript_lacks_is_refused_by_name(name: str) -> None:
    graph = Graph()
    with pytest.raises(NotWrittenError, match=f"^{name}$"):
        program(graph, [graph.make(name, graph.input("x.a"))])


@in_node
def test_the_results_may_take_the_place_of_an_argument() -> None:
    graph = Graph()
    first, then = graph.input("x[0]"), graph.input("x[1]")
    words = f"const m = {{ {method('swap', ['x'], graph, [then, graph.make('neg', first)])} }}; const x = [1, 2];"
    words += "m.swap(x, x); console.log(x.join());"
    done = subprocess.run([NODE or "node", "-e", words], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "2,-1"


@in_node
def test_numbers_that_are_none_are_seen() -> None:
    graph = Graph()
    a, zero = graph.input("x.a"), graph.constant(0.0)
    root = graph.make("sqrt", a)
    nodes = [graph.make("max", root, zero), graph.make("is_finite", root), graph.constant(math.inf)]
    none, finite, most = run(graph, nodes, {"a": -1.0})
    assert math.isnan(none)
    assert (finite, most) == (0.0, math.inf)


@pytest.mark.parametrize("number", [0.1, -1e-300, 1.0, 2.0**60, math.pi])
def test_a_constant_keeps_every_digit(number: float) -> None:
    assert float(literal(number)) == number
    assert (literal(True), literal(-math.inf), literal(math.nan)) == ("true", "-Infinity", "NaN")
