"""Effects that cannot be printed as straight-line code: those with loops or look-ups, or with functions that a language
lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax

from ..kernels.graph import Graph
from ..kernels.infix import NotWrittenError
from ..kernels.lowering import NotScalarError, lowered
from .effects import AbstractEffect, Inputs, State
from .parameters import parameters_of
from .throttle import Throttle


def refused(
    types: Sequence[type[AbstractEffect]], program: Callable[[Graph, Sequence[int]], object]
) -> tuple[type[AbstractEffect], ...]:
    """The effects that cannot be printed in a language, each tried by itself.

    Args:
        program: the language's printer; prints nodes of a graph or raises NotWrittenError.
    """
    return tuple(effect for effect in types if not _is_held(effect, program))


def _is_held(effect: type[AbstractEffect], program: Callable[[Graph, Sequence[int]], object]) -> bool:
    graph = Graph()
    given: dict[str, Any] = {name: graph.input(name) for name in Inputs._fields[:8]}
    values = {p.symbol: graph.input(p.symbol) for p in parameters_of(effect)}
    x, z = State(*map(graph.input, State._fields)), tuple(graph.input(f"z{k}") for k in range(len(effect.z0)))

    def contribution(values: Any, x: State, z: Any, u: Inputs) -> Any:
        return Throttle.build((effect,), values)(x, z, u)

    try:
        program(graph, jax.tree.leaves(lowered(contribution, graph, (values, x, z, Inputs(**given)))))
    except (NotScalarError, NotWrittenError):
        return False
    return True
