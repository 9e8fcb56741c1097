"""Where the tests look at effects: states, loads, memories and parameters, one row each, and paths through them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from etcfit.model.effects import EFFECTS, AbstractEffect, Contribution, Inputs, State
from etcfit.model.parameters import parameters_of

N = 20.68
OPEN = math.pi / 2
COUNT = 60  # rows
AXES = ("i", "theta", "omega", "voltage", "motor", "external")  # of a row, before memories and parameters
PARTS = tuple(name for name in Contribution._fields if name not in ("lower", "upper", "dz"))
every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)


class Tabled(AbstractEffect):
    """An effect that looks a place up, which no printer of straight-line code can."""

    name = "tabled"

    def __call__(self, x: State, z: tuple[Any, ...], u: Inputs) -> Contribution:
        return Contribution(torque=jnp.interp(x.theta, jnp.array([0.0, 1.0]), jnp.array([1.0, 2.0])))


def inputs(**changes: Any) -> Inputs:
    fields: dict[str, Any] = {"voltage": 3.0, "torque": 0.0, "time": 0.4, "plate": 1.0, "series": 0.3, "gear_ratio": N}
    fields |= {"lower": 0.0, "upper": OPEN}
    return Inputs(**(fields | changes))


def typical(effect: type[AbstractEffect]) -> dict[str, float]:
    """Half of each scale: off every bound and every off value."""
    return {p.symbol: 0.5 * getattr(p.domain, "scale", 1.0) for p in parameters_of(effect)}


def made(effect: type[AbstractEffect], **changes: float) -> AbstractEffect:
    return effect(**(typical(effect) | changes))


def rows(effect: type[AbstractEffect], **changes: float) -> np.ndarray:
    """Shape (COUNT, axes + memories + parameters), SI; every other row is small, where laws bend."""
    rng = np.random.default_rng(1)
    wide = rng.uniform(-1.0, 1.0, (COUNT, len(AXES))) * np.array([8.0, 0.0, 30.0, 12.0, 1.0, 1.0])
    wide[::2] *= 0.01
    wide[:, AXES.index("theta")] = rng.uniform(0.0, OPEN, COUNT)
    memory = rng.uniform(-1.0, 1.0, (COUNT, len(effect.z0)))
    values = np.tile(list((typical(effect) | changes).values()), (COUNT, 1))
    return np.concatenate((wide, memory, values), axis=1)


def names(effect: type[AbstractEffect]) -> list[str]:
    """What the entries of a row are."""
    return [*AXES, *(f"z{k}" for k in range(len(effect.z0))), *typical(effect)]


def contribution(effect: type[AbstractEffect], row: Any, **changes: float) -> Contribution:
    """What the effect contributes at one row."""
    at = dict(zip(names(effect), row, strict=True))
    u = inputs(voltage=at["voltage"], motor=at["motor"], external=at["external"], **changes)
    z = tuple(at[f"z{k}"] for k in range(len(effect.z0)))
    return effect(**{symbol: at[symbol] for symbol in typical(effect)})(State(*row[:3]), z, u)


def parts(effect: type[AbstractEffect], row: Any, **changes: float) -> jax.Array:
    """Everything finite that it contributes at one row, as one vector: PARTS, then the rates of its memory."""
    c = contribution(effect, row, **changes)
    return jnp.stack([jnp.asarray(v, float) for v in (*(getattr(c, name) for name in PARTS), *c.dz)])


def table(effect: type[AbstractEffect], at: np.ndarray, **changes: float) -> np.ndarray:
    """`parts` at many rows, shape (COUNT, parts + memories)."""
    return np.asarray(_compiled(effect, tuple(changes.items()))(at))


@cache
def _compiled(effect: type[AbstractEffect], changes: tuple[tuple[str, float], ...]) -> Callable[[Any], jax.Array]:
    return jax.jit(jax.vmap(lambda row: parts(effect, row, **dict(changes))))


def seen(effect: type[AbstractEffect], at: np.ndarray, **changes: float) -> dict[str, np.ndarray]:
    """PARTS at many rows, by name, each of shape (COUNT,); the rates of its memory left out."""
    columns = table(effect, at, **changes).T
    return {name: columns[k] for k, name in enumerate(PARTS)}


class Path(NamedTuple):
    """An effect along a motion: times, states and contributions, entries of shape (steps + 1,)."""

    time: np.ndarray
    x: State
    c: Contribution


def follow(effect: AbstractEffect, at: Callable[[Any], tuple[State, Inputs]], duration: float, steps: int) -> Path:
    """Integrate its memory explicitly (Runge and Kutta) along a motion and inputs given as functions of time."""
    dt = duration / steps
    times = dt * jnp.arange(steps + 1)

    def rate(t: Any, z: jax.Array) -> jax.Array:
        x, u = at(t)
        return jnp.array(effect(x, tuple(z), u).dz, float)

    def advance(z: jax.Array, t: Any) -> tuple[jax.Array, jax.Array]:
        k1 = rate(t, z)
        k2 = rate(t + 0.5 * dt, z + 0.5 * dt * k1)
        k3 = rate(t + 0.5 * dt, z + 0.5 * dt * k2)
        k4 = rate(t + dt, z + dt * k3)
        return z + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), z

    _, memory = jax.lax.scan(advance, jnp.array(effect.z0, float), times)

    def along(t: Any, z: jax.Array) -> tuple[State, Contribution]:
        x, u = at(t)
        c = effect(x, tuple(z), u)
        return State(*(jnp.asarray(v, float) for v in x)), jax.tree.map(lambda v: jnp.asarray(v, float), c)

    x, c = jax.vmap(along)(times, memory)
    return Path(np.asarray(times), jax.tree.map(np.asarray, x), jax.tree.map(np.asarray, c))
