"""Compares a log with the prediction of a model for the gains that made it: steps between two levels, up and back.

A figure is as predicted where it lies in the range of 95 % of the models that fit, widened by the accuracy of model and
log:

    overshoot   at most its upper end + max(2 %, 2 e / size)     e: rms error of the model on motion not fitted
    settling    at most its upper end + 0.1 s                    a swing that touches the band or not (docs: drive)
    error       within max(10 %, 2 e) of its ends                rms of target - position from the step on

Less overshoot and an earlier rest are no warning, but an error that is too small is one: the log was made with other
gains, or the model is of another plate.

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
_HELD = 0.9  # share of the predicted hold time for which a step must be held
_OVERSHOOT, _SETTLING, _ERROR = 2.0, 0.1, 0.1  # % of the step; s; share of the error
_TIMES = 2.0  # rms errors of the model

Range = tuple[float, float, float]  # 2.5, 50 and 97.5 % of the models that fit; infinite for never


@dataclass(frozen=True)
class Foretold:
    """The prediction of a model for steps."""

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
    """One figure of a log and its prediction."""

    # name, unit: of it
    name: str
    unit: str
    # low, high: predicted range; infinite for never
    low: float
    high: float
    # least, most: limits within which it is as predicted; infinite where there is no such limit
    least: float
    most: float
    found: float  # in the log; infinite for never

    @property
    def as_foretold(self) -> bool:
        """Whether the log agrees with the prediction."""
        return self.least <= self.found <= self.most


@dataclass(frozen=True)
class Comparison:
    """The comparison of a log with a prediction."""

    steps: int  # number of steps of the log that are compared
    figures: tuple[Figure, ...]  # overshoot, settling, error
    better: bool | None  # whether the error is less than with the gains before; None where the latter is unknown
    unchanged: bool  # the error is not that of the new gains but that of those before

    @property
    def as_foretold(self) -> bool:
        """Whether every figure is as predicted, and tracking is no worse than before."""
        return all(figure.as_foretold for figure in self.figures) and self.better is not False


def held_against(study: Study, prediction: Foretold) -> Comparison:
    """The steps of a log compared with a prediction: the median of each direction; of overshoot and settling the worse
    direction.

    Raises:
        MeasurementError: the log has no such step, up or back.
    """
    low, high, hold, before = prediction.low, prediction.high, prediction.hold, prediction.before
    ways = [_steps(study, prediction, *ends) for ends in ((low, high), (high, low))]
    if missing := [word for word, found in zip(("up", "back"), ways, strict=True) if not found]:
        raise MeasurementError(
            study.log.name, f"no step from {low:g} to {high:g} % of the travel {' or '.join(missing)}, held "
            f"for {hold:g} s.", f"The prediction is for such steps, to within {NEAR:g} % of the travel.",
            f"Log steps of the target from {low:g} to {high:g} % and back, {hold:g} s each, three times."
        )  # fmt: skip
    overshoot = max(_median([step.overshoot for step in each]) for each in ways)
    settling = max(_median([step.settling if step.settling <= hold else math.inf for step in each])
                   for each in ways)  # fmt: skip
    squares = [_median([_mean_square(study, step, hold) for step in each]) for each in ways]
    error = math.sqrt(float(np.mean(squares)))
    off = _TIMES * (prediction.off or 0.0)
    wide = max(_ERROR * prediction.error[1], off)
    figures = (
        _figure("overshoot", "% of the step", prediction.overshoot, overshoot, None,
                max(_OVERSHOOT, 100.0 * off / (high - low))),
        _figure("settling", "s", prediction.settling, settling, None, _SETTLING),
        _figure("error of the step (rms)", "% of the travel", prediction.error, error, wide, wide),
    )  # fmt: skip
    better = None if before is None else error < before[1] or prediction.error[1] >= before[1]
    unchanged = (before is not None and not figures[-1].as_foretold
                 and before[0] - wide <= error <= before[2] + wide)  # fmt: skip
    return Comparison(sum(map(len, ways)), figures, better, unchanged)


def _steps(study: Study, prediction: Foretold, before: float, after: float) -> list[Step]:
    """The steps of the log from one level to the other."""
    return [step for step in study.steps if abs(step.before - before) <= NEAR and abs(step.after - after) <= NEAR
            and step.held >= _HELD * prediction.hold]  # fmt: skip


def _mean_square(study: Study, step: Step, hold: float) -> float:
    """Mean square of target - position from the step on, % of the travel squared."""
    position = study.log.position
    seen = (position.time >= step.begin) & (position.time <= step.begin + min(step.held, hold))
    return float(np.mean((position.value[seen] - step.after) ** 2))


def _median(figures: Sequence[float]) -> float:
    """The median as one of the figures, so that an infinite one stays infinite; the larger of two middle ones."""
    return sorted(figures)[len(figures) // 2]


def _figure(name: str, unit: str, predicted: Range, found: float, below: float | None, above: float) -> Figure:
    """A figure with the allowance below and above its predicted range; `below` None: any lower figure is allowed."""
    least = -math.inf if below is None else predicted[0] - below
    return Figure(name, unit, predicted[0], predicted[2], least, predicted[2] + above, found)
