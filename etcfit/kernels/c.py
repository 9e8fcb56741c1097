"""A graph as straight-line C99."""

from __future__ import annotations

import math
from collections.abc import Sequence

from .graph import Graph
from .infix import OPERATORS, Language, Program, Written, call, calls
from .infix import program as printed

_ITSELF = (
    "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "erf", "erfc", "sin", "cos", "tan", "asin", "acos", "atan", "sinh",
    "cosh", "tanh", "asinh", "acosh", "atanh", "floor", "ceil", "sign",
)  # fmt: skip

WRITTEN: dict[str, Written] = {
    **OPERATORS,
    "is_finite": calls("(isfinite({0}) != 0)"),
    "max": call("fmax", 2),
    "min": call("fmin", 2),
    "clamp": calls("fmin(fmax({1}, {0}), {2})"),
    "abs": call("fabs"),
    "round": call("rint"),
    "pow": call("pow", 2),
    "atan2": call("atan2", 2),
    **{name: call(name) for name in _ITSELF},
}


def program(graph: Graph, results: Sequence[int]) -> Program:
    """C of some nodes of a graph; see `infix.program`. It takes `sign` for a function of its own."""
    return printed(graph, results, _C)


def literal(value: float | bool) -> str:
    """A constant in C, to the last digit."""
    if isinstance(value, bool):
        return str(int(value))
    if math.isinf(value):
        return "HUGE_VAL" if value > 0.0 else "-HUGE_VAL"
    return repr(float(value))


_C = Language(WRITTEN, literal, number="const double", condition="const int")
