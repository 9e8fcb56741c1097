"""A graph as straight-line code, in any language with the arithmetic of C."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from .graph import Graph


class NotWrittenError(Exception):
    """An operation that the language lacks; the text is the operation's name."""


class Written(NamedTuple):
    """The form of an operation in a language."""

    text: str  # text with {0}, {1} ... for its operands.
    binds: int  # its precedence; operands with less precedence get parentheses
    operands: int  # least precedence of an operand


class Language(NamedTuple):
    """The properties of a language."""

    written: Mapping[str, Written]  # the form of each operation
    literal: Callable[[float | bool], str]  # prints a constant, to the last digit
    # number, condition: type in the declaration of a number and of a truth value
    number: str
    condition: str


class Program(NamedTuple):
    """Straight-line code."""

    lines: tuple[str, ...]  # declarations of expressions that are long or used more than once, in order
    results: tuple[str, ...]  # expressions, one for each result
    calls: frozenset[str]  # names of the functions called
    inputs: frozenset[str]  # names of the inputs read


_CALL, _SIGN, _TIMES, _PLUS, _COMPARE, _LOGIC, _CHOICE = 9, 8, 7, 6, 5, 4, 3
_ALONE = 0  # the operand of a call
_WIDEST = 88  # largest number of characters of an expression that is used once and not declared


def call(name: str, count: int = 1) -> Written:
    """A function of `count` operands."""
    return Written(f"{name}({', '.join(f'{{{k}}}' for k in range(count))})", _CALL, _ALONE)


def calls(text: str) -> Written:
    """Nested calls of operands {0}, {1} ..."""
    return Written(text, _CALL, _ALONE)


def _infix(symbol: str, binds: int) -> Written:
    return Written(f"{{0}} {symbol} {{1}}", binds, binds + 1)


OPERATORS: Mapping[str, Written] = {
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
}
"""Operations with the same form in C and related languages."""


def program(graph: Graph, results: Sequence[int], language: Language) -> Program:
    """Code of some nodes of a graph, and of all nodes that they need.

    Args:
        graph: the graph of all nodes; its inputs have their names in the language.
        results: nodes whose values are needed.
        language: the language.
    Raises:
        NotWrittenError: the language lacks an operation.
    """
    needed = graph.needed(results)
    uses = dict.fromkeys(needed, 0)
    for node in (*(k for n in needed for k in graph.operands(n)), *results):
        uses[node] += 1
    lines: list[str] = []
    texts: dict[int, tuple[str, int]] = {}
    for node in needed:
        text, binds = _expression(graph, node, texts, language)
        atom = not graph.operands(node)
        if not atom and (uses[node] > 1 or len(text) > _WIDEST):
            condition = graph.is_condition(node)
            name = f"{'c' if condition else 'a'}{len(lines)}"
            lines.append(f"{language.condition if condition else language.number} {name} = {text};")
            text, binds = name, _CALL
        texts[node] = text, binds
    operations = {graph.nodes[n][0] for n in needed if graph.operands(n)}
    called = {name for operation in operations for name in _called(language.written[operation])}
    inputs = {graph.nodes[n][1] for n in needed if graph.nodes[n][0] == "input"}
    return Program(tuple(lines), tuple(texts[node][0] for node in results), frozenset(called), frozenset(inputs))


def _called(operation: Written) -> list[str]:
    """The functions that an operation calls; none for an operator."""
    return re.findall(r"[A-Za-z][\w.]*(?=\()", operation.text)


def _expression(graph: Graph, node: int, texts: Mapping[int, tuple[str, int]], language: Language) -> tuple[str, int]:
    """Code of a node whose operands are written, and its precedence."""
    name, *rest = graph.nodes[node]
    if name == "input":
        return rest[0], _CALL
    if name == "constant":
        return language.literal(rest[1]), _SIGN if rest[1] < 0 else _CALL
    if name not in language.written:
        raise NotWrittenError(name)
    operation = language.written[name]
    return operation.text.format(*_enclosed(operation, rest, texts)), operation.binds


def _enclosed(operation: Written, operands: Sequence[int], texts: Mapping[int, tuple[str, int]]) -> Iterator[str]:
    for k, operand in enumerate(operands):
        text, binds = texts[operand]
        # a + b + c needs no parentheses: these languages evaluate from the left
        enough = operation.binds if k == 0 and operation.binds in (_PLUS, _TIMES) else operation.operands
        yield text if binds >= enough else f"({text})"
