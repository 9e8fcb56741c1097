"""Compares a log with the thresholds of `criteria`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from .criteria import (
    ACTIVITY,
    APART,
    ASTRAY,
    CYCLE,
    HELD,
    LAG,
    OVERSHOOT,
    RMSE,
    SATURATED,
    SETTLING,
    Criterion,
    Judgement,
    Verdict,
)
from .duty import DutyUse
from .limit_cycle import LimitCycle
from .log import DriveLog
from .sensors import Sensors
from .steps import Step, log_resolution, noise_sd
from .tracking import Tracking

_RATE = 50.0  # Hz: four samples within half of a good settling time; assumed
_LARGE = 2.0  # per cent of travel: smaller steps are shown but not judged, because 20 % of them is hardly visible
_SHARE = 0.9  # share of the steps that must be good: other events in the car sometimes spoil one; assumed
_RESTED = 5.0  # s at rest that are needed to see an oscillation; assumed


def judge(
    log: DriveLog,
    follows: Tracking | None,
    steps: Sequence[Step],
    rested: float,
    cycle: LimitCycle | None,
    duty: DutyUse | None,
    pair: Sensors | None,
) -> Verdict:
    """Every judgement; one that the log does not allow states why.

    Args:
        follows, steps, cycle, duty, pair: results found in the log.
        rested: time at rest in which an oscillation would be visible, s.
    """
    return Verdict((
        *_of_steps(log, steps),
        *_of_tracking(follows),
        _of_rest(log, rested, cycle),
        *(() if duty is None else _of_duty(duty)),
        *(() if pair is None else (APART.judged(pair.apart),)),
    ))  # fmt: skip


def _of_tracking(follows: Tracking | None) -> Iterator[Judgement]:
    no_setpoint = "no setpoint was logged"
    limit = RMSE.limit if follows is None else max(RMSE.limit, follows.within_reach)
    yield RMSE.judged(None if follows is None else follows.rmse, without=no_setpoint, limit=limit)
    lag = None if follows is None else follows.lag
    yield LAG.judged(lag, without=no_setpoint if follows is None else "the setpoint hardly moves")
    yield ASTRAY.judged(None if follows is None else follows.astray, without=no_setpoint)


def _of_rest(log: DriveLog, rested: float, cycle: LimitCycle | None) -> Judgement:
    """Whether the plate oscillates at rest, if the log can show that."""
    if cycle is not None:
        return CYCLE.judged(cycle.amplitude, f"{cycle.kind}, {cycle.period:.2g} s a period")
    coarse = max(noise_sd(log.position.value), 0.5 * log_resolution(log.position.value)) > CYCLE.limit
    enough = log.setpoint is not None and rested >= _RESTED and not coarse
    why = "the sensor's noise or resolution hides it" if coarse else f"the setpoint rests for {rested:.2g} s only"
    return CYCLE.judged(0.0 if enough else None, "none seen", without=why)


def _of_duty(duty: DutyUse) -> Iterator[Judgement]:
    yield ACTIVITY.judged(duty.activity, without="the setpoint never rests")
    resting = None if duty.saturated_at_rest is None else 100.0 * duty.saturated_at_rest
    yield SATURATED.judged(resting, without="the setpoint never rests")


def _of_steps(log: DriveLog, steps: Sequence[Step]) -> Iterator[Judgement]:
    """The worst step among the best nine tenths."""
    large = [each for each in steps if abs(each.size) >= _LARGE]
    why = ("no setpoint was logged" if log.setpoint is None else
           "no step of 2 % or more between two rests of 0.3 s" if not large else
           f"a log of {1.0 / log.position.step:.0f} Hz is too slow, {_RATE:.0f} Hz are needed"
           if log.position.step > 1.0 / _RATE * 1.01 else "")  # fmt: skip
    sd = noise_sd(log.position.value)

    def worst(criterion: Criterion, figure: Callable[[Step], float], among: Sequence[Step], without: str) -> Judgement:
        if why or not among:
            return criterion.judged(None, without=why or without)
        order = sorted(among, key=figure)
        at = order[int(np.ceil(_SHARE * len(order))) - 1]
        place = f"step from {at.before:.0f} to {at.after:.0f} % at {at.begin:.1f} s"
        where = f"{place}; {100.0 * _SHARE:.0f} % of {len(order)} are no worse"
        return criterion.judged(figure(at), where)

    clear = [each for each in large if 0.01 * OVERSHOOT.limit * abs(each.size) > 3.5 * sd]
    yield worst(OVERSHOOT, lambda each: each.overshoot, clear, "the sensor's noise hides it")
    yield worst(SETTLING, lambda each: each.settling, large, "")
    yield worst(HELD, lambda each: each.error_pct, large, "")
