"""How long the springs take to bring the plate back without a current, and where it comes to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ...model.effects import State
from ...model.stepper import Step, step
from ...model.throttle import Throttle
from ...problem.program import QUICK, Program
from ..pid.base import Task
from ..pid.loop import Loop
from ..pid.scenarios import default_position


@dataclass(frozen=True)
class Return:
    """From one opening; the worst of all models.

    Args:
        opening: at which the current is cut, share of the travel.
        cut_s: s until the plate stays near its limp-home position, or the closed stop where it has none, terminals
            open; None for not while watched.
        shorted_s: likewise with shorted terminals, which brake it.
        rests: where it comes to rest on open terminals, share of the travel: least and largest.
    """

    opening: float
    cut_s: float | None
    shorted_s: float | None
    rests: tuple[float, float]


def _falls(ticks: int, throttles: Throttle, angles: Any, circuits: Any, body: Any, dt: Any) -> Any:
    """Angle at each step, rad, of every model (D), angle (A) and circuit (2): shape (D, A, 2, ticks)."""

    def fall(throttle: Throttle, angle: Any, circuit: Any) -> Any:
        def advance(carry: Any, k: Any) -> Any:
            still = Step(dt=dt, voltage0=0.0, voltage1=0.0, torque0=0.0, torque1=0.0, time=dt * (k + 1.0), mobile=1.0,
                         circuit=circuit, plate=1.0, series=0.0, gear_ratio=body.gear_ratio, lower=body.lower,
                         upper=body.upper, guide_stiffness=0.0, target0=0.0, target1=0.0, lever=0.0)  # fmt: skip
            before, memory = carry
            x, z = step(throttle, before, memory, still)
            return (x, z), before.theta

        x = State(jnp.zeros(()), angle, jnp.zeros(()))
        z = tuple(jnp.asarray(each, dtype=float) for each in throttle.z0)
        return jax.lax.scan(advance, (x, z), jnp.arange(ticks))[1]

    over_circuits = jax.vmap(fall, in_axes=(None, None, 0))
    over_angles = jax.vmap(over_circuits, in_axes=(None, 0, None))
    return jax.vmap(over_angles, in_axes=(0, None, None))(throttles, angles, circuits)


_every_fall = Program(_falls, options=QUICK)


def returns(loop: Loop, task: Task) -> tuple[Return, ...]:
    """From rest at each opening, the bridge open as of then."""
    settings, body = task.settings.safety, loop.body
    openings = np.array([0.0, *settings.openings])
    ticks = round(settings.falls / settings.fall_step)
    falls = _every_fall(ticks, loop.throttles, loop.angle(openings), np.array([0.0, 1.0]), body, settings.fall_step)
    path = loop.share(np.asarray(falls))
    ends, home = path[..., -1], default_position(loop) or 0.0
    far = np.abs(path - home) > settings.returned
    back = settings.fall_step * np.where(far.any(axis=-1), path.shape[-1] - np.argmax(far[..., ::-1], axis=-1), 0)
    worst = np.max(np.where(far[..., -1], np.inf, back), axis=0)
    rests = ends[:, :, 0]
    return tuple(
        Return(float(opening), _known(cut), _known(shorted), (float(rests[:, k].min()), float(rests[:, k].max())))
        for k, (opening, (cut, shorted)) in enumerate(zip(openings, worst, strict=True))
    )


def _known(seconds: float) -> float | None:
    return float(seconds) if np.isfinite(seconds) else None
