"""The contract of an effect: its inputs, and its contribution to the balances of torque and voltage."""

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
    """A known contribution at one instant in addition to all effects; it does not depend on the state."""

    # torque, voltage, friction, position, current: as in `Contribution`; torque of motor and plate
    torque: Scalar
    voltage: Scalar
    friction: Scalar
    position: Scalar
    current: Scalar
    # motor, external: the part of the torque that the gear carries, as in `Inputs`
    motor: Scalar
    external: Scalar

    @property
    def contribution(self) -> Contribution:
        """The same as the contribution of an effect."""
        each = {name: getattr(self, name) for name in ("torque", "voltage", "friction", "position", "current")}
        return Contribution(**each)


class Inputs(NamedTuple):
    """Inputs of the throttle at one instant, and its boundary conditions in the rig test."""

    voltage: Scalar  # voltage at the terminals, V
    torque: Scalar  # motor torque at the plate if there is no electrical side, N m
    time: Scalar  # since the trace began, s
    plate: Scalar  # 1 with the gear fitted, 0 if the motor runs alone
    series: Scalar  # extra circuit resistance of this test, ohm
    gear_ratio: Scalar  # N, motor angle over plate angle
    # lower, upper: end stops, rad
    lower: Scalar
    upper: Scalar
    # motor, external: load of the gear: torque of the motor at the plate, and smooth torque on the plate, N m; given to
    # `loaded` effects only, 0 for all others
    motor: Scalar = 0.0
    external: Scalar = 0.0
    # 1 if an ECU that is part of the model drives the throttle; None if the model has none
    controlled: Scalar | None = None
    setpoint: Scalar | None = None  # the last setpoint that this ECU read, rad
    ahead: Scalar = 0.0  # its feed-forward for that setpoint, a share of its supply
    # a contribution in addition to all effects, which no effect sees; None if there is none
    besides: Besides | None = None

    @property
    def gear_load(self) -> Scalar:
        """Torque through the teeth, N m: the mean of the torques on both sides, without inertia."""
        return 0.5 * (self.motor - self.external)


class Contribution(NamedTuple):
    """The contribution of one effect; every part is zero (or no limit) by default.

    Args:
        torque: smooth torque on the plate, positive opens, N m.
        drive: smooth torque of the motor, at the plate, through the gear, N m.
        friction: dry friction budget at the plate, >= 0, N m; the stepper turns it into a set-valued torque.
        voltage: voltage in the armature loop, positive drives current, V.
        inertia: inertia at the plate, kg m2.
        inductance: inductance in the armature loop, H.
        lower, upper: angles that the plate cannot exceed, rad.
        restitution: share of the speed that a stop gives back.
        play: travel of the motor beyond the lower stop, on which the plate rests, rad.
        tooth_damping: c of a motor that rebounds from the teeth of a plate on its stop with v/(1 + c v), s/rad.
        tooth_restitution: share of the speed with which it rebounds from the teeth that open the plate, which yields.
        position, current: error of a sensor's reading, rad and A.
        input_delay, position_delay, current_delay: delay of the input and of a logged channel, s.
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
        name: its name in rig.toml and diagnosis.json.
        off: value (SI) of each of its amplitudes at which it contributes exactly nothing; None for the effects of Eqs.
            1-2, which are always there. Its other parameters are its shape.
        told_by: the measurement that shows it best.
        scan: start values (SI) of the diagnosis for shapes, and for amplitudes that have no effect while small.
        z0: memories of an effect that nothing has loaded; each entry decays or grows independently. Loops and exports
            begin with it, traces with `first`.
        hidden: True if it shifts the reading of a moving plate: a run guided along the measured angle does not show it.
        loaded: True if it depends on the load of the gear (`Inputs.motor`, `Inputs.external`).
        delays: True if it shifts the input or a channel in time.
        rough: True if chi2 has many valleys over its parameters: its trial searches with a population.
        commands: True if it drives the throttle from its sensors' readings, see `AbstractComputer`.
        needs: what must be logged to see it: "circuit", "current", "position", "gear"; for a hypothesis that would
            imitate others, "bridge": `rig.checks` must report it.
        stated: kind of a finding of `rig.checks` that states this effect -> its first parameter, SI, from the size of
            the finding. A diagnosis tries it first, from there.
        inexact: possible relative error of its formula; largest for friction, contacts and delays.
        scope: its location: "plate", "motor", "driver" or "channel"; "test" or "rig" for rig effects.
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
        """A declared parameter as it is in the model; a family of effects may change its symbol or scale."""
        return p

    def first(self, load: Scalar) -> tuple[Scalar, ...]:
        """Memories with which a trace begins: those of a plate at rest under a load, N m, positive opens."""
        return self.z0

    @abc.abstractmethod
    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """The effect's contribution; a pure function of its parameters, x, z and u."""


class AbstractComputer(AbstractEffect):
    """An effect that drives the throttle from its sensors' readings: it gets the angle as read, and its voltage is
    added to that of the terminals before the other effects are evaluated. It reads and computes at ticks of its own
    clock."""

    commands: ClassVar[bool] = True

    @abc.abstractmethod
    def ticked(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> tuple[Scalar, ...]:
        """Its memories after a tick, from those before it; x has the angle as read."""


_SUMS = tuple(name for name in Contribution._fields if name not in ("lower", "upper", "dz"))


def total(parts: list[Contribution]) -> Contribution:
    """Sum of all effects, with the tightest of all stops and all memories in turn."""
    lower, upper = parts[0].lower, parts[0].upper
    for part in parts[1:]:
        lower, upper = jnp.maximum(lower, part.lower), jnp.minimum(upper, part.upper)
    sums = {name: _sum([getattr(part, name) for part in parts]) for name in _SUMS}
    return Contribution(**sums, lower=lower, upper=upper, dz=tuple(rate for part in parts for rate in part.dz))


def _sum(terms: list[Any]) -> Any:
    """The sum without the zeros of effects that do not contribute, which need not be traced and compiled."""
    real = [term for term in terms if not (isinstance(term, float) and term == 0.0)]
    return sum(real[1:], start=real[0]) if real else 0.0


def fraction(theta: Scalar, lower: Scalar, upper: Scalar) -> Scalar:
    """(theta - lower)/(upper - lower): 0 at the lower stop, 1 at the upper; a missing stop counts as half a turn."""
    lower = jnp.where(jnp.isfinite(lower), lower, -math.pi)
    span = jnp.where(jnp.isfinite(upper), upper, math.pi) - lower
    return (theta - lower) / jnp.where(span > 0.0, span, 1.0)
