"""Arithmetic as a graph in which equal expressions are one node.

A node is a constant, a named input, or an operation on earlier nodes. Constant operations are computed beforehand.
0 a = 0 and a == a are assumed: if a simulation diverges, another of its numbers is not finite and shows it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Hashable, Iterable
from typing import Any

OPERATIONS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "neg": operator.neg,
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": operator.eq,
    "ne": operator.ne,
    "and": lambda a, b: a and b,
    "or": lambda a, b: a or b,
    "not": operator.not_,
    "choose": lambda c, a, b: a if c else b,
    "number": float,
    "is_finite": math.isfinite,
    "max": max,
    "min": min,
    "clamp": lambda low, a, high: min(max(a, low), high),
    "abs": abs,
    "sign": lambda a: float((a > 0.0) - (a < 0.0)),
    "round": lambda a: float(round(a)),
    "pow": math.pow,
    "atan2": math.atan2,
    **{name: getattr(math, name) for name in (
        "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "erf", "erfc", "sin", "cos", "tan", "asin", "acos", "atan",
        "sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "floor", "ceil",
    )},
}  # fmt: skip
"""Value of each operation, of constants."""

_COMMUTATIVE = frozenset({"add", "mul"})  # commutative to the last bit
CONDITIONS = frozenset({"lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "is_finite"})


class Graph:
    """Nodes by number; a node's operands come before it."""

    def __init__(self) -> None:
        self.nodes: list[tuple[Any, ...]] = []
        self._numbers: dict[tuple[Any, ...], int] = {}

    def input(self, name: Hashable) -> int:
        """A named quantity; in C its name there."""
        return self._number(("input", name))

    def constant(self, value: Any) -> int:
        """A number or a truth value."""
        return self._number(("constant", type(value).__name__, value, math.copysign(1.0, value)))

    def known(self, node: int) -> Any:
        """The value of a constant; None for anything else."""
        return self.nodes[node][2] if self.nodes[node][0] == "constant" else None

    def make(self, name: str, *operands: int) -> int:
        """The operation on these nodes, or its simplification."""
        known = [self.known(node) for node in operands]
        if all(value is not None for value in known):
            try:
                return self.constant(OPERATIONS[name](*known))
            except (ArithmeticError, ValueError):  # as 1/0: C computes it by IEEE 754
                return self._number((name, *operands))
        simpler = self._simpler(name, operands, known)
        if simpler is None and name in _COMMUTATIVE and (name, *operands[::-1]) in self._numbers:
            return self._numbers[name, *operands[::-1]]
        return self._number((name, *operands)) if simpler is None else simpler

    def _number(self, node: tuple[Any, ...]) -> int:
        if node not in self._numbers:
            self._numbers[node] = len(self.nodes)
            self.nodes.append(node)
        return self._numbers[node]

    def _simpler(self, name: str, operands: tuple[int, ...], known: list[Any]) -> int | None:
        """A simpler node of the same value, or None."""
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

    def operands(self, node: int) -> tuple[int, ...]:
        """Operands of an operation; () for a constant or an input."""
        name, *rest = self.nodes[node]
        return tuple(rest) if name in OPERATIONS else ()

    def needed(self, results: Iterable[int], given: Iterable[int] = ()) -> list[int]:
        """These nodes and all nodes that they depend on, operands first.

        Args:
            results: nodes whose values are needed.
            given: nodes with known values, whose operands are not needed.
        """
        given, seen = set(given), set()
        left = list(results)
        while left:
            node = left.pop()
            if node not in seen:
                seen.add(node)
                left.extend(() if node in given else self.operands(node))
        return sorted(seen)

    def is_condition(self, node: int) -> bool:
        """Whether its value is true or false."""
        name, *rest = self.nodes[node]
        if name == "choose":
            return self.is_condition(rest[1])
        return name in CONDITIONS or (name == "constant" and rest[0] == "bool")
