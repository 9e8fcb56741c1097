"""A control loop as machine code: plant and controller together, tick by tick, many loops in vectors."""

from __future__ import annotations

import math
from collections.abc import Callable
from threading import Lock, local
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...kernels.loop import Across
from ...kernels.lowering import NotScalarError
from ...kernels.machine import POINTS, Kernel, available
from ...problem.lanes import compiled, remembered, shared_out
from ...problem.traced_entry import Shape, TracedEntry, nodes_of

_LOOPS = 64  # loops that a process keeps compiled


class _Lasting(NamedTuple):
    """Numbers that are constant over the ticks: of each plant (D, ...), of each controller (G, ...), common to all."""

    plants: Any
    controllers: Any
    all: Any


class Kind(NamedTuple):
    """The kind of loop that is compiled."""

    # function of (control, keep, plant, run, parts, room), see `loop`: initial state and function of a tick
    simulation: Callable[..., Any]
    # control, keep, parts, room: its arguments
    control: Any
    keep: Any
    parts: int
    room: int
    tree: Any  # structure of the constant numbers
    shapes: tuple[tuple[int, ...], ...]  # shapes of its leaves, for one plant and one controller
    entry: Any  # structure of what a tick reads: demand, feed-forward, what is judged, instant, noise
    common: frozenset[int]  # leaves of it that all loops share


class LoopKernel:
    """The loop of one kind of plant under one kind of controller."""

    def __init__(self, kind: Kind, plant: Any, run: Any) -> None:
        names = [f"{k}.{n}" for k, shape in enumerate(kind.shapes) for n in range(math.prod(shape))]

        def simulated(values: Any) -> Any:
            leaves = [_array(values, k, shape) for k, shape in enumerate(kind.shapes)]
            # plant and run with these numbers
            lasting = jax.tree.unflatten(kind.tree, leaves)
            (throttle, drive, ceiling), (settings, first), (ecu, body, start) = lasting
            joined = (plant._replace(throttle=throttle, drive=drive, ceiling=ceiling),
                    run._replace(settings=settings, first=first, ecu=ecu, body=body, start=start))  # fmt: skip
            return kind.simulation(kind.control, kind.keep, *joined, kind.parts, kind.room)

        like = jax.eval_shape(lambda: simulated(dict.fromkeys(names, 0.5)).begin)
        nothing = Shape(jax.tree.structure(()), (), (), ())
        first = TracedEntry(lambda values, *_: ((), simulated(values).begin), names, nothing, ())
        entries = Shape(kind.entry, ((),) * kind.entry.num_leaves, (), ())
        tick = TracedEntry(lambda values, carry, e: simulated(values).advance(carry, e), names, entries, like)
        self._begin: Kernel = compiled(first.loop(Across.BOTH, stored=nodes_of(first.results)))
        self._tick: Kernel = compiled(tick.loop(Across.BOTH, stored=nodes_of(tick.results), common=kind.common))
        self._read = tick.leaves
        self._kept, self._tally = jax.tree.structure(tick.results), jax.tree.structure(like.tally)

    def run(self, plants: Any, run: Any, reduced: Callable[[Any], Any] = lambda kept: kept) -> Any:
        """Every plant (D) under every controller (G).

        Args:
            plants, run: see `loop`.
            reduced: function of the tree of kept values, shape (N, K), to arrays of shape (N, ...); it is called while
                they are in the processor's caches.
        Returns:
            the tree of its results and the tally after the last tick, shape (D, G, ...).
        """
        lasting = _lasting(plants, run)
        draws, gains = len(plants.drive), len(jax.tree.leaves(run.settings)[0])
        values = np.concatenate([*(np.repeat(each, gains, axis=1) for each in _rows(lasting.plants, draws)),
                                 *(np.tile(each, draws) for each in _rows(lasting.controllers, gains)),
                                 *(np.tile(np.ravel(each).astype(float)[:, None], draws * gains)
                                   for each in jax.tree.leaves(lasting.all))])  # fmt: skip
        ticks = np.size(run.bias)
        time = float(run.ecu.period) * np.arange(ticks)
        entry = jax.tree.leaves(_entry(plants, run, time))
        columns = [np.ascontiguousarray(entry[k], dtype=float) for k in self._read]
        own = len(entry) - 1  # the noise of each plant; other leaves with rows are of controllers
        this_run, first_result = object(), Lock()
        out: list[Any] = []

        def records_of(plant: np.ndarray, controller: np.ndarray) -> list[int]:
            apart = [k for k, column in enumerate(columns) if column.ndim > 1]
            records = dict(zip(apart, _room_for("records", (len(apart), ticks, POINTS)), strict=True))
            by, before = getattr(_ROOMS, "records_of", (None, plant))
            for k, record in records.items():
                if self._read[k] != own:
                    record[:] = columns[k][controller].T
                elif by is not this_run or not np.array_equal(before, plant):  # neighbours usually have the same plant
                    record[:] = columns[k][plant].T
            _ROOMS.records_of = this_run, plant
            return [records.get(k, column).ctypes.data for k, column in enumerate(columns)]

        def some(first: int) -> None:
            points = np.minimum(np.arange(first, first + POINTS), draws * gains - 1)
            fixed, records = np.ascontiguousarray(values[:, points]), records_of(*divmod(points, gains))
            begun = np.empty((1, self._begin.stored, POINTS))
            self._begin.run(1, POINTS, [], fixed, np.empty((0, POINTS)), begun)
            stored = _room_for("stored", (ticks, self._tick.stored, POINTS))
            _, end = self._tick.run_to_end(ticks, POINTS, records, fixed, begun[0], stored)
            count = min(POINTS, draws * gains - first)
            kept = jax.tree.unflatten(self._kept, list(_along_ticks(stored)[:, :count]))
            tally = end[len(end) - self._tally.num_leaves :, :count]  # the last of what is carried
            numbers = jax.tree.unflatten(self._tally, list(tally))
            leaves, tree = jax.tree.flatten((reduced(kept), numbers))
            with first_result:
                if not out:
                    out.append(jax.tree.unflatten(tree, [np.empty((draws * gains, *x.shape[1:])) for x in leaves]))
            for every, each in zip(jax.tree.leaves(out[0]), leaves, strict=True):
                every[first : first + count] = each

        shared_out(some, range(0, draws * gains, POINTS), lambda _: 1)
        return jax.tree.map(lambda each: each.reshape(draws, gains, *each.shape[1:]), out[0])


