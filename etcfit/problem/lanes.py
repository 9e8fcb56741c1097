"""Kernels run over the lanes of a batch, or over many points at each lane, on all cores in parallel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial, wraps
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.kept import kept
from ..kernels.loop import Across, Loop
from ..kernels.machine import LANES, POINTS, Kernel
from .cores import CORES, side_by_side
from .records import MAKING, Entries, Group, Grouped, Records, put, records_of
from .traced_entry import Shape, TracedEntry, nodes_of

Known = TypeVar("Known", bound=Callable[..., Any])
_NOTHING = np.zeros(1)  # output array of a kernel that stores nothing
_ENTRIES = 256  # number of remembered kernels of traced functions


def remembered(most: int, *known: Any) -> Callable[[Known], Known]:
    """Remember the results of a function that makes graphs or kernels; only one thread makes at a time.

    Args:
        most: largest number of remembered results.
        known: key of the function; if given, its results are also `kept` on disk.
    """

    def decorate(function: Known) -> Known:
        def made(*args: Any) -> Any:
            return kept(partial(function, *args), *known, *args) if known else function(*args)

        found = lru_cache(maxsize=most)(made)

        @wraps(function)
        def one_at_a_time(*args: Any) -> Any:
            with MAKING:
                return found(*args)

        return one_at_a_time  # pyright: ignore[reportReturnType]

    return decorate


def compiled(loop: Loop) -> Kernel:
    """The loop as machine code."""
    return Kernel.made(loop, LANES if loop.across is Across.LANES else POINTS)


class Along:
    """A function of each entry along a batch, its results as arrays.

    Args:
        function_of: a function of hashable arguments; it returns the arguments of `TracedEntry` except the shape:
            function, names of the values, carry, and ties.
        known: its key on disk, `function_of` itself if a module defines it; without a key nothing is kept on disk.
    """

    def __init__(self, function_of: Callable[..., Any], *known: Any) -> None:
        def made(shape: Shape, *arguments: Any) -> tuple[tuple[int, ...], tuple[Stored, Kernel]]:
            function, names, carried, ties = function_of(*arguments)
            entry = TracedEntry(function, names, shape, carried, ties)
            return entry.leaves, stored(entry, entry.results)

        self._made = remembered(_ENTRIES, *known)(made)

    def run(self, arguments: tuple[Any, ...], values: Float[np.ndarray, " Q"], batch: Entries) -> Any:
        """The tree of results, axes T and L first; 0 where a lane is blank. They are `Grouped`, the form that other
        kernels read; `np.asarray` converts them to arrays.

        Args:
            arguments: arguments of `function_of`.
            values: values in the order of their names.
            batch: arrays of NumPy.
        """
        records, (results, kernel) = records_of(batch, lambda shape: self._made(shape, *arguments))
        return results.over(kernel, records, values)


class Stored(NamedTuple):
    """The layout of a tree that a kernel stores."""

    tree: Any  # its structure
    shapes: tuple[tuple[int, ...], ...]  # shapes of its leaves, at one entry
    # range of stored numbers of each stored leaf, by the leaf's number; the end is exclusive
    blocks: Mapping[int, tuple[int, int]]

    def over(self, kernel: Kernel, records: Records, values: Sequence[float] | np.ndarray) -> Any:
        """The tree of a batch; its leaves are `Grouped`, zeros are repeated."""
        stored: dict[int, np.ndarray] = {}
        over_lanes(kernel, records, values, stored.__setitem__)

        def array(k: int) -> Any:
            shape = (*records.shape, *self.shapes[k])
            if k not in self.blocks:
                return _zeros(shape, records.groups)
            start, stop = self.blocks[k]
            each = (np.split(stored[g].reshape(kernel.stored, -1), [start, stop])[1] for g in sorted(stored))
            parts = tuple(part.reshape(-1, stop - start, LANES) for part in each)
            return Grouped(shape, records.groups, parts)

        return jax.tree.unflatten(self.tree, map(array, range(len(self.shapes))))


@lru_cache(maxsize=16)  # one array for a batch, so that its record is packed once, too
def _zeros(shape: tuple[int, ...], groups: tuple[Group, ...]) -> Float[np.ndarray, "T L *F"]:
    return np.broadcast_to(0.0, shape)


def stored(entry: TracedEntry, tree: Any) -> tuple[Stored, Kernel]:
    """The kernel that stores a tree of nodes at each entry, one block per leaf; leaves that are 0 at every entry are
    left out and take no memory.

    Args:
        entry: the entry with the graph.
        tree: a node or an array of nodes for each leaf.
    """
    leaves, structure = jax.tree.flatten(tree)
    blocks: dict[int, tuple[int, int]] = {}
    wanted: list[int] = []
    for k, nodes in enumerate(map(nodes_of, leaves)):
        if any(entry.graph.known(node) != 0.0 for node in nodes):
            blocks[k] = len(wanted), len(wanted) + len(nodes)
            wanted += nodes
    sizes = [stop - start for start, stop in blocks.values()]
    kernel = compiled(entry.loop(Across.LANES, stored=wanted, blocks=sizes))
    return Stored(structure, tuple(map(np.shape, leaves)), blocks), kernel


def over_lanes(
    kernel: Kernel,
    records: Records,
    fixed: Sequence[float] | np.ndarray,
    keep: Callable[[int, Float[np.ndarray, " stored"]], None] | None = None,
) -> Float[np.ndarray, " sums"]:
    """Run over all lanes.

    Args:
        kernel: kernel of a loop across lanes.
        fixed: parameters and further numbers, in the order of `TracedEntry.fixed`, without the uniform columns.
        keep: called with the number of each group and its stored numbers, see `Kernel.run`.
    Returns:
        The sums.
    """
    given = np.concatenate((fixed, records.uniform))
    first = np.zeros((kernel.carried, LANES))

    def run(group: int) -> np.ndarray:
        longest, packed = max(records.groups[group].rows), records.records[group]()
        stored = np.empty(longest * kernel.stored * LANES) if kernel.stored else _NOTHING
        total = kernel.run(longest, LANES, [record.ctypes.data for record in packed], given, first, stored)
        if keep is not None:
            keep(group, stored)
        return total.sum(axis=1)

    each = shared_out(run, range(len(records.groups)), lambda group: max(records.groups[group].rows))
    return np.sum(each, axis=0)


def stored_over_lanes(
    kernel: Kernel, records: Records, fixed: Sequence[float] | np.ndarray
) -> Float[np.ndarray, "T L stored"]:
    """The numbers that a kernel stores of each entry, in one block; 0 where a lane is blank. Arguments:
    `over_lanes`."""
    out = np.zeros((*records.shape, kernel.stored))

    def keep(group: int, stored: np.ndarray) -> None:
        put(out, records.groups[group], stored.reshape(-1, kernel.stored, LANES))

    over_lanes(kernel, records, fixed, keep)
    return out


def over_points(kernel: Kernel, records: Records, fixed: Float[np.ndarray, "K Q"]) -> Float[np.ndarray, "sums K"]:
    """Run over all lanes at many points: the sums of each.

    Args:
        kernel: kernel of a loop across points.
        fixed: parameters of each point, shape (K, Q).
    """
    sets = [np.take(fixed, range(k, k + POINTS), axis=0, mode="clip") for k in range(0, len(fixed), POINTS)]
    given = [np.ascontiguousarray(np.column_stack((some, np.tile(records.uniform, (POINTS, 1)))).T) for some in sets]
    packed = [make() for make in records.records]
    lanes = [(group, side) for group, each in enumerate(records.groups) for side in range(len(each.lanes))]
    tasks = [(k, group, side) for k in range(len(sets)) for group, side in lanes]
    first = np.zeros((kernel.carried, POINTS))

    def rows(task: tuple[int, int, int]) -> int:
        return records.groups[task[1]].rows[task[2]]

    def run(task: tuple[int, int, int]) -> np.ndarray:
        k, group, side = task
        at = [record.ctypes.data + side * record.itemsize for record in packed[group]]
        return kernel.run(rows(task), LANES, at, given[k], first, _NOTHING)

    out = np.zeros((kernel.sums, len(sets), POINTS))
    for (k, *_), each in zip(tasks, shared_out(run, tasks, rows), strict=True):
        out[:, k] += each
    return out.reshape(kernel.sums, -1)[:, : len(fixed)]


def shared_out(run: Callable[[Any], Any], tasks: Sequence[Any], length: Callable[[Any], int]) -> list[Any]:
    """Results of tasks in their order; the cores take the longest tasks first.

    Args:
        run: runs a task.
        tasks: independent tasks.
        length: duration of a task, in any unit.
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
