"""A batch packed for a kernel: lanes of like length side by side, each entry one row of numbers.

Lanes are taken longest first, some at a time; a group runs as long as its longest lane. Entries that only fill a
shorter lane up, and lanes that only fill a group up, have weight 0.

What was logged is packed once for each batch; what a new filter brings, once for each filter.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import numpy as np

from ..kernels.machine import LANES
from .free_parameters import Form
from .innovations import InnovationsFilter
from .one_pass import entries
from .residual import WeightedData
from .traced_entry import Column, Shape, TracedEntry, traced_entry

Made = TypeVar("Made")


class Group(NamedTuple):
    """Lanes that run side by side.

    Args:
        lanes: of the batch, at most `LANES` of them.
        rows: entries of each, those that follow are blank.
        lasting, renewed: records, shape (longest, columns, `LANES`).
    """

    lanes: tuple[int, ...]
    rows: tuple[int, ...]
    lasting: np.ndarray
    renewed: np.ndarray

    @property
    def longest(self) -> int:
        """Entries of its longest lane."""
        return self.lasting.shape[0]


@dataclass(frozen=True, eq=False)
class Records:
    """A batch packed for the kernels of a model.

    Args:
        entry: the model's entry, traced on a batch of this shape.
        uniform: numbers that are the same at every entry, in the order of `entry.fixed`.
        groups: its lanes.
        shape: T, L and M of the batch.
    """

    entry: TracedEntry
    uniform: np.ndarray
    groups: tuple[Group, ...]
    shape: tuple[int, int, int]

    def unpacked(self, group: Group, stored: np.ndarray, out: np.ndarray) -> None:
        """Put what a kernel stored, shape (rows, columns, `LANES`), in its place in `out`, shape (T, L, columns)."""
        for side, (lane, rows) in enumerate(zip(group.lanes, group.rows, strict=True)):
            out[:rows, lane] = stored[:rows, :, side]


class _Remembered:
    """What was made of some arrays, for as long as all of them live."""

    def __init__(self) -> None:
        self._kept: dict[tuple[Any, ...], Any] = {}

    def of(self, arrays: Sequence[np.ndarray], further: Any, make: Callable[[], Made]) -> Made:
        """What `make` returns, once for the same arrays and the same further key."""
        key = (*map(id, arrays), further)
        if key not in self._kept:
            self._kept[key] = make()
            for array in arrays:
                weakref.finalize(array, partial(self._kept.pop, key, None)).atexit = False
        return self._kept[key]


_SHAPES, _LASTING, _RENEWED, _PACKED = _Remembered(), _Remembered(), _Remembered(), _Remembered()


def records_of(form: Form, weighted: WeightedData) -> Records:
    """The batch packed for a model.

    Args:
        form: the model; it must have a single pass.
        weighted: data and whitening, arrays of NumPy.
    """
    read = weighted._replace(slots=weighted.slots._replace(sigma=None))  # the filter's weights have it
    leaves, tree = jax.tree.flatten(entries(read))
    leaves = [np.asarray(leaf) for leaf in leaves]
    return _PACKED.of(leaves, form, lambda: _packed(form, weighted, leaves, tree))


def _packed(form: Form, weighted: WeightedData, leaves: list[np.ndarray], tree: Any) -> Records:
    renewed = _renewed(tree)
    lasting = [leaf for k, leaf in enumerate(leaves) if k not in renewed]
    lanes, constant, uniform = _SHAPES.of(lasting, None, lambda: _found(weighted, leaves, renewed))
    constant = (*constant, *((column, 0.0) for column in _never(leaves, tree, weighted.whitening)))
    order = weighted.whitening.transition.shape[-1]
    shape = Shape(tree, tuple(leaf.shape[2:] for leaf in leaves), constant, tuple(uniform), order, renewed)
    entry = traced_entry(form, shape)

    def record(which: int) -> list[np.ndarray]:
        return [_record(leaves, tuple(entry.columns[which]), *group) for group in lanes]

    old = _LASTING.of(lasting, tuple(entry.columns[0]), lambda: record(0))
    fresh = [leaf for k, leaf in enumerate(leaves) if k in renewed]
    new = _RENEWED.of(fresh, tuple(entry.columns[1]), lambda: _muted(record(1), entry, leaves, tree, lanes))
    groups = tuple(Group(*group, *both) for group, *both in zip(lanes, old, new, strict=True))
    return Records(entry, np.array(list(uniform.values())), groups, weighted.slots.value.shape)


def _places(tree: Any) -> Any:
    """The entries' tree with the number of each leaf in its place."""
    return jax.tree.unflatten(tree, list(range(tree.num_leaves)))


