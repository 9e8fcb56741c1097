"""The throttle body: a composition of effects, and its sensors' readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import equinox as eqx

from .effects import AbstractComputer, AbstractEffect, Contribution, Inputs, State, total
from .parameters import Parameter, Scalar, declared, parameters_of
from .rig_effects import AbstractRigEffect


class Delays(NamedTuple):
    """Delays of the input and of each channel that may be late, s."""

    input: Scalar
    channels: Mapping[str, Scalar]


def followed(effects: Sequence[AbstractEffect | type[AbstractEffect]]) -> tuple[int, ...]:
    """Indices, among all memories, of those of an ECU in the model: through them a disturbance of the state acts on the
    state again."""
    places = iter(range(sum(len(effect.z0) for effect in effects)))
    return tuple(k for effect in effects for k in [next(places) for _ in effect.z0] if effect.commands)


class Throttle(eqx.Module):
    """Eqs. 1-2 of the paper with all added effects.

    L di/dt = v + sum voltage,    J domega/dt + Sgn(omega) sum friction = sum torque,    dtheta/dt = omega
    """

    # effects inside the throttle; each adds to voltage, torque, friction, inertia ... (`Contribution`).
    effects: tuple[AbstractEffect, ...]
    # effects between throttle and log: they change the inputs and the readings in some traces
    rig: tuple[AbstractRigEffect, ...] = ()

    @classmethod
    def build(cls, types: tuple[type[AbstractEffect], ...], values: Mapping[str, Scalar]) -> Throttle:
        """A throttle of these effects.

        Args:
            values: values of all their parameters, SI by symbol.
        """
        every = [t(**{field: values[p.symbol] for field, p in declared(t).items()}) for t in types]
        inside = tuple(e for e in every if not isinstance(e, AbstractRigEffect))
        return cls(inside, tuple(e for e in every if isinstance(e, AbstractRigEffect)))

    @property
    def z0(self) -> tuple[float, ...]:
        """Memories of all effects that nothing has loaded, one after the other."""
        return tuple(z for effect in self.effects for z in effect.z0)

    def first(self, x: State, u: Inputs) -> tuple[Scalar, ...]:
        """Memories of all effects of a plate at rest in this state; `z0` where none depends on its load."""
        if all(type(effect).first is AbstractEffect.first for effect in self.effects):
            return self.z0
        u = self.informed(x, self.z0, u)
        return tuple(z for effect in self.effects for z in effect.first(u.motor + u.external))

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """Sum of the contributions of all effects.

        Args:
            x: state, SI.
            z: memories of all effects, see `z0`.
        """
        parts = self.parts(x, z, u)
        return total(parts if u.besides is None else [*parts, u.besides.contribution])

    def parts(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> list[Contribution]:
        """Contribution of each effect, in their order. Effects that command are evaluated first, `loaded` effects
        last."""
        memories = self._memories(z)
        parts, u = self._first(x, memories, u)
        if len(parts) < len(self.effects):
            carrying = _carrying(parts, u)
            parts |= {k: e(x, memories[k], carrying) for k, e in enumerate(self.effects) if e.loaded}
        return [parts[k] for k in range(len(self.effects))]

    def informed(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Inputs:
        """The inputs of a `loaded` effect, with the gear's load; arguments as of `__call__`."""
        return _carrying(*self._first(x, self._memories(z), u))

    def _first(self, x: State, memories: list[tuple[Scalar, ...]], u: Inputs) -> tuple[dict[int, Contribution], Inputs]:
        """Contributions of all effects that are not `loaded`, and their inputs."""
        parts = self._commands(x, memories, u)
        u = u._replace(voltage=u.voltage + total(list(parts.values())).voltage) if parts else u
        parts |= {k: e(x, memories[k], u) for k, e in enumerate(self.effects) if not e.loaded and k not in parts}
        return parts, u

    def _commands(self, x: State, memories: list[tuple[Scalar, ...]], u: Inputs) -> dict[int, Contribution]:
        """Contributions of effects that drive the throttle from the angle that its sensor shows; {} without any."""
        commanding = [k for k, e in enumerate(self.effects) if e.commands]
        if not commanding:
            return {}
        seen = self._as_read(x, memories, u)
        return {k: self.effects[k](seen, memories[k], u) for k in commanding}

    def _as_read(self, x: State, memories: list[tuple[Scalar, ...]], u: Inputs) -> State:
        """The state with the angle that the sensor shows."""
        sensed = total([e(x, z, u) for e, z in zip(self.effects, memories, strict=True) if not e.commands])
        return x._replace(theta=x.theta + sensed.position)

    def ticked(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> tuple[Scalar, ...]:
        """Memories of all effects after a tick of the computers among them; arguments as of `__call__`."""
        computers = {k: e for k, e in enumerate(self.effects) if isinstance(e, AbstractComputer)}
        if not computers:
            return z
        memories = self._memories(z)
        seen = self._as_read(x, memories, u)
        memories = [computers[k].ticked(seen, m, u) if k in computers else m for k, m in enumerate(memories)]
        return tuple(each for memory in memories for each in memory)

    def _memories(self, z: tuple[Scalar, ...]) -> list[tuple[Scalar, ...]]:
        """Each effect's own share of the memories."""
        ends = list(accumulate(len(effect.z0) for effect in self.effects))
        return [z[end - len(effect.z0) : end] for effect, end in zip(self.effects, ends, strict=True)]

    def parameter(self, symbol: str) -> Scalar:
        """Value of a parameter, SI, by its symbol."""
        return next(getattr(effect, symbol) for effect in self.effects if hasattr(effect, symbol))

    def observe(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> dict[str, Scalar]:
        """The sensors' readings.

        Args:
            x, z, u: as of `__call__`.
        Returns:
            Current (A), position (rad), emf at the open terminals (V) and motor_speed (rad/s), by channel.
        """
        motor_speed = u.gear_ratio * x.omega
        seen = self(x, z, u)
        return {
            "current": x.i + seen.current,
            "position": x.theta + seen.position,
            "emf": self.parameter("K_b") * motor_speed,
            "motor_speed": motor_speed,
        }

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        """The steps of a batch as they act on the throttle, from those logged.

        Args:
            test_of: `number_of` the rig test of each entry, of the steps' shape.
        """
        for effect in self.rig:
            steps = effect.driven(steps, test_of)
        return steps

    def begun(self, resets: Any, test_of: Scalar, trace: Scalar | None) -> Any:
        """The true states in which traces begin, from those logged.

        Args:
            test_of, trace: `number_of` the rig test and of the file of each entry, of the resets' shape.
        """
        for effect in self.rig:
            resets = effect.begun(resets, test_of, trace)
        return resets

    def read(self, seen: dict[str, Scalar], test_of: Scalar, trace: Scalar | None) -> dict[str, Scalar]:
        """The logged values for the sensors' readings `seen`, by channel, SI; `test_of` and `trace` as of `begun`."""
        for effect in self.rig:
            seen = effect.read(seen, test_of, trace)
        return seen

    def delays(self) -> Delays:
        """Delays of input and channels, s: they depend on parameters, never on the state."""
        zero = State(0.0, 0.0, 0.0)
        c = self(zero, self.z0, Inputs(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0))
        return Delays(c.input_delay, {"position": c.position_delay, "current": c.current_delay})

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        """Lateness of the rig's channels, s, for each entry; channels that cannot be late are left out."""
        late: dict[str, Scalar] = {}
        for effect in self.rig:
            for channel, by in effect.lateness(steps, test_of).items():
                late[channel] = late[channel] + by if channel in late else by
        return late

    @property
    def may_delay(self) -> bool:
        """Whether any effect can delay; if not, no signal needs to be shifted."""
        return any(effect.delays for effect in self.effects)


def _carrying(parts: Mapping[int, Contribution], u: Inputs) -> Inputs:
    """The inputs with the load of the gear, from the contributions of all effects that are not `loaded`."""
    first = total(list(parts.values()))
    motor, external = first.drive + u.torque, first.torque
    if u.besides is not None:
        motor, external = motor + u.besides.motor, external + u.besides.external
    return u._replace(motor=motor, external=external)


def catalogue(types: tuple[type[AbstractEffect], ...]) -> dict[str, Parameter]:
    """Every parameter of a model with these effects, by symbol, in their order."""
    return {p.symbol: p for t in types for p in parameters_of(t)}
