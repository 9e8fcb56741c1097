"""Traces in a batch: rectangular arrays of integration steps for the stepper and the whitening.

Short traces share a lane in sequence and long ones have a lane of their own, so that one compiled model serves all
folders of similar size with little padding.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np
from jaxtyping import Float, Int

from ..kernels.machine import available
from ..model.parameters import AnyArray
from ..model.rig_effects import number_of
from ..model.stepper import Command, Edge, Reset, Step
from ..rig.base import RigConfig
from . import edges
from .breaks import Breaks, breaks_of
from .ticks import broken, commands
from .trace import Trace


class Packing(NamedTuple):
    """Traces in lanes."""

    lanes: list[list[int]]  # for each lane, the numbers of its traces in sequence
    length: int  # number of entries of every lane


def pack(lengths: Sequence[int], least: int = 0) -> Packing:
    """The lane of each trace: little padding, and few different shapes to compile for.

    The longest trace first, each into the first lane with enough space; lanes are as long as the longest trace,
    rounded up.

    Args:
        lengths: number of entries of each trace.
        least: least number of entries of a lane.
    """
    length = max(least, rounded(max(lengths)))
    lanes: list[list[int]] = []
    free: list[int] = []
    for k in sorted(range(len(lengths)), key=lambda k: -lengths[k]):
        lane = next((j for j, room in enumerate(free) if room >= lengths[k]), None)
        if lane is None:
            lanes.append([])
            free.append(length)
            lane = len(lanes) - 1
        lanes[lane].append(k)
        free[lane] -= lengths[k]
    lanes += [[] for _ in range(rounded(len(lanes)) - len(lanes))]
    return Packing(lanes, length)


def rounded(n: int) -> int:
    """Round up to a number of at most four significant bits, so that similar folders share one compiled shape."""
    unit = max(1, 2 ** max(0, math.floor(math.log2(max(n, 1))) - 3))
    return unit * math.ceil(n / unit)


KINDS = ("current", "position", "emf", "motor_speed")  # channels of a slot


class SampleSlots(NamedTuple):
    """Measured samples at the end of each step, shape (T, L, M) each."""

    value: Float[AnyArray, "T L M"]  # sample, SI unit of its channel; 0 without a sample
    weight: Float[AnyArray, "T L M"]  # 1 if there is a sample to fit, else 0
    sigma: Float[AnyArray, "T L M"]  # standard deviation of its noise, unit of the value; 1 without a sample
    kind: Float[AnyArray, "T L M"]  # its channel, an index into `KINDS`


class Disturbance(NamedTuple):
    """Uncertainty of input and initial state, shape (T, L) each; start_* are 0 except at the first entry of a trace.

    The error e of the input (V, or N m if a torque is the input) changes from step to step as

        e_k = keep_k e_{k-1} + w_k,    var w_k = fresh_k
    """

    keep: Float[AnyArray, "T L"]  # share of the input's error kept from the step before, dimensionless
    fresh: Float[AnyArray, "T L"]  # variance added to it, V^2 or (N m)^2
    edge: Float[AnyArray, "T L"]  # number of steps of an interval in which the input jumps, at its last entry; else 0
    # edge_from, edge_to: input before and after that jump, V or N m
    edge_from: Float[AnyArray, "T L"]
    edge_to: Float[AnyArray, "T L"]
    edge_span: Float[AnyArray, "T L"]  # length of that interval, s
    spacing: Float[AnyArray, "T L"]  # time since the sample before, s
    # start_i, start_theta, start_omega: variance of the initial state, A^2, rad^2 and (rad/s)^2
    start_i: Float[AnyArray, "T L"]
    start_theta: Float[AnyArray, "T L"]
    start_omega: Float[AnyArray, "T L"]
    # variance of the release instant, s^2, at the entry of the step that follows it; else 0
    release: Float[AnyArray, "T L"]
    # variance of the instant at which an ECU in the model read its setpoint's jump, s^2, at the entry before the step
    # that ends there; else 0
    seen: Float[AnyArray, "T L"]
    # d dt / d instant of each step's length, because the ECU's ticks are in step with that instant: > 0 before the jump
    # and before a tick, < 0 after one, 0 if the step does not depend on it
    follows: Float[AnyArray, "T L"]


class BatchArrays(NamedTuple):
    """The arrays of a `TraceBatch`, for compiled functions; axes T, L and M."""

    # steps, resets, slots, disturbance, test_of: see `TraceBatch`
    steps: Step
    resets: Reset
    slots: SampleSlots
    disturbance: Disturbance
    test_of: Float[AnyArray, "T L"]


@dataclass(frozen=True, eq=False)
class TraceBatch:
    """All traces of a problem as arrays over steps T, lanes L and sample slots M: the residual's data."""

    steps: Step  # integration steps: length, inputs, boundary conditions; (T, L)
    resets: Reset  # begins of traces and their initial states; (T, L)
    slots: SampleSlots  # samples; (T, L, M)
    disturbance: Disturbance  # uncertainty of inputs and initial states; (T, L)
    guidable: Float[np.ndarray, "T L"]  # 1 where a logged angle exists for a guide, shape (T, L)
    # `number_of` the rig test of each entry's trace, shape (T, L); 0 in blank entries
    test_of: Float[np.ndarray, "T L"]
    traces: tuple[Trace, ...]  # the traces in the order given
    # for each trace its lane, its first entry, and the entry of each of its n instants
    places: tuple[tuple[int, int, Int[np.ndarray, " _"]], ...]

    def stretches(self, count: int) -> Iterator[tuple[int, np.ndarray]]:
        """Lane and entries of each of `count` equal parts of every trace."""
        for lane, _, marks in self.places:
            for stretch in np.array_split(marks, count):
                yield lane, stretch

    def holding(self, volts: Float[np.ndarray, " traces"]) -> TraceBatch:
        """The batch with other initial voltages in the integrals of ECUs that are part of the model.

        Args:
            volts: voltage for each trace, V; without effect if no such ECU drives it.
        """
        traces = tuple(t.holding(float(v)) for t, v in zip(self.traces, volts, strict=True))
        level = np.array(self.steps.voltage0)
        for trace, (lane, row, marks) in zip(traces, self.places, strict=True):
            if trace.controlled and trace.input is not None:
                level[row : marks[-1] + 1, lane] = trace.input.value[0]
        active = np.asarray(self.steps.command.active) > 0.5 if self.steps.command is not None else False
        steps = self.steps._replace(voltage0=level, voltage1=np.where(active, level, self.steps.voltage1))
        return replace(self, steps=steps, traces=traces)

    def with_times_of(self, traces: Sequence[Trace], config: RigConfig, substeps: Sequence[np.ndarray]) -> TraceBatch:
        """The batch with other instants of releases, or other instants at which an ECU in the model read its setpoint's
        jump. Arrays that do not change are the same objects, unless a trace now has another number of steps.

        Args:
            traces: the traces of the batch, some with another such instant.
            config, substeps: as of `batch_of`.
        """
        parts: dict[str, Any] = {"steps": self.steps, "resets": self.resets, "slots": self.slots}
        parts["disturbance"] = self.disturbance
        if self.steps.command is not None:
            parts["command"] = self.steps.command

        def arrays(part: Any) -> dict[str, np.ndarray]:
            return {name: column for name, column in part._asdict().items() if isinstance(column, np.ndarray)}

        table = {name: column for part in parts.values() for name, column in arrays(part).items()}
        places, fresh = list(self.places), set()
        for k, (trace, (lane, row, _)) in enumerate(zip(traces, self.places, strict=True)):
            if trace is self.traces[k]:
                continue
            breaks, command = _under_ecu(trace, substeps[k], config)
            if breaks.ends.size != self.places[k][2][-1] - row + 1:
                return batch_of(traces, config, substeps, self.guidable.shape + self.slots.sigma.shape[2:])
            places[k] = lane, row, row + breaks.marks
            for name, column in _strip(trace, breaks, command, config).items():
                own = slice(row, row + len(column)), lane, *(slice(n) for n in column.shape[1:])
                if name in table and not np.array_equal(table[name][own], column):
                    if name not in fresh:
                        table[name] = np.array(table[name])
                        fresh.add(name)
                    table[name][own] = column
        renewed = {name: part._replace(**{n: table[n] for n in arrays(part)}) for name, part in parts.items()}
        if "command" in renewed:
            renewed["steps"] = renewed["steps"]._replace(command=renewed.pop("command"))
        return replace(self, **renewed, traces=tuple(traces), places=tuple(places))

    def jumping(self, share: float) -> TraceBatch:
        """The batch with every edge of the voltage at one share of its interval: 0 at its begin, 1 at its end.

        Steps have an input linear in time, so a jump within a step is approximated by a line with the same mean and
        first moment.
        """
        early, late = np.array(self.steps.voltage0), np.array(self.steps.voltage1)
        for trace, (lane, _, marks) in zip(self.traces, self.places, strict=True):
            if trace.circuit and trace.input is not None:
                for k in np.flatnonzero(trace.input.edge):
                    rows = np.arange(marks[k] + 1, marks[k + 1] + 1)
                    inside = np.clip(share * rows.size - np.arange(rows.size), 0.0, 1.0)  # share of each step
                    before, after = trace.input.value[k : k + 2]
                    mean = before + (after - before) * (1.0 - inside)
                    swing = 3.0 * (after - before) * inside * (1.0 - inside)
                    early[rows, lane], late[rows, lane] = mean - swing, mean + swing
        return replace(self, steps=self.steps._replace(voltage0=early, voltage1=late))

    def guided(self, guide_stiffness: float) -> Step:
        """The steps with a guide that pulls the plate along the measured angle where one was logged.

        Args:
            guide_stiffness: V/rad, or N m/rad if a torque is the input; 0 for a free run.
        """
        kept = _GUIDES.setdefault(self, WeakValueDictionary())
        along = kept.get(guide_stiffness)
        if along is None:
            along = kept[guide_stiffness] = guide_stiffness * self.guidable
        return self.steps._replace(guide_stiffness=along)


