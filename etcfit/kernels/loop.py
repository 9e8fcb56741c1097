"""A loop over the entries of a batch: numbers that are read, carried, summed and stored at each entry.

A vector of the processor has neighbouring lanes of a batch at one point of the parameters, or many points at one lane,
or points with their own entries. Nodes that do not differ along the vector are computed once, as scalars; nodes that do
not change from entry to entry are computed before the loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

from .graph import Graph


class Across(Enum):
    """The contents of a vector."""

    LANES = "lanes"
    POINTS = "points"
    BOTH = "points, each with entries of its own"


@dataclass(frozen=True, eq=False)
class Loop:
    """A loop over entries, in nodes of a graph."""

    graph: Graph  # the graph of all nodes
    across: Across  # the contents of a vector
    records: tuple[tuple[int, ...], ...]  # inputs read at each entry, in the order of the columns of each record
    fixed: tuple[int, ...]  # inputs that are the same at all entries, in their order: parameters
    carried: tuple[tuple[int, int], ...]  # (input, result): numbers that one entry passes to the next
    sums: tuple[tuple[tuple[int, int], ...], ...] = ()  # each a sum over all entries of products of two nodes
    stored: tuple[int, ...] = ()  # nodes that are written at each entry
    # sizes of the groups of stored nodes; each group is stored as one block of shape (rows, nodes, numbers in a
    # vector), as a record is; () for one block
    blocks: tuple[int, ...] = ()
    common: frozenset[int] = frozenset()  # records, by their numbers, that hold one number for all of a vector

    @cached_property
    def nodes(self) -> list[int]:
        """All computed nodes, operands first."""
        products = [node for pairs in self.sums for pair in pairs for node in pair]
        return self.graph.needed([*(result for _, result in self.carried), *products, *self.stored])

    @cached_property
    def differing(self) -> frozenset[int]:
        """Nodes that differ along a vector."""
        entries = [node for k, record in enumerate(self.records) if k not in self.common for node in record]
        begun = {*(self.fixed if self.across is not Across.LANES else ())}
        begun |= {*(entries if self.across is not Across.POINTS else ())}
        return self._reached_from(begun | {node for node, _ in self.carried})

    @cached_property
    def changing(self) -> frozenset[int]:
        """Nodes that change from entry to entry."""
        entries = {node for record in self.records for node in record}
        return self._reached_from(entries | {node for node, _ in self.carried})

    def _reached_from(self, begun: set[int]) -> frozenset[int]:
        reached = set(begun)
        for node in self.nodes:
            if any(operand in reached for operand in self.graph.operands(node)):
                reached.add(node)
        return frozenset(reached)
