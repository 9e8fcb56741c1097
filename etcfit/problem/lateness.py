"""Delays of the signals of a model in a batch, and the shifted signals, with derivatives in the parameters; late
samples moved to the instants that they show, where the whitening has their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..kernels.derivatives import forward
from ..kernels.graph import Graph
from ..kernels.lowering import lowered
from ..kernels.machine import Kernel
from ..model.delay import Clock, Earlier, LateInput, between, earlier, late_input
from ..model.effects import AbstractEffect
from ..model.parameters import Scalar
from ..model.rig_effects import AbstractRigEffect
from ..model.stepper import Acting, Reset, Step
from ..model.throttle import Throttle
from .batch import TraceBatch
from .free_parameters import Form
from .innovations import Moved
from .lanes import Stored, remembered, stored
from .records import Entries, Latest, Records, Remembered, numbered, records_of, used_rows
from .residual import equipped
from .traced_entry import Shape, TracedEntry, nodes_of

_REMEMBERED = 256  # number of remembered kernels
_AT_ONCE = 65_536  # numbers of tangents that are shifted at a time: more do not fit into the caches
_WARP = 2e-5  # relative change of a step's length for the numerical derivative of a shift

Signal = Float[np.ndarray, "T L"]


class Simulated(NamedTuple):
    """The simulated batch, arrays of NumPy with axes T and L: see `TraceBatch`."""

    steps: Step
    resets: Reset
    test_of: Signal


class Lags(NamedTuple):
    """Delays of signals. Quantities that depend on no parameter, or are never late, are None or left out."""

    acting: Any  # voltage and torque of the rig, before their delay
    input: Any  # delay of the input, s
    dt: Any  # length of each step, s
    channels: Mapping[str, Any]  # delay of each channel, s
    logged: Mapping[str, Any]  # lateness of the rig's channels, s


def _lags(form: Form, values: Any, carried: Any, entry: Simulated) -> Any:
    throttle = Throttle.build(form.types, values)
    s, _ = equipped(throttle, *entry, values)
    delays = throttle.delays()
    return carried, Lags(s.levels, delays.input, s.dt, delays.channels, throttle.lateness(s, entry.test_of))


class _LagsEntry:
    """`Lags` of one entry as a graph.

    Attributes:
        traced: the graph.
        late: nodes of `Lags`.
        ways: nodes of its derivative in each parameter that changes it.
        depends: numbers of the parameters on which it depends.
    """

    def __init__(self, form: Form, shape: Shape) -> None:
        self.traced = TracedEntry(lambda *given: _lags(form, *given), tuple(form.index), shape, (), form.ties)
        graph, found = self.traced.graph, self.traced.results
        zero = graph.constant(0.0)

        def tangents(symbol: str, *wanted: int) -> dict[int, int]:
            return forward(graph, graph.needed(wanted), {self.traced.fixed[symbol]: graph.constant(1.0)})

        kept: dict[str, Any] = {
            name: {channel: node for channel, node in getattr(found, name).items() if graph.known(node) != 0.0}
            for name in ("channels", "logged")
        }
        if not _acts_late(form):
            kept |= {"acting": None, "input": None}
        if not any(found.dt in tangents(symbol, found.dt) for symbol in form.index):
            kept["dt"] = None
        self.late: Lags = found._replace(**kept)
        wanted, self.ways = nodes_of(self.late), {}
        needed = set(graph.needed(wanted))
        self.depends = tuple(k for k, symbol in enumerate(form.index) if self.traced.fixed[symbol] in needed)
        for symbol in form.index:
            moves = tangents(symbol, *wanted)
            if any(node in moves for node in wanted):
                self.ways[symbol] = jax.tree.map(lambda node, of=moves: of.get(node, zero), self.late)


class _LagsKernel(NamedTuple):
    """The kernel of `Lags` and their derivatives, and the numbers of the parameters that they depend on."""

    results: Stored
    kernel: Kernel
    depends: tuple[int, ...]


@remembered(_REMEMBERED, __name__, "lags")
def _lags_entry(form: Form, shape: Shape) -> tuple[tuple[int, ...], _LagsKernel]:
    entry = _LagsEntry(form, shape)
    return entry.traced.leaves, _LagsKernel(*stored(entry.traced, (entry.late, entry.ways)), entry.depends)


_PACKED, _CLOCKS = Remembered(), Remembered()
_LATEST = Latest(4)  # two threads, each with and without derivatives


def _packed(form: Form, batch: Simulated) -> tuple[Records, _LagsKernel]:
    def packed() -> Any:
        renewed = frozenset({numbered(batch).steps.guide_stiffness})
        entries = Entries(batch, used_rows(batch.steps, batch.resets), renewed)
        return records_of(entries, lambda shape: _lags_entry(form, shape))

    return _PACKED.made_once(jax.tree.leaves(batch), form, packed)


class _Reading(NamedTuple):
    """The shift of a channel: first the delay of the throttle, then the lateness of the rig."""

    delay: Earlier | None  # None without a delay
    logged: Any  # a `Between` of some lanes
    lanes: Int[np.ndarray, " l"]  # lanes in which the rig may log it late

    def read(self, signal: Signal) -> Signal:
        signal = signal if self.delay is None else self.delay.delayed(signal)
        return self._with(signal, self.logged.delayed(signal[:, self.lanes], np))

    def tangents(
        self, ways: Float[np.ndarray, "K T L"], signal: Signal, moves: Sequence[tuple[Any, Any]]
    ) -> Float[np.ndarray, "K T L"]:
        """Derivatives of `read`, from those of the signal and, in pairs, those of its delay and of its lateness."""
        if self.delay is not None:
            rate = self.delay.rate(signal)
            ways = self.delay.delayed(ways)
            for way, (delay, _) in zip(ways, moves, strict=True):
                way -= delay * rate
            signal = self.delay.delayed(signal)
        own = self.logged.delayed(ways[..., self.lanes], np)
        if any(np.any(late) for _, late in moves):
            rate = self.logged.rate(signal[:, self.lanes])
            for way, (_, late) in zip(own, moves, strict=True):
                if np.any(late):
                    way -= late[:, self.lanes] * rate
        return self._with(ways, own)

    def _with(self, signal: Float[np.ndarray, "*K T L"], own: Float[np.ndarray, "*K T l"]) -> Any:
        out = np.array(signal)
        out[..., self.lanes] = own
        return out


class _Shifted(NamedTuple):
    """The shifts of the input and the channels for given lengths of the steps."""

    input: LateInput | None
    channels: Mapping[str, _Reading]

    def acting(self, levels: Acting) -> Acting:
        """What acts."""
        by = self.input
        return levels if by is None else Acting(*by.acting(*levels[:2], np), *by.acting(*levels[2:], np))


def _shifted(
    late: Lags,
    ways: Mapping[str, Lags],
    steps: Step,
    resets: Reset,
    names: Collection[str],
    near: _Shifted | None = None,
) -> _Shifted:
    """`names`: names of the channels. `near`: shifts whose entries are used again."""
    channels, still = {}, np.zeros(np.shape(steps.dt))
    for name in names:
        delay, logged = _delay(late.channels.get(name, 0.0)), late.logged.get(name, still)
        moves = [logged, *(way.logged[name] for way in ways.values() if name in way.logged)]
        lanes = np.flatnonzero(np.any([_anywhere(each) for each in moves], axis=0))
        own = _CLOCKS.made_once([steps.dt, resets.begins], lanes.tobytes(), partial(_clock_of, steps, resets, lanes))
        as_there = _Reading(None, None, lanes) if near is None else near.channels[name]
        channels[name] = _Reading(
            earlier(steps, resets, delay, np, as_there.delay) if delay > 0.0 else None,
            between(own, logged[:, lanes], np, as_there.logged),
            lanes,
        )
    delay = 0.0 if late.input is None else _delay(late.input)
    begun = None if near is None else near.input
    return _Shifted(late_input(steps, resets, delay, np, begun) if delay > 0.0 else None, channels)


def _clock_of(steps: Step, resets: Reset, lanes: Int[np.ndarray, " l"]) -> Clock:
    """Clock of some lanes."""
    own = steps._replace(dt=steps.dt[:, lanes]), resets._replace(begins=resets.begins[:, lanes])
    return Clock.of_batch(*own, np)


def _anywhere(signal: Signal) -> Bool[np.ndarray, " L"]:
    """Lanes in which a signal is not 0 at every entry; a repeated number (`lanes.Stored`) is tested once."""
    return np.any(signal if signal.strides[0] else signal[:1], axis=0)


def _delay(each: Any) -> float:
    """The common delay of all entries; blank ones have 0."""
    return float(np.max(each))


class Shifts:
    """All shifts at some values of the parameters.

    Args:
        form: the model.
        full: value of every parameter, SI, shape (Q,).
        batch: the simulated batch.
        differentiated: whether `ways` are needed.
        shown: channels that are read; if None, all that may be late.
    Attributes:
        acting: the acting input of each step; None if the input is never late.
        ways: its derivative in each parameter that changes it.
        channels: channels that may be late.
    """

    def __init__(
        self,
        form: Form,
        full: Float[np.ndarray, " Q"],
        batch: Simulated,
        differentiated: bool = False,
        shown: Collection[str] | None = None,
    ) -> None:
        records, (results, kernel, _) = _packed(form, batch)
        found: tuple[Lags, dict[str, Lags]] = jax.tree.map(np.asarray, results.over(kernel, records, full))
        (self._late, self._ways), self._batch = found, batch
        late = self._late
        self.channels = tuple(sorted({*late.channels, *late.logged}))
        self._read = [name for name in self.channels if shown is None or name in shown]
        self._as_is = self._with(late.dt)
        self._warped: dict[str, tuple[_Shifted, _Shifted, float]] = {}
        self.acting = None if late.acting is None else self._as_is.acting(late.acting)
        symbols = self._ways if differentiated and late.acting is not None else ()
        self.ways = {symbol: self._acting_way(symbol) for symbol in symbols}

    def _with(self, dt: Signal | None, near: _Shifted | None = None) -> _Shifted:
        steps = self._batch.steps if dt is None else self._batch.steps._replace(dt=dt)
        return _shifted(self._late, self._ways, steps, self._batch.resets, self._read, near)

    @classmethod
    def latest(
        cls,
        form: Form,
        full: Float[np.ndarray, " Q"],
        batch: Simulated,
        differentiated: bool = False,
        shown: Collection[str] | None = None,
    ) -> Shifts:
        """The same, computed again only if a parameter has changed on which a delay depends: in most searches all
        delays are constant. Arguments as of the class."""
        depends = full[list(_packed(form, batch)[1].depends)].tobytes()
        further = form, differentiated, None if shown is None else frozenset(shown), depends
        made = partial(cls, form, full, batch, differentiated, shown)
        return _LATEST.made_once(jax.tree.leaves(batch), further, made)

    @property
    def lanes(self) -> Int[np.ndarray, " l"]:
        """Lanes in which a signal may be late."""
        if self._late.acting is not None or self._late.channels:
            return np.arange(np.shape(self._batch.steps.dt)[1])
        of_channels = (reading.lanes for reading in self._as_is.channels.values())
        return np.unique(np.concatenate([np.zeros(0, dtype=int), *of_channels]))

    def read(self, channel: str, signal: Signal) -> Signal:
        """The logged signal of a channel."""
        return self._as_is.channels[channel].read(signal)

    def tangents(
        self, symbols: Sequence[str], channel: str, ways: Float[np.ndarray, "K T L"], signal: Signal
    ) -> Float[np.ndarray, "K T L"]:
        """Derivatives of `read` in parameters, given those of the signal, `ways`."""
        reading, out = self._as_is.channels[channel], np.empty(ways.shape)
        some = max(1, _AT_ONCE // signal.size)
        for k in range(0, len(symbols), some):
            few = slice(k, k + some)
            out[few] = reading.tangents(ways[few], signal, [self._moves(s, channel) for s in symbols[few]])
        for way, symbol in zip(out, symbols, strict=True):
            way += self._by_warp(symbol, lambda shifted: shifted.channels[channel].read(signal))
        return out

    def _moves(self, symbol: str, channel: str) -> tuple[Any, Any]:
        """Derivatives of a channel's delay and of its lateness in a parameter."""
        moves = self._ways.get(symbol)
        return (0.0, 0.0) if moves is None else (moves.channels.get(channel, 0.0), moves.logged.get(channel, 0.0))

    def _by_warp(self, symbol: str, read: Callable[[_Shifted], Any]) -> Any:
        """Derivative of a shift in a parameter that changes the lengths of steps, by a central difference: rarely
        needed, and exact to rounding if all steps are stretched equally."""
        way = None if symbol not in self._ways else self._ways[symbol].dt
        if way is None or not np.any(way):
            return 0.0
        if symbol not in self._warped:
            dt = self._late.dt
            by = _WARP * float(np.max(dt)) / float(np.max(np.abs(way)))
            later, sooner = (self._with(dt + sign * by * way, self._as_is) for sign in (1.0, -1.0))
            self._warped[symbol] = later, sooner, 2.0 * by
        later, sooner, by = self._warped[symbol]
        return (read(later) - read(sooner)) / by

    def _acting_way(self, symbol: str) -> Acting:
        way, driven, by = self._ways[symbol], self._late.acting, self._as_is.input
        moved = self._as_is.acting(way.acting)
        if by is None:  # no delay, no shift
            return moved
        rates = np.array([*by.rates(*driven[:2]), *by.rates(*driven[2:])])
        warp = self._by_warp(symbol, lambda shifted: np.array(shifted.acting(driven)))
        return Acting(*(np.array(moved) - way.input * rates + warp))


