"""Arithmetic as a graph in which equal things are one thing, and which prints itself as straight-line C99.

A node is a constant, a named input, or an operation on earlier nodes. What can be computed beforehand is; 0 a = 0 and
a == a hold besides, since all numbers of a plant are finite.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple


class Operation(NamedTuple):
    """What an operation is in Python and in C.

    Args:
        value: of constants.
        text: in C, with {0}, {1} ... for its operands.
        binds: how strongly its C holds together; operands that bind less get parentheses.
        operands: how strongly an operand must bind at least.
    """

    value: Callable[..., Any]
    text: str
    binds: int
    operands: int


_CALL, _SIGN, _TIMES, _PLUS, _COMPARE, _LOGIC, _CHOICE = 9, 8, 7, 6, 5, 4, 3
_ALONE = 0  # the operand of a call


def _infix(value: Callable[..., Any], symbol: str, binds: int, operands: int | None = None) -> Operation:
    return Operation(value, f"{{0}} {symbol} {{1}}", binds, binds + 1 if operands is None else operands)


def _call(name: str, value: Callable[..., Any], count: int = 1) -> Operation:
    return Operation(value, f"{name}({', '.join(f'{{{k}}}' for k in range(count))})", _CALL, _ALONE)


OPERATIONS: dict[str, Operation] = {
    "add": _infix(operator.add, "+", _PLUS),
    "sub": _infix(operator.sub, "-", _PLUS),
    "mul": _infix(operator.mul, "*", _TIMES),
    "div": _infix(operator.truediv, "/", _TIMES),
    "neg": Operation(operator.neg, "-{0}", _SIGN, _CALL),
    "lt": _infix(operator.lt, "<", _COMPARE),
    "le": _infix(operator.le, "<=", _COMPARE),
    "gt": _infix(operator.gt, ">", _COMPARE),
    "ge": _infix(operator.ge, ">=", _COMPARE),
    "eq": _infix(operator.eq, "==", _COMPARE),
    "ne": _infix(operator.ne, "!=", _COMPARE),
    "and": _infix(lambda a, b: a and b, "&&", _LOGIC),
    "or": _infix(lambda a, b: a or b, "||", _LOGIC),
    "not": Operation(operator.not_, "!{0}", _SIGN, _CALL),
    "choose": Operation(lambda c, a, b: a if c else b, "{0} ? {1} : {2}", _CHOICE, _COMPARE),
    "number": Operation(float, "({0} ? 1.0 : 0.0)", _CALL, _COMPARE),
    "is_finite": Operation(math.isfinite, "(isfinite({0}) != 0)", _CALL, _ALONE),
    "max": _call("fmax", max, 2),
    "min": _call("fmin", min, 2),
    "abs": _call("fabs", abs),
    "sign": _call("sign", lambda a: float((a > 0.0) - (a < 0.0))),
    "pow": _call("pow", math.pow, 2),
    "atan2": _call("atan2", math.atan2, 2),
    **{name: _call(name, getattr(math, name)) for name in (
        "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "erf", "erfc", "sin", "cos", "tan", "asin", "acos", "atan",
        "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "floor", "ceil",
    )},
}  # fmt: skip

_WIDEST = 88  # characters of an expression that is used once and written where it is used


class Graph:
    """Nodes by number; a node's operands come before it."""

    def __init__(self) -> None:
        self.nodes: list[tuple[Any, ...]] = []
        self._numbers: dict[tuple[Any, ...], int] = {}

    def input(self, name: str) -> int:
        """A named quantity, as C has it."""
        return self._number(("input", name))

    def constant(self, value: Any) -> int:
        """A number or a truth value."""
        return self._number(("constant", type(value).__name__, value, math.copysign(1.0, value)))

    def known(self, node: int) -> Any:
        """The value of a constant; None for anything else."""
        return self.nodes[node][2] if self.nodes[node][0] == "constant" else None

    def make(self, name: str, *operands: int) -> int:
        """The operation on these nodes, or what it comes to."""
        known = [self.known(node) for node in operands]
        if all(value is not None for value in known):
            try:
                return self.constant(OPERATIONS[name].value(*known))
            except (ArithmeticError, ValueError):  # as 1/0: C does it as IEEE 754 has it
                return self._number((name, *operands))
        simpler = self._simpler(name, operands, known)
        return self._number((name, *operands)) if simpler is None else simpler

    def _number(self, node: tuple[Any, ...]) -> int:
        if node not in self._numbers:
            self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return self._numbers[node]

    def _simpler(self, name: str, operands: tuple[int, ...], known: list[Any]) -> int | None:
        """A node of the same value; None where the operation is as simple as it gets."""
        a, b = operands[0], operands[-1]
        match name, known:
            case ("add", [0.0, None]) | ("mul", [1.0, None]) | ("and", [True, None]) | ("or", [False, None]):
                return b
            case ("max", [float(low), None]) if low == -math.inf:
                return b
            case ("min", [float(high), None]) if high == math.inf:
                return b
            case ("add" | "sub", [None, 0.0]) | ("mul" | "div", [None, 1.0]):
                return a
            case ("and", [None, True]) | ("or", [None, False]):
                return a
            case ("max", [None, float(low)]) if low == -math.inf:
                return a
            case ("min", [None, float(high)]) if high == math.inf:
                return a
            case ("mul", [0.0, None] | [None, 0.0]) | ("div", [0.0, None]):
                return self.constant(0.0)
            case ("and", [False, None] | [None, False]):
                return self.constant(False)
            case ("or", [True, None] | [None, True]):
                return self.constant(True)
            case ("sub", [0.0, None]) | ("mul", [-1.0, None]):
                return self.make("neg", b)
            case ("mul", [None, -1.0]):
                return self.make("neg", a)
            case ("choose", [bool(met), _, _]):
                return operands[1] if met else operands[2]
            case ("choose", [None, True, False]):
                return a
        if name == "choose" and operands[1] == operands[2]:
            return operands[1]
        if name in ("max", "min", "and", "or") and a == b:
            return a
        if name in ("eq", "le", "ge") and a == b:
            return self.constant(True)
        if name == "sub" and a == b:
            return self.constant(0.0)
        return self._without_signs(name, operands)

    def _without_signs(self, name: str, operands: tuple[int, ...]) -> int | None:
        """-(-a), a + -b and a - -b without their minus signs."""
        a, b = operands[0], operands[-1]
        if self.nodes[b][0] == "neg":
            inner = self.nodes[b][1]
            if name == "neg":
                return inner
            if name in ("add", "sub"):
                return self.make({"add": "sub", "sub": "add"}[name], a, inner)
        if name == "add" and self.nodes[a][0] == "neg":
            return self.make("sub", b, self.nodes[a][1])
        return None


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
    needed = sorted(_needed(graph, results))
    uses = dict.fromkeys(needed, 0)
    for node in (*(k for n in needed for k in _operands(graph, n)), *results):
        uses[node] += 1
    lines: list[str] = []
    written: dict[int, tuple[str, int]] = {}
    for node in needed:
        text, binds = _written(graph, node, written)
        atom = not _operands(graph, node)
        if not atom and (uses[node] > 1 or len(text) > _WIDEST):
            name = f"{'c' if _is_condition(graph, node) else 'a'}{len(lines)}"
            lines.append(f"const {'int' if _is_condition(graph, node) else 'double'} {name} = {text};")
            text, binds = name, _CALL
        written[node] = text, binds
    calls = {name for n in needed if _operands(graph, n) if (name := _called(graph.nodes[n][0]))}
    inputs = {graph.nodes[n][1] for n in needed if graph.nodes[n][0] == "input"}
    return Program(tuple(lines), tuple(written[node][0] for node in results), frozenset(calls), frozenset(inputs))


