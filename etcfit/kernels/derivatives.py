"""Derivatives on the graph: forward along a direction, backward from a result.

Each operation has its partial derivatives as nodes of the same graph; conditions have none. If two operands of a
maximum are equal each counts half, and a clamped number on its bound has derivative 0, as in JAX.

Source: Griewank and Walther 2008, ch. 3. Differs from source: no.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from .graph import CONDITIONS, Graph

_STILL = CONDITIONS | {"sign", "number", "floor", "ceil", "round"}


def forward(graph: Graph, nodes: Sequence[int], ways: Mapping[int, int]) -> dict[int, int]:
    """Tangents along a direction.

    Args:
        graph: the graph of all nodes, to which nodes are added.
        nodes: nodes to differentiate, operands first.
        ways: given tangents, by node, which replace computed ones.
    Returns:
        The tangent of each node that has one; for the others it is 0.
    """
    moved = dict(ways)
    for node in nodes:
        if node in moved:
            continue
        total = None
        for operand, partial in _partials(graph, node, moved):
            term = _times(graph, moved[operand], partial)
            total = term if total is None else graph.make("add", total, term)
        if total is not None and graph.known(total) != 0.0:
            moved[node] = total
    return moved


def backward(graph: Graph, nodes: Sequence[int], result: int, by: Sequence[int]) -> list[int]:
    """Derivatives of one node in others.

    Args:
        graph: the graph of all nodes, to which nodes are added.
        nodes: the result and all nodes that it depends on, operands first.
        result: the node to differentiate.
        by: the nodes in which it is differentiated.
    """
    moving = set(by)
    for node in nodes:
        if any(operand in moving for operand in graph.operands(node)):
            moving.add(node)
    sums = {result: graph.constant(1.0)}
    for node in reversed(nodes):
        if node not in sums or node in by:
            continue
        for operand, partial in _partials(graph, node, moving):
            term = _times(graph, sums[node], partial)
            if graph.known(term) != 0.0:
                sums[operand] = graph.make("add", sums[operand], term) if operand in sums else term
    return [sums.get(node, graph.constant(0.0)) for node in by]


class _Branch(tuple[int, bool]):
    """A condition, and whether it must hold: a partial derivative that is 1 there and 0 elsewhere."""


def _times(graph: Graph, way: int, partial: int | _Branch) -> int:
    if isinstance(partial, _Branch):
        (condition, holds), zero = partial, graph.constant(0.0)
        return graph.make("choose", condition, way, zero) if holds else graph.make("choose", condition, zero, way)
    return graph.make("mul", way, partial)


def _partials(graph: Graph, node: int, moving: Collection[int]) -> Iterator[tuple[int, int | _Branch]]:
    """Each operand of a node that has a tangent, and the derivative of the node in it."""
    operation = graph.nodes[node][0]
    if operation in _STILL:
        return
    for place, operand in enumerate(graph.operands(node)):
        if operand in moving and not graph.is_condition(operand):
            yield operand, _partial(graph, operation, node, place)


def _partial(graph: Graph, operation: str, node: int, place: int) -> int | _Branch:
    """Derivative of a node in one of its operands, the first, second ... of its operation."""
    make, number = graph.make, graph.constant
    operands = graph.operands(node)
    a, b = operands[0], operands[-1]
    one = number(1.0)

    def squared(n: int) -> int:
        return make("mul", n, n)

    match operation, place:
        case ("add", _) | ("sub", 0):
            return one
        case ("sub", 1) | ("neg", _):
            return number(-1.0)
        case ("mul", _):
            return operands[1 - place]
        case ("div", 0):
            return make("div", one, b)
        case ("div", 1):
            return make("neg", make("div", node, b))
        case ("choose", 1 | 2):
            return _Branch((a, place == 1))
        case ("max" | "min", _):
            apart = make("gt" if operation == "max" else "lt", a, b)
            halves = make("choose", make("eq", a, b), number(0.5), number(0.0 if place == 0 else 1.0))
            return make("choose", apart, number(1.0 - place), halves)
        case ("clamp", _):
            low, value, high = operands
            within = make("and", make("gt", value, low), make("lt", value, high))
            return _Branch(((make("gt", low, value), within, make("lt", high, value))[place], True))
        case ("abs", _):
            return make("sign", a)
        case ("pow", 0):
            return make("mul", b, make("pow", a, make("sub", b, one)))
        case ("pow", 1):
            return make("mul", node, make("log", a))
        case ("atan2", _):
            across = (b, make("neg", a))[place]
            return make("div", across, make("add", squared(a), squared(b)))
        case ("exp", _):
            return node
        case ("expm1", _):
            return make("add", node, one)
        case ("log", _):
            return make("div", one, a)
        case ("log1p", _):
            return make("div", one, make("add", one, a))
        case ("sqrt", _):
            return make("div", number(0.5), node)
        case ("cbrt", _):
            return make("div", number(1.0 / 3.0), squared(node))
        case ("erf" | "erfc", _):
            bell = make("exp", make("neg", squared(a)))
            slope = 2.0 / math.sqrt(math.pi)
            return make("mul", number(slope if operation == "erf" else -slope), bell)
        case ("sin", _):
            return make("cos", a)
        case ("cos", _):
            return make("neg", make("sin", a))
        case ("tan", _):
            return make("add", one, squared(node))
        case ("asin" | "acos", _):
            root = make("sqrt", make("sub", one, squared(a)))
            return make("div", number(1.0 if operation == "asin" else -1.0), root)
        case ("atan", _):
            return make("div", one, make("add", one, squared(a)))
        case ("sinh", _):
            return make("cosh", a)
        case ("cosh", _):
            return make("sinh", a)
        case ("tanh", _):
            return make("sub", one, squared(node))
        case ("asinh", _):
            return make("div", one, make("sqrt", make("add", squared(a), one)))
        case ("acosh", _):
            return make("div", one, make("sqrt", make("sub", squared(a), one)))
        case ("atanh", _):
            return make("div", one, make("sub", one, squared(a)))
    raise NotImplementedError(f"no derivative of {operation!r} in its operand {place}")
