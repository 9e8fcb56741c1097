"""What is printed as C is what Python computes; what cannot be printed is refused by name."""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import exports
from effect_samples import Tabled, inputs, made, typical
from etcfit.errors import UsageError
from etcfit.exporting import Source
from etcfit.exporting.plant import plant_of
from etcfit.kernels.c import WRITTEN, literal, program
from etcfit.kernels.graph import OPERATIONS, Graph
from etcfit.kernels.lowering import NotScalarError, lowered
from etcfit.model.effects import EFFECTS, AbstractEffect, State
from etcfit.model.smooth import UNKNOWNS

# C's operators and functions as Python has them: an evaluator that shares no table with what prints
PYTHON: dict[str, Any] = {name: getattr(math, name) for name in dir(math) if not name.startswith("_")} | {
    "fmax": max, "fmin": min, "fabs": abs, "sign": lambda a: float(np.sign(a)), "HUGE_VAL": math.inf,
}  # fmt: skip


def as_python(text: str) -> str:
    """A C expression in Python: ternaries from the inside out."""
    text = text.replace("&&", " and ").replace("||", " or ").replace("!=", "<>").replace("!", " not ")
    text = text.replace("<>", "!=")
    while "?" in text:
        ask = text.rindex("?")
        start = _opening(text, ask)
        colon = text.index(":", ask)
        end = _closing(text, colon)
        c, a, b = text[start:ask], text[ask + 1 : colon], text[colon + 1 : end]
        text = f"{text[:start]}(({a}) if ({c}) else ({b})){text[end:]}"
    return text


def _opening(text: str, at: int) -> int:
    depth = 0
    for k in range(at - 1, -1, -1):
        depth += {")": 1, "(": -1}.get(text[k], 0)
        if depth < 0 or (depth == 0 and text[k] == ","):
            return k + 1
    return 0


def _closing(text: str, at: int) -> int:
    depth = 0
    for k in range(at + 1, len(text)):
        depth += {"(": 1, ")": -1}.get(text[k], 0)
        if depth < 0 or (depth == 0 and text[k] == ","):
            return k
    return len(text)


def value(graph: Graph, nodes: list[int], at: dict[str, float]) -> list[float]:
    """Values of nodes by their C."""
    code = program(graph, nodes)
    names = PYTHON | at
    for line in code.lines:
        name, text = line.removeprefix("const ").rstrip(";").split(" = ", 1)
        names[name.split()[1]] = eval(as_python(text), names)
    return [float(eval(as_python(text), names)) for text in code.results]


def wild(a: Any, b: Any) -> Any:
    bent = jnp.where(a > b, jnp.sin(a) ** 3, jnp.clip(b, -0.5, 0.5)) / (1.0 + a * a)
    return bent - -b, jnp.sign(b) * jnp.abs(a) ** 1.5, a**-2 - (b - (a - b)), jax.nn.sigmoid(a * b), 2.0 - a / b * b


@pytest.mark.parametrize("at", [(0.3, 0.7), (2.0, -1.5), (-0.4, 0.9), (1.1, 1.1)])
def test_an_expression_has_the_same_value_in_c(at: tuple[float, float]) -> None:
    graph = Graph()
    nodes = jax.tree.leaves(lowered(wild, graph, (graph.input("x"), graph.input("y"))))
    assert value(graph, nodes, {"x": at[0], "y": at[1]}) == pytest.approx([float(v) for v in wild(*at)], rel=1e-14)


def test_a_slope_is_lowered_with_its_function() -> None:
    graph = Graph()
    node = lowered(lambda a: jax.jvp(lambda t: jnp.tanh(t * t), (a,), (1.0,))[1], graph, (graph.input("x"),))
    assert value(graph, [node], {"x": 0.6})[0] == pytest.approx(1.2 / math.cosh(0.36) ** 2, rel=1e-14)


