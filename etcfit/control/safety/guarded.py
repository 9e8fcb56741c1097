"""Simulates an ECU with failure checks: its PID under a failing sensor or supply, until a check opens the bridge."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.parameters import Scalar
from ...model.pid import Gains, Memory, tick
from ..pid.base import Task
from ..pid.conditions import Conditions, under
from ..pid.loop import Loop, Path
from ..setpoint import Setpoint

NEVER = np.inf
_EARLY = 1e-9  # s by which a tick counts as on time


class SensorFault(NamedTuple):
    """The reading of a failed sensor: kept y + frozen (last reading) + shift."""

    begins: Scalar = NEVER  # s; infinite for never
    # kept, frozen: 1 or 0
    kept: Scalar = 1.0
    frozen: Scalar = 0.0
    shift: Scalar = 0.0  # rad


class Guards(NamedTuple):
    """Checks that open the bridge permanently; infinite for none."""

    # jam, jam_for: limit of the error (rad), and the time above it (s)
    jam: Scalar = NEVER
    jam_for: Scalar = NEVER
    # apart, apart_for: likewise for the difference of two sensors, the second one sound
    apart: Scalar = NEVER
    apart_for: Scalar = NEVER


SOUND, UNCHECKED = SensorFault(), Guards()


class Demand(NamedTuple):
    """Setpoint, supply and feed-forward of an ECU at each tick, shape (K,)."""

    angle: Any  # setpoint, rad
    supply: Any  # supply over the nominal one of the ECU
    ahead: Any  # feed-forward, V


class Equipment(NamedTuple):
    """The constants of an experiment."""

    gains: Gains  # gains of the PID
    fault: SensorFault  # fault of its sensor
    guards: Guards  # checks of the ECU


class Trial(NamedTuple):
    """One experiment; for many, every entry has a first axis G."""

    equipment: Equipment
    demand: Demand


class Watch(NamedTuple):
    """The memory of an ECU with checks."""

    pid: Memory  # memory of its controller
    time: Scalar  # time of the next tick, s
    shown: Scalar  # last reading of the sensor, rad
    # over, apart: time for which the error, or the difference of two sensors, has been too large, s
    over: Scalar
    apart: Scalar
    tripped: Scalar  # 1 after a check has opened the bridge


class Seen(NamedTuple):
    """The result of trials at each tick, shape (D, G, K)."""

    position: np.ndarray  # of the plate, rad
    shown: np.ndarray  # reading of the sensor, rad
    integral: np.ndarray  # integral of the PID, V
    tripped: np.ndarray  # 1 after a check has opened the bridge


def guarded(equipment: Equipment, ecu: Ecu, memory: Watch, demand: Demand, position: Scalar, bias: Scalar) -> Any:
    """`model.pid.tick` with a sensor that may fail, a supply that may sag, and checks that may cut the motor.

    The ECU does not measure the supply: its duty is a share of the actual supply. An ECU that divides by the battery
    voltage does measure it: there the supply only limits its output voltage. The supply sags from the tick at which a
    voltage is computed, that is, earlier by the delay of the output. A cut motor has shorted terminals, which brake it
    most.
    """
    del bias  # each trial has its own feed-forward
    fault, guards = equipment.fault, equipment.guards
    failed = memory.time >= fault.begins - _EARLY
    shown = jnp.where(failed, fault.kept * position + fault.frozen * memory.shown + fault.shift, position)
    volts, pid = tick(equipment.gains, ecu, memory.pid, demand.angle, shown, demand.ahead)
    over = jnp.where(jnp.abs(demand.angle - shown) > guards.jam, memory.over + ecu.period, 0.0)
    apart = jnp.where(jnp.abs(position - shown) > guards.apart, memory.apart + ecu.period, 0.0)
    late = (over > guards.jam_for + _EARLY) | (apart > guards.apart_for + _EARLY)
    tripped = jnp.maximum(memory.tripped, late.astype(float))
    most = demand.supply * ecu.limit
    given = jnp.where(ecu.compensated > 0.0, jnp.clip(volts, -most, most), demand.supply * volts)
    acting = jnp.where(tripped > 0.0, 0.0, given)
    return acting, Watch(pid, memory.time + ecu.period, shown, over, apart, tripped)


def run_trials(loop: Loop, trials: Trial, start: float) -> Seen:
    """Run trials of shape (G,) on every model, from rest at a share of the travel."""
    equipment, demand = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), trials)
    still = Setpoint((0.0, demand.angle.shape[-1] * loop.ecu.period), (start, start), ())
    none = np.zeros_like(equipment.gains.Kp)
    first = Watch(Memory.at_rest(equipment.gains, loop.ecu, loop.angle(start)), none, none, none, none, none)
    return Seen(*loop.run(guarded, equipment, first, still, keep=_seen, demand=demand))


def _seen(path: Path, memory: Watch) -> Seen:
    return Seen(path.position, memory.shown, memory.pid.integral, memory.tripped)


def stack_trials(trials: list[Trial]) -> Trial:
    """Many trials as one, with a first axis G."""
    return jax.tree.map(lambda *row: np.stack(row), *trials)


def of_setpoint(
    loop: Loop,
    gains: Gains,
    shares: np.ndarray,
    fault: SensorFault = SOUND,
    guards: Guards = UNCHECKED,
    supply: Any = 1.0,
) -> Trial:
    """One trial of a setpoint at each tick (shares of the travel), shape (K,), under its loop's feed-forward."""
    angle = loop.angle(shares)
    demand = Demand(angle, np.broadcast_to(supply, angle.shape), loop.ahead(angle))
    return Trial(Equipment(gains, fault, guards), demand)


def longest_above(error: np.ndarray, threshold: float) -> np.ndarray:
    """Largest number of consecutive ticks in which an error exceeds a threshold, for errors of shape (..., K)."""
    return np.max(lasted(np.abs(error) > threshold), axis=-1)


def lasted(holds: np.ndarray) -> np.ndarray:
    """Number of consecutive ticks for which truth values of shape (..., K) have been true, at each tick."""
    place = np.arange(1, holds.shape[-1] + 1)
    return place - np.maximum.accumulate(np.where(holds, 0, place), axis=-1)


def bench_and_extremes(task: Task) -> Loop:
    """The nominal model as at the bench, then at each corner of winding and friction, under the ECU's own supply."""
    ranges = task.settings.conditions
    rows = [(ranges.bench, 1.0), *product(ranges.winding, ranges.friction)]
    winding, friction = np.array(rows).T
    conditions = Conditions(np.full(len(rows), task.ecu.supply), winding, friction)
    return under(task.loop.taking(np.zeros(len(rows), dtype=int)), conditions, ranges)
