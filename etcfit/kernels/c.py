"""A graph as straight-line C99."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from .graph import Graph


class Written(NamedTuple):
    """How C writes an operation.

    Args:
        text: with {0}, {1} ... for its operands.
        binds: how strongly it holds together; operands that bind less get parentheses.
        operands: how strongly an operand must bind at least.
    """

    text: str
    binds: int
    operands: int


_CALL, _SIGN, _TIMES, _PLUS, _COMPARE, _LOGIC, _CHOICE = 9, 8, 7, 6, 5, 4, 3
_ALONE = 0  # the operand of a call


def _infix(symbol: str, binds: int) -> Written:
    return Written(f"{{0}} {symbol} {{1}}", binds, binds + 1)


def _call(name: str, count: int = 1) -> Written:
    return Written(f"{name}({', '.join(f'{{{k}}}' for k in range(count))})", _CALL, _ALONE)


_ITSELF = (
    "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "erf", "erfc", "sin", "cos", "tan", "asin", "acos", "atan", "sinh",
    "cosh", "tanh", "asinh", "acosh", "atanh", "floor", "ceil", "sign",
)  # fmt: skip

WRITTEN: dict[str, Written] = {
    "add": _infix("+", _PLUS),
    "sub": _infix("-", _PLUS),
    "mul": _infix("*", _TIMES),
    "div": _infix("/", _TIMES),
    "neg": Written("-{0}", _SIGN, _CALL),
    "lt": _infix("<", _COMPARE),
    "le": _infix("<=", _COMPARE),
    "gt": _infix(">", _COMPARE),
    "ge": _infix(">=", _COMPARE),
    "eq": _infix("==", _COMPARE),
    "ne": _infix("!=", _COMPARE),
    "and": _infix("&&", _LOGIC),
    "or": _infix("||", _LOGIC),
    "not": Written("!{0}", _SIGN, _CALL),
    "choose": Written("{0} ? {1} : {2}", _CHOICE, _COMPARE),
    "number": Written("({0} ? 1.0 : 0.0)", _CALL, _COMPARE),
    "is_finite": Written("(isfinite({0}) != 0)", _CALL, _ALONE),
    "max": _call("fmax", 2),
    "min": _call("fmin", 2),
    "clamp": Written("fmin(fmax({1}, {0}), {2})", _CALL, _ALONE),
    "abs": _call("fabs"),
    "round": _call("rint"),
    "pow": _call("pow", 2),
    "atan2": _call("atan2", 2),
    **{name: _call(name) for name in _ITSELF},
}

_WIDEST = 88  # characters of an expression that is used once and written where it is used


class Program(NamedTuple):
    """Straight-line C.

    Args:
        lines: declarations of what is used more than once or is long, in order.
        results: expressions, one for each result asked for.
        calls: names of the functions called.
        inputs: names of the inputs read.
    """

    lines: tuple[str, ...]
    results: tuple[str, ...]
    calls: frozenset[str]
    inputs: frozenset[str]


def program(graph: Graph, results: Sequence[int]) -> Program:
    """C of some nodes of a graph, and of all that they need.

    Args:
        graph: of all nodes.
        results: nodes whose values are wanted.
    """
    needed = graph.needed(results)
    uses = dict.fromkeys(needed, 0)
    for node in (*(k for n in needed for k in graph.operands(n)), *results):
        uses[node] += 1
    lines: list[str] = []
    written: dict[int, tuple[str, int]] = {}
    for node in needed:
        text, binds = _expression(graph, node, written)
        atom = not graph.operands(node)
        if not atom and (uses[node] > 1 or len(text) > _WIDEST):
            name = f"{'c' if graph.is_condition(node) else 'a'}{len(lines)}"
            lines.append(f"const {'int' if graph.is_condition(node) else 'double'} {name} = {text};")
            text, binds = name, _CALL
        written[node] = text, binds
    calls = {name for n in needed if graph.operands(n) for name in _called(graph.nodes[n][0])}
    inputs = {graph.nodes[n][1] for n in needed if graph.nodes[n][0] == "input"}
    return Program(tuple(lines), tuple(written[node][0] for node in results), frozenset(calls), frozenset(inputs))


def _called(operation: str) -> list[str]:
    """The functions that C calls for it; none for an operator."""
    return re.findall(r"[a-z]\w*(?=\()", WRITTEN[operation].text)


def _expression(graph: Graph, node: int, written: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """C of a node whose operands are written, and how strongly it binds."""
    name, *rest = graph.nodes[node]
    if name == "input":
        return rest[0], _CALL
    if name == "constant":
        return literal(rest[1]), _SIGN if rest[1] < 0 else _CALL
    operation = WRITTEN[name]
    return operation.text.format(*_enclosed(operation, rest, written)), operation.binds


def _enclosed(operation: Written, operands: Sequence[int], written: dict[int, tuple[str, int]]) -> Iterator[str]:
    for k, operand in enumerate(operands):
        text, binds = written[operand]
        # a + b + c needs no parentheses: C too begins on the left
        enough = operation.binds if k == 0 and operation.binds in (_PLUS, _TIMES) else operation.operands
        yield text if binds >= enough else f"({text})"


def literal(value: float | bool) -> str:
    """A constant in C, to the last digit."""
    if isinstance(value, bool):
        return str(int(value))
    if math.isinf(value):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(float(value))