def test_constants_are_folded_and_equal_things_are_one() -> None:
    graph = Graph()

    def three(a: Any) -> Any:
        return jnp.exp(a) + jnp.exp(a) * (2.0 * 3.0 - 5.0) + 0.0 * jnp.sqrt(a)

    code = program(graph, [lowered(three, graph, (graph.input("x"),))])
    assert code.lines == ("const double a0 = exp(x);",)
    assert code.results == ("a0 + a0",)
    assert code.calls == {"exp"}


@pytest.mark.parametrize("number", [0.1, -1e-300, 1.0, 2.0**60, math.pi])
def test_a_constant_keeps_every_digit(number: float) -> None:
    assert float(literal(number)) == number


@pytest.mark.parametrize("effect", [*EFFECTS, *UNKNOWNS], ids=lambda effect: effect.name)
def test_every_effect_is_printed_as_it_computes(effect: type[AbstractEffect]) -> None:
    graph, values = Graph(), typical(effect)
    state, z = {"i": 1.3, "theta": 0.4, "omega": -2.0}, {f"z{k}": 0.2 + 0.1 * k for k in range(len(effect.z0))}

    def parts(p: Any, x: Any, z: Any) -> Any:
        return effect(**p)(x, z, inputs())

    asked = ({s: graph.input(s) for s in values}, State(*map(graph.input, state)), tuple(map(graph.input, z)))
    found = lowered(parts, graph, asked)
    wanted = made(effect)(State(*state.values()), tuple(z.values()), inputs())
    got = value(graph, jax.tree.leaves(found), values | state | z)
    assert got == pytest.approx([float(v) for v in jax.tree.leaves(wanted)], rel=1e-12, abs=1e-300)


def test_a_model_of_all_effects_is_printed() -> None:
    every = {effect.name: {} for effect in EFFECTS if effect.off is not None}
    plant = plant_of(exports.source(every))
    assert {m.effect for m in plant.memories} == {effect.name for effect in EFFECTS if effect.z0}
    assert len(plant.advance.results) == 3 + len(plant.memories)


def test_small_arrays_are_taken_apart() -> None:
    def product(a: Any, v: Any) -> Any:
        return (a @ a.T @ v)[1:], jnp.einsum("pq,q->p", a, v).sum(), jnp.concatenate((v[:1], 2.0 * v)).max()

    graph = Graph()
    names = [[f"a{p}{q}" for q in range(2)] for p in range(2)], [f"v{p}" for p in range(2)]
    asked = tuple(np.array([graph.input(n) for n in np.ravel(each)], object).reshape(np.shape(each)) for each in names)
    a, v = np.array([[0.3, -1.0], [2.0, 0.7]]), np.array([1.5, -0.2])
    nodes = [int(n) for leaf in jax.tree.leaves(lowered(product, graph, asked)) for n in np.ravel(leaf)]
    at = dict(zip(np.ravel(names[0]), a.ravel(), strict=True)) | dict(zip(names[1], v, strict=True))
    wanted = np.concatenate([np.ravel(each) for each in product(a, v)])
    assert value(graph, nodes, at) == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("loop", ["array", "while"])
def test_what_is_no_arithmetic_of_numbers_is_refused_with_the_primitive(loop: str) -> None:
    def counted(a: Any) -> Any:
        if loop == "array":
            return jnp.interp(a, jnp.array([0.0, 1.0]), jnp.array([1.0, 2.0]))
        return jax.lax.while_loop(lambda b: b < 10.0, lambda b: 2.0 * b, a)

    graph = Graph()
    with pytest.raises(NotScalarError, match="while" if loop == "while" else "."):
        lowered(counted, graph, (graph.input("x"),))


class WithTabled(Source):
    """A model that has it besides."""

    @property
    def effects(self) -> tuple[type[AbstractEffect], ...]:
        return (*super().effects, Tabled)


def test_the_refusal_names_the_effect_and_the_cure() -> None:
    with pytest.raises(UsageError, match=r"^tabled: its formula uses .*, which is no arithmetic.*lowering\.py"):
        plant_of(WithTabled(exports.source({"quadratic_drag": {}}).fitted))


def test_c_writes_every_operation() -> None:
    assert WRITTEN.keys() == OPERATIONS.keys()
