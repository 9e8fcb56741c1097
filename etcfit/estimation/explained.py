"""How much of the motion a model explains, running free: a figure that, unlike chi2, needs no noise to be known.

    explained = 1 - sum (y - y_hat)^2 / sum (y - mean y)^2

Below 0 the model is worse than a plate that stands still at the mean. Source: coefficient of determination, in system
identification "variance accounted for". The mean is each trace's own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..car_log.criteria import EXPLAINED, Judgement
from ..problem.prediction_error import PredictionError
from ..rig.base import Measurement

MOTION = ("position", "motor_speed")
_MOVES = 3.0  # standard deviations of the noise that a channel's own must be, for a share of it to mean anything


@dataclass(frozen=True)
class Explained:
    """Of one channel of one trace.

    Args:
        file, test, channel: where.
        missed, moved: sum (y - y_hat)^2 and sum (y - mean y)^2, SI.
        moves: whether the channel moves by more than its noise.
    """

    file: str
    test: str
    channel: str
    missed: float
    moved: float
    moves: bool

    @property
    def share(self) -> float | None:
        """1 - missed/moved; None where the channel hardly moves."""
        return 1.0 - self.missed / self.moved if self.moves else None


def explained(rows: Iterable[PredictionError], measurements: Iterable[Measurement]) -> tuple[Explained, ...]:
    """Of every channel of every trace that was logged itself.

    Args:
        rows: free-running errors.
        measurements: of these traces, others too.
    """
    logged = {trace.file: trace.channels for trace in measurements}
    out = []
    for row in rows:
        channel = logged.get(row.file, {}).get(row.channel)
        if channel is None:
            continue
        size, spread = abs(channel.scale), float(np.std(channel.value))
        moves = spread > _MOVES * row.sigma * size
        missed = row.n * (row.rms * size) ** 2
        out.append(Explained(row.file, row.test, row.channel, missed, row.n * spread**2, moves))
    return tuple(out)


def share_of(found: Sequence[Explained], channels: Sequence[str] = MOTION) -> float | None:
    """Of all traces together: of position where any was logged, else of speed; None where nothing moves."""
    for name in channels:
        own = [each for each in found if each.channel == name and each.moves]
        if own:
            return 1.0 - sum(each.missed for each in own) / sum(each.moved for each in own)
    return None


def by_place(found: Iterable[Explained]) -> Mapping[tuple[str, str], float | None]:
    """Share by file and channel."""
    return {(each.file, each.channel): each.share for each in found}


def judged(share: float) -> Judgement:
    """A share (1: all) held against the threshold."""
    return EXPLAINED.judged(100.0 * share if np.isfinite(share) else None, without="the model could not be simulated")


def sentence(share: float | None, held_out: float | None = None) -> str:
    """What tables, pages and notebooks say of it; "" where nothing moves."""
    if share is None:
        return ""
    found = judged(share)
    if found.value is None:
        return found.says
    others = "" if held_out is None or not np.isfinite(held_out) else f", {_percent(held_out)} of that held out"
    text = f"It explains {_percent(share)} of the motion, running free{others}"
    if found.word == "good":
        enough = f"enough to tune a loop with ({found.limit:g} % or more: {found.source})"
        return f"{text}: {enough}; how sure the parameters are, chi2 tells."
    return f"{text}: too little to tune a loop with (at least {found.limit:g} %: {found.source})."


def motion_explained(
    fitted: Iterable[PredictionError], held_out: Iterable[PredictionError], measurements: Sequence[Measurement]
) -> str:
    """The sentence of a fit, by its free-running errors; "" where nothing moves."""
    return sentence(*(share_of(explained(rows, measurements)) for rows in (fitted, held_out)))


def _percent(share: float) -> str:
    """One decimal more where it is near to all."""
    return f"{100.0 * share:.2f} %" if share > 0.99 else f"{100.0 * share:.1f} %"
