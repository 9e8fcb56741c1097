"""Simulates many plates under a constant voltage or with open terminals: arrival times in bands, and final
positions."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..model.effects import State
from ..model.parameters import Scalar
from ..model.stepper import Step, step
from ..model.throttle import Throttle
from ..problem.cores import CORES, side_by_side

_STILL = 1e-6  # rad/s, below which a plate does not move


class Experiment(NamedTuple):
    """A plate released from rest without a current; for many plates, every entry has shape (D,)."""

    angle: Any  # start angle, rad
    volts: Any  # voltage at the terminals afterwards, V
    circuit: Any  # 1, or 0 where the terminals are open


class Bands(NamedTuple):
    """Ranges of angle for which arrival is timed, rad, shape (D, M); infinite for no end."""

    low: Any
    high: Any


class Watching(NamedTuple):
    """Step and length of the simulation."""

    step: Scalar  # step of the integration, s
    longest: Scalar  # longest simulated time, s
    rest: Scalar  # time without motion after which a plate counts as at rest and its simulation ends, s


class Motion(NamedTuple):
    """The result of an experiment."""

    first: np.ndarray  # time until the plate is first in each band, s, shape (D, M); infinite for never
    stays: np.ndarray  # time from which on it stays in the band, likewise
    angle: np.ndarray  # final angle, rad, shape (D,)
    still: np.ndarray  # 1 where the plate was at rest at the end, shape (D,)


class _Carry(NamedTuple):
    k: Any
    x: State
    z: tuple[Scalar, ...]
    first: Any
    stays: Any
    still: Any


def free_step(body: Any, dt: Scalar, volts: Scalar, time: Scalar, circuit: Scalar = 1.0) -> Step:
    """One integration step of dt (s) under a constant voltage (V), the plate free between the stops of its body."""
    return Step(dt=dt, voltage0=volts, voltage1=volts, torque0=0.0, torque1=0.0, time=time, mobile=1.0,
                circuit=circuit, plate=1.0, series=0.0, gear_ratio=body.gear_ratio, lower=body.lower,
                upper=body.upper, guide_stiffness=0.0, target0=0.0, target1=0.0, lever=0.0)  # fmt: skip


def _within(theta: Any, bands: Bands) -> Any:
    return (theta[:, None] >= bands.low) & (theta[:, None] <= bands.high)


def _entered(before: Any, now: Any, bands: Bands) -> Any:
    """Share of a step after which a plate that moves linearly from before to now is in a band, shape (D, M)."""
    edge = jnp.where(before[:, None] < bands.low, bands.low, bands.high)
    way = (now - before)[:, None]
    share = (edge - before[:, None]) / jnp.where(way == 0.0, 1.0, way)
    return jnp.clip(share, 0.0, 1.0)


def _simulate_motion(throttles: Throttle, what: Experiment, bands: Bands, body: Any, watching: Watching) -> Motion:
    """Simulate every model (D) in its experiment."""
    count, (dt, longest, rest) = what.angle.shape[0], watching

    def one(throttle: Throttle, x: State, z: Any, volts: Any, circuit: Any, time: Any) -> Any:
        return step(throttle, x, z, free_step(body, dt, volts, time, circuit))

    every = jax.vmap(one, in_axes=(0, 0, 0, 0, 0, None))

    def going(carry: _Carry) -> Any:
        return (carry.k * dt < longest) & jnp.any(carry.still < rest)

    def advance(carry: _Carry) -> _Carry:
        k, before, z, first, stays, still = carry
        x, z = every(throttles, before, z, what.volts, what.circuit, dt * (k + 1.0))
        was, now = _within(before.theta, bands), _within(x.theta, bands)
        crossed = dt * (k + _entered(before.theta, x.theta, bands))
        first = jnp.where(now & ~was, jnp.minimum(first, crossed), first)
        stays = jnp.where(now, jnp.where(was, stays, crossed), jnp.inf)
        still = jnp.where(jnp.abs(x.omega) < _STILL, still + dt, 0.0)
        return _Carry(k + 1.0, x, z, first, stays, still)

    none = jnp.zeros(count)
    x = State(none, jnp.asarray(what.angle, dtype=float), none)
    z = tuple(jnp.full(count, each) for each in throttles.z0)
    begun = jnp.where(_within(x.theta, bands), 0.0, jnp.inf)
    end = jax.lax.while_loop(going, advance, _Carry(jnp.zeros(()), x, z, begun, begun, none))
    return Motion(end.first, end.stays, end.x.theta, (end.still >= rest).astype(float))


_every = jax.jit(_simulate_motion)


def simulate_motion(throttles: Throttle, what: Experiment, bands: Bands, body: Any, watching: Watching) -> Motion:
    """Simulate every model (D) in its experiment, on all cores; `body`: gear ratio and stops, rad."""
    count = np.shape(what.angle)[0]
    room = -(-count // CORES)  # models for each core; the last model is repeated to fill up
    whole = np.minimum(np.arange(room * CORES), count - 1)
    shared = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), (throttles, what, bands))
    pieces = [jax.tree.map(lambda leaf, k=k: leaf[whole[k : k + room]], shared)
              for k in range(0, room * CORES, room)]  # fmt: skip
    fixed = type(body)(*(float(each) for each in body)), Watching(*(float(each) for each in watching))
    done = side_by_side(lambda piece: _every(*piece, *fixed), pieces)
    return Motion(
        *(np.concatenate([np.asarray(each) for each in column])[:count] for column in zip(*done, strict=True))
    )
