"""The effect contract: what an effect sees, and what it adds to the balances of torque and voltage."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ..parameters import Scalar


class State(NamedTuple):
    """Armature current i (A), plate angle theta (rad), plate speed omega (rad/s)."""

    i: Scalar
    theta: Scalar
    omega: Scalar


class Inputs(NamedTuple):
    """What drives the throttle at one instant, and how the rig test ties it down.

    Args:
        voltage: at the terminals, V.
        torque: motor torque at the plate where there is no electrical side, N m.
        time: since the trace began, s.
        plate: 1 with the gear fitted, 0 where the motor runs alone.
        series: extra circuit resistance of this test, ohm.
        gear_ratio: N, motor angle over plate angle.
        lower, upper: end stops, rad.
    """

    voltage: Scalar
    torque: Scalar
    time: Scalar
    plate: Scalar
    series: Scalar
    gear_ratio: Scalar
    lower: Scalar
    upper: Scalar


class Contribution(NamedTuple):
    """What one effect adds; every part is zero (or no limit) by default.

    Args:
        torque: smooth torque on the plate, positive opens, N m.
        friction: dry friction budget at the plate, >= 0, N m; the stepper turns it into a set-valued torque.
        voltage: in the armature loop, positive drives current, V.
        inertia: at the plate, kg m2.
        inductance: in the armature loop, H.
        lower, upper: angles beyond which the plate cannot go, rad.
        dz: rates of the effect's own memory, one for each entry of `z0`.
    """

    torque: Scalar = 0.0
    friction: Scalar = 0.0
    voltage: Scalar = 0.0
    inertia: Scalar = 0.0
    inductance: Scalar = 0.0
    lower: Scalar = -jnp.inf
    upper: Scalar = jnp.inf
    dz: tuple[Scalar, ...] = ()


class AbstractEffect(eqx.Module):
    """One physical effect. Its fields are its parameters (see `parameter`).

    `name` is what rig.toml and diagnosis.json call it. `off` gives the parameter values (SI) at which the effect
    contributes exactly nothing; None for the effects of Eqs. 1-2, which are never off. `z0` is the initial memory.
    """

    name: ClassVar[str]
    off: ClassVar[Mapping[str, float] | None] = None
    z0: ClassVar[tuple[float, ...]] = ()

    @abc.abstractmethod
    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """The effect's contribution; a pure function of its parameters, x, z and u."""


def total(parts: list[Contribution]) -> Contribution:
    """Sum of all effects; the tightest of all stops; memories side by side."""

    def add(name: str) -> Any:
        return sum(getattr(part, name) for part in parts)

    lower, upper = parts[0].lower, parts[0].upper
    for part in parts[1:]:
        lower, upper = jnp.maximum(lower, part.lower), jnp.minimum(upper, part.upper)
    return Contribution(
        add("torque"),
        add("friction"),
        add("voltage"),
        add("inertia"),
        add("inductance"),
        lower,
        upper,
        tuple(rate for part in parts for rate in part.dz),
    )