# the same array for the same stiffness as long as it is in use, so that it is packed for a kernel only once
_GUIDES: WeakKeyDictionary[TraceBatch, WeakValueDictionary[float, np.ndarray]] = WeakKeyDictionary()


def batch_of(
    traces: Sequence[Trace],
    config: RigConfig,
    substeps: Sequence[Int[np.ndarray, " _"]],
    least: tuple[int, ...] = (0, 0, 0),
) -> TraceBatch:
    """Put traces into a batch: long ones in lanes of their own, short ones in sequence.

    Args:
        config: their rig, for gear ratio and stops.
        substeps: integration steps in each interval between instants, shape (n - 1,) for each trace.
        least: least steps T, lanes L and slots M of the batch, so that programs compiled for another batch can be used
            again.
    """
    steps = [_under_ecu(t, n, config) for t, n in zip(traces, substeps, strict=True)]
    sizes = [breaks.ends.size for breaks, _ in steps]
    lanes, length = pack(sizes, least[0])
    lanes += [[] for _ in range(least[1] - len(lanes))]
    if available():  # a kernel works for any length and any number of lanes
        lanes = [lane for lane in lanes if lane]
        length = max(sum(sizes[k] for k in lane) for lane in lanes)
    slots = max(least[2], *(len(t.channels) for t in traces))
    table = _Table((length, len(lanes)), slots, config)
    places: list[tuple[int, int, np.ndarray]] = [(0, 0, np.zeros(0, int))] * len(traces)
    for lane, members in enumerate(lanes):
        row = 0
        for k in members:
            strip, marks = _strip(traces[k], *steps[k], config), steps[k][0].marks
            for name, column in strip.items():
                table.write(name, row, lane, column)
            places[k] = (lane, row, row + marks)
            row += strip["dt"].size
    return _assemble(table, tuple(traces), tuple(places), config.ecu is not None)


