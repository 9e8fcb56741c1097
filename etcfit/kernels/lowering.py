"""From a function of JAX to a graph of arithmetic, so that the model's own code runs.

JAX traces the function once; each primitive of the trace becomes a node for each number that it computes. A new effect
needs no second implementation: its expression is traced like any other. Small arrays, such as the matrices of a filter,
are split into their numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from .graph import OPERATIONS, Graph

Nodes = np.ndarray  # array of objects, the numbers of nodes


class NotScalarError(Exception):
    """A primitive without a form in straight-line arithmetic; the message is the primitive's name."""


_SAME = ("copy", "stop_gradient", "optimization_barrier", "copy_p")
_RESHAPED = ("reshape", "squeeze", "expand_dims")
_RENAMED = {"add_any": "add"}
_LOOPS = ("scan", "while", "cond")
_LONGEST = 32  # largest number of rounds of a loop that is unrolled
_MOST = 4096  # largest number of entries of an array: more are data, not arithmetic


def lowered(function: Callable[..., Any], graph: Graph, arguments: Any) -> Any:
    """The result of a function of numbers and small arrays, as nodes of a graph.

    Args:
        function: a function of `arguments` that JAX can trace.
        graph: the graph to which the nodes are added.
        arguments: a tuple of trees whose leaves are nodes, or arrays of nodes (NumPy arrays of objects).
    Returns:
        The function's tree, with nodes as leaves, or arrays of them.
    Raises:
        NotScalarError: the function has a loop, or a look-up at a computed index.
    """
    leaves, tree = jax.tree.flatten(arguments)

    def flat(*leaves: Any) -> Any:
        return function(*jax.tree.unflatten(tree, leaves))

    shapes = [jax.ShapeDtypeStruct(np.shape(leaf), float) for leaf in leaves]
    traced, shape = jax.make_jaxpr(flat, return_shape=True)(*shapes)
    results = _run(graph, traced.jaxpr, traced.consts, [np.asarray(leaf, dtype=object) for leaf in leaves])
    return jax.tree.unflatten(jax.tree.structure(shape), [r if r.shape else r.item() for r in results])


def _run(graph: Graph, jaxpr: Any, constants: Sequence[Any], arguments: Sequence[Nodes]) -> list[Nodes]:
    """Nodes of a traced function's results."""
    values: dict[Any, Nodes] = dict(zip(jaxpr.invars, arguments, strict=True))
    values |= {var: _constants(graph, value) for var, value in zip(jaxpr.constvars, constants, strict=True)}

    def nodes(atom: Any) -> Nodes:
        return _constants(graph, atom.val) if hasattr(atom, "val") else values[atom]

    for equation in jaxpr.eqns:
        results = _equation(graph, equation, [nodes(atom) for atom in equation.invars])
        values |= dict(zip(equation.outvars, results, strict=True))
    return [nodes(atom) for atom in jaxpr.outvars]


def _constants(graph: Graph, value: Any) -> Nodes:
    array = np.asarray(value)
    if array.size > _MOST:
        raise NotScalarError(f"a constant array of {array.size} numbers")
    return _each(graph.constant, array)


def _each(function: Callable[..., int], *arrays: Any) -> Nodes:
    """Apply a function of one entry of each array, entry by entry."""
    if not any(np.ndim(array) for array in arrays):
        return np.array(function(*(np.asarray(array).item() for array in arrays)), dtype=object)
    arrays = np.broadcast_arrays(*arrays)
    flat = [function(*entries) for entries in zip(*(array.ravel().tolist() for array in arrays), strict=True)]
    out = np.empty(len(flat), dtype=object)
    out[:] = flat
    return out.reshape(arrays[0].shape)


def _equation(graph: Graph, equation: Any, operands: list[Nodes]) -> list[Nodes]:
    """Nodes of the results of one primitive."""
    name, params = equation.primitive.name, equation.params
    if name == "scan" and params["length"] <= _LONGEST:
        return _unrolled(graph, params, operands)
    if name == "split":
        return np.split(operands[0], np.cumsum(params["sizes"])[:-1], axis=params["axis"])
    inner = params.get("jaxpr") or params.get("call_jaxpr") or params.get("fun_jaxpr")
    if inner is not None and name not in _LOOPS:
        closed = hasattr(inner, "consts")
        return _run(graph, inner.jaxpr if closed else inner, inner.consts if closed else (), operands)
    shaped = _shaped(graph, name, params, operands, equation)
    return [_each(_entrywise(graph, equation), *operands) if shaped is None else shaped]


def _unrolled(graph: Graph, params: Any, operands: list[Nodes]) -> list[Nodes]:
    """A short loop, unrolled."""
    body, constants, carried = params["jaxpr"], params["num_consts"], params["num_carry"]
    fixed, state, entries = operands[:constants], operands[constants:][:carried], operands[constants + carried :]
    rounds = range(params["length"])
    stacked = []
    for k in reversed(rounds) if params["reverse"] else rounds:
        given = [*fixed, *state, *(np.asarray(each[k], dtype=object) for each in entries)]
        after = _run(graph, body.jaxpr, body.consts, given)
        state, out = after[:carried], after[carried:]
        stacked.append(out)
    stacked = stacked[::-1] if params["reverse"] else stacked
    return [*state, *(np.stack(each) for each in zip(*stacked, strict=True))]


