"""The whitening filter, the variance of a free run and the error of integration by machine code.

A first pass simulates and finds impacts and, where the input jumps within an interval, the states that it jumps from. A
second simulates again, with what those events are uncertain by, and carries the covariance along. The formulas are
those of `process_noise`, `innovations` and `substeps`, traced.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.loop import Across
from ..kernels.machine import LANES, Kernel, available
from ..model.effects import State
from ..model.parameters import Scalar
from ..model.stepper import StatePath, begun, step
from ..model.throttle import Throttle
from .batch import BatchArrays
from .free_parameters import Form
from .innovations import InnovationsFilter, renewed
from .lanes import MAKING, compiled, over_lanes, remembered
from .process_noise import (
    ErrorProcess,
    Events,
    edge_covariance,
    impact,
    impacts_nearby_here,
    linearised_step,
    order_of,
    process_of,
    spread_on,
)
from .records import Entries, numbered, records_of, used_rows
from .residual import equipped
from .substeps import step_error, worst
from .traced_entry import Column, Shape, TracedEntry, nodes_of

_GRAPHS = 128  # that a process remembers


def runs(form: Form) -> bool:
    """Whether these run as machine code for a model."""
    return available() and not any(effect.delays for effect in form.types)


def filter_and_timing(
    form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays, jitter: float
) -> tuple[InnovationsFilter, Float[np.ndarray, "T L M"]]:
    """What `innovations.kalman` returns, of the free run.

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        batch: as it was logged, arrays of NumPy.
        jitter: standard deviation of the sampling instants, as a share of the time between samples.
    """
    stored = _along(_filtered, form, full, (*batch, _events(form, full, batch)), jitter)
    n, m = order_of(form.types), batch.slots.value.shape[2]
    shapes = {"transition": (n, n), "sense": (m, n), "gain": (m, n), "weight": (m,), "timing": (m,)}
    parts = _parted(stored, shapes)
    timing = parts.pop("timing")
    return InnovationsFilter(**parts), timing


def free_run_variance(
    form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays, jitter: float
) -> Float[np.ndarray, "T L M"]:
    """What `process_noise.free_run_variance` returns; arguments as of `filter_and_timing`."""
    return _along(_spread, form, full, (*batch, _events(form, full, batch)), jitter)


def local_error(form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays) -> Float[np.ndarray, "T L"]:
    """What `substeps.local_error` returns; arguments as of `filter_and_timing`."""
    stored = _along(_stepped, form, full, tuple(batch))
    weight = np.asarray(batch.slots.weight)
    return worst(stored[..., 1:], weight, impacts_nearby_here(stored[..., 0], weight), np)


class _Given(NamedTuple):
    """One entry as it acts on the model: states and memories before and after it, and its part of the batch."""

    throttle: Throttle
    before: StatePath
    after: StatePath
    batch: BatchArrays


def _taken(form: Form, values: Any, path: StatePath, entry: Any) -> _Given:
    steps, resets, slots, disturbance, test_of = entry
    throttle = Throttle.build(form.types, values)
    steps, resets = equipped(throttle, steps, resets, test_of, values)
    before = begun(throttle, *path, resets)
    batch = BatchArrays(steps, resets, slots, disturbance, test_of)
    return _Given(throttle, before, step(throttle, *before, steps), batch)


def _process(given: _Given, events: Events) -> ErrorProcess:
    steps, disturbance = given.batch.steps, given.batch.disturbance
    linear = linearised_step(given.throttle, *given.before, steps, disturbance)
    return process_of(given.throttle, given.before, given.after, given.batch, linear, events)


def _filtered(form: Form, values: Any, carried: Any, entry: Any, jitter: Scalar) -> Any:
    path, covariance = carried
    given = _taken(form, values, path, entry[:5])
    covariance, found = renewed(covariance, _process(given, entry[5]), given.batch.slots.weight, jitter)
    return (given.after, covariance), found


def _spread(form: Form, values: Any, carried: Any, entry: Any, jitter: Scalar) -> Any:
    path, covariance = carried
    given = _taken(form, values, path, entry[:5])
    process = _process(given, entry[5])
    covariance, spread = spread_on(covariance, process.transition, process.noise, process.sense)
    return (given.after, covariance), spread + process.sample_variance(jitter)


def _stepped(form: Form, values: Any, path: StatePath, entry: Any) -> Any:
    given = _taken(form, values, path, entry)
    steps, _, slots, _, test_of = given.batch
    error = step_error(given.throttle, *given.before, steps, slots, test_of)
    return given.after, (impact(given.before[0], given.after[0], steps), error)


def _passed(form: Form, values: Any, path: StatePath, entry: Any) -> Any:
    given = _taken(form, values, path, entry)
    return given.after, (impact(given.before[0], given.after[0], given.batch.steps), given.before, given.after[0])


def _jumped(form: Form, values: Any, carried: Any, entry: Any) -> Any:
    """The covariance by a jump, each entry by itself: what is carried is not read."""
    steps, resets, disturbance, test_of, (x, z), end = entry
    throttle = Throttle.build(form.types, values)
    steps, _ = equipped(throttle, steps, resets, test_of, values)
    return carried, edge_covariance(throttle, x, z, end, steps, disturbance)


def _path(form: Form) -> StatePath:
    """Numbers like those that are carried from step to step."""
    memories = len(Throttle.build(form.types, dict.fromkeys(form.index, 0.5)).z0)
    return State(0.0, 0.0, 0.0), (0.0,) * memories


def _with_covariance(form: Form) -> Any:
    order = order_of(form.types)
    return _path(form), np.zeros((order, order))


@remembered(_GRAPHS)
def _made(function: Callable[..., Any], form: Form, shape: Shape, covariance: bool) -> tuple[TracedEntry, Kernel]:
    carried, further = (_with_covariance(form), ("jitter",)) if covariance else (_path(form), ())
    entry = TracedEntry(function, form, shape, carried, further)
    return entry, compiled(entry.loop(Across.LANES, stored=nodes_of(entry.results)))


def _along(
    function: Callable[..., Any], form: Form, full: Float[np.ndarray, " Q"], tree: tuple[Any, ...], *jitter: float
) -> Float[np.ndarray, "T L stored"]:
    """Results of a function of each entry along a batch; jitter where it carries a covariance."""
    steps, _, slots, _, _, *events = numbered(tree)
    renewed = frozenset({steps.guide_stiffness, slots.value, slots.weight, slots.sigma, *jax.tree.leaves(events)})
    dt, begins = np.asarray(tree[0].dt), np.asarray(tree[1].begins)
    batch = Entries(tree, used_rows(dt, begins), renewed, never=(Column(steps.guide_stiffness, ()),))
    return _run(function, form, full, batch, jitter)


def _run(
    function: Callable[..., Any],
    form: Form,
    full: Float[np.ndarray, " Q"],
    batch: Entries,
    jitter: tuple[float, ...] = (),
) -> Float[np.ndarray, "T L stored"]:
    kernels: list[Kernel] = []

    def entry_of(shape: Shape) -> TracedEntry:
        entry, kernel = _made(function, form, shape, bool(jitter))
        kernels.append(kernel)
        return entry

    with MAKING:
        records = records_of(batch, entry_of)
    return over_lanes(kernels[0], records, np.concatenate((full, jitter)))[1]


def _parted(stored: Float[np.ndarray, "T L stored"], shapes: dict[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
    """What was stored, by name, each with its own axes after T and L."""
    parts, at = {}, 0
    for name, shape in shapes.items():
        size = math.prod(shape)
        parts[name] = stored[..., at : at + size].reshape(*stored.shape[:2], *shape)
        at += size
    return parts


def _events(form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays) -> Events:
    weight, edge = np.asarray(batch.slots.weight), np.asarray(batch.disturbance.edge)
    count = len(jax.tree.leaves(_path(form)))
    stored = _along(_passed, form, full, tuple(batch))
    parts = _parted(stored, {"lost": (), "before": (count,), "after": (3,)})
    spread = np.zeros((*edge.shape, 3, 3))
    rows, lanes = np.nonzero(edge > 0.0)
    if rows.size:
        began = rows - np.maximum(edge[rows, lanes] - 1.0, 0.0).astype(int)
        fold, pad = partial(np.pad, mode="edge"), -rows.size % LANES

        def gathered(array: Any, at: np.ndarray = rows) -> np.ndarray:
            picked = np.asarray(array)[at, lanes]
            return fold(picked, [(0, pad)] + [(0, 0)] * (picked.ndim - 1)).reshape(-1, LANES, *picked.shape[1:])

        before = [gathered(parts["before"][..., k], began) for k in range(count)]
        end = State(*(gathered(parts["after"][..., k]) for k in range(3)))
        logged = jax.tree.map(gathered, (batch.steps, batch.resets, batch.disturbance, batch.test_of))
        entry = (*logged, (State(*before[:3]), tuple(before[3:])), end)
        # few entries, which would be alike by chance: nothing is taken as the same at all of them
        every = frozenset(range(len(jax.tree.leaves(entry))))
        found = _run(_jumped, form, full, Entries(entry, np.full(LANES, len(end.i)), every))
        spread[rows, lanes] = found.reshape(-1, 3, 3)[: rows.size]
    return Events(impacts_nearby_here(parts["lost"], weight), spread)