def _renewed(tree: Any) -> frozenset[int]:
    """Leaves that change with the filter."""
    steps, _, slots, _, whitening = _places(tree)
    return frozenset({steps.guide_stiffness, slots.value, slots.weight, *jax.tree.leaves(whitening)})


def _found(
    weighted: WeightedData, leaves: list[np.ndarray], renewed: frozenset[int]
) -> tuple[list[tuple[tuple[int, ...], tuple[int, ...]]], tuple[tuple[Column, float], ...], dict[Column, float]]:
    """Lanes and their entries, group by group; columns that are 0 or 1 at all of them; others that are one number."""
    active = (np.asarray(weighted.steps.dt) > 0.0) | (np.asarray(weighted.resets.begins) > 0.5)
    rows = np.where(active.any(axis=0), active.shape[0] - np.argmax(active[::-1], axis=0), 0)
    order = [int(lane) for lane in np.argsort(-rows, kind="stable") if rows[lane]]
    lanes = [tuple(order[k : k + LANES]) for k in range(0, len(order), LANES)]
    used = np.arange(active.shape[0])[:, None] < rows
    constant: list[tuple[Column, float]] = []
    uniform: dict[Column, float] = {}
    for k, leaf in enumerate(leaves):
        for place in np.ndindex(leaf.shape[2:]) if k not in renewed else ():
            values = leaf[(slice(None), slice(None), *place)]
            first = float(values[0, order[0]])
            if not np.any(values[used] != first):
                if first in (0.0, 1.0):
                    constant.append((Column(k, place), first))
                else:
                    uniform[Column(k, place)] = first
    return [(each, tuple(int(rows[lane]) for lane in each)) for each in lanes], tuple(constant), uniform


def _never(leaves: list[np.ndarray], tree: Any, whitening: InnovationsFilter) -> Iterator[Column]:
    """Columns of the filter that are 0 by what they mean, where they are: no state acts on the input's error, and no
    sensor reads that."""
    _, _, _, _, places = _places(tree)
    order, count = whitening.transition.shape[-1], whitening.sense.shape[-2]
    for q in range(order - 1):
        yield from _where_zero(leaves, Column(places.transition, (order - 1, q)))
    for m in range(count):
        yield from _where_zero(leaves, Column(places.sense, (m, order - 1)))


def _where_zero(leaves: list[np.ndarray], column: Column) -> Iterator[Column]:
    if not leaves[column.leaf][(slice(None), slice(None), *column.place)].any():
        yield column


def _record(
    leaves: list[np.ndarray], columns: Sequence[Column], lanes: Sequence[int], rows: Sequence[int]
) -> np.ndarray:
    """Columns of some lanes, shape (longest, columns, `LANES`): what ends earlier repeats its last entry."""
    longest, side_by_side = max(rows), np.array([*lanes, *[lanes[0]] * (LANES - len(lanes))])
    out = np.empty((longest, len(columns), LANES))
    for place, (leaf, at) in enumerate(columns):
        out[:, place] = leaves[leaf][(slice(longest), side_by_side, *at)]
    for side, count in enumerate(rows):
        out[count:, :, side] = out[count - 1, :, side]
    return out


def _muted(
    records: list[np.ndarray],
    entry: TracedEntry,
    leaves: list[np.ndarray],
    tree: Any,
    lanes: list[tuple[tuple[int, ...], tuple[int, ...]]],
) -> list[np.ndarray]:
    """Records of the filter in which nothing counts that only fills up."""
    _, _, slots, _, whitening = _places(tree)
    weights = [k for k, column in enumerate(entry.columns[1]) if column.leaf in (slots.weight, whitening.weight)]
    for record, (members, rows) in zip(records, lanes, strict=True):
        for side in range(LANES):
            count = rows[side] if side < len(members) else 0
            for k in weights:
                record[count:, k, side] = 0.0
    return records
