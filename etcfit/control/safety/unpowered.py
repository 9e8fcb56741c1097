"""Simulates the return of a plate without current by its springs, and computes current and heat of holding a plate.

`safety` calls it for the fitted models, `fleets.line` calls `release_plates` for all units of a line. The motion itself
is simulated by `control.motion`.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np

from ...model.effects.electrical import WindingHeating
from ...model.throttle import Throttle
from ..motion import Bands, Experiment, Motion, Watching, simulate_motion
from ..pid.base import Task
from ..pid.conditions import COPPER, default_position
from ..pid.feedforward import held
from ..pid.loop import Body, Loop

RETURNED = 0.05  # distance from the limp-home position within which a plate counts as back, share of the travel
FALLS = 2.0  # s: simulated time of a plate without a current
_PLACES = 21  # number of positions at which the holding current is given
_FALL = Watching(step=5e-4, longest=FALLS, rest=0.1)


@dataclass(frozen=True)
class Return:
    """The return of the plate from one opening; the worst of all models."""

    opening: float  # opening at which the current is cut, share of the travel
    # time until the plate stays near its limp-home position, or near the closed stop if there is none, terminals open,
    # s; None where it does not in the simulated time
    cut_s: float | None
    shorted_s: float | None  # likewise with shorted terminals, which brake the motor
    rests: tuple[float, float]  # least and largest final position with open terminals, share of the travel


def release_plates(
    throttles: Throttle, angles: np.ndarray, homes: np.ndarray, circuit: float, body: Body, near: float, how: Watching
) -> Motion:
    """Release every model from its own angle, terminals open (`circuit` 0) or shorted (1), and simulate it.

    Args:
        throttles: parameters of shape (D,).
        angles: start angles, rad, shape (D,).
        homes: positions to which the springs bring the plates, rad, shape (D,).
        circuit: 0 or 1.
        body: gear ratio and stops.
        near: distance from home, share of the travel, within which the plate is back: the one band of the motion.
        how: step and length of the simulation.
    """
    reach = near * (body.upper - body.lower)
    none = np.zeros(angles.size)
    bands = Bands((homes - reach)[:, None], (homes + reach)[:, None])
    return simulate_motion(throttles, Experiment(angles, none, none + circuit), bands, body, how)


def return_times(loop: Loop, task: Task) -> tuple[Return, ...]:
    """Return times from each opening, at rest, with the bridge opened at time 0."""
    openings = np.array([0.0, *task.settings.safety.openings])
    home = loop.angle(default_position(loop) or 0.0)
    which, angles = (each.ravel() for each in np.meshgrid(np.arange(loop.draws), loop.angle(openings), indexing="ij"))
    throttles = jax.tree.map(lambda leaf: np.asarray(leaf)[which], loop.throttles)
    homes, shape = np.full(angles.size, home), (loop.draws, openings.size)
    cut, shorted = (
        release_plates(throttles, angles, homes, circuit, loop.body, RETURNED, _FALL) for circuit in (0.0, 1.0)
    )
    rests = loop.share(cut.angle).reshape(shape)
    worst = [np.max(each.stays.reshape(shape), axis=0).tolist() for each in (cut, shorted)]
    ends = zip(np.min(rests, axis=0).tolist(), np.max(rests, axis=0).tolist(), strict=True)
    return tuple(
        Return(opening, _known(after_cut), _known(after_short), rest)
        for opening, after_cut, after_short, rest in zip(openings.tolist(), *worst, ends, strict=True)
    )


def _known(seconds: float) -> float | None:
    return seconds if np.isfinite(seconds) else None


@dataclass(frozen=True, eq=False)
class Holding:
    """Current and heat of holding a plate still, by the nominal model at the temperature of the bench."""

    shares: np.ndarray  # positions of the other rows, shares of the travel, shape (S,)
    current: np.ndarray  # current in the middle of the dry friction, A, shape (S,)
    closing: np.ndarray  # current at which it is about to close, A, shape (S,)
    opening: np.ndarray  # current at which it is about to open, A, shape (S,)
    watts: np.ndarray  # heat of the winding in the middle of the dry friction, W, shape (S,)
    # final temperature rise of the winding, K, shape (S,); None where its heating is unknown
    rise: np.ndarray | None
    stall_A: float  # current at the full duty against a stop
    stall_W: float  # heat of it in the winding
    # time at a stop until the winding warms from the bench's temperature to the allowed one, s; infinite where it never
    # does; None where its heating is unknown
    longest: float | None


def holding_currents(loop: Loop, task: Task) -> Holding:
    """Current and heat of holding over the whole travel, and of the ECU's largest duty at a stop."""
    settings, throttle = task.settings.safety, loop.nominal
    shares = np.linspace(0.0, 1.0, _PLACES)
    angles = loop.angle(shares)
    closing, current, opening = (np.asarray(held(throttle, angles, side, *loop.body)[0])
                                 for side in (-1.0, 0.0, 1.0))  # fmt: skip
    ohm, volts = float(np.asarray(throttle.parameter("R_a"))), float(task.ecu.limit)
    heating = next((each for each in throttle.effects if isinstance(each, WindingHeating)), None)
    stall = volts / ohm
    if heating is None or float(heating.r_h) <= 0.0:
        return Holding(shares, current, closing, opening, ohm * current**2, None, stall, ohm * stall**2, None)
    grows, slow, copper = float(heating.r_h), float(heating.tau_h), COPPER
    warmth = grows / (ohm * copper)  # K per A2 s
    rise = warmth * slow * current**2
    longest = _time_to_warm_by(settings.insulation - task.settings.conditions.bench, volts, ohm, warmth, copper, slow)
    return Holding(shares, current, closing, opening, ohm * current**2, rise, stall, ohm * stall**2, longest)


def _time_to_warm_by(most: float, volts: float, ohm: float, warmth: float, copper: float, slow: float) -> float:
    """Time until a winding under a constant voltage is `most` K warmer, s; infinite where it never is.

    dD/dt = warmth i^2 - D / slow,    i = V / (R (1 + copper D)): `model.effects.electrical.WindingHeating`.
    """

    from scipy.integrate import solve_ivp

    def rate(_: float, warmer: np.ndarray) -> np.ndarray:
        return warmth * (volts / (ohm * (1.0 + copper * warmer))) ** 2 - warmer / slow

    def there(_: float, warmer: np.ndarray) -> float:
        return float(warmer[0] - most)

    there.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    found = solve_ivp(rate, (0.0, 50.0 * slow), [0.0], events=there, rtol=1e-8)
    return float(found.t_events[0][0]) if found.t_events[0].size else np.inf
