"""Models that delay a signal, by machine code. A late reading needs the path, so there are several passes:

    1. all delays, and the rig's input if the input is late                          machine code
    2. the input shifted                                                               NumPy
    3. the model simulated and observed                                                machine code
    4. channels shifted, compared with the samples, late samples moved                 NumPy
    5. the error whitened                                                              machine code

Every pass is linear in the result of the pass before, except for the delays, so tangents use the same passes. The
formulas are those of `residual`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ..kernels.loop import Across
from ..kernels.machine import Kernel
from ..model.stepper import StepBesides, begun, step
from ..model.throttle import Throttle
from .batch import KINDS
from .free_parameters import Form
from .innovations import InnovationsFilter, innovate, shifted_samples
from .lanes import Along, compiled, remembered, shared_out, stored_over_lanes
from .lateness import Shifts, Simulated
from .one_pass import Carried, carried_like, pushed
from .one_pass_kernels import LinearisedTrace, Place, Sums, free_of, never_in, rows_of
from .records import Entries, Records, Remembered, numbered, records_of
from .residual import Compared, WeightedData, equipped, shown
from .residual_entry import SimulatedEntry
from .traced_entry import Shape, nodes_of

_GRAPHS, _KERNELS = 32, 256  # largest numbers that a process remembers


# ---- the simulation


class _Observed(NamedTuple):
    """The sensors' readings after a step."""

    prompt: Any  # values of the slots that are not late, shape (M,)
    signals: Mapping[str, Any]  # values of late channels at that instant
    # acting, ways: the given ones
    acting: Any
    ways: Mapping[str, Any]


def _observed(late: Sequence[str], form: Form, values: Any, carried: Carried, entry: Any) -> tuple[Carried, _Observed]:
    batch: Simulated
    batch, kind, ways = entry
    acting, throttle = batch.steps.acting, Throttle.build(form.types, values)
    s, reset = equipped(throttle, *batch, values)
    x, z = step(throttle, *begun(throttle, carried.x, carried.z, s, reset), s)
    seen = throttle.read(throttle.observe(x, z, s.inputs(1.0)), batch.test_of, s.trace)
    prompt = shown({name: seen[name] for name in KINDS if name not in late}, kind)
    return Carried(x, z, ()), _Observed(prompt, {name: seen[name] for name in late}, acting, ways)


class _ObservedEntry(SimulatedEntry):
    def __init__(self, form: Form, shape: Shape, late: tuple[str, ...]) -> None:
        super().__init__(lambda *given: _observed(late, *given), form, shape, 0)
        found: _Observed = self.traced.results
        self.results = nodes_of((found.prompt, found.signals))
        self.acting = nodes_of(found.acting)
        self.ways = {symbol: nodes_of(way) for symbol, way in found.ways.items()}


_EntryArguments = tuple[Form, Shape, tuple[str, ...]]  # arguments of `_ObservedEntry`


@remembered(_GRAPHS)
def _observed_entry(form: Form, shape: Shape, late: tuple[str, ...]) -> _ObservedEntry:
    return _ObservedEntry(form, shape, late)


@remembered(_KERNELS, __name__, "leaves")
def _leaves(*arguments: Any) -> tuple[int, ...]:
    return _observed_entry(*arguments).traced.leaves


@remembered(_KERNELS, __name__, "kernel")
def _observed_kernel(arguments: _EntryArguments, free: tuple[str, ...]) -> Kernel:
    entry = _observed_entry(*arguments)
    return compiled(entry.loop(Across.LANES, free, stored=entry.results))


class _Laid(NamedTuple):
    """A batch in the form for `_observed`."""

    late: Shifts  # all delays in it
    tree: Any  # its entries
    rows: Int[np.ndarray, " L"]  # number of used entries of each lane, shape (L,)
    renewed: frozenset[int]  # leaves that change with the guide, and with the parameters
    places: Mapping[str, tuple[np.ndarray, ...]]  # entries, lanes and slots of each channel that may be late

    def shown(
        self, prompt: Float[np.ndarray, "*K T L M"], read: Mapping[str, Float[np.ndarray, "*K T L"]]
    ) -> Float[np.ndarray, "*K T L M"]:
        """The value of each slot, from the prompt channels and the late ones."""
        for name, column in read.items():
            rows, lanes, slots = self.places[name]
            prompt[..., rows, lanes, slots] = column[..., rows, lanes]
        return prompt


