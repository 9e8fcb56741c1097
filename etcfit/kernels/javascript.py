"""A graph as straight-line JavaScript (ECMAScript 2015).

It has no erf and no erfc; expressions with them are refused.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from .graph import Graph
from .infix import OPERATORS, Language, Program, Written, call, calls
from .infix import program as printed

_OF_MATH = (
    "exp", "expm1", "log", "log1p", "sqrt", "cbrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh",
    "asinh", "acosh", "atanh", "floor", "ceil", "sign", "abs",
)  # fmt: skip

WRITTEN: dict[str, Written] = {
    **OPERATORS,
    "is_finite": call("Number.isFinite"),
    "round": call("rounded"),
    "clamp": calls("Math.min(Math.max({1}, {0}), {2})"),
    **{name: call(f"Math.{name}", 2) for name in ("max", "min", "pow", "atan2")},
    **{name: call(f"Math.{name}") for name in _OF_MATH},
}


PRELUDE = """const rounded = (value) => {
const below = Math.floor(value), rest = value - below;
return rest > 0.5 || (rest === 0.5 && below % 2 !== 0) ? below + 1 : below;
};"""
"""The function in front of the code: the nearest whole number, with ties to even."""


def program(graph: Graph, results: Sequence[int]) -> Program:
    """JavaScript of some nodes of a graph; see `infix.program`. It uses the function in PRELUDE."""
    return printed(graph, results, _JAVASCRIPT)


def method(name: str, arguments: Sequence[str], graph: Graph, results: Sequence[int]) -> str:
    """A method of an object literal that puts the results into its last argument, the array `out`.

        name(arguments, out) { ...; out[0] = ...; out[1] = ...; }

    All results are computed before `out` changes, so that it may be one of the arguments.

    Args:
        name: name of the method.
        arguments: arguments to which the names of the graph's inputs refer, such as x for an input x[0].
        graph, results: see `program`.
    Raises:
        NotWrittenError: JavaScript lacks an operation.
    """
    code = program(graph, results)
    ends = [f"const out{k} = {text};" for k, text in enumerate(code.results)]
    puts = [f"out[{k}] = out{k};" for k in range(len(ends))]
    return "\n".join((f"{name}({', '.join((*arguments, 'out'))}) {{", *code.lines, *ends, *puts, "},"))


def literal(value: float | bool) -> str:
    """A constant in JavaScript, to the last digit."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if math.isinf(value):
        return "Infinity" if value > 0.0 else "-Infinity"
    return repr(float(value)) if math.isfinite(value) else "NaN"


_JAVASCRIPT = Language(WRITTEN, literal, number="const", condition="const")
