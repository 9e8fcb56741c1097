"""The conditions that a fleet will meet: warm, hot and cold, on a weak battery and a charged one."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from ...control.pid.conditions import DRY_FRICTION, scaled
from ...model.throttle import Throttle
from .settings import LINE, WARMTH, LineSettings, TemperatureSettings

SUPPLIES = (9.0, 12.0, 14.0, 16.0)  # V


@dataclass(frozen=True)
class Condition:
    """Of all units alike.

    Args:
        name: such as "hot, 9 V".
        supply: V.
        winding: its temperature, and that of the magnets, degrees Celsius.
        friction: dry friction over that of the bench.
    """

    name: str
    supply: float
    winding: float
    friction: float = 1.0

    def acting_on(self, throttles: Throttle, settings: TemperatureSettings) -> Throttle:
        """The units there.

            R = R_a (1 + copper (T - T_bench)),    K_b, K_m times 1 + magnet (T - T_bench),    T_f, ... times friction

        Viscous friction, springs and inductance stay as at the bench; magnets are as warm as the winding, which after
        a while they nearly are.
        """
        warmer = self.winding - settings.bench
        copper = (1.0 + settings.copper * (self.winding - 20.0)) / (1.0 + settings.copper * (settings.bench - 20.0))
        magnet = 1.0 + settings.magnet * warmer
        dry = dict.fromkeys(DRY_FRICTION, self.friction)
        return scaled(throttles, {"R_a": copper, "K_b": magnet, "K_m": magnet, **dry})


def at_bench(settings: LineSettings = LINE, warmth: TemperatureSettings = WARMTH) -> Condition:
    """As measured, at the line's own supply."""
    return Condition("bench", settings.supply, warmth.bench)


def conditions(supplies: tuple[float, ...] = SUPPLIES, warmth: TemperatureSettings = WARMTH) -> tuple[Condition, ...]:
    """Bench, hot and cold at each supply (V)."""
    states = (("bench", warmth.bench, 1.0), ("hot", warmth.bench + warmth.hot, 1.0),
              ("cold", warmth.cold, warmth.cold_friction))  # fmt: skip
    return tuple(
        Condition(f"{name}, {supply:g} V", supply, winding, friction)
        for (name, winding, friction), supply in product(states, supplies)
    )