def _error(trace: Trace, interval: Int[np.ndarray, " rows"]) -> dict[str, Float[np.ndarray, " rows"]]:
    """Share of the input's error kept in each step, and variance added."""
    keep, fresh = np.ones(interval.size), np.zeros(interval.size)
    signal = trace.input
    if signal is not None:
        new = np.concatenate(([True], np.diff(interval) > 0))
        new[1] = True  # entry 0 is the start itself; entry 1 begins the first interval
        after_edge = np.concatenate(([True], signal.edge[:-1]))
        memory = np.where(signal.edge | after_edge, 0.0, signal.memory[:-1])
        variance = signal.error[:-1] ** 2 * (1.0 - memory**2)
        keep[new], fresh[new] = memory[interval[new]], variance[interval[new]]
        keep[0], fresh[0] = 0.0, 0.0
    return {"keep": keep, "fresh": fresh}


def _strip(trace: Trace, breaks: Breaks, command: Mapping[str, np.ndarray], config: RigConfig) -> dict[str, np.ndarray]:
    """All columns of one trace, by its steps and the commands to an ECU in them."""
    ends, interval, marks = breaks
    n = ends.size
    zeros, ones = np.broadcast_to(0.0, n), np.broadcast_to(1.0, n)
    early, late = edges.levels(trace, ends, interval)
    boundary, first = trace.test.boundary, np.arange(n) == 0
    dt = np.diff(ends, prepend=ends[0])
    held = boundary.plate_held * ones
    release = np.zeros(n)
    if trace.release is not None:
        held = np.where(ends <= trace.release[0], 1.0, 0.0)
        release[int(np.argmax(held < 0.5))] = trace.release[1] ** 2
    electric = zeros if trace.torque_driven else ones
    target = _target(trace, ends)
    columns = {
        "dt": dt,
        "guide_stiffness": zeros,
        "voltage0": early * electric,
        "voltage1": late * electric,
        "torque0": early * (1.0 - electric),
        "torque1": late * (1.0 - electric),
        "time": ends - ends[0],
        "mobile": 1.0 - held,
        "circuit": ones * trace.circuit,
        "plate": ones * (not boundary.gear_apart),
        "test_of": ones * number_of(trace.test.name),
        "trace": ones * number_of(trace.measurement.file),
        "duty": early / config.supply_V if trace.sags and config.supply_V else zeros,
        "begins": first * 1.0,
        "release": release,
        "guidable": ones * ("position" in trace.channels and not boundary.plate_held),
        "lever": ones * trace.torque_driven,
        "target0": np.concatenate((target[:1], target[:-1])),
        "target1": target,
        "spacing": np.where(first, 0.0, np.diff(trace.instants)[np.minimum(interval, trace.instants.size - 2)]),
    }
    for name, value, sd in zip(("i", "theta", "omega"), trace.start.state, trace.start.sd, strict=True):
        columns[name] = first * value
        columns[f"start_{name}"] = first * sd**2
    placed, unplaced = edges.in_step(trace, ends, interval), edges.unplaced(trace, marks, n)
    for more in (placed, _error(trace, interval), unplaced, command, _samples(trace, n, marks)):
        columns.update(more)
    return columns