@remembered(_REMEMBERED, __name__, "acts late")
def _acts_late(form: Form) -> bool:
    """Whether the input of a model may be late."""
    graph = Graph()
    values = {name: graph.input(name) for name in form.index}
    delay = lowered(lambda values: jnp.asarray(Throttle.build(form.types, values).delays().input), graph, (values,))
    return graph.known(delay) != 0.0


def acting_late(form: Form, full: Float[np.ndarray, " Q"], batch: Simulated) -> Step:
    """The steps with the acting input if the input is late; arguments as of `Shifts`."""
    if not any(effect.delays for effect in form.types) or not _acts_late(form):
        return batch.steps
    return batch.steps._replace(acting=Shifts.latest(form, full, batch).acting)


def moved_samples(
    batch: TraceBatch, types: tuple[type[AbstractEffect], ...], values: Mapping[str, Scalar]
) -> Moved | None:
    """Places of late samples: earlier or later by the number of intervals in their lateness; None if none is late.

    Samples that would be before the first sample of their trace, or after its last, have no place. The rest of a
    lateness, at most half an interval, remains in the reading.

    Args:
        values: values of its parameters, SI by symbol.
    """
    late = tuple(effect for effect in types if issubclass(effect, AbstractRigEffect) and effect.delays)
    if not late:
        return None
    by = Throttle.build(late, values).lateness(batch.steps, batch.test_of)
    shape = batch.slots.value.shape
    seconds = {channel: np.broadcast_to(np.asarray(each, dtype=float), shape[:2]) for channel, each in by.items()}
    forth, back = (np.broadcast_to(np.arange(shape[0])[:, None, None], shape).copy() for _ in range(2))
    for trace, (lane, row, marks) in zip(batch.traces, batch.places, strict=True):
        interval = float(np.median(np.diff(trace.instants)))
        for m, channel in enumerate(trace.channels):
            if channel in seconds and (shift := round(float(seconds[channel][row, lane]) / interval)):
                shift = max(-marks.size, min(marks.size, shift))
                shown, logged = (marks[: marks.size - shift], marks[shift:]) if shift > 0 else (
                    marks[-shift:], marks[: marks.size + shift])  # fmt: skip
                forth[marks, lane, m] = back[marks, lane, m] = shape[0]
                forth[shown, lane, m], back[logged, lane, m] = logged, shown
    still = np.broadcast_to(np.arange(shape[0])[:, None, None], shape)
    return None if np.array_equal(forth, still) else Moved(forth, back)
