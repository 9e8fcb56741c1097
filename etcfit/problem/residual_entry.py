"""One entry of the residual as a graph, and its tangents along parameters.

The step has its local Jacobian by backward mode; columns are pushed by that, and go forward through what is shown and
whitened.
"""

from __future__ import annotations

from functools import cached_property, partial

import jax

from ..kernels.derivatives import backward, forward
from ..kernels.loop import Across, Loop
from .free_parameters import Form
from .one_pass import advance, start
from .traced_entry import Shape, TracedEntry, nodes_of


class ResidualEntry:
    """`one_pass.advance` of a model, traced.

    Args:
        form: the model.
        shape: of the batch.
        order: error states of the whitening filter.
    Attributes:
        traced: its graph.
        seen, r: nodes of what each slot ought to show, and of the residual.
    """

    def __init__(self, form: Form, shape: Shape, order: int) -> None:
        carried = jax.eval_shape(lambda: start(form, dict.fromkeys(form.index, 0.5), (), order))
        self.symbols = tuple(form.index)
        self.traced = TracedEntry(partial(advance, form), self.symbols, shape, carried, form.ties)
        self.seen, self.r = map(nodes_of, self.traced.results)
        self._states = len(self.traced.begun) - order  # the error states of the filter come last

    @cached_property
    def _slopes(self) -> list[list[int]]:
        """Derivatives of state and memories after the step in those before it, and in each parameter."""
        graph, n = self.traced.graph, self._states
        by = [*self.traced.begun[:n], *(self.traced.fixed[symbol] for symbol in self.symbols)]
        return [backward(graph, graph.needed([end]), end, by) for end in self.traced.ends[:n]]

    def _column(self, symbol: str) -> tuple[list[tuple[int, int]], list[int]]:
        """Along one parameter: what is carried, and the tangents of `r`."""
        graph, n, begun, ends = self.traced.graph, self._states, self.traced.begun, self.traced.ends
        before = [graph.input(("carried", symbol, k)) for k in range(len(begun))]
        zero, place = graph.constant(0.0), n + self.symbols.index(symbol)
        after = []
        for row in self._slopes:
            total = row[place]
            for slope, way in zip(row[:n], before[:n], strict=True):
                total = graph.make("add", total, graph.make("mul", slope, way))
            after.append(total)
        moved = dict(zip(begun, before, strict=True)) | {self.traced.fixed[symbol]: graph.constant(1.0)}
        moved |= dict(zip(ends[:n], after, strict=True))
        rest = [*ends[n:], *self.r]
        found = forward(graph, graph.needed(rest, given=ends[:n]), moved)
        errors, r = ([found.get(node, zero) for node in nodes] for nodes in (ends[n:], self.r))
        return list(zip(before, [*after, *errors], strict=True)), r

    def residual_loop(
        self, across: Across, free: tuple[str, ...] = (), summed: bool = False, stored: bool = False
    ) -> Loop:
        """The loop that simulates, observes and whitens.

        Args:
            across: what a vector holds.
            free: parameters in which it is differentiated, P of them.
            summed: whether it adds up r^T r, J^T r and the lower triangle of J^T J, in this order.
            stored: whether it stores what each slot ought to show and the residual, M each, and dr/d each parameter.
        """
        carried, columns = [], []
        for symbol in free:
            pairs, dr = self._column(symbol)
            carried += pairs
            columns.append(dr)
        sums: list[list[tuple[int, int]]] = []
        if summed:
            sums.append([(each, each) for each in self.r])
            sums += [list(zip(self.r, column, strict=True)) for column in columns]
            sums += [list(zip(columns[i], columns[j], strict=True)) for i in range(len(free)) for j in range(i + 1)]
        kept = [*self.seen, *self.r, *(each for column in columns for each in column)] if stored else []
        return self.traced.loop(across, carried, sums, kept)