def _called(operation: str) -> str:
    """The function that C calls for it; "" for an operator."""
    name = OPERATIONS[operation].text.partition("(")[0]
    return name if name.isidentifier() else ""


def _operands(graph: Graph, node: int) -> tuple[int, ...]:
    name, *rest = graph.nodes[node]
    return tuple(rest) if name in OPERATIONS else ()


def _needed(graph: Graph, results: Sequence[int]) -> set[int]:
    seen: set[int] = set()
    left = list(results)
    while left:
        node = left.pop()
        if node not in seen:
            seen.add(node)
            left.extend(_operands(graph, node))
    return seen


def _is_condition(graph: Graph, node: int) -> bool:
    name = graph.nodes[node][0]
    if name == "choose":
        return _is_condition(graph, graph.nodes[node][2])
    return name in ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "is_finite") or (
        name == "constant" and graph.nodes[node][1] == "bool"
    )


def _written(graph: Graph, node: int, written: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """C of a node whose operands are written, and how strongly it binds."""
    name, *rest = graph.nodes[node]
    if name == "input":
        return rest[0], _CALL
    if name == "constant":
        return literal(rest[1]), _SIGN if rest[1] < 0 else _CALL
    operation = OPERATIONS[name]
    return operation.text.format(*_enclosed(operation, rest, written)), operation.binds


def _enclosed(operation: Operation, operands: Sequence[int], written: dict[int, tuple[str, int]]) -> Iterator[str]:
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
