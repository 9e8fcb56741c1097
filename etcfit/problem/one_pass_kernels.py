"""The residual of a model with a single pass, its sum of squares and its Jacobian, by machine code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ..kernels.loop import Across
from ..kernels.machine import LANES, Kernel
from .cores import in_background
from .free_parameters import Form, Pick
from .innovations import InnovationsFilter
from .lanes import compiled, over_lanes, over_points, remembered, stored_over_lanes
from .one_pass import entries
from .records import Entries, Records, Remembered, as_numpy, numbered, records_of, used_rows
from .residual import Compared, WeightedData
from .residual_entry import ResidualEntry
from .traced_entry import Column, Shape

_GRAPHS, _KERNELS = 32, 1024  # largest numbers that a process remembers; some MB and some 50 kB each


Place = tuple[int, Int[np.ndarray, " _"]]  # a lane, and n entries of it
LinearisedTrace = tuple[Float[np.ndarray, "_ _"], Float[np.ndarray, "_ _ _"]]  # residual (n, M), derivatives (M, n, P)


class Sums(NamedTuple):
    """Sums over all samples of r and of its derivatives D in the *values* of the free parameters."""

    chi2: float  # r^T r, dimensionless
    gradient: Float[np.ndarray, " P"]  # D^T r, shape (P,), 1 over the unit of each parameter
    information: Float[np.ndarray, "P P"]  # D^T D, shape (P, P)


def free_of(form: Form, pick: Pick) -> tuple[str, ...]:
    """Symbols of the free parameters."""
    return tuple(form.parameters[k].symbol for k in np.asarray(pick.where) if k < len(form.parameters))


EntryArguments = tuple[Form, Shape, int]  # arguments of `ResidualEntry`


@remembered(_GRAPHS)
def entry(form: Form, shape: Shape, order: int) -> ResidualEntry:
    """One entry as a graph; traced again if it is no longer remembered."""
    return ResidualEntry(form, shape, order)


@remembered(_KERNELS, __name__, "leaves")
def _leaves(*arguments: Any) -> tuple[int, ...]:
    return entry(*arguments).traced.leaves


@remembered(_KERNELS, __name__, "kernel")
def kernel(
    arguments: EntryArguments, across: Across, free: tuple[str, ...] = (), summed: bool = False, stored: bool = False
) -> Kernel:
    """The loop of `ResidualEntry.residual_loop` as machine code, made once."""
    return compiled(entry(*arguments).residual_loop(across, free, summed, stored))


_PACKED = Remembered()


def data_of(weighted: WeightedData) -> tuple[Any, ...]:
    """The data in the form for `one_pass.advance`, without the noise of samples, which is in the filter's weights."""
    return entries(weighted._replace(slots=weighted.slots._replace(sigma=None)))


def rows_of(weighted: WeightedData) -> Int[np.ndarray, " L"]:
    """Number of used entries of each lane, shape (L,)."""
    return used_rows(weighted.steps, weighted.resets)


def renewed_and_muted(numbers: tuple[Any, ...]) -> tuple[frozenset[int], frozenset[int]]:
    """Numbers of the leaves of `data_of` that change with the filter, and of those among them that are 0 in blank
    entries."""
    steps, _, slots, _, filter_ = numbers
    weights = frozenset({slots.weight, filter_.weight})
    return weights | {steps.guide_stiffness, slots.value, *filter_[:3]}, weights


def packed_records(form: Form, weighted: WeightedData) -> tuple[Records, EntryArguments]:
    """The samples in the form for a kernel, packed once, and the arguments of `entry` for them."""
    return _PACKED.made_once(jax.tree.leaves(data_of(weighted)), form, lambda: _packed(form, weighted))


def _packed(form: Form, weighted: WeightedData) -> tuple[Records, EntryArguments]:
    tree = as_numpy(data_of(weighted))
    numbers, order = numbered(tree), weighted.whitening.transition.shape[-1]
    renewed, muted = renewed_and_muted(numbers)
    batch = Entries(tree, rows_of(weighted), renewed, muted, never_in(weighted.whitening, numbers[-1]))

    def made_of(shape: Shape) -> tuple[tuple[int, ...], EntryArguments]:
        return _leaves(form, shape, order), (form, shape, order)

    return records_of(batch, made_of)


