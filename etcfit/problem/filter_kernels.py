"""The whitening filter, the variance of a free run and the error of integration by machine code.

A first pass simulates and finds impacts and, where the input jumps within an interval, the states before the jumps. A
second pass simulates again, with the uncertainty of these events, and propagates the covariance. The formulas are those
of `process_noise`, `innovations` and `substeps`, traced.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.machine import LANES
from ..model.effects import State
from ..model.stepper import StatePath, begun, step
from ..model.throttle import Throttle
from .batch import BatchArrays
from .free_parameters import Form
from .innovations import InnovationsFilter, renewed
from .lanes import Along
from .lateness import Simulated, acting_late
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
from .records import Entries, numbered, used_rows
from .residual import equipped
from .substeps import step_error, worst
from .traced_entry import Column

_JITTER = "jitter of instants"  # a name that is no symbol of a parameter


def filter_and_timing(
    form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays, jitter: float
) -> tuple[InnovationsFilter, Float[np.ndarray, "T L M"]]:
    """The result of `innovations.kalman` for the free run.

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        batch: the logged batch, arrays of NumPy.
        jitter: standard deviation of the sampling instants, as a share of the time between samples.
    """
    batch = _acting(form, full, batch)
    filter_, timing = along(_FILTERED, form, full, batch, (_events(form, full, batch),), (jitter,))
    return filter_._replace(weight=np.asarray(filter_.weight)), np.asarray(timing)


def free_run_variance(
    form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays, jitter: float
) -> Float[np.ndarray, "T L M"]:
    """The result of `process_noise.free_run_variance`; arguments as of `filter_and_timing`."""
    batch = _acting(form, full, batch)
    return np.asarray(along(_SPREAD, form, full, batch, (_events(form, full, batch),), (jitter,)))


def local_error(form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays) -> Float[np.ndarray, "T L"]:
    """The result of `substeps.local_error`; arguments as of `filter_and_timing`."""
    lost, error = map(np.asarray, along(_STEPPED, form, full, batch))
    weight = np.asarray(batch.slots.weight)
    return worst(error, weight, impacts_nearby_here(lost, weight), np)


def _acting(form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays) -> BatchArrays:
    """The batch with the acting input if the input is late."""
    if batch.steps.acting is not None:
        return batch
    return batch._replace(steps=acting_late(form, full, Simulated(batch.steps, batch.resets, batch.test_of)))


class Given(NamedTuple):
    """One entry of a simulated batch: states and memories before and after it, and its part of the batch."""

    throttle: Throttle
    before: StatePath
    after: StatePath
    batch: BatchArrays


def _taken(form: Form, values: Any, path: StatePath, entry: Any) -> Given:
    steps, resets, slots, disturbance, test_of = entry
    throttle = Throttle.build(form.types, values)
    steps, resets = equipped(throttle, steps, resets, test_of, values)
    before = begun(throttle, *path, steps, resets)
    batch = BatchArrays(steps, resets, slots, disturbance, test_of)
    return Given(throttle, before, step(throttle, *before, steps), batch)


def _process(given: Given, events: Events) -> ErrorProcess:
    steps, disturbance = given.batch.steps, given.batch.disturbance
    linear = linearised_step(given.throttle, *given.before, steps, disturbance)
    return process_of(given.throttle, given.before, given.after, given.batch, linear, events)


def _filtered(form: Form, values: Any, carried: Any, entry: Any) -> Any:
    path, covariance = carried
    given = _taken(form, values, path, entry[:5])
    covariance, found = renewed(covariance, _process(given, entry[5]), given.batch.slots.weight, values[_JITTER])
    return (given.after, covariance), found


def _spread(form: Form, values: Any, carried: Any, entry: Any) -> Any:
    path, covariance = carried
    given = _taken(form, values, path, entry[:5])
    process = _process(given, entry[5])
    covariance, spread = spread_on(covariance, process.transition, process.noise, process.sense)
    return (given.after, covariance), spread + process.sample_variance(values[_JITTER])


def _stepped(given: Given) -> Any:
    steps, _, slots, _, test_of = given.batch
    error = step_error(given.throttle, *given.before, steps, slots, test_of)
    return impact(given.before[0], given.after[0], steps), error


def _passed(given: Given) -> Any:
    return impact(given.before[0], given.after[0], given.batch.steps), given.before, given.after[0]


def _jumped(form: Form, values: Any, carried: Any, entry: Any) -> Any:
    """The covariance by a jump, each entry by itself; the carry is not used."""
    steps, resets, disturbance, test_of, (x, z), end = entry
    throttle = Throttle.build(form.types, values)
    steps, _ = equipped(throttle, steps, resets, test_of, values)
    return carried, edge_covariance(throttle, x, z, end, steps, disturbance)


def _path(form: Form) -> StatePath:
    """Example numbers of the carry from step to step."""
    memories = len(Throttle.build(form.types, dict.fromkeys(form.index, 0.5)).z0)
    return State(0.0, 0.0, 0.0), (0.0,) * memories


def _with_covariance(form: Form) -> Any:
    order = order_of(form.types)
    return _path(form), np.zeros((order, order))


def along(
    which: Along,
    form: Form,
    full: Float[np.ndarray, " Q"],
    batch: BatchArrays,
    events: tuple[Events, ...] = (),
    jitter: tuple[float, ...] = (),
) -> Any:
    """Results along a batch, axes T and L first, see `Along.run`.

    Args:
        which: see `along_path`.
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        batch: the logged batch, arrays of NumPy.
        events, jitter: given if a covariance is carried.
    """
    tree = *_acting(form, full, batch), *events
    steps, _, slots, _, _, *late = numbered(tree)
    renewed = frozenset({steps.guide_stiffness, *slots[:3], *jax.tree.leaves((steps.acting, late))})
    rows = used_rows(batch.steps, batch.resets)
    entries = Entries(tree, rows, renewed, never=(Column(steps.guide_stiffness, ()),), lasting=False)
    return which.run((form,), np.concatenate((full, np.asarray(jitter))), entries)


def _simulated(function: Callable[..., Any], *known: Any, covariance: bool = False) -> Along:
    """A function of (form, values, carry, entry); `known`: its key, see `Along`."""

    def function_of(form: Form) -> Any:
        carried = _with_covariance(form) if covariance else _path(form)
        return partial(function, form), (*form.index, *((_JITTER,) if covariance else ())), carried, form.ties

    return Along(function_of, *known)


def along_path(function: Callable[[Given], Any]) -> Along:
    """Results of a function of each entry of a simulated batch, for `along`; the function is defined in a module."""

    def one(form: Form, values: Any, path: StatePath, entry: Any) -> Any:
        given = _taken(form, values, path, entry)
        return given.after, function(given)

    return _simulated(one, function)


_FILTERED, _SPREAD = (_simulated(each, each, covariance=True) for each in (_filtered, _spread))
_STEPPED, _PASSED, _JUMPED = along_path(_stepped), along_path(_passed), _simulated(_jumped, _jumped)


def _events(form: Form, full: Float[np.ndarray, " Q"], batch: BatchArrays) -> Events:
    weight, edge = np.asarray(batch.slots.weight), np.asarray(batch.disturbance.edge)
    lost, before, after = jax.tree.map(np.asarray, along(_PASSED, form, full, batch))
    spread = np.zeros((*edge.shape, 3, 3))
    rows, lanes = np.nonzero(edge > 0.0)
    if rows.size:
        began, pad = rows - np.maximum(edge[rows, lanes] - 1.0, 0.0).astype(int), -rows.size % LANES

        def gathered(array: Any, at: np.ndarray = rows) -> np.ndarray:
            filled = np.concatenate((np.arange(rows.size), np.zeros(pad, int)))
            picked = np.asarray(array)[at[filled], lanes[filled]]
            return picked.reshape(-1, LANES, *picked.shape[1:])

        logged = jax.tree.map(gathered, (batch.steps, batch.resets, batch.disturbance, batch.test_of))
        path = jax.tree.map(partial(gathered, at=began), before), jax.tree.map(gathered, after)
        entry = (*logged, *path)
        # few entries may be equal by chance, so no column is treated as constant
        every = frozenset(range(len(jax.tree.leaves(entry))))
        count = np.full(LANES, logged[-1].shape[0])
        found = np.asarray(_JUMPED.run((form,), full, Entries(entry, count, every, lasting=False)))
        spread[rows, lanes] = found.reshape(-1, 3, 3)[: rows.size]
    return Events(impacts_nearby_here(lost, weight), spread)