def _under_ecu(
    trace: Trace, substeps: Int[np.ndarray, " intervals"], config: RigConfig
) -> tuple[Breaks, dict[str, np.ndarray]]:
    """The steps, and the inputs of an ECU that is part of the model (`Command`), which are zero if it does not drive
    the trace."""
    if config.ecu is None or trace.setpoint is None:
        return breaks_of(trace, edges.halved(trace, substeps)), {}
    breaks, ticks = broken(trace, trace.setpoint, substeps, config.ecu)
    return breaks, commands(trace.setpoint, trace.start.state[1], breaks.ends, ticks, config.ecu, config.bias)


def _target(trace: Trace, ends: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    """The measured angle at the end of each step, rad; 0 where none was logged."""
    if "position" not in trace.channels:
        return np.zeros(ends.size)
    angle = trace.data[:, trace.channels.index("position")]
    seen = np.isfinite(angle)
    return np.interp(ends, trace.instants[seen], angle[seen])


def _samples(trace: Trace, rows: int, marks: Int[np.ndarray, " n"]) -> dict[str, Float[np.ndarray, "{rows} M"]]:
    shape = (rows, len(trace.channels))
    value, weight, sigma = np.zeros(shape), np.zeros(shape), np.ones(shape)
    seen = np.isfinite(trace.data)
    value[marks] = np.where(seen, trace.data, 0.0)
    weight[marks] = seen
    sigma[:] = trace.sigma
    kind = np.broadcast_to([float(KINDS.index(c)) for c in trace.channels], shape)
    return {"value": value, "weight": weight, "sigma": sigma, "kind": kind}


class _Table:
    """Columns of a batch, at first blank: steps of length 0, without motion and observation.

    A column takes memory only when a value differs. In memory the entries of a lane are contiguous, as traces are
    written and packed.

    Args:
        shape: T and L.
        slots: M.
        config: the rig.
    """

    def __init__(self, shape: tuple[int, int], slots: int, config: RigConfig) -> None:
        self._shape, self._slots, self._columns = shape, slots, dict[str, np.ndarray]()
        lower, upper = config.travel
        self._blank = {"sigma": 1.0, "gear_ratio": config.gear_ratio, "lower": lower, "upper": upper}

    def write(self, name: str, row: int, lane: int, column: Float[np.ndarray, "_ ..."]) -> None:
        """Write a column of a trace into a lane from an entry on; it may have fewer channels than there are slots."""
        if name not in self._columns:
            if np.all(column == self._blank.get(name, 0.0)):
                return
            length, lanes = self._shape
            shape, order = ((lanes, length), (1, 0)) if column.ndim == 1 else ((lanes, self._slots, length), (2, 0, 1))
            self._columns[name] = np.full(shape, self._blank.get(name, 0.0)).transpose(order)
        self._columns[name][(slice(row, row + len(column)), lane, *map(slice, column.shape[1:]))] = column

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def column(self, name: str) -> Float[np.ndarray, "T L *M"]:
        """A column; if it is constant, a repeated number, which takes no memory."""
        shape = (*self._shape, self._slots) if name in SampleSlots._fields else self._shape
        column = self._columns.get(name)
        if column is None:
            return np.broadcast_to(self._blank.get(name, 0.0), shape)
        first = column.flat[0]
        return np.broadcast_to(first, shape) if np.all(column == first) else column

    def part(self, kind: Any) -> Any:
        """The columns that are fields of a kind of tuple."""
        return kind(*map(self.column, kind._fields))


def _assemble(
    table: _Table, traces: tuple[Trace, ...], places: tuple[tuple[int, int, np.ndarray], ...], controlled: bool
) -> TraceBatch:
    command = table.part(Command) if controlled else None
    edge = table.part(Edge) if "span" in table else None
    duty = table.column("duty") if "duty" in table else None
    steps = table.part(Step)._replace(command=command, edge=edge, duty=duty, besides=None, acting=None)
    parts = steps, table.part(Reset), table.part(SampleSlots), table.part(Disturbance)
    return TraceBatch(*parts, table.column("guidable"), table.column("test_of"), traces, places)
