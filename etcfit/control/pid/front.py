"""Tracking against effort: how well the plate follows, over how restless the duty may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from .base import Task
from .gains import Gains
from .optimal import best_from


@dataclass(frozen=True)
class FrontPoint:
    """The best gains within a limit of the duty's activity.

    Args:
        limit: of the activity, %; infinite for none.
        gains: them.
        activity: theirs, %.
        rmse: tracking error, % of the travel.
        meets: whether they meet everything else that is asked for.
    """

    limit: float
    gains: Gains
    activity: float
    rmse: float
    meets: bool


def front(task: Task, begin: Gains) -> tuple[FrontPoint, ...]:
    """On the nominal model, from the most restless to the calmest; each search begins at the end of the one before.

    The first is not limited; the others are allowed a share of its activity each.

    Args:
        task: whose other requirements all points are to meet.
        begin: gains to begin with.
    """
    alone, points = replace(task, loop=task.loop.first(1)), list[FrontPoint]()
    for share in (math.inf, *task.settings.front.shares):
        limit = share * points[0].activity if points else math.inf
        here = replace(alone, requirements=replace(task.requirements, duty_activity_pct=limit))
        begin, figures, missed = best_from(here, begin, task.settings.front.rounds)
        points.append(FrontPoint(limit, begin, figures.duty_activity_pct, figures.rmse_pct, missed == 0.0))
    return carried(points)


def carried(points: Sequence[FrontPoint]) -> tuple[FrontPoint, ...]:
    """Points of which none follows worse than a calmer one: what is best within a limit is within every looser one.

    Args:
        points: as the searches ended, limits falling.
    """
    best = [points[-1]]
    for point in reversed(points[:-1]):
        calmer = best[-1]
        better = calmer.meets and not (point.meets and point.rmse <= calmer.rmse)
        best.append(replace(calmer, limit=point.limit) if better else point)
    return tuple(reversed(best))