_PLACES, _PACKED = Remembered(), Remembered()


def _places_of(kind: Float[np.ndarray, "T L M"]) -> dict[str, tuple[np.ndarray, ...]]:
    """Entries, lanes and slots of each channel; channels without slots are left out."""
    every = ((name, np.nonzero(kind == k)) for k, name in enumerate(KINDS))
    return {name: places for name, places in every if places[0].size}


def _laid(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, differentiated: bool = False) -> _Laid:
    batch = Simulated(weighted.steps, weighted.resets, weighted.test_of)
    kind = np.asarray(weighted.slots.kind)
    places = _PLACES.made_once([kind], None, lambda: _places_of(kind))
    late = Shifts.latest(form, full, batch, differentiated, places)
    tree = batch._replace(steps=batch.steps._replace(acting=late.acting)), kind, dict(late.ways)
    numbers = numbered(tree)
    changing = jax.tree.leaves((numbers[0].steps.acting, numbers[2]))
    renewed = frozenset({numbers[0].steps.guide_stiffness, *changing})
    return _Laid(late, tree, rows_of(weighted), renewed, {n: places[n] for n in late.channels if n in places})


def _simulated(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...]
) -> Float[np.ndarray, "K T L M"]:
    """The simulated value of each slot, and its derivatives in the free parameters, K = 1 + P."""
    laid = _laid(form, full, weighted, bool(free))
    records, arguments = _packed(form, laid)
    out = stored_over_lanes(_observed_kernel(arguments, free), records, full)
    parts = np.moveaxis(out.reshape(*records.shape, 1 + len(free), -1), 2, 0)
    count, late = weighted.slots.kind.shape[-1], laid.late
    shown = {name: parts[..., count + late.channels.index(name)] for name in laid.places}
    seen = np.ascontiguousarray(parts[..., :count])
    laid.shown(seen[0], {name: late.read(name, each[0]) for name, each in shown.items()})
    if free:
        laid.shown(seen[1:], {name: late.tangents(free, name, each[1:], each[0]) for name, each in shown.items()})
    return seen


def _packed(form: Form, laid: _Laid) -> tuple[Records, _EntryArguments]:
    """The batch in the form for a kernel; packed once, unless its input depends on the parameters."""

    def made_of(shape: Shape) -> tuple[tuple[int, ...], _EntryArguments]:
        arguments = form, shape, laid.late.channels
        return _leaves(*arguments), arguments

    def packed() -> tuple[Records, _EntryArguments]:
        return records_of(Entries(laid.tree, laid.rows, laid.renewed), made_of)

    changes = laid.late.acting is not None
    return packed() if changes else _PACKED.made_once(jax.tree.leaves(laid.tree), (form, laid.late.channels), packed)


def _responds(form: Form, late: tuple[str, ...]) -> Any:
    def one(values: Any, carried: Any, entry: Any) -> Any:
        (batch, kind, _), way = entry

        def response(before: Carried, acts: StepBesides) -> Any:
            within = batch._replace(steps=batch.steps._replace(besides=acts))
            after, seen = _observed(late, form, values, before, (within, kind, {}))
            return after, (seen.prompt, seen.signals)

        return pushed(response, carried, way)

    return one, tuple(form.index), (carried_like(form, 0),) * 2, form.ties


_RESPONSES = Along(_responds, _responds)


def responses(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, besides: Sequence[StepBesides]
) -> Float[np.ndarray, "K T L M"]:
    """The result of `input_perturbation.responses`."""
    laid = _laid(form, full, weighted)

    def along(way: StepBesides) -> np.ndarray:
        tree = laid.tree, way
        ways = frozenset(jax.tree.leaves(numbered(tree)[1]))
        prompt, signals = _RESPONSES.run(
            (form, laid.late.channels), full, Entries(tree, laid.rows, laid.renewed | ways)
        )
        late = {name: laid.late.read(name, np.asarray(signals[name])) for name in laid.places}
        return laid.shown(np.array(prompt), late)

    errors = np.stack([-weighted.slots.weight * along(way) for way in besides])
    return whitened(weighted.whitening, errors, laid.rows)


