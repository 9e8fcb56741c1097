"""What holding costs: current and heat across the travel, and for how long a winding bears the full duty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ...model.effects.winding_heating import WindingHeating
from ...model.linear import holding_against
from ...model.throttle import Throttle
from ..pid.base import Task
from ..pid.loop import Loop


@dataclass(frozen=True, eq=False)
class Holding:
    """Holding a plate still, nominal model at the temperature of the bench.

    Args:
        shares: of the travel, shape (S,).
        current: A in the middle of the dry friction, shape (S,).
        closing, opening: A at which it is about to close and to open, shape (S,).
        watts: heat of the winding in the middle of the dry friction, shape (S,).
        rise: K by which the winding is warmer in the long run, shape (S,); None where its heating is not known.
        stall_A, stall_W: current and heat at the full duty against a stop.
        longest: s of that from the bench's temperature to what the winding may reach; infinite where it never does;
            None where its heating is not known.
    """

    shares: np.ndarray
    current: np.ndarray
    closing: np.ndarray
    opening: np.ndarray
    watts: np.ndarray
    rise: np.ndarray | None
    stall_A: float
    stall_W: float
    longest: float | None


@jax.jit
def _currents(throttle: Throttle, angles: Any, share: Any, body: Any) -> Any:
    return jax.vmap(lambda theta: holding_against(throttle, theta, share, *body)[0])(angles)


def holding(loop: Loop, task: Task) -> Holding:
    """Over the whole travel, and at the ECU's largest duty."""
    settings, throttle = task.settings.safety, loop.nominal
    shares = np.linspace(0.0, 1.0, settings.places)
    angles = loop.angle(shares)
    closing, current, opening = (np.asarray(_currents(throttle, angles, side, loop.body)) for side in (-1.0, 0.0, 1.0))
    ohm, volts = float(np.asarray(throttle.parameter("R_a"))), float(task.ecu.limit)
    heating = next((each for each in throttle.effects if isinstance(each, WindingHeating)), None)
    stall = volts / ohm
    if heating is None or float(heating.r_h) <= 0.0:
        return Holding(shares, current, closing, opening, ohm * current**2, None, stall, ohm * stall**2, None)
    grows, slow, copper = float(heating.r_h), float(heating.tau_h), task.settings.conditions.copper
    warmth = grows / (ohm * copper)  # K of each A2 s
    rise = warmth * slow * current**2
    longest = _until(settings.insulation - task.settings.conditions.bench, volts, ohm, warmth, copper, slow)
    return Holding(shares, current, closing, opening, ohm * current**2, rise, stall, ohm * stall**2, longest)


def _until(most: float, volts: float, ohm: float, warmth: float, copper: float, slow: float) -> float:
    """s until a winding under a constant voltage is so many K warmer; infinite where it never is.

    dD/dt = warmth i^2 - D / slow,    i = V / (R (1 + copper D)): `model.effects.winding_heating`.
    """

    from scipy.integrate import solve_ivp

    def rate(_: float, warmer: np.ndarray) -> np.ndarray:
        return warmth * (volts / (ohm * (1.0 + copper * warmer))) ** 2 - warmer / slow

    def there(_: float, warmer: np.ndarray) -> float:
        return float(warmer[0] - most)

    there.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    found = solve_ivp(rate, (0.0, 50.0 * slow), [0.0], events=there, rtol=1e-8)
    return float(found.t_events[0][0]) if found.t_events[0].size else np.inf
