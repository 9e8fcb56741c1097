"""One entry of a simulation as a graph, and its tangents along parameters.

Backward mode gives the local Jacobian of the step; it propagates the columns, which then go forward through observation
and whitening.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any

from ..kernels.derivatives import backward, forward
from ..kernels.loop import Across, Loop
from .free_parameters import Form
from .one_pass import advance, carried_like
from .traced_entry import Shape, TracedEntry, nodes_of


class SimulatedEntry:
    """A function of (form, values, carry, entry) that makes a step, traced.

    Args:
        function: returns the new carry, see `one_pass.start`, and its results.
        form: the model.
        shape: shape of the batch.
        order: number of error states of the whitening filter.
    Attributes:
        traced: its graph.
        results: nodes that are differentiated.
        acting: nodes of the acting input, if its derivatives in parameters are given at each entry.
        ways: nodes of these derivatives, by parameter.
    """

    results: Sequence[int] = ()
    acting: Sequence[int] = ()
    ways: Mapping[str, Sequence[int]] = {}

    def __init__(self, function: Callable[..., Any], form: Form, shape: Shape, order: int) -> None:
        self.symbols = tuple(form.index)
        self.traced = TracedEntry(partial(function, form), self.symbols, shape, carried_like(form, order), form.ties)
        self._states = len(self.traced.begun) - order  # the error states of the filter come last

    @cached_property
    def _slopes(self) -> list[list[int]]:
        """Derivatives of state and memories after the step in those before it, in each parameter, and in the input."""
        graph, n = self.traced.graph, self._states
        by = [*self.traced.begun[:n], *(self.traced.fixed[symbol] for symbol in self.symbols), *self.acting]
        return [backward(graph, graph.needed([end]), end, by) for end in self.traced.ends[:n]]

    def _column(self, symbol: str) -> tuple[list[tuple[int, int]], list[int]]:
        """Tangents of the carry and of `results` along one parameter."""
        graph, n, begun, ends = self.traced.graph, self._states, self.traced.begun, self.traced.ends
        before = [graph.input(("carried", symbol, k)) for k in range(len(begun))]
        zero, place, acts = graph.constant(0.0), n + self.symbols.index(symbol), self.ways.get(symbol, ())
        after = []
        for row in self._slopes:
            total = row[place]
            pushed = [*zip(row[:n], before[:n], strict=True), *zip(row[n + len(self.symbols) :], acts, strict=False)]
            for slope, way in pushed:
                total = graph.make("add", total, graph.make("mul", slope, way))
            after.append(total)
        moved = dict(zip(begun, before, strict=True)) | {self.traced.fixed[symbol]: graph.constant(1.0)}
        moved |= dict(zip(self.acting, acts, strict=False)) | dict(zip(ends[:n], after, strict=True))
        rest = [*ends[n:], *self.results]
        found = forward(graph, graph.needed(rest, given=ends[:n]), moved)
        errors, tangents = ([found.get(node, zero) for node in nodes] for nodes in (ends[n:], self.results))
        return list(zip(before, [*after, *errors], strict=True)), tangents

    def loop(
        self, across: Across, free: tuple[str, ...] = (), summed: bool = False, stored: Sequence[int] | None = None
    ) -> Loop:
        """The loop over entries.

        Args:
            across: the contents of a vector.
            free: parameters in which the results are differentiated, P of them.
            summed: whether it adds up r^T r, J^T r and the lower triangle of J^T J, in this order, for results r.
            stored: nodes that it stores, followed by the derivatives of all results in each parameter; None: nothing.
        """
        carried, columns = [], []
        for symbol in free:
            pairs, tangents = self._column(symbol)
            carried += pairs
            columns.append(tangents)
        sums: list[list[tuple[int, int]]] = []
        if summed:
            sums.append([(each, each) for each in self.results])
            sums += [list(zip(self.results, column, strict=True)) for column in columns]
            sums += [list(zip(columns[i], columns[j], strict=True)) for i in range(len(free)) for j in range(i + 1)]
        kept = [] if stored is None else [*stored, *(each for column in columns for each in column)]
        return self.traced.loop(across, carried, sums, kept)


class ResidualEntry(SimulatedEntry):
    """`one_pass.advance` of a model.

    Attributes:
        seen: nodes of each slot's simulated value; the results are the whitened residual.
    """

    def __init__(self, form: Form, shape: Shape, order: int) -> None:
        super().__init__(advance, form, shape, order)
        self.seen, self.results = map(nodes_of, self.traced.results)

    def residual_loop(
        self, across: Across, free: tuple[str, ...] = (), summed: bool = False, stored: bool = False
    ) -> Loop:
        """The loop that simulates, observes and whitens; it stores each slot's simulated value and the residual, M
        each. Arguments as of `loop`."""
        return self.loop(across, free, summed, [*self.seen, *self.results] if stored else None)
