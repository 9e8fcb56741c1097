"""The residual, its sum of squares and its Jacobian by machine code: what `residual`, `chi2` and `normal_equations` run
where the model has a single pass and llvmlite is there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..kernels.loop import Across
from ..kernels.machine import LANES, POINTS, Kernel, available
from .free_parameters import Form, Pick
from .one_pass import has_single_pass
from .program import CORES, in_background, side_by_side
from .records import Group, Records, records_of
from .residual import Compared, WeightedData
from .traced_entry import TracedEntry

_KERNELS = 1024  # that a process remembers, some 50 kB each


def runs(form: Form, weighted: WeightedData) -> bool:
    """Whether the residual of a model runs as machine code."""
    return available() and has_single_pass(form, weighted)


class Sums(NamedTuple):
    """Sums over all samples of r and of its derivatives D in the *values* of the free parameters.

    Args:
        chi2: r^T r, dimensionless.
        gradient: D^T r, shape (P,), 1 over the unit of each parameter.
        information: D^T D, shape (P, P).
    """

    chi2: float
    gradient: Float[np.ndarray, " P"]
    information: Float[np.ndarray, "P P"]


def free_of(form: Form, pick: Pick) -> tuple[str, ...]:
    """Symbols of the free parameters."""
    return tuple(form.parameters[k].symbol for k in np.asarray(pick.where) if k < len(form.parameters))


@lru_cache(maxsize=_KERNELS)
def _made(entry: TracedEntry, across: Across, free: tuple[str, ...], summed: bool, stored: bool) -> Kernel:
    return Kernel(entry.loop(across, free, summed, stored), LANES if across is Across.LANES else POINTS)


_MAKING = RLock()  # a graph grows while it is differentiated, and each kernel is made once


def _kernel(
    entry: TracedEntry, across: Across, free: tuple[str, ...] = (), summed: bool = False, stored: bool = False
) -> Kernel:
    with _MAKING:
        return _made(entry, across, free, summed, stored)


def _records(form: Form, weighted: WeightedData) -> Records:
    with _MAKING:
        return records_of(form, weighted)


def ahead(form: Form, weighted: WeightedData) -> None:
    """Begin to make, in the background, what a descent runs."""

    def make() -> None:
        entry = _records(form, weighted).entry
        _kernel(entry, Across.LANES, free_of(form, weighted.pick), summed=True)
        _kernel(entry, Across.LANES, summed=True)

    in_background(make)


def sums(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Sums:
    """What a least-squares step needs.

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        weighted: data and whitening.
    """
    records, free = _records(form, weighted), free_of(form, weighted.pick)
    kernel = _kernel(records.entry, Across.LANES, free, summed=True)
    total = _over_lanes(kernel, records, full)
    size = len(free)
    lower = np.zeros((size, size))
    lower[np.tril_indices(size)] = total[1 + size :]
    return Sums(float(total[0]), total[1 : 1 + size], lower + np.tril(lower, -1).T)


def chi2(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> float:
    """Sum of squares of the whitened residual; arguments as of `sums`."""
    records = _records(form, weighted)
    return float(_over_lanes(_kernel(records.entry, Across.LANES, summed=True), records, full)[0])


def chi2_of_points(form: Form, fulls: Float[np.ndarray, "K Q"], weighted: WeightedData) -> Float[np.ndarray, " K"]:
    """The same of many points, shape (K, Q) -> (K,): each vector holds points."""
    records = _records(form, weighted)
    kernel, count = _kernel(records.entry, Across.POINTS, summed=True), len(fulls)
    sets = [np.take(fulls, range(k, k + POINTS), axis=0, mode="clip") for k in range(0, count, POINTS)]
    fixed = [np.ascontiguousarray(np.column_stack((some, np.tile(records.uniform, (POINTS, 1)))).T) for some in sets]
    lanes = [(group, side) for group in records.groups for side in range(len(group.lanes))]
    tasks = [(k, group, side) for k in range(len(sets)) for group, side in lanes]

    def run(task: tuple[int, Group, int]) -> np.ndarray:
        k, group, side = task
        at = [8 * side + record.ctypes.data for record in (group.lasting, group.renewed)]
        return kernel.run(group.rows[side], LANES, at, fixed[k], np.zeros((kernel.carried, POINTS)), _NOTHING)[0]

    out = np.zeros((len(sets), POINTS))
    for (k, *_), each in zip(tasks, _shared_out(run, tasks, lambda task: task[1].rows[task[2]]), strict=True):
        out[k] += each
    return out.ravel()[:count]


def compared(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Compared:
    """What each slot ought to show, and the whitened residual; arguments as of `sums`."""
    records = _records(form, weighted)
    kernel = _kernel(records.entry, Across.LANES, stored=True)
    count, out = records.shape[2], np.zeros((*records.shape[:2], kernel.stored))
    _over_lanes(kernel, records, full, out)
    return Compared(out[..., :count], out[..., count:])


def linearised(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "T L M P"]]:
    """The whitened residual, shape (T, L, M), and its derivatives in the values of the free parameters, shape
    (T, L, M, P); arguments as of `sums`."""
    records, free = _records(form, weighted), free_of(form, weighted.pick)
    kernel = _kernel(records.entry, Across.LANES, free, stored=True)
    (steps, lanes, count), out = records.shape, np.zeros((*records.shape[:2], kernel.stored))
    _over_lanes(kernel, records, full, out)
    slopes = out[..., 2 * count :].reshape(steps, lanes, len(free), count)
    return out[..., count : 2 * count], np.swapaxes(slopes, 2, 3)


_NOTHING = np.zeros(1)  # is stored


def _over_lanes(
    kernel: Kernel, records: Records, full: Float[np.ndarray, " Q"], out: np.ndarray | None = None
) -> np.ndarray:
    """Run over all lanes: the sums; what is stored goes to `out`, shape (T, L, stored)."""
    fixed = np.concatenate((full, records.uniform))

    def run(group: Group) -> np.ndarray:
        stored = _NOTHING if out is None else np.empty((group.longest, kernel.stored, LANES))
        at = [record.ctypes.data for record in (group.lasting, group.renewed)]
        total = kernel.run(group.longest, LANES, at, fixed, np.zeros((kernel.carried, LANES)), stored)
        if out is not None:
            records.unpacked(group, stored, out)
        return total.sum(axis=1)

    return np.sum(_shared_out(run, records.groups, lambda group: group.longest), axis=0)


def _shared_out(run: Callable[[Any], Any], tasks: Sequence[Any], length: Callable[[Any], int]) -> list[Any]:
    """Results of tasks in their order, which the cores share, longest first."""
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
