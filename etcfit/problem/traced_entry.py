"""One entry of a batch as a graph of arithmetic: `one_pass.advance` traced, and its derivatives.

What a field of the batch has at every entry is no data: 0 and 1 are taken as such, another number is read once. That is
found out for each batch (`Shape`) and makes part of what a kernel is known by.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import jax
import numpy as np

from ..kernels.derivatives import backward, forward
from ..kernels.graph import Graph
from ..kernels.loop import Across, Loop
from ..kernels.lowering import lowered
from .free_parameters import Form
from .one_pass import Carried, advance, start

_GRAPHS = 256  # traced entries that are remembered, some MB each at most


class Column(NamedTuple):
    """A number of each entry.

    Args:
        leaf: of `one_pass.entries`, in JAX's order.
        place: in the array of one entry.
    """

    leaf: int
    place: tuple[int, ...]


@dataclass(frozen=True)
class Shape:
    """What is known of a batch before its numbers are.

    Args:
        tree: structure of its entries, with the shape of each leaf's array at one entry.
        shapes: those shapes.
        constant: columns that are 0 or 1 everywhere, and which.
        uniform: columns that are some other number everywhere.
        order: error states of its whitening filter.
        renewed: leaves that change with the filter; the others are those of the batch as it was logged.
    """

    tree: Any
    shapes: tuple[tuple[int, ...], ...]
    constant: tuple[tuple[Column, float], ...]
    uniform: tuple[Column, ...]
    order: int
    renewed: frozenset[int]


@lru_cache(maxsize=_GRAPHS)
def traced_entry(form: Form, shape: Shape) -> TracedEntry:
    """The graph of an entry of a model, on a batch of that shape."""
    return TracedEntry(form, shape)


class TracedEntry:
    """The graph of one entry.

    Attributes:
        columns: inputs that are read at each entry, and their nodes: those of the batch, those renewed with the filter.
        fixed: inputs that no entry changes: parameters by symbol, then uniform columns; and their nodes.
    """

    def __init__(self, form: Form, shape: Shape) -> None:
        self.form, self.shape = form, shape
        graph = self.graph = Graph()
        known = {column: graph.constant(value) for column, value in shape.constant}

        def leaf(k: int, size: tuple[int, ...]) -> np.ndarray:
            out = np.empty(size, dtype=object)
            for place in np.ndindex(size):
                column = Column(k, place)
                out[place] = known.get(column, graph.input(column))
            return out

        entry = jax.tree.unflatten(shape.tree, [leaf(k, size) for k, size in enumerate(shape.shapes)])
        ties = dict(form.ties)
        values = {symbol: graph.input(ties.get(symbol, symbol)) for symbol in form.index}
        first = jax.eval_shape(lambda: start(form, dict.fromkeys(form.index, 0.5), (), shape.order))
        self._names, tree = list(range(len(jax.tree.leaves(first)))), jax.tree.structure(first)
        self.begun = [graph.input(("carried", k)) for k in self._names]
        carried = jax.tree.unflatten(tree, self.begun)

        def one(values: Any, carried: Carried, entry: Any) -> Any:
            return advance(form, values, carried, entry)

        after, (seen, r) = lowered(one, graph, (values, carried, entry))
        self.ends = [int(node) for node in jax.tree.leaves(after)]
        self.seen, self.r = ([int(node) for node in np.ravel(each)] for each in (seen, r))
        results = [*self.ends, *self.seen, *self.r]
        used = [(graph.nodes[node][1], node) for node in graph.needed(results) if graph.nodes[node][0] == "input"]
        uniform = set(shape.uniform)
        read = {name: node for name, node in used if isinstance(name, Column) and name not in uniform}
        lasting, renewed = (
            {n: k for n, k in read.items() if (n.leaf in shape.renewed) == new} for new in (False, True)
        )
        self.columns = lasting, renewed
        self.fixed = {s: graph.input(s) for s in form.index} | {c: graph.input(c) for c in shape.uniform}

    @cached_property
    def _slopes(self) -> list[list[int]]:
        """Derivatives of state and memories after the step in those before it, and in each parameter."""
        by = [*self.begun[: self._states], *(self.fixed[symbol] for symbol in self.form.index)]
        ends = self.ends[: self._states]
        return [backward(self.graph, self.graph.needed([end]), end, by) for end in ends]

    @property
    def _states(self) -> int:
        """Numbers that are carried besides the error states of the filter, which come last."""
        return len(self.begun) - self.shape.order

    def _column(self, symbol: str) -> tuple[list[tuple[int, int]], list[int], list[int]]:
        """Along one parameter: what is carried, and the tangents of `r` and `seen`."""
        graph, n = self.graph, self._states
        before = [graph.input(("carried", symbol, k)) for k in self._names]
        zero, place = graph.constant(0.0), n + list(self.form.index).index(symbol)
        after = []
        for row in self._slopes:
            total = row[place]
            for slope, way in zip(row, before[:n], strict=False):
                total = graph.make("add", total, graph.make("mul", slope, way))
            after.append(total)
        moved = dict(zip(self.begun, before, strict=True)) | {self.fixed[symbol]: graph.constant(1.0)}
        moved |= dict(zip(self.ends[:n], after, strict=True))
        rest = [*self.ends[n:], *self.r, *self.seen]
        found = forward(graph, graph.needed(rest, given=self.ends[:n]), moved)
        errors, r, seen = ([found.get(node, zero) for node in nodes] for nodes in (self.ends[n:], self.r, self.seen))
        return list(zip(before, [*after, *errors], strict=True)), r, seen

    def loop(
        self,
        across: Across,
        free: tuple[str, ...] = (),
        summed: bool = False,
        stored: bool = False,
    ) -> Loop:
        """The loop that simulates, observes and whitens.

        Args:
            across: what a vector holds.
            free: parameters in which it is differentiated, P of them.
            summed: whether it adds up r^T r, J^T r and the lower triangle of J^T J, in this order.
            stored: whether it stores what each slot ought to show and the residual, M each, and dr/d each parameter.
        """
        carried, columns = list(zip(self.begun, self.ends, strict=True)), []
        for symbol in free:
            pairs, dr, _ = self._column(symbol)
            carried += pairs
            columns.append(dr)
        sums: list[list[tuple[int, int]]] = []
        if summed:
            sums.append([(each, each) for each in self.r])
            sums += [list(zip(self.r, column, strict=True)) for column in columns]
            sums += [list(zip(columns[i], columns[j], strict=True)) for i in range(len(free)) for j in range(i + 1)]
        kept = [*self.seen, *self.r, *(each for column in columns for each in column)] if stored else []
        return Loop(
            self.graph,
            across,
            tuple(tuple(columns.values()) for columns in self.columns),
            tuple(self.fixed.values()),
            tuple(carried),
            tuple(tuple(pairs) for pairs in sums),
            tuple(kept),
        )
