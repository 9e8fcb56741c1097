"""Evaluates one log in every respect, compares it with the thresholds of `criteria`, and compares two logs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..errors import UsageError
from ..rig.base import Measurement, Rig, RigConfig
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
from .duty import DutyUse, duty_use
from .limit_cycle import LimitCycle, at_rest, limit_cycle
from .log import DriveLog, Series
from .others import DUTY, SECOND, VOLTS_1, VOLTS_2
from .sensors import Sensors, two_sensors
from .steps import Step, log_resolution, noise_sd, steps
from .tracking import Tracking, tracking
from .usage import BOUNDS, Spectrum, Usage, spectrum, usage

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


_CLEAR = 2.0  # standard errors from which on a difference of two logs is clear
_MANY = "more than 100"


@dataclass(frozen=True, eq=False)
class Study:
    """The evaluation of one log."""

    log: DriveLog
    usage: Usage  # time spent at each position
    spectrum: Spectrum | None  # frequencies of the motion; None for a log that is too short
    tracking: Tracking | None  # error against the setpoint; None where no setpoint was logged
    steps: tuple[Step, ...] = ()  # every step of the setpoint, and the response
    cycle: LimitCycle | None = None  # an oscillation while the setpoint rests; None where there is none
    duty: DutyUse | None = None  # use of the duty; None where none was logged
    sensors: Sensors | None = None  # both sensors of the plate; None where one of them was not logged, or hardly moves
    verdict: Verdict = field(default_factory=lambda: Verdict(()))  # whether it is good enough


def study(log: DriveLog, bounds: tuple[float, float] = BOUNDS) -> Study:
    """Evaluate a log; `bounds` are two positions between which the share of time is given, per cent."""
    duty, setpoint = log.others.get(DUTY), log.setpoint
    follows = None if setpoint is None else tracking(log.position, setpoint)
    answers = () if setpoint is None else steps(log.position, setpoint)
    cycle = None if setpoint is None else limit_cycle(log.position, setpoint, duty)
    used = None if duty is None else duty_use(duty, setpoint)
    pair = _pair(log)
    rested = 0.0 if setpoint is None else at_rest(log.position, setpoint)
    return Study(log, usage(log.position, bounds), spectrum(log.position), follows, answers, cycle, used, pair,
                 judge(log, follows, answers, rested, cycle, used, pair))  # fmt: skip


def study_traces(rig: Rig) -> tuple[Study, ...]:
    """Traces of a measurement folder that hold a setpoint and a position, evaluated as logs of a car."""
    traces = (trace for trace in rig.measurements if {"position", "setpoint"} <= set(trace.channels))
    return tuple(study(as_log(trace, rig.config)) for trace in traces)


def as_log(trace: Measurement, config: RigConfig) -> DriveLog:
    """A trace that holds a position, as a log of a car."""
    low, high = config.travel

    def series(name: str, offset: float, scale: float) -> Series:
        channel = trace.channels[name]
        return Series(channel.time, 100.0 * (channel.value - offset) / scale)

    duty = {DUTY: series("duty", 0.0, 1.0)} if "duty" in trace.channels else {}
    moves = {name: series(name, low, high - low) for name in ("position", "setpoint") if name in trace.channels}
    columns = {name: trace.channels[name].header for name in (*moves, *duty)}
    return DriveLog(trace.file, moves["position"], moves.get("setpoint"), columns, others=duty)


def _pair(log: DriveLog) -> Sensors | None:
    """The pair of sensors, in volts where logged, otherwise in per cent."""
    if VOLTS_1 in log.others and VOLTS_2 in log.others:
        return two_sensors(log.others[VOLTS_1], log.others[VOLTS_2], "V", _opens(log), log.tps)
    if SECOND in log.others:
        return two_sensors(log.position, log.others[SECOND], "%", 1.0)
    return None


def _opens(log: DriveLog) -> float:
    """1 where the first sensor rises while the plate opens, -1 where it falls; 0 without a setpoint, because the
    position of a sensor that is not calibrated yet does not show the direction."""
    first = log.others[VOLTS_1]
    if log.setpoint is None:
        return 0.0
    setpoint = np.interp(first.time, log.setpoint.time, log.setpoint.value)
    return float(np.sign(np.cov(first.value, setpoint)[0, 1]))


def chosen(logs: Sequence[DriveLog], names: Sequence[str]) -> tuple[DriveLog, ...]:
    """Logs by the names of their files, in the order given.

    Raises:
        UsageError: there is none of that name.
    """
    known = {log.name: log for log in logs}
    for name in names:
        if name not in known:
            raise UsageError(f"no log is called {name}. There are: {', '.join(known)}.")
    return tuple(known[name] for name in names)


def verdict(before: Study, after: Study) -> str:
    """Two logs, before and after new gains, in a sentence."""
    was, now = before.tracking, after.tracking
    if was is None or now is None:
        return "Tracking errors cannot be compared: a log without a setpoint has none."
    text = f"RMSE {was.rmse:.2f} -> {now.rmse:.2f} % of travel"
    if was.lag is not None and now.lag is not None:
        text += f", lag {1e3 * was.lag:.0f} -> {1e3 * now.lag:.0f} ms"
    return " ".join((f"{text}.", *_clear(was, now), *_judged(before.verdict, after.verdict), _alike(was, now)))


def _judged(before: Verdict, after: Verdict) -> Iterator[str]:
    """Figures that have become good, that are still not good, and that are no longer good."""
    was, now = ({each.name: each.word for each in verdict.judgements} for verdict in (before, after))
    for words, pair in (("Now good", ("not good", "good")), ("Still not good", ("not good", "not good")),
                        ("No longer good", ("good", "not good"))):  # fmt: skip
        names = [name for name, word in now.items() if (was.get(name), word) == pair]
        if names:
            yield f"{words}: {', '.join(names)}."


def _clear(was: Tracking, now: Tracking) -> Iterator[str]:
    """How sure the differences in RMSE and in lag are."""
    if was.stderr is None or now.stderr is None:
        yield "The logs are too short to estimate how much the RMSE varies by chance."
        return
    sd = float(np.hypot(was.stderr, now.stderr))
    yield _significance("RMSE", now.rmse - was.rmse, sd, f"{sd:.2f} %")
    if was.lag is None or now.lag is None or was.lag_stderr is None or now.lag_stderr is None:
        return
    sd = float(np.hypot(was.lag_stderr, now.lag_stderr))
    yield _significance("lag", now.lag - was.lag, sd, f"{1e3 * sd:.1f} ms")


def _significance(name: str, difference: float, sd: float, shown: str) -> str:
    if abs(difference) <= _CLEAR * sd:
        return f"The difference in {name} is within its variation by chance ({shown})."
    errors = abs(difference) / max(sd, 1e-300)
    return f"The difference in {name} is clear ({_MANY if errors > 100.0 else format(errors, '.1f')} standard errors)."


def _alike(was: Tracking, now: Tracking) -> str:
    ratio = now.demand / was.demand if was.demand > 0.0 else np.inf
    if 0.8 < ratio < 1.25:
        return "The setpoints of both drives move about equally fast."
    return (
        f"But the second drive's setpoint moves {ratio:.2f} times as fast: the two drives cannot be compared directly."
    )