_ROOMS = local()  # each thread keeps its arrays: the allocation of new ones would take as long as a kernel
_AT_ONCE = 512  # ticks that are transposed together: more do not fit the caches


def _room_for(name: str, shape: tuple[int, ...]) -> np.ndarray:
    """An uninitialised array that this thread reuses."""
    size, kept = math.prod(shape), getattr(_ROOMS, name, None)
    if kept is None or not size <= kept.size <= 4 * size:
        kept = np.empty(size)
        setattr(_ROOMS, name, kept)
    return kept[:size].reshape(shape)


def _along_ticks(stored: np.ndarray) -> np.ndarray:
    """Values stored by tick, shape (K, S, N), transposed to runs, shape (S, N, K)."""
    out = _room_for("turned", (*stored.shape[1:], stored.shape[0]))
    for k in range(0, len(stored), _AT_ONCE):
        out[..., k : k + _AT_ONCE] = np.moveaxis(stored[k : k + _AT_ONCE], 0, 2)
    return out


def kernel_of(
    simulation: Callable[..., Any], control: Any, keep: Any, parts: int, room: int, plants: Any, run: Any
) -> LoopKernel | None:
    """The compiled loop for these plants and this run, see `Kind`; None where JAX runs it."""
    if not available():
        return None
    lasting = _lasting(plants, run)
    every = (*jax.tree.leaves(lasting.plants), *jax.tree.leaves(lasting.controllers))
    shapes = (*(np.shape(each)[1:] for each in every), *map(np.shape, jax.tree.leaves(lasting.all)))
    entry, tree = jax.tree.flatten(_entry(plants, run, run.bias))
    common = frozenset(k for k, leaf in enumerate(entry) if np.ndim(leaf) == 1)
    kind = Kind(simulation, control, keep, parts, room, jax.tree.structure(lasting), shapes, tree, common)
    bare = (each._replace(**dict.fromkeys(each._fields)) for each in (plants, run))
    return _made(kind, *bare)


@remembered(_LOOPS)
def _made(kind: Kind, plant: Any, run: Any) -> LoopKernel | None:
    """The loop from plant and run without numbers."""
    try:
        return LoopKernel(kind, plant, run)
    except NotScalarError:  # a controller that is not scalar arithmetic
        return None


def _entry(plants: Any, run: Any, time: np.ndarray) -> Any:
    """What the function of a tick reads, shape (K,), or (D, K) for the noise of plants, (G, K) for controllers' own."""
    return run.wanted, run.bias, run.judged, time, plants.misread


def _lasting(plants: Any, run: Any) -> _Lasting:
    return _Lasting(
        (plants.throttle, plants.drive, plants.ceiling), (run.settings, run.first), (run.ecu, run.body, run.start)
    )


def _array(values: Any, k: int, shape: tuple[int, ...]) -> Any:
    if not shape:
        return values[f"{k}.0"]
    return jnp.stack([values[f"{k}.{n}"] for n in range(math.prod(shape))]).reshape(shape)


def _rows(tree: Any, count: int) -> list[np.ndarray]:
    """The numbers of `count` plants or controllers, shape (n, count), leaf by leaf."""
    return [np.asarray(leaf, dtype=float).reshape(count, -1).T for leaf in jax.tree.leaves(tree)]
