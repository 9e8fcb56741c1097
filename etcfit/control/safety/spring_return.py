"""How long the springs take to bring the plate back without a current, and where it comes to rest."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import numpy as np

from ...model.throttle import Throttle
from ..motion import Bands, Experiment, Motion, Watching, moved
from ..pid.base import Task
from ..pid.loop import Body, Loop
from ..pid.scenarios import default_position
from ..settings import SafetySettings


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


def falls(
    throttles: Throttle, angles: np.ndarray, homes: np.ndarray, circuit: float, body: Body, settings: SafetySettings
) -> Motion:
    """Every model let go from an angle of its own, its terminals open (`circuit` 0) or shorted (1).

    The one band of the motion is what counts as back: `settings.returned` of the travel either side of its home.

    Args:
        throttles: parameters of shape (D,).
        angles: from which, rad, shape (D,).
        homes: where its springs bring it, rad, shape (D,).
        circuit: 0 or 1.
        body: gear ratio and stops.
        settings: how near, how long and how closely.
    """
    near = settings.returned * (body.upper - body.lower)
    none = np.zeros(angles.size)
    what = Experiment(angles, none, none + circuit)
    bands = Bands((homes - near)[:, None], (homes + near)[:, None])
    return moved(throttles, what, bands, body, Watching(settings.fall_step, settings.falls, settings.at_rest))


def returns(loop: Loop, task: Task) -> tuple[Return, ...]:
    """From rest at each opening, the bridge open as of then."""
    settings, body = task.settings.safety, loop.body
    openings = np.array([0.0, *settings.openings])
    home = loop.angle(default_position(loop) or 0.0)
    which, angles = (each.ravel() for each in np.meshgrid(np.arange(loop.draws), loop.angle(openings), indexing="ij"))
    throttles = jax.tree.map(lambda leaf: np.asarray(leaf)[which], loop.throttles)
    homes, shape = np.full(angles.size, home), (loop.draws, openings.size)
    cut, shorted = (falls(throttles, angles, homes, circuit, body, settings) for circuit in (0.0, 1.0))
    rests = loop.share(cut.angle).reshape(shape)
    worst = [np.max(each.stays.reshape(shape), axis=0).tolist() for each in (cut, shorted)]
    ends = zip(np.min(rests, axis=0).tolist(), np.max(rests, axis=0).tolist(), strict=True)
    return tuple(
        Return(opening, _known(after_cut), _known(after_short), rest)
        for opening, after_cut, after_short, rest in zip(openings.tolist(), *worst, ends, strict=True)
    )


def _known(seconds: float) -> float | None:
    return seconds if np.isfinite(seconds) else None