def never_in(filter_: InnovationsFilter, numbers: InnovationsFilter) -> tuple[Column, ...]:
    """Columns of a filter that may be 0 everywhere, by the numbers of its leaves: no state acts on the input's error,
    and no sensor reads that. If samples are independent (`innovations.plain`) all columns are 0."""
    matrices = list(zip(filter_[:3], numbers[:3], strict=True))
    if all(isinstance(matrix, np.ndarray) and not np.any(matrix) for matrix, _ in matrices):
        return tuple(Column(int(leaf), place) for m, leaf in matrices for place in np.ndindex(m.shape[2:]))
    order, count = filter_.transition.shape[-1], filter_.sense.shape[-2]
    acts = (Column(numbers.transition, (order - 1, q)) for q in range(order - 1))  # pyright: ignore[reportArgumentType]
    reads = (Column(numbers.sense, (m, order - 1)) for m in range(count))  # pyright: ignore[reportArgumentType]
    return (*acts, *reads)


def compile_ahead(form: Form, weighted: WeightedData) -> None:
    """Start compiling, in the background, the kernels of a descent."""

    def make() -> None:
        arguments = packed_records(form, weighted)[1]
        kernel(arguments, Across.LANES, free_of(form, weighted.pick), True)
        kernel(arguments, Across.LANES, (), True)

    in_background(make)


def sums(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Sums:
    """The sums that a least-squares step needs.

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        weighted: data and whitening, arrays of NumPy.
    """
    free = free_of(form, weighted.pick)
    records, arguments = packed_records(form, weighted)
    total = over_lanes(kernel(arguments, Across.LANES, free, True), records, full)
    size = len(free)
    lower = np.zeros((size, size))
    lower[np.tril_indices(size)] = total[1 + size :]
    return Sums(total[0], total[1 : 1 + size], lower + np.tril(lower, -1).T)


def chi2(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> float:
    """Sum of squares of the whitened residual; arguments as of `sums`."""
    records, arguments = packed_records(form, weighted)
    return float(over_lanes(kernel(arguments, Across.LANES, (), True), records, full)[0])


def chi2_of_points(form: Form, fulls: Float[np.ndarray, "K Q"], weighted: WeightedData) -> Float[np.ndarray, " K"]:
    """`chi2` of many points at once, shape (K, Q) -> (K,); each vector holds several points."""
    records, arguments = packed_records(form, weighted)
    return over_points(kernel(arguments, Across.POINTS, (), True), records, fulls)[0]


def compared(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Compared:
    """The simulated value of each slot, and the whitened residual; arguments as of `sums`."""
    records, arguments = packed_records(form, weighted)
    out = stored_over_lanes(kernel(arguments, Across.LANES, (), False, True), records, full)
    count = weighted.slots.value.shape[-1]
    return Compared(out[..., :count], out[..., count:])


def linearised(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...]
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "T L M P"]]:
    """The whitened residual, shape (T, L, M), and its derivatives in the values of some parameters, shape (T, L, M, P).

    Args:
        form, full, weighted: as of `sums`.
        free: symbols of these parameters.
    """
    records, arguments = packed_records(form, weighted)
    out = stored_over_lanes(kernel(arguments, Across.LANES, free, False, True), records, full)
    count = weighted.slots.value.shape[-1]
    slopes = out[..., 2 * count :].reshape(*records.shape, len(free), count)
    return out[..., count : 2 * count], np.swapaxes(slopes, 2, 3)


def linearised_at(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...], places: Sequence[Place]
) -> list[LinearisedTrace]:
    """`linearised` only at some places; the results of the others are not kept. Arguments as of `linearised`."""
    records, arguments = packed_records(form, weighted)
    storing, count = kernel(arguments, Across.LANES, free, False, True), weighted.slots.value.shape[-1]
    out: list[Any] = [None] * len(places)

    def keep(group: int, numbers: np.ndarray) -> None:
        stored = numbers.reshape(-1, storing.stored, LANES)
        sides = {lane: side for side, lane in enumerate(records.groups[group].lanes)}
        for k, (lane, rows) in enumerate(places):
            if lane in sides:
                here = stored[rows, :, sides[lane]]
                columns = here[:, 2 * count :].reshape(len(rows), len(free), count)
                out[k] = here[:, count : 2 * count].copy(), np.ascontiguousarray(np.moveaxis(columns, 2, 0))

    over_lanes(storing, records, full, keep)
    return out
