"""A batch packed for a kernel: lanes of like length side by side, each entry one row of numbers.

Lanes are taken longest first, some at a time; a group runs as long as its longest lane. Entries that only fill a
shorter lane up, and lanes that only fill a group up, have weight 0.

What was logged is packed once for each batch; what a new filter brings goes into a record of its own.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from threading import RLock
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np
from jaxtyping import Float, Int

from ..kernels.machine import LANES
from ..model.stepper import Reset, Step
from .traced_entry import Column, Shape, TracedEntry

Made = TypeVar("Made")
# a graph grows while it is differentiated, and each kernel and each record is made once; nothing runs meanwhile, for
# what runs is shared out to threads, which may wait for this lock
MAKING = RLock()


class Group(NamedTuple):
    """Lanes that run side by side.

    Args:
        lanes: of the batch, at most `LANES` of them.
        rows: entries of each; those that follow are blank.
    """

    lanes: tuple[int, ...]
    rows: tuple[int, ...]


class Packed(NamedTuple):
    """A group with its records, shape (longest, columns, `LANES`) each."""

    group: Group
    records: tuple[np.ndarray, ...]

    @property
    def longest(self) -> int:
        """Entries of its longest lane."""
        return self.records[0].shape[0]


@dataclass(frozen=True, eq=False)
class Entries:
    """Arrays of a batch, and what of them changes.

    Args:
        tree: arrays of NumPy, axes T and L first.
        rows: entries of each lane, shape (L,).
        renewed: numbers of the leaves, in JAX's order, that have a record of their own since they change together; all
            others are in the first record.
        muted: those that are 0 where nothing counts.
        never: columns that may be 0 everywhere by what they mean.
    """

    tree: Any
    rows: Int[np.ndarray, " L"]
    renewed: tuple[frozenset[int], ...] = ()
    muted: frozenset[int] = frozenset()
    never: tuple[Column, ...] = ()


@dataclass(frozen=True, eq=False)
class Records:
    """A batch packed for a kernel.

    Args:
        uniform: numbers that are the same at every entry, in the order of `Shape.uniform`.
        packed: its lanes, group by group.
        shape: T and L.
    """

    uniform: Float[np.ndarray, " U"]
    packed: tuple[Packed, ...]
    shape: tuple[int, int]


def used_rows(steps: Step, resets: Reset) -> Int[np.ndarray, " L"]:
    """Entries of each lane up to the end of its last trace, shape (L,)."""
    active = (np.asarray(steps.dt) > 0.0) | (np.asarray(resets.begins) > 0.5)
    return np.max(np.where(active, np.arange(1, active.shape[0] + 1)[:, None], 0), axis=0, initial=0)


def numbered(tree: Any) -> Any:
    """The tree with the number of each leaf in its place."""
    structure = jax.tree.structure(tree)
    return jax.tree.unflatten(structure, list(range(structure.num_leaves)))


class Remembered:
    """What was made of some arrays, for as long as all of them live."""

    def __init__(self) -> None:
        self._kept: dict[tuple[Any, ...], Any] = {}

    def of(self, arrays: Sequence[np.ndarray], further: Any, make: Callable[[], Made]) -> Made:
        """What `make` returns, once for the same arrays and the same further key."""
        if not arrays:
            return make()
        key = (*map(id, arrays), further)
        if key not in self._kept:
            self._kept[key] = make()
            for array in arrays:
                weakref.finalize(array, partial(self._kept.pop, key, None)).atexit = False
        return self._kept[key]


_FOUND, _RECORDS = Remembered(), Remembered()


def records_of(entries: Entries, made_of: Callable[[Shape], tuple[TracedEntry, Made]]) -> tuple[Records, Made]:
    """The batch packed, and what else was made for its shape.

    Args:
        entries: the batch.
        made_of: what is computed of an entry of a batch of such a shape, and what else is made for that; the same for
            the same shape.
    """
    with MAKING:
        leaves, structure = jax.tree.flatten(entries.tree)
        lasting = frozenset(range(len(leaves))).difference(*entries.renewed)
        groups = _groups(entries.rows)
        constant, uniform = _FOUND.of(
            [leaves[k] for k in sorted(lasting)], structure, lambda: _everywhere(leaves, lasting, entries.rows)
        )
        never = tuple((column, 0.0) for column in entries.never if not _column(leaves, column).any())
        shapes = tuple(leaf.shape[2:] for leaf in leaves)
        entry, made = made_of(Shape(structure, shapes, (*constant, *never), tuple(uniform), entries.renewed))
        records = []
        for of, columns in zip((lasting, *entries.renewed), map(tuple, entry.columns), strict=True):
            make = partial(record_of, leaves, columns, muted=entries.muted)
            place = {leaf: k for k, leaf in enumerate(sorted(of))}  # the same record whatever lies beside it
            named = tuple((place[leaf], at) for leaf, at in columns)
            key = named, frozenset(place[leaf] for leaf in entries.muted & of), tuple(groups)
            records.append(_RECORDS.of([leaves[k] for k in place], key, lambda make=make: list(map(make, groups))))
        packed = tuple(Packed(group, each) for group, each in zip(groups, zip(*records, strict=True), strict=True))
        return Records(np.array(list(uniform.values())), packed, leaves[0].shape[:2]), made


def _groups(rows: Int[np.ndarray, " L"]) -> list[Group]:
    order = [int(lane) for lane in np.argsort(-rows, kind="stable") if rows[lane]]
    lanes = [tuple(order[k : k + LANES]) for k in range(0, len(order), LANES)]
    return [Group(each, tuple(int(rows[lane]) for lane in each)) for each in lanes]


def _column(leaves: Sequence[np.ndarray], column: Column) -> Float[np.ndarray, "T L"]:
    return leaves[column.leaf][(slice(None), slice(None), *column.place)]


def _everywhere(
    leaves: Sequence[np.ndarray], lasting: Iterable[int], rows: Int[np.ndarray, " L"]
) -> tuple[tuple[tuple[Column, float], ...], dict[Column, float]]:
    """Columns of what lasts that are 0 or 1 at all entries, and others that are one number there."""
    used = np.arange(leaves[0].shape[0])[:, None] < rows
    constant: list[tuple[Column, float]] = []
    uniform: dict[Column, float] = {}
    for name in (Column(k, place) for k in sorted(lasting) for place in np.ndindex(leaves[k].shape[2:])):
        values = _column(leaves, name)[used]
        if not np.any(values != values[0]):
            if values[0] in (0.0, 1.0):
                constant.append((name, float(values[0])))
            else:
                uniform[name] = float(values[0])
    return tuple(constant), uniform


def record_of(
    leaves: Sequence[np.ndarray], columns: Sequence[Column], group: Group, muted: frozenset[int]
) -> Float[np.ndarray, "rows F W"]:
    """Columns of some lanes. What ends earlier repeats its last entry; where lanes are few the first is repeated; in
    `muted` columns both are 0."""
    longest = max(group.rows)
    lanes = np.array([*group.lanes, *[group.lanes[0]] * (LANES - len(group.lanes))])
    out = np.empty((longest, len(columns), LANES))
    for place, (leaf, at) in enumerate(columns):
        out[:, place] = leaves[leaf][(slice(longest), lanes, *at)]
    weights = [k for k, column in enumerate(columns) if column.leaf in muted]
    for side in range(LANES):
        count = group.rows[side] if side < len(group.rows) else 0
        if count:
            out[count:, :, side] = out[count - 1, :, side]
        out[count:, weights, side] = 0.0
    return out
