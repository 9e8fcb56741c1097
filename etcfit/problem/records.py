"""A batch packed for a kernel: lanes of similar length in parallel, each entry one row of numbers.

Lanes are grouped, the longest first; a group is as long as its longest lane. Entries that only fill a shorter lane, and
lanes that only fill a group, have weight 0.

Each leaf of the batch is a record: it is packed once for all kernels, and not at all if a kernel stored it.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from threading import RLock
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float, Int

from ..kernels.machine import LANES
from ..model.stepper import Reset, Step
from .traced_entry import Column, Shape

Made = TypeVar("Made")
# a graph grows while it is differentiated, and each kernel and each record is made once; no kernel runs meanwhile,
# because kernels run in threads, which may wait for this lock
MAKING = RLock()
_AT_ONCE = 512  # entries that are transposed at once: more do not fit into the caches


class Group(NamedTuple):
    """Lanes that run in parallel."""

    lanes: tuple[int, ...]  # at most `LANES` lanes of the batch
    rows: tuple[int, ...]  # number of entries of each; further entries are blank


@dataclass(frozen=True, eq=False)
class Grouped:
    """An array over a batch in the form in which kernels store and read it, so that no packing is needed."""

    shape: tuple[int, ...]  # its shape as an array, T and L first
    groups: tuple[Group, ...]  # the lanes
    parts: tuple[np.ndarray, ...]  # their numbers, shape (longest, columns, `LANES`) each

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        out = np.zeros(self.shape)
        for group, part in zip(self.groups, self.parts, strict=True):
            put(out.reshape(*self.shape[:2], -1), group, part)
        return out


def put(out: Float[np.ndarray, "T L F"], group: Group, part: Float[np.ndarray, "rows F W"]) -> None:
    """Copy the stored numbers of some lanes into an array, without those after the end of a lane."""
    for side, (lane, rows) in enumerate(zip(*group, strict=True)):
        for k in range(0, rows, _AT_ONCE):
            some = slice(k, min(k + _AT_ONCE, rows))
            out[some, lane] = part[some, :, side]


def as_numpy(tree: Any) -> Any:
    """The tree with arrays of NumPy; `Grouped` arrays stay as they are."""
    return jax.tree.map(lambda leaf: leaf if isinstance(leaf, Grouped) else np.asarray(leaf), tree)


@dataclass(frozen=True, eq=False)
class Entries:
    """Arrays of a batch, and which of them change."""

    tree: Any  # arrays of NumPy, or `Grouped`, axes T and L first
    rows: Int[np.ndarray, " L"]  # number of entries of each lane, shape (L,)
    # numbers of the leaves, in JAX's order, that are read at every entry even if they are constant, because other
    # values will replace them
    renewed: frozenset[int] = frozenset()
    muted: frozenset[int] = frozenset()  # leaves that are 0 in blank entries
    never: tuple[Column, ...] = ()  # columns that may be 0 everywhere by their meaning
    lasting: bool = True  # whether packed leaves are kept for further runs


@dataclass(frozen=True, eq=False)
class Records:
    """A batch packed for a kernel."""

    uniform: Float[np.ndarray, " U"]  # numbers that are the same at every entry, in the order of `Shape.uniform`
    groups: tuple[Group, ...]  # its lanes
    records: Sequence[Callable[[], tuple[np.ndarray, ...]]]  # records of each group, packed once, or at every run
    shape: tuple[int, int]  # T and L


def numbered(tree: Any) -> Any:
    """The tree with each leaf replaced by its number."""
    structure = jax.tree.structure(tree)
    return jax.tree.unflatten(structure, list(range(structure.num_leaves)))


class Remembered:
    """Results made from some arrays, kept as long as all of these arrays exist."""

    def __init__(self) -> None:
        self._kept: dict[tuple[Any, ...], Any] = {}

    def made_once(self, arrays: Sequence[np.ndarray | Grouped], further: Any, make: Callable[[], Made]) -> Made:
        """The result of `make`, computed once for the same arrays and the same further key."""
        if not arrays:
            return make()
        key = (*map(id, arrays), further)
        found = self._kept.get(key, self)
        if found is self:
            found = self._kept[key] = make()
            for array in arrays:
                weakref.finalize(array, partial(self._kept.pop, key, None)).atexit = False
        return found


class Latest:
    """The last results made from some arrays: for results that refer to the arrays themselves, which `Remembered` would
    keep alive for ever."""

    def __init__(self, most: int) -> None:
        self._kept: dict[tuple[Any, ...], tuple[Any, Any]] = {}
        self._most = most

    def made_once(self, arrays: Sequence[np.ndarray | Grouped], further: Any, make: Callable[[], Made]) -> Made:
        """The result of `make`, computed once for the same arrays and further key as long as it is among the last."""
        key = (*map(id, arrays), further)
        kept = self._kept.pop(key, None) or (arrays, make())  # kept with the arrays, so that their ids stay valid
        self._kept[key] = kept
        for oldest in list(self._kept)[: -self._most]:
            self._kept.pop(oldest, None)
        return kept[1]


_FOUND, _RECORDS, _ROWS = Remembered(), Remembered(), Remembered()


def used_rows(steps: Step, resets: Reset) -> Int[np.ndarray, " L"]:
    """Number of entries of each lane up to the end of its last trace, shape (L,); computed once for the same arrays."""

    def rows() -> Int[np.ndarray, " L"]:
        active = (np.asarray(steps.dt) > 0.0) | (np.asarray(resets.begins) > 0.5)
        return np.max(np.where(active, np.arange(1, active.shape[0] + 1)[:, None], 0), axis=0, initial=0)

    return _ROWS.made_once([steps.dt, resets.begins], None, rows)


def records_of(entries: Entries, made_of: Callable[[Shape], tuple[Sequence[int], Made]]) -> tuple[Records, Made]:
    """The packed batch, and the further result for its shape.

    Args:
        entries: the batch.
        made_of: returns for a shape the leaves that are read at an entry, and a further result; the same for the same
            shape.
    """
    with MAKING:
        leaves, structure = jax.tree.flatten(entries.tree)
        groups = _groups(entries.rows)
        ready = [_is_ready(leaf, groups) and k not in entries.muted for k, leaf in enumerate(leaves)]
        leaves = [leaf if as_it_is else np.asarray(leaf) for leaf, as_it_is in zip(leaves, ready, strict=True)]
        constant: list[tuple[Column, float]] = [
            (c, 0.0)
            for c in entries.never
            if not _FOUND.made_once([leaves[c.leaf]], ("ever", c.place), partial(_ever, leaves[c.leaf], c.place))
        ]
        uniform: dict[Column, float] = {}
        for k, leaf in enumerate(leaves):
            if k not in entries.renewed:
                found = _FOUND.made_once([leaf], groups, partial(_everywhere, leaf, groups))
                constant += [(Column(k, at), value) for at, value in found if value in (0.0, 1.0)]
                uniform |= {Column(k, at): value for at, value in found if value not in (0.0, 1.0)}
        shapes = tuple(leaf.shape[2:] for leaf in leaves)
        which, made = made_of(Shape(structure, shapes, tuple(constant), tuple(uniform)))
        read = [(leaves[k], k in entries.muted) for k in which]
        if entries.lasting:
            kept = [
                _RECORDS.made_once([leaf], (muted, groups), partial(_packed, leaf, groups, muted))
                for leaf, muted in read
            ]
            packed = [partial(tuple, [each[g] for each in kept]) for g in range(len(groups))]
        else:
            packed = [partial(_each_packed, read, g, group) for g, group in enumerate(groups)]
        return Records(np.array(list(uniform.values())), groups, packed, leaves[0].shape[:2]), made


def _groups(rows: Int[np.ndarray, " L"]) -> tuple[Group, ...]:
    order = [int(lane) for lane in np.argsort(-rows, kind="stable") if rows[lane]]
    lanes = [tuple(order[k : k + LANES]) for k in range(0, len(order), LANES)]
    return tuple(Group(each, tuple(int(rows[lane]) for lane in each)) for each in lanes)


def _ever(leaf: np.ndarray | Grouped, place: tuple[int, ...]) -> bool:
    """Whether a column is not 0 somewhere."""
    if isinstance(leaf, Grouped):
        column = np.ravel_multi_index(place, leaf.shape[2:]) if place else 0
        return any(part[:, column].any() for part in leaf.parts)
    return bool(leaf[(slice(None), slice(None), *place)].any())


def _everywhere(leaf: np.ndarray | Grouped, groups: Sequence[Group]) -> list[tuple[tuple[int, ...], float]]:
    """Columns that have the same number at all entries, with the number."""
    if isinstance(leaf, Grouped):
        return []

    def same(column: np.ndarray) -> bool:
        first = column[0, groups[0].lanes[0]]
        return all(np.all(column[:rows, lane] == first) for group in groups for lane, rows in zip(*group, strict=True))

    columns = ((at, leaf[(slice(None), slice(None), *at)]) for at in np.ndindex(leaf.shape[2:]))
    return [(at, float(c[0, groups[0].lanes[0]])) for at, c in columns if c.strides[:2] == (0, 0) or same(c)]


def _is_ready(leaf: Any, groups: tuple[Group, ...]) -> bool:
    """Whether a leaf is stored in the form of these groups."""
    return isinstance(leaf, Grouped) and leaf.groups == groups


def _packed(leaf: np.ndarray | Grouped, groups: tuple[Group, ...], muted: bool) -> tuple[np.ndarray, ...]:
    return leaf.parts if isinstance(leaf, Grouped) else tuple(record_of(leaf, group, muted) for group in groups)


def _each_packed(read: Sequence[tuple[Any, bool]], place: int, group: Group) -> tuple[np.ndarray, ...]:
    """Every leaf of one group."""
    return tuple(
        leaf.parts[place] if isinstance(leaf, Grouped) else record_of(leaf, group, muted) for leaf, muted in read
    )


def record_of(leaf: Float[np.ndarray, "T L *F"], group: Group, muted: bool) -> Float[np.ndarray, "rows F W"]:
    """A leaf of some lanes. A shorter lane repeats its last entry, and missing lanes repeat the first; both are 0 if
    the leaf is `muted`."""
    longest, numbers = max(group.rows), math.prod(leaf.shape[2:])
    out = np.empty((longest, numbers, LANES))
    for side in range(LANES):
        there = side < len(group.lanes)
        lane, count = (group.lanes[side], group.rows[side]) if there else (group.lanes[0], 0 if muted else longest)
        for k in range(0, count, _AT_ONCE):
            some = slice(k, min(k + _AT_ONCE, count))
            out[some, :, side] = leaf[some, lane].reshape(-1, numbers)
        out[count:, :, side] = 0.0 if muted else out[count - 1, :, side]
    return out
