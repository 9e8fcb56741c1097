"""A graph as straight-line text, in any language that writes arithmetic as C does."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from .graph import Graph


class NotWrittenError(Exception):
    """An operation that the language lacks; the text is the operation's name."""


class Written(NamedTuple):
    """How a language writes an operation.

    Args:
        text: with {0}, {1} ... for its operands.
        binds: how strongly it holds together; operands that bind less get parentheses.
        operands: how strongly an operand must bind at least.
    """

    text: str
    binds: int
    operands: int


class Language(NamedTuple):
    """What a language has of its own.

    Args:
        written: how it writes each operation.
        literal: a constant as it writes it, to the last digit.
        number, condition: what stands in front of the name of a number and of a truth value where it is declared.
    """

    written: Mapping[str, Written]
    literal: Callable[[float | bool], str]
    number: str
    condition: str


class Program(NamedTuple):
    """Straight-line text.

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


_CALL, _SIGN, _TIMES, _PLUS, _COMPARE, _LOGIC, _CHOICE = 9, 8, 7, 6, 5, 4, 3
_ALONE = 0  # the operand of a call
_WIDEST = 88  # characters of an expression that is used once and written where it is used


def call(name: str, count: int = 1) -> Written:
    """A function of so many operands."""
    return Written(f"{name}({', '.join(f'{{{k}}}' for k in range(count))})", _CALL, _ALONE)


def calls(text: str) -> Written:
    """Calls within each other, of operands {0}, {1} ..."""
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
"""Operations that C and its heirs write alike."""


def program(graph: Graph, results: Sequence[int], language: Language) -> Program:
    """Text of some nodes of a graph, and of all that they need.

    Args:
        graph: of all nodes; its inputs are named as the language refers to them.
        results: nodes whose values are wanted.
        language: in which.
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
    """The functions that are called for it; none for an operator."""
    return re.findall(r"[A-Za-z][\w.]*(?=\()", operation.text)


def _expression(graph: Graph, node: int, texts: Mapping[int, tuple[str, int]], language: Language) -> tuple[str, int]:
    """Text of a node whose operands are written, and how strongly it binds."""
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
        # a + b + c needs no parentheses: these languages too begin on the left
        enough = operation.binds if k == 0 and operation.binds in (_PLUS, _TIMES) else operation.operands
        yield text if binds >= enough else f"({text})"
