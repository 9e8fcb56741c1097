"""The share of the motion that a model explains, running free; unlike chi2 it does not depend on the noise.

    explained = 1 - sum (y - y_hat)^2 / sum (y - mean y)^2

Below 0 the model is worse than a plate that stands still at the mean. Source: coefficient of determination, in system
identification "variance accounted for". The mean is that of each trace.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..car_log.criteria import EXPLAINED, Judgement
from ..problem.prediction_error import PredictionError, pooled, rows
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from ..rig.base import Measurement

MOTION = ("position", "motor_speed")
_MOVES = 3.0  # least standard deviation of a channel, in standard deviations of its noise, for a meaningful share


@dataclass(frozen=True)
class Explained:
    """The motion of one channel of one trace and its explained part."""

    # file, test, channel: the channel
    file: str
    test: str
    channel: str
    # missed, moved: sum (y - y_hat)^2 and sum (y - mean y)^2, SI
    missed: float
    moved: float
    moves: bool  # whether the channel moves by more than its noise

    @property
    def share(self) -> float | None:
        """1 - missed/moved; None if the channel hardly moves."""
        return 1.0 - self.missed / self.moved if self.moves else None


def explained(rows: Iterable[PredictionError], measurements: Iterable[Measurement]) -> tuple[Explained, ...]:
    """The explained motion of every logged channel of every trace."""
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
    """The share over all traces together: of position if any was logged, else of speed; None if nothing moves."""
    for name in channels:
        own = [each for each in found if each.channel == name and each.moves]
        if own:
            return 1.0 - sum(each.missed for each in own) / sum(each.moved for each in own)
    return None


def by_place(found: Iterable[Explained]) -> Mapping[tuple[str, str], float | None]:
    """Share by file and channel."""
    return {(each.file, each.channel): each.share for each in found}


def judged(share: float) -> Judgement:
    """A share (1: all) compared with the threshold."""
    return EXPLAINED.judged(100.0 * share if np.isfinite(share) else None, without="the model could not be simulated")


def sentence(share: float | None, held_out: float | None = None) -> str:
    """The sentence for tables, pages and notebooks; "" if nothing moves."""
    if share is None:
        return ""
    found = judged(share)
    if found.value is None:
        return found.says
    others = "" if held_out is None or not np.isfinite(held_out) else f", {_percent(held_out)} of the held-out motion"
    text = f"It explains {_percent(share)} of the motion, running free{others}"
    if found.word == "good":
        enough = f"enough to tune a loop with ({found.limit:g} % or more: {found.source})"
        return f"{text}: {enough}; chi2 shows how certain the parameters are."
    return f"{text}: too little to tune a loop with (at least {found.limit:g} %: {found.source})."


def motion_explained(
    fitted: Iterable[PredictionError], held_out: Iterable[PredictionError], measurements: Sequence[Measurement]
) -> str:
    """The sentence of a fit, from its free-running errors; "" if nothing moves."""
    return sentence(*(share_of(explained(rows, measurements)) for rows in (fitted, held_out)))


def _percent(share: float) -> str:
    """A percentage, with one more decimal near 100; below 100 never printed as 100.00."""
    if 0.9999 < share < 1.0:
        return "over 99.99 %"
    return f"{100.0 * share:.2f} %" if share > 0.99 else f"{100.0 * share:.1f} %"


# ---- A held-out trace of another session: whether another scale of its drive explains what the model misses there
#
#     e(g) = rms of (y - y_hat(g u)) over sigma,    g: the drive that acted over the one logged
#
# A throttle with a warm winding, or a supply below the stated one, gives less torque for the same log. A trace with a
# far larger error than the fitted traces is simulated again with its drive at other scales; if one of them removes most
# of the error, a warning says so.

STRANGE = 3.0  # error of a free run over that of the fitted traces, in sigma, above which other drives are tried
OTHER_DRIVE = 0.5  # largest share of the error that remains if another scale of the drive explains it
_FACTORS = np.exp(np.linspace(-0.5, 0.5, 41))  # scales of the drive: 0.61 to 1.65 in steps of 2.5 %
_FINER = np.exp(np.linspace(-0.025, 0.025, 11))


class DriveScale(NamedTuple):
    """The best scale of the drive of one trace."""

    file: str  # file of the trace
    factor: float  # drive that acted over the logged one
    # before, after: error of the free run with the drive as logged and at that scale, in sigma
    before: float
    after: float

    @property
    def words(self) -> str:
        """The warning of the fit."""
        off = 100.0 * (self.factor - 1.0)
        size = f"{abs(off):.2g} % {'stronger' if off > 0.0 else 'weaker'}"
        return (
            f"{self.file} is held out, and the model's error there is {self.before:.3g} times the noise, far more than "
            f"in the fitted traces. With a drive {size} than logged the error would be {self.after:.3g} times: another "
            "supply or another winding temperature has this effect. Log supply and temperature with each session."
        )


def drive_scale(problem: EstimationProblem, x: np.ndarray, trace: Trace) -> DriveScale:
    """The scale of a trace's drive at which the model fits it best.

    Args:
        trace: a driven trace without an ECU in the model.
    """
    before, *coarse = _errors(problem, x, trace, np.array([1.0, *_FACTORS]))
    about = _FACTORS[int(np.argmin(coarse))]
    finer = about * _FINER
    errors = _errors(problem, x, trace, finer)
    best = int(np.argmin(errors))
    return DriveScale(trace.measurement.file, float(finer[best]), before, errors[best])


def drives_of_another_session(
    problem: EstimationProblem,
    x: np.ndarray,
    held_out: Sequence[Trace],
    errors: tuple[Sequence[PredictionError], Sequence[PredictionError]],
) -> tuple[DriveScale, ...]:
    """Held-out traces with a far larger error than the fitted ones, which is small with another drive.

    Args:
        errors: free-run errors of the fitted and of the held-out traces.
    """
    fitted, others = errors
    usual, found = pooled(fitted), []
    for trace in held_out:
        own = [row for row in others if row.file == trace.measurement.file]
        if trace.input is None or trace.controlled or not own or not pooled(own) > STRANGE * usual:
            continue
        scale = drive_scale(problem, x, trace)
        if scale.after < OTHER_DRIVE * scale.before:
            found.append(scale)
    return tuple(found)


def _errors(problem: EstimationProblem, x: np.ndarray, trace: Trace, factors: np.ndarray) -> list[float]:
    """Error of the free run at each scale of the drive, in sigma."""
    signal = trace.input
    assert signal is not None, f"{trace.measurement.file} is not driven: it has no drive to scale"
    scaled = tuple(replace(trace, input=replace(signal, value=factor * signal.value)) for factor in factors)
    beside = problem.for_traces(scaled, x)
    free = beside.free_run(x)
    return [pooled(rows((one,), (model,))) for one, model in zip(beside.batch.traces, free, strict=True)]
