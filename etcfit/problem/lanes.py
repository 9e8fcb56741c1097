"""Kernels run over the lanes of a batch, or over many points at each lane, the cores at work side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache, wraps
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.graph import Graph
from ..kernels.loop import Across, Loop
from ..kernels.machine import LANES, POINTS, Kernel
from .cores import CORES, side_by_side
from .records import MAKING, Entries, Packed, Records, records_of
from .traced_entry import Shape, TracedEntry, nodes_of

Known = TypeVar("Known", bound=Callable[..., Any])
_NOTHING = np.zeros(1)  # is stored
_ENTRIES = 256  # traced functions that are remembered


def remembered(most: int) -> Callable[[Known], Known]:
    """Remember so many results of a function that makes graphs or kernels; one thread makes at a time."""

    def decorate(function: Known) -> Known:
        kept = lru_cache(maxsize=most)(function)

        @wraps(function)
        def one_at_a_time(*args: Any) -> Any:
            with MAKING:
                return kept(*args)

        return one_at_a_time  # pyright: ignore[reportReturnType]

    return decorate


def compiled(loop: Loop) -> Kernel:
    """The loop as machine code."""
    return Kernel(loop, LANES if loop.across is Across.LANES else POINTS)


class Along:
    """A function of each entry along a batch, its results as arrays.

    Args:
        function_of: of hashable arguments; it returns what `TracedEntry` takes besides the shape: function, names of
            the values, what is carried, and ties.
    """

    def __init__(self, function_of: Callable[..., Any]) -> None:
        def made(shape: Shape, *asked: Any) -> tuple[TracedEntry, tuple[Any, Kernel]]:
            function, names, carried, ties = function_of(*asked)
            entry = TracedEntry(function, names, shape, carried, ties)
            results = Stored(entry.graph, entry.results)
            return entry, (results, compiled(entry.loop(Across.LANES, stored=results.nodes)))

        self._made = remembered(_ENTRIES)(made)

    def run(self, asked: tuple[Any, ...], values: Float[np.ndarray, " Q"], batch: Entries) -> Any:
        """The tree of results, axes T and L first; 0 where a lane is blank.

        Args:
            asked: arguments of `function_of`.
            values: in the order of their names.
            batch: arrays of NumPy.
        """
        records, (results, kernel) = records_of(batch, lambda shape: self._made(shape, *asked))
        return results.like(over_lanes(kernel, records, values)[1])


class Stored:
    """A tree of nodes as a kernel stores it: leaves that are 0 at every entry are left out, and take no memory.

    Args:
        graph: of the nodes.
        tree: a node or an array of nodes for each leaf.
    Attributes:
        nodes: that are stored.
    """

    def __init__(self, graph: Graph, tree: Any) -> None:
        self._leaves, self._tree = jax.tree.flatten(tree)
        self._zeros = [all(graph.known(node) == 0.0 for node in nodes_of(leaf)) for leaf in self._leaves]
        self.nodes = nodes_of([leaf for leaf, zero in zip(self._leaves, self._zeros, strict=True) if not zero])

    def like(self, stored: Float[np.ndarray, "T L stored"]) -> Any:
        """What was stored, as the tree with axes T and L first."""
        out, begin = [], 0
        for leaf, zero in zip(self._leaves, self._zeros, strict=True):
            shape, end = (*stored.shape[:2], *np.shape(leaf)), begin + (0 if zero else np.size(leaf))
            out.append(np.broadcast_to(0.0, shape) if zero else stored[..., begin:end].reshape(shape))
            begin = end
        return jax.tree.unflatten(self._tree, out)


def over_lanes(
    kernel: Kernel, records: Records, fixed: Sequence[float] | np.ndarray
) -> tuple[Float[np.ndarray, " sums"], Float[np.ndarray, "T L stored"]]:
    """Run over all lanes.

    Args:
        kernel: of a loop across lanes.
        records: the batch.
        fixed: parameters and further numbers, in the order of `TracedEntry.fixed`, without the uniform columns.
    Returns:
        the sums, and what is stored of each entry; that is 0 where a lane is blank.
    """
    given = np.concatenate((fixed, records.uniform))
    first = np.zeros((kernel.carried, LANES))
    out = np.zeros((*records.shape, kernel.stored))

    def run(packed: Packed) -> np.ndarray:
        stored = np.empty((packed.longest, kernel.stored, LANES)) if kernel.stored else _NOTHING
        at = [record.ctypes.data for record in packed.records]
        total = kernel.run(packed.longest, LANES, at, given, first, stored)
        if kernel.stored:
            for side, (lane, rows) in enumerate(zip(*packed.group, strict=True)):
                out[:rows, lane] = stored[:rows, :, side]
        return total.sum(axis=1)

    return np.sum(shared_out(run, records.packed, lambda packed: packed.longest), axis=0), out


def over_points(kernel: Kernel, records: Records, fixed: Float[np.ndarray, "K Q"]) -> Float[np.ndarray, "sums K"]:
    """Run over all lanes at many points: the sums of each.

    Args:
        kernel: of a loop across points.
        records: the batch.
        fixed: parameters of each point, shape (K, Q).
    """
    sets = [np.take(fixed, range(k, k + POINTS), axis=0, mode="clip") for k in range(0, len(fixed), POINTS)]
    given = [np.ascontiguousarray(np.column_stack((some, np.tile(records.uniform, (POINTS, 1)))).T) for some in sets]
    lanes = [(packed, side) for packed in records.packed for side in range(len(packed.group.lanes))]
    tasks = [(k, packed, side) for k in range(len(sets)) for packed, side in lanes]
    first = np.zeros((kernel.carried, POINTS))

    def run(task: tuple[int, Packed, int]) -> np.ndarray:
        k, packed, side = task
        at = [record.ctypes.data + side * record.itemsize for record in packed.records]
        return kernel.run(packed.group.rows[side], LANES, at, given[k], first, _NOTHING)

    out = np.zeros((kernel.sums, len(sets), POINTS))
    for (k, *_), each in zip(tasks, shared_out(run, tasks, lambda t: t[1].group.rows[t[2]]), strict=True):
        out[:, k] += each
    return out.reshape(kernel.sums, -1)[:, : len(fixed)]


def shared_out(run: Callable[[Any], Any], tasks: Sequence[Any], length: Callable[[Any], int]) -> list[Any]:
    """Results of tasks in their order, which the cores share, longest first.

    Args:
        run: a task.
        tasks: each by itself.
        length: how long one takes, in any unit.
    """
    shares: list[list[int]] = [[] for _ in range(min(CORES, len(tasks)))]
    loads = [0] * len(shares)
    for k in sorted(range(len(tasks)), key=lambda k: -length(tasks[k])):
        least = int(np.argmin(loads))
        shares[least].append(k)
        loads[least] += length(tasks[k])
    out: list[Any] = [None] * len(tasks)
    for share, done in zip(shares, side_by_side(lambda share: [run(tasks[k]) for k in share], shares), strict=True):
        for k, each in zip(share, done, strict=True):
            out[k] = each
    return out
