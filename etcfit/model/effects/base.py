"""The effect contract: what an effect sees, and what it adds to the balances of torque and voltage."""

from __future__ import annotations

import abc
import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from ..parameters import Parameter, Scalar


class State(NamedTuple):
    """Armature current i (A), plate angle theta (rad), plate speed omega (rad/s)."""

    i: Scalar
    theta: Scalar
    omega: Scalar


class Besides(NamedTuple):
    """What acts at one instant besides all effects, known beforehand: none of it depends on the state.

    Args:
        torque, voltage, friction, position, current: as of `Contribution`; torque of motor and plate alike.
        motor, external: what of the torque the gear carries, as of `Inputs`.
    """

    torque: Scalar
    voltage: Scalar
    friction: Scalar
    position: Scalar
    current: Scalar
    motor: Scalar
    external: Scalar

    @property
    def contribution(self) -> Contribution:
        """Itself as if an effect added it."""
        each = {name: getattr(self, name) for name in ("torque", "voltage", "friction", "position", "current")}
        return Contribution(**each)


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
        motor, external: what the gear carries: torque of the motor at the plate, and smooth torque on the plate, N m;
            given to `loaded` effects only, 0 for all others.
        controlled: 1 where an ECU that is part of the model drives the throttle; None where the model has none.
        setpoint: what that ECU last read that it should follow, rad.
        ahead: its feed-forward for that, a share of its supply.
        besides: what acts besides all effects, of which none sees anything; None where nothing does.
    """

    voltage: Scalar
    torque: Scalar
    time: Scalar
    plate: Scalar
    series: Scalar
    gear_ratio: Scalar
    lower: Scalar
    upper: Scalar
    motor: Scalar = 0.0
    external: Scalar = 0.0
    controlled: Scalar | None = None
    setpoint: Scalar | None = None
    ahead: Scalar = 0.0
    besides: Besides | None = None

    @property
    def gear_load(self) -> Scalar:
        """Torque through the teeth, N m: the mean of what pulls at either side; inertia is left out of it."""
        return 0.5 * (self.motor - self.external)


class Contribution(NamedTuple):
    """What one effect adds; every part is zero (or no limit) by default.

    Args:
        torque: smooth torque on the plate, positive opens, N m.
        drive: smooth torque of the motor, at the plate, through the gear, N m.
        friction: dry friction budget at the plate, >= 0, N m; the stepper turns it into a set-valued torque.
        voltage: in the armature loop, positive drives current, V.
        inertia: at the plate, kg m2.
        inductance: in the armature loop, H.
        lower, upper: angles beyond which the plate cannot go, rad.
        restitution: share of its speed that a stop gives back.
        play: how far the motor turns on beyond the lower stop, on which the plate rests, rad.
        tooth_damping: c of a motor that comes back from the teeth of a plate on its stop with v/(1 + c v), s/rad.
        tooth_restitution: share of its speed with which it comes back from those that open the plate, which gives way.
        position, current: what a sensor reads besides the truth, rad and A.
        input_delay, position_delay, current_delay: how late the input acts and a channel is logged, s.
        dz: rates of the effect's own memory, one for each entry of `z0`.
    """

    torque: Scalar = 0.0
    drive: Scalar = 0.0
    friction: Scalar = 0.0
    voltage: Scalar = 0.0
    inertia: Scalar = 0.0
    inductance: Scalar = 0.0
    lower: Scalar = -jnp.inf
    upper: Scalar = jnp.inf
    restitution: Scalar = 0.0
    play: Scalar = 0.0
    tooth_damping: Scalar = 0.0
    tooth_restitution: Scalar = 0.0
    position: Scalar = 0.0
    current: Scalar = 0.0
    input_delay: Scalar = 0.0
    position_delay: Scalar = 0.0
    current_delay: Scalar = 0.0
    dz: tuple[Scalar, ...] = ()


class AbstractEffect(eqx.Module):
    """One physical effect: a pure function of state, memories and inputs, whose fields are its parameters
    (`parameter`).

    Attributes:
        name: what rig.toml and diagnosis.json call it.
        off: value (SI) of each of its amplitudes at which it contributes exactly nothing; None for the effects of Eqs.
            1-2, which are always there. Its other parameters are its shape.
        told_by: which measurement shows it best.
        scan: values (SI) of shapes, and of amplitudes that show nothing while small, from which the diagnosis tries it.
        z0: memories with which a trace begins; each entry decays or grows on its own.
        hidden: True where it moves the reading off a moving plate: a run drawn along the measured angle shows nothing
            of it.
        loaded: True where it must be told what the gear carries (`Inputs.motor`, `Inputs.external`).
        delays: True where it shifts the input or a channel in time.
        rough: True where chi2 has many valleys over its parameters: its trial searches with a population.
        commands: True where it drives the throttle by what its sensors show, see `AbstractComputer`.
        needs: what must have been logged for it to be seen: "circuit", "current", "position", "gear"; or, of a
            hypothesis that would imitate others, that `rig.checks` tells of it: "bridge".
        stated: kind of a finding of `rig.checks` that states this effect -> its first parameter, SI, from the size of
            the finding. A diagnosis tries it first, from there.
        inexact: relative error that its formula may have; largest for friction, contacts and delays.
        scope: where it sits: "plate", "motor", "driver" or "channel"; rig effects have "test" or "rig".
    """

    name: ClassVar[str]
    off: ClassVar[Mapping[str, float] | None] = None
    told_by: ClassVar[str] = ""
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    z0: ClassVar[tuple[float, ...]] = ()
    hidden: ClassVar[bool] = False
    loaded: ClassVar[bool] = False
    delays: ClassVar[bool] = False
    rough: ClassVar[bool] = False
    commands: ClassVar[bool] = False
    needs: ClassVar[tuple[str, ...]] = ()
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {}
    inexact: ClassVar[float] = 0.02
    scope: ClassVar[str] = "plate"

    @classmethod
    def named(cls, p: Parameter) -> Parameter:
        """A declared parameter as the model knows it; a family of effects may change its symbol or scale."""
        return p

    @abc.abstractmethod
    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """The effect's contribution; a pure function of its parameters, x, z and u."""