# ---- the whitening


def _whitens(order: int, columns: int) -> Any:
    def one(values: Any, state: Any, entry: Any) -> Any:
        return innovate(state, *entry)

    return one, (), (np.zeros(columns),) * order, ()


_WHITENED = Along(_whitens, _whitens)


def whitened(
    filter_: InnovationsFilter, errors: Float[np.ndarray, "K T L M"], rows: Any
) -> Float[np.ndarray, "K T L M"]:
    """`innovations.whiten` for K errors.

    Args:
        filter_: the frozen filter, arrays of NumPy.
        errors: measured - simulated, SI, 0 without a sample.
        rows: number of used entries of each lane, shape (L,).
    """
    if filter_.moved is not None:
        forth, back = filter_.moved
        there = shifted_samples(errors, forth)
        return shifted_samples(whitened(filter_._replace(moved=None), there, rows), back)
    tree = filter_, np.ascontiguousarray(np.moveaxis(errors, 0, 2))
    numbers = numbered(tree)
    weight = numbers[0].weight
    renewed = frozenset({*numbers[0][:3], weight, numbers[1]})
    batch = Entries(tree, rows, renewed, frozenset({weight}), never_in(filter_, numbers[0]))
    out = _WHITENED.run((filter_.transition.shape[-1], len(errors)), np.zeros(0), batch)
    return np.moveaxis(np.asarray(out), 2, 0)


# ---- the residual: arguments as of `one_pass_kernels`


def compared(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Compared:
    """The simulated value of each slot, and the whitened residual."""
    with np.errstate(all="ignore"):  # simulations that diverge
        seen = _simulated(form, full, weighted, ())
        error = weighted.slots.weight * (weighted.slots.value - seen)
        return Compared(seen[0], whitened(weighted.whitening, error, rows_of(weighted))[0])


def linearised(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...]
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "T L M P"]]:
    """The whitened residual, and its derivatives in the values of some parameters."""
    r, slopes = _linearised(form, full, weighted, free)
    return r, np.moveaxis(slopes, 0, -1)


def linearised_at(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...], places: Sequence[Place]
) -> list[LinearisedTrace]:
    """As `linearised`, only at some places."""
    r, slopes = linearised(form, full, weighted, free)
    return [(r[rows, lane], np.moveaxis(slopes[rows, lane], 1, 0)) for lane, rows in places]


def sums(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> Sums:
    """The sums that a least-squares step needs."""
    free = free_of(form, weighted.pick)
    r, slopes = _linearised(form, full, weighted, free)
    flat = slopes.reshape(len(free), -1)
    with np.errstate(all="ignore"):
        return Sums(np.sum(r**2), flat @ r.ravel(), flat @ flat.T)


def chi2(form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData) -> float:
    """Sum of squares of the whitened residual."""
    with np.errstate(all="ignore"):
        return float(np.sum(compared(form, full, weighted).r ** 2))


def chi2_of_points(form: Form, fulls: Float[np.ndarray, "K Q"], weighted: WeightedData) -> Float[np.ndarray, " K"]:
    """`chi2` of many points, in parallel."""
    return np.array(shared_out(lambda full: chi2(form, full, weighted), list(fulls), lambda _: 1))


def _linearised(
    form: Form, full: Float[np.ndarray, " Q"], weighted: WeightedData, free: tuple[str, ...]
) -> tuple[Float[np.ndarray, "T L M"], Float[np.ndarray, "P T L M"]]:
    with np.errstate(all="ignore"):
        seen = _simulated(form, full, weighted, free)
        seen[0] -= weighted.slots.value
        out = whitened(weighted.whitening, -weighted.slots.weight * seen, rows_of(weighted))
    return out[0], out[1:]
