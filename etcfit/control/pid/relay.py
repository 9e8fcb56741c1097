"""The relay experiment, as an ECU's autotune does it."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.linear import MIDDLE
from .base import Refusal, Task
from .ecu import quantised
from .gains import Gains
from .setpoint import step
from .ultimate import Ultimate
from .ziegler_nichols import from_ultimate


class Relay(NamedTuple):
    """v = bias + d or bias - d.

    Args:
        swing: d, V.
        bias: V that hold the plate.
        hysteresis: rad.
    """

    swing: Any
    bias: Any
    hysteresis: Any


def switch(relay: Relay, ecu: Ecu, side: Any, setpoint: Any, position: Any, bias: Any) -> Any:
    """One tick of the relay: it turns over where the error has passed its hysteresis."""
    error = setpoint - quantised(position, ecu.resolution)
    side = jnp.where(error > relay.hysteresis, 1.0, jnp.where(error < -relay.hysteresis, -1.0, side))
    volts = jnp.clip(relay.bias + side * relay.swing, -ecu.limit, ecu.limit)
    return quantised(volts, ecu.pwm), side


def relay(task: Task) -> Gains | Refusal:
    """K_u = 4 d / (pi sqrt(a^2 - e^2)), P_u the period of the swing, on the nonlinear plant; then Ziegler-Nichols.

    Source: Astrom and Hagglund 1984, Automatica 20(5). Differs from source: the experiment is made on the fitted model
    with its friction, about the voltage that holds the plate, with the smallest relay that keeps it swinging.
    """
    found = experiment(task)
    return found if isinstance(found, Refusal) else from_ultimate(found)


def experiment(task: Task) -> Ultimate | Refusal:
    """The relay's swing on the nominal plant."""
    settings = task.settings.relay
    nominal = task.loop.first(1).in_steps_of(settings.longest_step)
    ecu, body = nominal.ecu, nominal.body
    span = settings.hysteresis * (body.upper - body.lower)
    _, hold, _ = nominal.holds(np.array([nominal.angle(MIDDLE)]))
    swings = np.geomspace(settings.smallest, settings.largest, settings.count) * ecu.supply
    relays = Relay(jnp.asarray(swings), jnp.full(swings.shape, float(hold[0])), jnp.full(swings.shape, span))
    path = nominal.run(switch, relays, jnp.ones(()), step(MIDDLE, MIDDLE, settings.hold, lead=0.0))
    for swing, angle in zip(swings, np.asarray(path.position)[0], strict=True):
        swung = swing_of(angle[angle.size // 2 :], ecu.period, settings.turns)
        if swung is not None and swung[0] > settings.clear * span:
            amplitude, period = swung
            return Ultimate(4.0 * swing / (math.pi * math.sqrt(amplitude**2 - span**2)), period)
    return Refusal("no relay within the supply keeps the plate swinging")


def swing_of(angle: np.ndarray, period: float, turns: int) -> tuple[float, float] | None:
    """Amplitude (rad) and period (s) of an oscillation, None where it turns less often.

    Args:
        angle: rad, at even instants, shape (K,).
        period: between them, s.
        turns: rises through the middle at least.
    """
    middle = angle - 0.5 * (angle.max() + angle.min())
    rises = np.flatnonzero((middle[:-1] < 0.0) & (middle[1:] >= 0.0))
    if rises.size < turns:
        return None
    return 0.5 * float(np.ptp(angle)), float(np.mean(np.diff(rises))) * period
