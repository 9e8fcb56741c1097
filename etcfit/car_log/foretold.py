"""A log held against what a model foretold for the gains that made it: steps between two levels, up and back.

A figure is as foretold where it lies in the range of 95 % of the models that fit, widened by what neither the model nor
a log tells better:

    overshoot   at most its upper end + max(2 %, 2 e / size)     e: rms error of the model on motion not fitted
    settling    at most its upper end + 0.1 s                    a swing that touches the band or not (docs: drive)
    error       within max(10 %, 2 e) of its ends                rms of target - position from the step on

Less overshoot and an earlier rest are no warning; an error that is too small is one: other gains made the log, or the
model is of another plate.

Source: this project; the allowances are assumed, 0.1 s from the settling times of second-order loops in
commands/drive.md (5 of 100 are off by more than 91 ms).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import MeasurementError
from .steps import Step
from .study import Study

NEAR = 5.0  # % of the travel within which both ends of a step must lie
_HELD = 0.9  # of the time that a step is to be held
_OVERSHOOT, _SETTLING, _ERROR = 2.0, 0.1, 0.1  # % of the step; s; share of the error
_TIMES = 2.0  # rms errors of the model

Range = tuple[float, float, float]  # 2.5, 50 and 97.5 % of the models that fit; infinite for never


@dataclass(frozen=True)
class Foretold:
    """What a model says of steps."""

    # low, high: their levels, % of the travel
    low: float
    high: float
    hold: float  # s that each is held
    overshoot: Range  # % of the step, the larger of up and back
    settling: Range  # s, likewise
    error: Range  # rms of target - position over both, % of the travel
    # error with the gains that were in the ECU before; None where these are not known, or made the log
    before: Range | None = None
    # rms error of the model on motion that was not fitted, % of the travel; None where nothing was held out
    off: float | None = None


@dataclass(frozen=True)
class Figure:
    """One figure of a log beside what was foretold."""

    # name, unit: of it
    name: str
    unit: str
    # low, high: foretold; infinite for never
    low: float
    high: float
    # least, most: that still are as foretold; infinite where there is no such limit
    least: float
    most: float
    found: float  # in the log; infinite for never

    @property
    def as_foretold(self) -> bool:
        """Whether it is."""
        return self.least <= self.found <= self.most


@dataclass(frozen=True)
class Comparison:
    """A log beside what was foretold."""

    steps: int  # how many steps of the log count
    figures: tuple[Figure, ...]  # overshoot, settling, error
    better: bool | None  # whether the error is less than with the gains before; None where nobody knows that one
    unchanged: bool  # the error is not that of the new gains but that of those before

    @property
    def as_foretold(self) -> bool:
        """Whether every figure is, and tracking no worse than before."""
        return all(figure.as_foretold for figure in self.figures) and self.better is not False


def held_against(study: Study, told: Foretold) -> Comparison:
    """The steps of a log beside what was foretold: the median of each way, of overshoot and settling the worse way.

    Raises:
        MeasurementError: there is no such step, up or back.
    """
    ways = [_steps(study, told, *ends) for ends in ((told.low, told.high), (told.high, told.low))]
    if missing := [word for word, found in zip(("up", "back"), ways, strict=True) if not found]:
        raise MeasurementError(
            study.log.name, f"no step from {told.low:g} to {told.high:g} % of the travel {' or '.join(missing)}, held "
            f"for {told.hold:g} s.", f"What was foretold is of such steps, {NEAR:g} % of the travel either way.",
            f"Log steps of the target from {told.low:g} to {told.high:g} % and back, {told.hold:g} s each, three times."
        )  # fmt: skip
    overshoot = max(_median([step.overshoot for step in each]) for each in ways)
    settling = max(_median([step.settling if step.settling <= told.hold else math.inf for step in each])
                   for each in ways)  # fmt: skip
    squares = [_median([_mean_square(study, step, told.hold) for step in each]) for each in ways]
    error = math.sqrt(float(np.mean(squares)))
    off = _TIMES * (told.off or 0.0)
    wide = max(_ERROR * told.error[1], off)
    figures = (
        _figure("overshoot", "% of the step", told.overshoot, overshoot, None,
                max(_OVERSHOOT, 100.0 * off / (told.high - told.low))),
        _figure("settling", "s", told.settling, settling, None, _SETTLING),
        _figure("error of the step (rms)", "% of the travel", told.error, error, wide, wide),
    )  # fmt: skip
    better = None if told.before is None else error < told.before[1] or told.error[1] >= told.before[1]
    unchanged = (told.before is not None and not figures[-1].as_foretold
                 and told.before[0] - wide <= error <= told.before[2] + wide)  # fmt: skip
    return Comparison(sum(map(len, ways)), figures, better, unchanged)


def _steps(study: Study, told: Foretold, before: float, after: float) -> list[Step]:
    """Those of the log from one level to the other."""
    return [step for step in study.steps if abs(step.before - before) <= NEAR and abs(step.after - after) <= NEAR
            and step.held >= _HELD * told.hold]  # fmt: skip


def _mean_square(study: Study, step: Step, hold: float) -> float:
    """Of target - position from the step on, % of the travel squared."""
    position = study.log.position
    seen = (position.time >= step.begin) & (position.time <= step.begin + min(step.held, hold))
    return float(np.mean((position.value[seen] - step.after) ** 2))


def _median(figures: Sequence[float]) -> float:
    """One of them, so that an infinite figure stays one; of an even number the larger."""
    return sorted(figures)[len(figures) // 2]


def _figure(name: str, unit: str, told: Range, found: float, below: float | None, above: float) -> Figure:
    """With what is allowed on either side; None: any lower figure is."""
    least = -math.inf if below is None else told[0] - below
    return Figure(name, unit, told[0], told[2], least, told[2] + above, found)
