"""Computes the residual, its sum of squares and its Jacobian by machine code, if llvmlite is installed.

`EstimationProblem`, `chi2`, `normal_equations` and `diagnosis.tangents` call it. It splits the lanes of a batch in two,
has another module compute each part, and puts the results together: `one_pass_kernels` takes the lanes in which no
signal is delayed, in one pass; `late_kernels` takes those with a delayed input or sensor, in several.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from . import late_kernels, one_pass_kernels
from .free_parameters import Form
from .innovations import InnovationsFilter
from .lateness import Shifts, Simulated
from .one_pass import has_single_pass
from .one_pass_kernels import LinearisedTrace, Place, Sums, free_of, rows_of
from .records import Grouped, Remembered
from .residual import Compared, WeightedData

_LATE, _SLICES = Remembered(), Remembered()


class _Part(NamedTuple):
    """Some lanes of a batch, and the module that computes them."""

    by: ModuleType
    lanes: Int[np.ndarray, " l"]
    weighted: WeightedData


def _parts(form: Form, weighted: WeightedData) -> list[_Part]:
    lanes = np.arange(weighted.slots.value.shape[1])
    if has_single_pass(form, weighted):
        return [_Part(one_pass_kernels, lanes, weighted)]
    late, used = _late_and_used(form, weighted)
    late = late | _lanes_with_moved_samples(weighted.whitening)
    prompt = weighted._replace(whitening=weighted.whitening._replace(moved=None))
    found = (one_pass_kernels, lanes[~late & used], prompt), (late_kernels, lanes[late & used], weighted)
    return [_Part(by, some, _take_lanes(data, some)) for by, some, data in found if some.size]


def _late_and_used(form: Form, weighted: WeightedData) -> tuple[Bool[np.ndarray, " L"], Bool[np.ndarray, " L"]]:
    """Lanes in which a signal may be delayed, and lanes that hold data, as masks."""
    batch = Simulated(weighted.steps, weighted.resets, weighted.test_of)

    def found() -> tuple[np.ndarray, np.ndarray]:
        somewhere = 1e-3 * np.arange(1.0, 1.0 + len(form.parameters))  # values at which no delay is 0 by chance
        late = Shifts(form, somewhere, batch).lanes
        used = rows_of(weighted) > 0
        return np.isin(np.arange(used.size), late), used

    return _LATE.made_once(jax.tree.leaves(batch), form, found)


def _take_lanes(weighted: WeightedData, lanes: Int[np.ndarray, " l"]) -> WeightedData:
    """The data of some lanes; the same slices for the same arrays, so that each is packed once."""
    data = weighted.steps, weighted.resets, weighted.slots, weighted.test_of, weighted.whitening
    if lanes.size == weighted.slots.value.shape[1]:
        return weighted

    def some(leaf: np.ndarray | Grouped) -> np.ndarray:
        return _SLICES.made_once([leaf], lanes.tobytes(), lambda: np.ascontiguousarray(np.asarray(leaf)[:, lanes]))

    return weighted._replace(**dict(zip(WeightedData._fields[:5], jax.tree.map(some, data), strict=True)))


def _lanes_with_moved_samples(filter_: InnovationsFilter) -> Bool[np.ndarray, " L"]:
    """Lanes in which samples move to other entries; the filter may be that of another model."""
    if filter_.moved is None:
        return np.zeros(filter_.weight.shape[1], dtype=bool)
    still = np.arange(filter_.weight.shape[0])[:, None, None]
    return np.any(np.asarray(filter_.moved.forth) != still, axis=(0, 2))


def _merge_lanes(parts: Sequence[_Part], results: Sequence[np.ndarray], lanes: int) -> np.ndarray:
    """Results of parts, axes T and L first, in one array; 0 in blank lanes."""
    if parts[0].lanes.size == lanes:
        return results[0]
    shape = results[0].shape
    out = np.zeros((shape[0], lanes, *shape[2:]))
    for part, each in zip(parts, results, strict=True):
        out[:, part.lanes] = each
    return out


def compile_ahead(form: Form, weighted: WeightedData) -> None:
    """Start compiling, in the background, the kernels of a descent; does nothing if a signal is delayed."""
    if has_single_pass(form, weighted):
        one_pass_kernels.compile_ahead(form, weighted)


def sums(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Sums:
    """The sums that a least-squares step needs (`Sums`).

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        weighted: data and whitening, arrays of NumPy.
    """
    each = [part.by.sums(form, full, part.weighted) for part in _parts(form, weighted)]
    return Sums(*(np.sum(terms, axis=0) for terms in zip(*each, strict=True)))


def chi2(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> float:
    """Sum of squares of the whitened residual; arguments as of `sums`."""
    return float(sum(part.by.chi2(form, full, part.weighted) for part in _parts(form, weighted)))


def chi2_of_points(form: Form, fulls: Float[np.ndarray, "K Q"], weighted: WeightedData) -> Float[np.ndarray, " K"]:
    """`chi2` of many points at once, shape (K, Q) -> (K,)."""
    each = [part.by.chi2_of_points(form, fulls, part.weighted) for part in _parts(form, weighted)]
    return np.sum(each, axis=0)


def compared(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Compared:
    """The simulated value of each slot, and the whitened residual; arguments as of `sums`."""
    parts, lanes = _parts(form, weighted), weighted.slots.value.shape[1]
    each = [part.by.compared(form, full, part.weighted) for part in parts]
    return Compared(*(_merge_lanes(parts, some, lanes) for some in zip(*each, strict=True)))


def linearised(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, by: tuple[str, ...] | None = None
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "T L M P"]]:
    """The whitened residual, shape (T, L, M), and its derivatives in the values of some parameters, shape (T, L, M, P).

    Args:
        form, full, weighted: as of `sums`.
        by: symbols; None: the free parameters.
    """
    free, parts = free_of(form, weighted.pick) if by is None else by, _parts(form, weighted)
    each = [part.by.linearised(form, full, part.weighted, free) for part in parts]
    r, slopes = (_merge_lanes(parts, some, weighted.slots.value.shape[1]) for some in zip(*each, strict=True))
    return r, slopes


def linearised_at(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, places: Sequence[Place]
) -> list[LinearisedTrace]:
    """As `linearised`, only at some places, n entries each: the residual, shape (n, M), and its derivatives in the
    values of the free parameters, shape (M, n, P).

    Args:
        form, full, weighted: as of `sums`.
        places: each in a used lane.
    """
    free, found = free_of(form, weighted.pick), {}
    for part in _parts(form, weighted):
        within = {int(lane): place for place, lane in enumerate(part.lanes)}
        own = [k for k, (lane, _) in enumerate(places) if lane in within]
        there = [(within[places[k][0]], places[k][1]) for k in own]
        found |= dict(zip(own, part.by.linearised_at(form, full, part.weighted, free, there), strict=True))
    return [found[k] for k in range(len(places))]
