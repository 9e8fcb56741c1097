"""The throttle body: a composition of effects, and what its sensors see."""

from __future__ import annotations

from collections.abc import Mapping

import equinox as eqx

from .effects import AbstractEffect, Contribution, Inputs, State, total
from .parameters import Parameter, Scalar, parameters_of


class Throttle(eqx.Module):
    """Eqs. 1-2 of the paper and whatever effects were added to them.

    L di/dt = v + sum voltage,    J domega/dt + Sgn(omega) sum friction = sum torque,    dtheta/dt = omega
    """

    effects: tuple[AbstractEffect, ...]

    @classmethod
    def build(cls, types: tuple[type[AbstractEffect], ...], values: Mapping[str, Scalar]) -> Throttle:
        """Compose effects from values in SI by symbol."""
        return cls(tuple(t(**{p.symbol: values[p.symbol] for p in parameters_of(t)}) for t in types))

    @property
    def z0(self) -> tuple[float, ...]:
        """Memory of all effects at the start of a trace."""
        return tuple(z for effect in self.effects for z in effect.z0)

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        """Sum of the contributions of all effects."""
        parts, start = [], 0
        for effect in self.effects:
            stop = start + len(effect.z0)
            parts.append(effect(x, z[start:stop], u))
            start = stop
        return total(parts)

    def parameter(self, symbol: str) -> Scalar:
        """Value of a parameter, SI."""
        return next(getattr(effect, symbol) for effect in self.effects if hasattr(effect, symbol))

    def observe(self, x: State, u: Inputs) -> dict[str, Scalar]:
        """What the sensors see, by channel, SI; the EMF is that at the open terminals."""
        motor_speed = u.gear_ratio * x.omega
        return {
            "current": x.i,
            "position": x.theta,
            "emf": self.parameter("K_b") * motor_speed,
            "motor_speed": motor_speed,
        }


def catalogue(types: tuple[type[AbstractEffect], ...]) -> dict[str, Parameter]:
    """Every parameter of a composition by symbol, in order."""
    return {p.symbol: p for t in types for p in parameters_of(t)}