def _shaped(graph: Graph, name: str, params: Any, operands: list[Nodes], equation: Any) -> Nodes | None:
    """Nodes of a primitive that orders, picks or adds entries; None for any other."""
    match name:
        case _ if name in _SAME:
            return operands[0]
        case _ if name in _RESHAPED:
            return operands[0].reshape(equation.outvars[0].aval.shape)
        case "iota":
            along = np.arange(params["shape"][params["dimension"]], dtype=params["dtype"])
            shape = [1] * len(params["shape"])
            shape[params["dimension"]] = along.size
            return _constants(graph, np.broadcast_to(along.reshape(shape), params["shape"]))
        case "transpose":
            return operands[0].transpose(params["permutation"])
        case "broadcast_in_dim":
            shape = [1] * len(params["shape"])
            for axis, to in enumerate(params["broadcast_dimensions"]):
                shape[to] = operands[0].shape[axis]
            return np.broadcast_to(operands[0].reshape(shape), params["shape"])
        case "slice":
            strides = params["strides"] or (1,) * operands[0].ndim
            bounds = zip(params["start_indices"], params["limit_indices"], strides, strict=True)
            return operands[0][tuple(slice(*each) for each in bounds)]
        case "concatenate":
            return np.concatenate(operands, axis=params["dimension"])
        case "stack":
            return np.stack(operands, axis=params["axis"])
        case "reduce_sum" | "reduce_max" | "reduce_min":
            joins = {"reduce_sum": "add", "reduce_max": "max", "reduce_min": "min"}[name]
            return _reduced(graph, joins, operands[0], params["axes"])
        case "dot_general":
            return _product(graph, operands[0], operands[1], params["dimension_numbers"])
    return None


def _reduced(graph: Graph, joins: str, array: Nodes, axes: Sequence[int]) -> Nodes:
    for axis in sorted(axes, reverse=True):
        parts = list(np.moveaxis(array, axis, 0))
        array = np.asarray(parts[0], dtype=object)
        for part in parts[1:]:
            array = _each(lambda a, b: graph.make(joins, a, b), array, part)
    return array


def _product(graph: Graph, a: Nodes, b: Nodes, numbers: Any) -> Nodes:
    """Product of two arrays over their contracted axes; batch axes come first, as in JAX."""
    (over_a, over_b), (batch_a, batch_b) = numbers
    rest_a = [k for k in range(a.ndim) if k not in (*over_a, *batch_a)]
    rest_b = [k for k in range(b.ndim) if k not in (*over_b, *batch_b)]
    batch = [a.shape[k] for k in batch_a]
    left, right = [a.shape[k] for k in rest_a], [b.shape[k] for k in rest_b]
    a = a.transpose([*batch_a, *rest_a, *over_a]).reshape(*batch, *left, *[1] * len(right), -1)
    b = b.transpose([*batch_b, *rest_b, *over_b]).reshape(*batch, *[1] * len(left), *right, -1)
    terms = _each(lambda a, b: graph.make("mul", a, b), a, b)
    return _reduced(graph, "add", terms, (terms.ndim - 1,))


def _entrywise(graph: Graph, equation: Any) -> Callable[..., int]:
    """The operation of a primitive on one entry of each of its operands."""
    name, params, make = equation.primitive.name, equation.params, graph.make
    match name:
        case "select_n" if len(equation.invars) == 3:
            return lambda condition, otherwise, chosen: make("choose", condition, chosen, otherwise)
        case "clamp":
            return lambda low, value, high: _clamped(graph, low, value, high)
        case "round" if params["rounding_method"] != jax.lax.RoundingMethod.TO_NEAREST_EVEN:
            raise NotScalarError("round, away from zero")
        case "integer_pow":
            return lambda base: _power(graph, base, params["y"])
        case "square":
            return lambda base: make("mul", base, base)
        case "rsqrt":
            return lambda base: make("div", graph.constant(1.0), make("sqrt", base))
        case "logistic":
            one = graph.constant(1.0)
            return lambda base: make("div", one, make("add", one, make("exp", make("neg", base))))
        case "round" if params["rounding_method"] != jax.lax.RoundingMethod.TO_NEAREST_EVEN:
            raise NotScalarError("round with halves away from zero")
        case "convert_element_type":
            before, after = equation.invars[0].aval.dtype, params["new_dtype"]
            return lambda node: _converted(graph, node, before, after)
    name = _RENAMED.get(name, name)
    if name not in OPERATIONS:
        raise NotScalarError(name)
    return lambda *operands: make(name, *operands)


def _clamped(graph: Graph, low: int, value: int, high: int) -> int:
    if graph.known(low) == -np.inf:
        return graph.make("min", value, high)
    return graph.make("max", value, low) if graph.known(high) == np.inf else graph.make("clamp", low, value, high)


def _power(graph: Graph, base: int, exponent: int) -> int:
    """base^exponent by multiplications."""
    if exponent < 0:
        return _power(graph, graph.make("div", graph.constant(1.0), base), -exponent)
    if exponent == 0:
        return graph.constant(1.0)
    half = _power(graph, base, exponent // 2)
    whole = graph.make("mul", half, half)
    return graph.make("mul", whole, base) if exponent % 2 else whole


def _converted(graph: Graph, node: int, before: Any, after: Any) -> int:
    if np.dtype(before) == bool and np.dtype(after) != bool:
        return graph.make("number", node)
    if (value := graph.known(node)) is not None:
        return graph.constant(np.dtype(after).type(value).item())
    if np.dtype(before) == np.dtype(after) or {np.dtype(before).kind, np.dtype(after).kind} <= {"f"}:
        return node
    raise NotScalarError(f"convert_element_type from {before} to {after}")
