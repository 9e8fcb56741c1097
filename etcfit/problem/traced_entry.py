"""One entry of a batch as a graph of arithmetic.

A field that is constant over the batch is not read as data: 0 and 1 become constants, another number is read once. This
is determined for each batch (`Shape`) and is part of a kernel's key.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import jax
import numpy as np

from ..kernels.graph import Graph
from ..kernels.loop import Across, Loop
from ..kernels.lowering import lowered


class Column(NamedTuple):
    """One number of each entry."""

    leaf: int  # leaf of the tree of entries, in JAX's order
    place: tuple[int, ...]  # index in the array of one entry


@dataclass(frozen=True)
class Shape:
    """The structure of a batch, without its numbers."""

    tree: Any  # structure of its entries, with the shape of each leaf's array at one entry
    shapes: tuple[tuple[int, ...], ...]  # those shapes
    constant: tuple[tuple[Column, float], ...]  # columns that are 0 or 1 everywhere, with the value
    uniform: tuple[Column, ...]  # columns with another constant value

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:  # needed at every evaluation of a residual
        return hash((self.tree, self.shapes, self.constant, self.uniform))


class TracedEntry:
    """The computation of a function at one entry, as a graph.

    Args:
        function: function of (values by name, carried, entry); it returns the new carry and its results.
        names: names of the values, which are the same for all entries.
        shape: shape of the batch.
        carried: an example of the carry, a tree of numbers and small arrays.
        ties: (name, the name whose value it has).
    Attributes:
        begun, ends: numbers carried into and out of the entry.
        results: the tree of results, nodes for its leaves.
        leaves: leaves that are read at each entry; each is a record.
        columns: all columns of each of these leaves, with their nodes.
        fixed: inputs that are the same at all entries, values and then uniform columns, with their nodes.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        names: Sequence[str],
        shape: Shape,
        carried: Any,
        ties: Sequence[tuple[str, str]] = (),
    ) -> None:
        self.shape = shape
        graph = self.graph = Graph()
        known = {column: graph.constant(value) for column, value in shape.constant}

        def column(name: Column) -> int:
            return known[name] if name in known else graph.input(name)

        leaves = [_named(size, lambda place, k=k: column(Column(k, place))) for k, size in enumerate(shape.shapes)]
        entry = jax.tree.unflatten(shape.tree, leaves)
        values = {name: graph.input(dict(ties).get(name, name)) for name in names}
        examples, tree = jax.tree.flatten(carried)
        begun = [_named(np.shape(e), lambda p, k=k: graph.input(("carried", k, p))) for k, e in enumerate(examples)]
        after, self.results = lowered(function, graph, (values, jax.tree.unflatten(tree, begun), entry))
        self.begun, self.ends = nodes_of(begun), nodes_of(after)
        wanted = [*self.ends, *nodes_of(self.results)]
        used = [(graph.nodes[node][1], node) for node in graph.needed(wanted) if graph.nodes[node][0] == "input"]
        found = {name: node for name, node in used if isinstance(name, Column) and name not in shape.uniform}
        self.leaves = tuple(sorted({column.leaf for column in found}))
        every = ([Column(k, place) for place in np.ndindex(shape.shapes[k])] for k in self.leaves)
        self.columns = tuple({c: found.get(c, graph.input(("not read", c))) for c in leaf} for leaf in every)
        self.fixed: dict[Any, int] = {name: graph.input(name) for name in names}
        self.fixed |= {column: graph.input(column) for column in shape.uniform}

    def loop(
        self,
        across: Across,
        carried: Sequence[tuple[int, int]] = (),
        sums: Sequence[Sequence[tuple[int, int]]] = (),
        stored: Sequence[int] = (),
        blocks: Sequence[int] = (),
        common: frozenset[int] = frozenset(),
    ) -> Loop:
        """A loop that computes entry after entry.

        Args:
            across: the contents of a vector.
            carried: the carry in addition to the entry's own.
            sums, stored, blocks: see `Loop`.
            common: leaves of the entries whose numbers a whole vector shares.
        """
        return Loop(
            self.graph,
            across,
            tuple(tuple(columns.values()) for columns in self.columns),
            tuple(self.fixed.values()),
            (*zip(self.begun, self.ends, strict=True), *carried),
            tuple(map(tuple, sums)),
            tuple(stored),
            tuple(blocks),
            frozenset(k for k, leaf in enumerate(self.leaves) if leaf in common),
        )


def _named(size: tuple[int, ...], node: Callable[[tuple[int, ...]], int]) -> Any:
    """An array of nodes, or one node."""
    if not size:
        return node(())
    out = np.empty(size, dtype=object)
    for place in np.ndindex(size):
        out[place] = node(place)
    return out


def nodes_of(tree: Any) -> list[int]:
    """Every node of a tree, in order."""
    return [int(node) for leaf in jax.tree.leaves(tree) for node in np.ravel(leaf)]
