"""Tuning rules that experiment on the nonlinear model: the paper's manual procedure, and an ECU's relay autotune."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.linear import MIDDLE
from ...model.pid import Gains, quantised
from ..loop_figures import LoopFigures
from ..setpoint import step, trapezoid
from ..settings import ManualSettings
from .base import Refusal, Task
from .formulas import Ultimate, from_ultimate

COUNT = 64  # number of values of each gain, evenly spaced in the logarithm; those of Ki and Kd include 0
_QUICK = 1.05  # tracking error over the least with proportional gain alone, up to which a gain counts as quick
_CALM = 0.25  # overshoot over the allowed one, below which a response counts as calm


def manual(task: Task) -> Gains | Refusal:
    """P until quick, D until calm, then a little I: the paper's manual procedure, on the nonlinear model.

    1. P alone: the smallest within 5 % of the least tracking error that P alone reaches.
    2. D: raised until the overshoot is below a quarter of the allowed one; where no D does that, the one with the least
       overshoot.
    3. I: the smallest that meets the steady-state error and the overshoot; otherwise the one with the least error among
       those that meet the overshoot; otherwise none.

    Source: the paper, section 4.2. Differs from source: "quick" and "calm" have numerical limits; the paper judged by
    eye.
    """
    loop, required, setpoint = task.loop.first(1), task.requirements, trapezoid()
    settings = task.settings.manual
    proportional, integral, derivative = grids(settings)

    def tried(p: np.ndarray, i: np.ndarray, d: np.ndarray) -> LoopFigures:
        p, i, d = np.broadcast_arrays(p, i, d)
        return loop.figures(Gains(p, i, d), setpoint).each(lambda figure: np.asarray(figure)[0])

    quick = tried(proportional, np.zeros(1), np.zeros(1)).rmse_pct
    kp = proportional[np.argmax(quick <= _QUICK * quick.min())]
    if kp == proportional[-1]:
        return Refusal(f"P alone tracks best at the largest gain tried, {kp:g} V/rad: raise highest in ManualSettings")
    calm = tried(kp, np.zeros(1), derivative).overshoot_pct
    below = calm < _CALM * required.overshoot_pct
    kd = derivative[np.argmax(below)] if below.any() else derivative[np.argmin(calm)]
    end = tried(kp, integral, kd)
    keeps = end.overshoot_pct < required.overshoot_pct
    exact = keeps & (end.steady_state_error_pct < required.steady_state_error_pct)
    if exact.any():
        return Gains(float(kp), float(integral[np.argmax(exact)]), float(kd))
    error = np.where(keeps, end.steady_state_error_pct, np.inf)
    return Gains(float(kp), float(integral[np.argmin(error)]) if keeps.any() else 0.0, float(kd))


def grids(settings: ManualSettings) -> Gains:
    """The values of each gain that are tried, rising, shape (COUNT,) each: V/rad, V/(rad s) and V s/rad."""
    (p, i, d), (p_end, i_end, d_end), n = settings.lowest, settings.highest, COUNT
    return Gains(
        np.geomspace(p, p_end, n),
        np.concatenate(([0.0], np.geomspace(i, i_end, n - 1))),
        np.concatenate(([0.0], np.geomspace(d, d_end, n - 1))),
    )


_HYSTERESIS = 0.005  # error at which the relay switches, share of the travel
# least and largest amplitude, shares of the supply, and their number; the least that keeps the plate oscillating is
# used
_SWINGS = 0.06, 0.9, 12
_TURNS = 4  # least number of reversals in the second half of an experiment
_CLEAR = 1.2  # oscillation over the hysteresis above which it counts
_HOLD = 2.0  # duration of each experiment, s; the oscillation settles in the first half
LONGEST_STEP = 2.5e-5  # s: longest step of the integration; each switch of the relay causes an error of that order


class Relay(NamedTuple):
    """v = bias + d or bias - d."""

    swing: Any  # d, V
    bias: Any  # V that hold the plate
    hysteresis: Any  # rad


def switch(relay: Relay, ecu: Ecu, side: Any, setpoint: Any, position: Any, bias: Any) -> Any:
    """One tick of the relay: it switches where the error has passed its hysteresis."""
    error = setpoint - quantised(position, ecu.resolution)
    side = jnp.where(error > relay.hysteresis, 1.0, jnp.where(error < -relay.hysteresis, -1.0, side))
    volts = jnp.clip(relay.bias + side * relay.swing, -ecu.limit, ecu.limit)
    return quantised(volts, ecu.pwm), side


def relay(task: Task) -> Gains | Refusal:
    """K_u = 4 d / (pi sqrt(a^2 - e^2)), P_u the period of the oscillation, on the nonlinear plant; then
    Ziegler-Nichols.

    Source: Astrom and Hagglund 1984, Automatica 20(5). Differs from source: the experiment is simulated on the fitted
    model with its friction, about the voltage that holds the plate, with the smallest relay that keeps it oscillating.
    """
    found = experiment(task)
    return found if isinstance(found, Refusal) else from_ultimate(found)


def experiment(task: Task) -> Ultimate | Refusal:
    """The relay's oscillation on the nominal plant."""
    alone = task.loop.first(1)
    nominal = replace(alone, settings=replace(alone.settings, longest_step=LONGEST_STEP))
    ecu, body = nominal.ecu, nominal.body
    span = _HYSTERESIS * (body.upper - body.lower)
    _, hold, _ = nominal.holds(np.array([nominal.angle(MIDDLE)]))
    swings = np.geomspace(*_SWINGS) * ecu.supply
    relays = Relay(jnp.asarray(swings), jnp.full(swings.shape, float(hold[0])), jnp.full(swings.shape, span))
    path = nominal.run(switch, relays, jnp.ones(()), step(MIDDLE, MIDDLE, _HOLD, lead=0.0))
    for swing, angle in zip(swings, np.asarray(path.position)[0], strict=True):
        swung = swing_of(angle[angle.size // 2 :], ecu.period, _TURNS)
        if swung is not None and swung[0] > _CLEAR * span:
            amplitude, period = swung
            return Ultimate(4.0 * swing / (math.pi * math.sqrt(amplitude**2 - span**2)), period)
    return Refusal("no relay within the supply keeps the plate oscillating")


def swing_of(angle: np.ndarray, period: float, turns: int) -> tuple[float, float] | None:
    """Amplitude (rad) and period (s) of an oscillation sampled each `period` (s); None with fewer reversals."""
    middle = angle - 0.5 * (angle.max() + angle.min())
    rises = np.flatnonzero((middle[:-1] < 0.0) & (middle[1:] >= 0.0))
    if rises.size < turns:
        return None
    return 0.5 * float(np.ptp(angle)), float(np.mean(np.diff(rises))) * period
