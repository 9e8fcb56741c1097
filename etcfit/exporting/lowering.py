"""From a function of JAX on scalars to a graph of arithmetic: the model's own code is what is exported.

JAX traces the function once; each primitive of the trace becomes a node. A new effect needs no second implementation:
its expression is traced like any other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from .expressions import OPERATIONS, Graph


class NotScalarError(Exception):
    """A primitive that straight-line scalar arithmetic does not have; its text is the primitive's name."""


_SAME = ("copy", "stop_gradient", "broadcast_in_dim", "reshape", "squeeze", "optimization_barrier", "copy_p")
_RENAMED = {"add_any": "add"}


def lowered(function: Callable[..., Any], graph: Graph, arguments: Any) -> Any:
    """What a function of scalars returns, as nodes of a graph.

    Args:
        function: of `arguments`, whatever JAX can trace; its tree of results has scalars as leaves.
        graph: that takes the nodes.
        arguments: a tuple of trees whose leaves are nodes.
    Returns:
        the function's tree, with nodes as leaves.
    Raises:
        NotScalarError: it computes with arrays, or in loops.
    """
    nodes, tree = jax.tree.flatten(arguments)

    def flat(*leaves: Any) -> Any:
        return function(*jax.tree.unflatten(tree, leaves))

    traced, shapes = jax.make_jaxpr(flat, return_shape=True)(*(jax.ShapeDtypeStruct((), float) for _ in nodes))
    results = _run(graph, traced.jaxpr, traced.consts, nodes)
    return jax.tree.unflatten(jax.tree.structure(shapes), results)


def _run(graph: Graph, jaxpr: Any, constants: Sequence[Any], arguments: Sequence[int]) -> list[int]:
    """Nodes of a traced function's results."""
    values: dict[Any, int] = dict(zip(jaxpr.invars, arguments, strict=True))
    values |= {var: _constant(graph, value) for var, value in zip(jaxpr.constvars, constants, strict=True)}

    def node(atom: Any) -> int:
        return _constant(graph, atom.val) if hasattr(atom, "val") else values[atom]

    for equation in jaxpr.eqns:
        if any(var.aval.shape for var in equation.outvars):
            raise NotScalarError(f"{equation.primitive.name}, of an array")
        results = _equation(graph, equation, [node(atom) for atom in equation.invars])
        values |= dict(zip(equation.outvars, results, strict=True))
    return [node(atom) for atom in jaxpr.outvars]


def _constant(graph: Graph, value: Any) -> int:
    if np.ndim(value):
        raise NotScalarError("a constant array")
    return graph.constant(np.asarray(value).item())


def _equation(graph: Graph, equation: Any, operands: list[int]) -> list[int]:
    """Nodes of what one primitive returns."""
    name, params = equation.primitive.name, equation.params
    inner = params.get("jaxpr") or params.get("call_jaxpr")
    if inner is not None and name not in ("scan", "while"):
        closed = hasattr(inner, "consts")
        return _run(graph, inner.jaxpr if closed else inner, inner.consts if closed else (), operands)
    match name:
        case "select_n" if len(operands) == 3:
            condition, otherwise, chosen = operands
            return [graph.make("choose", condition, chosen, otherwise)]
        case "clamp":
            low, value, high = operands
            return [graph.make("min", graph.make("max", value, low), high)]
        case "integer_pow":
            return [_power(graph, operands[0], params["y"])]
        case "square":
            return [graph.make("mul", operands[0], operands[0])]
        case "rsqrt":
            return [graph.make("div", graph.constant(1.0), graph.make("sqrt", *operands))]
        case "logistic":
            grown = graph.make("exp", graph.make("neg", *operands))
            return [graph.make("div", graph.constant(1.0), graph.make("add", graph.constant(1.0), grown))]
        case "convert_element_type":
            return [_converted(graph, operands[0], equation.invars[0].aval.dtype, params["new_dtype"])]
    if name in _SAME:
        return operands
    name = _RENAMED.get(name, name)
    if name not in OPERATIONS:
        raise NotScalarError(name)
    return [graph.make(name, *operands)]


def _power(graph: Graph, base: int, exponent: int) -> int:
    """base^exponent by multiplications."""
    if exponent < 0:
        return graph.make("div", graph.constant(1.0), _power(graph, base, -exponent))
    if exponent == 0:
        return graph.constant(1.0)
    half = _power(graph, base, exponent // 2)
    whole = graph.make("mul", half, half)
    return graph.make("mul", whole, base) if exponent % 2 else whole


def _converted(graph: Graph, node: int, before: Any, after: Any) -> int:
    if np.dtype(before) == bool and np.dtype(after) != bool:
        return graph.make("number", node)
    if np.dtype(before) == np.dtype(after) or {np.dtype(before).kind, np.dtype(after).kind} <= {"f"}:
        return node
    raise NotScalarError(f"convert_element_type from {before} to {after}")