class AbstractComputer(AbstractEffect):
    """An effect that drives the throttle by what its sensors show: it gets the angle as read, and its voltage is added
    to that of the terminals before the other effects are asked. It reads and computes at ticks of its own clock."""

    commands: ClassVar[bool] = True

    @abc.abstractmethod
    def ticked(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> tuple[Scalar, ...]:
        """Its memories after a tick, from those before it; x with the angle as read."""


_SUMS = tuple(name for name in Contribution._fields if name not in ("lower", "upper", "dz"))


def total(parts: list[Contribution]) -> Contribution:
    """Sum of all effects; the tightest of all stops; memories side by side."""
    lower, upper = parts[0].lower, parts[0].upper
    for part in parts[1:]:
        lower, upper = jnp.maximum(lower, part.lower), jnp.minimum(upper, part.upper)
    sums = {name: _sum([getattr(part, name) for part in parts]) for name in _SUMS}
    return Contribution(**sums, lower=lower, upper=upper, dz=tuple(rate for part in parts for rate in part.dz))


def _sum(terms: list[Any]) -> Any:
    """Zeros of effects that say nothing of it are left out: what is not traced need not be compiled."""
    real = [term for term in terms if not (isinstance(term, float) and term == 0.0)]
    return sum(real[1:], start=real[0]) if real else 0.0


def fraction(theta: Scalar, lower: Scalar, upper: Scalar) -> Scalar:
    """(theta - lower)/(upper - lower): 0 at the lower stop, 1 at the upper; a missing stop counts as half a turn."""
    lower = jnp.where(jnp.isfinite(lower), lower, -math.pi)
    span = jnp.where(jnp.isfinite(upper), upper, math.pi) - lower
    return (theta - lower) / jnp.where(span > 0.0, span, 1.0)
