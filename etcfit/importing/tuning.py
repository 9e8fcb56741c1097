"""Logs of a car -> a measurement folder for a fit: the input of the model, the held-out part, and whether the logs are
sufficient for gains.

The input of the model is the logged duty if each tick of the ECU has a row of its own. A slower log does not show the
duty between two rows; then the ECU itself becomes a part of the model, which needs the setpoint and the present gains.
That fit starts from a regression on the motion and the logged duty (`rig.driven`), for which a slow log is sufficient:
from setpoint and position alone a search often ends in another valley.

A row of a log has the ECU's values at its last tick, which is up to a period T old. Rows in step with the clock are
moved to their ticks (`ecu_clock`). For other rows, and with an ECU in the model, the position's standard deviation is

    sigma^2 = sigma_sensor^2 + v^2 T^2 / 12,    v the rms of the plate's speed while it moves.

With the duty as input, logs are cut where the plate rests: a piece begins at a known angle, so that an early error that
dry friction would preserve does not persist in the free run; and pieces are simulated in parallel.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import PurePosixPath

import numpy as np

from ..errors import MeasurementError
from ..model.ecu import BiasPoints, Ecu, Notation, Terms
from ..ranges import check_ranges, real, whole
from ..rig.base import SLOW_LOG, Channel, Measurement, Rig
from ..rig.ecu import ecu_lines
from ..rig.user_text import toml_string
from .ecu_clock import ticks

DUTY, ECU = "duty", "ecu"
EFFECTS = ("limp_home_spring", "stribeck_friction")  # effects of every electronic throttle
LATE = "actuation_delay"  # a logged duty acts later: the ECU computes, its bridge waits for the next cycle
HELD_AT_NOMINAL = {"R_a": 1.5, "J_m": 1e-6, "B_m": 1e-9, "B_L": 0.0}
"""Held values, SI: position and volts determine only J R_a/K_m, L_a/R_a, torques over K_m/R_a and K_b + B R_a/K_m; a
search along undetermined directions takes twice the time, and often misses the optimum."""
_PERCENT = 100.0
_SLOWER = 0.6  # share of the rows of a log in which the plate moves least
_OTHER_SIDE = 0.03  # least share of these rows that an angle must bring to the side of their sign
_STILL = 0.03  # s on either side of a cut in which the plate should rest
_A_TICK = 0.8  # rows per period of the ECU's clock above which the duty is the input
_REACH = 0.2  # least share of the travel over which the plate must move
_MOVES = 6  # least number of moves by 5 % of the travel
_SATURATED = 0.2  # share of the rows with the duty at its limit above which the log is doubtful
_BLIND = 0.6  # share of these rows above which the log is useless
_AT_LIMIT = 0.98  # share of the largest duty of the ECU that counts as its limit
PIECE = 2.5  # approximate length of one trace, s


@dataclass(frozen=True)
class TuneSettings:
    """Which part of the logs of a car is fitted."""

    hold_out: float = real(0.4, 0.0, 0.8)  # share of the longest log, at its end, that is predicted and not fitted
    # largest number of fitted samples of all logs; of longer logs the pieces with most motion are fitted
    most_samples: int = whole(4_500, 100, 10**7)
    supply: float = real(13.5, 1.0, 100.0)  # supply voltage, V, if neither the log nor the user gives it

    __post_init__ = check_ranges


@dataclass(frozen=True)
class KnownEcu:
    """Known properties of the ECU that drove the logs."""

    title: str  # name of its make
    ecu: Ecu  # its controller without gains; its delay is one period if not given, see `api.tuned`
    clock_known: bool  # whether its period is published or given
    notation: Notation  # how it writes gains
    gains: Terms | None = None  # its present gains, in its own numbers; None if not given
    supply: float | None = None  # V; None if not given
    # gains under which each log was made, if given; else `gains` are those of all logs
    of_logs: tuple[Terms, ...] = ()
    bias: BiasPoints = ()  # its bias table, % of the travel and % of duty


@dataclass(frozen=True)
class LogCheck:
    """One requirement for a log."""

    name: str  # its name
    passed: bool  # whether the log meets it
    stops: bool  # whether there are no gains without it
    says: str  # what was found
    cure: str = ""  # what to record or to give; "" if it is met


@dataclass(frozen=True)
class TuneInput:
    """A planned measurement folder, with the reasons."""

    model: str  # DUTY or ECU: the input of the model
    why: str  # the reason in words
    checks: tuple[LogCheck, ...]  # checks of the logs
    files: Mapping[str, str]  # path inside the folder -> text
    held_out: str  # the file that is only predicted, or ""
    supply: float  # V
    noise: float  # noise of one reading of the sensor, rad
    delay: float = 0.0  # delay of the ECU from its reading to its output, given or assumed, s
    # with an ECU in the model: files of the same logs with their duty as the input. Their graphs give the start of the
    # fit; empty if no duty was logged.
    duty_files: Mapping[str, str] = field(default_factory=dict)

    @property
    def stopped_by(self) -> tuple[LogCheck, ...]:
        """Requirements that the logs fail and without which there are no gains."""
        return tuple(check for check in self.checks if check.stops and not check.passed)


def tune_input(rig: Rig, name: str, known: KnownEcu, settings: TuneSettings = TuneSettings()) -> TuneInput:
    """Choose the model, check the logs, and write the folder.

    Args:
        rig: the logs as the importer reads them.
        name: name of the new rig.
        known: properties of the ECU.
        settings: which part of the logs is fitted.
    Raises:
        MeasurementError: no log has a position together with a duty or a setpoint.
    """
    logs = [log for log in rig.measurements if "position" in log.channels and {"duty", "setpoint"} & set(log.channels)]
    if not logs:
        there = ", ".join(sorted({channel for log in rig.measurements for channel in log.channels}))
        raise MeasurementError(rig.folder, f"no log with a position and a duty or setpoint; found were {there}.",
                               "Gains need position, and the ECU's duty or its target.",
                               "Log both, or name the columns: --column 'HEADER=duty [%]'.")  # fmt: skip
    supply = _supply(logs, known, settings)
    model, why, rate = _model(rig, logs, known)
    placed = [at_ticks(log, known.ecu.period) for log in logs]
    checks = (rate, *_motion(logs, rig), _saturation(logs, known))
    noise = float(np.median([log.channels["position"].sigma for log in logs]))
    # the clock of an ECU in the model has an unknown phase, and its noise moves the plate
    old = 0.0 if all(placed) and model == DUTY else _speed(logs) * known.ecu.period / math.sqrt(12.0)
    logs = [log if at is None else at for log, at in zip(logs, placed, strict=True)]
    known, within = replace(known, supply=supply), math.hypot(noise, old)
    files, held_out = _texts(logs, name, model, known, within, settings)
    has_duty = model == ECU and all("duty" in log.channels for log in logs)
    by_duty = _texts(logs, name, DUTY, known, within, settings)[0] if has_duty else {}
    return TuneInput(model, why, checks, files, held_out, supply, noise, known.ecu.delay, by_duty)


def _speed(logs: Sequence[Measurement]) -> float:
    """Rms of the plate's speed over the rows in which it moves more than it does on average, rad/s."""
    channels = [log.channels["position"] for log in logs]
    speed = np.concatenate([np.abs(np.gradient(channel.value, channel.time)) for channel in channels])
    return float(np.sqrt(np.mean(speed[speed > np.mean(speed)] ** 2))) if speed.any() else 0.0


def _supply(logs: Sequence[Measurement], known: KnownEcu, settings: TuneSettings) -> float:
    """Supply voltage, V: the user's, else the median of the log, else the assumed one."""
    if known.supply is not None:
        return known.supply
    logged = [log.channels["supply"].value for log in logs if "supply" in log.channels]
    return float(np.median(np.concatenate(logged))) if logged else settings.supply


def _model(rig: Rig, logs: Sequence[Measurement], known: KnownEcu) -> tuple[str, str, LogCheck]:
    """The input of the model, the reason, and whether the log is fast enough for it."""
    rate = 1.0 / max(float(np.median(np.diff(log.time))) for log in logs)  # rows a second
    rows = rate * known.ecu.period
    slow = next((finding for finding in rig.findings if finding.kind == SLOW_LOG), None)
    fast_enough = rows >= _A_TICK if known.clock_known else slow is None
    clock = f"the ECU computes a new duty every {1e3 * known.ecu.period:g} ms"
    has_duty = all("duty" in log.channels for log in logs)
    several = len(logs) > 1
    unlike = len(set(known.of_logs)) > 1
    can_follow = all("setpoint" in log.channels for log in logs) and known.gains is not None
    if has_duty and fast_enough:
        because = clock if known.clock_known else "nothing shows that the duty changes between two rows"
        why = f"the logged duty is the input: {rate:.4g} rows a second, and {because}"
        why += "; under which gains each log was made does not matter" if several else ""
        return DUTY, why, LogCheck("fast enough", True, True, why)
    lacks = ("no duty was logged" if not has_duty else
             f"at {rate:.4g} rows a second the log misses duties, for {clock}" if known.clock_known else
             f"at {rate:.4g} rows a second the duty changes between two rows")  # fmt: skip
    if can_follow and unlike:
        says = f"the ECU would be a part of the model, and the logs were made under different gains: {lacks}"
        cure = (f"Give only the logs that were made under one set of gains; or log the duty at "
                f"{_A_TICK / known.ecu.period:.0f} Hz or faster, when gains do not matter.")  # fmt: skip
        return ECU, says, LogCheck("fast enough", False, True, says, cure)
    if can_follow:
        of_all = f", which are taken for those of all {len(logs)} logs" if several else ""
        why = f"the ECU is a part of the model, with the gains that are in it now{of_all}: {lacks}"
        return ECU, why, LogCheck("fast enough", True, True, why)
    need = _A_TICK / known.ecu.period
    target = () if all("setpoint" in log.channels for log in logs) else ("log the target too",)
    say = ("say which gains are in the ECU now (--present P,I,D or --msq FILE)",) if known.gains is None else ()
    cure = f"Log position, duty and battery at {need:.0f} Hz or faster; or {' and '.join((*target, *say))}."
    return DUTY if has_duty else ECU, lacks, LogCheck("fast enough", False, True, lacks, cure)


def _motion(logs: Sequence[Measurement], rig: Rig) -> tuple[LogCheck, ...]:
    """Checks of the range and the number of the plate's moves."""
    low, high = rig.config.travel
    shares = [(log.channels["position"].value - low) / (high - low) for log in logs]
    reach = max(float(np.max(each)) for each in shares) - min(float(np.min(each)) for each in shares)
    moves = sum(_moves(each, 0.05) for each in shares)
    return (
        LogCheck("moves over the travel", reach >= _REACH, True,
                 f"the plate moves over {_PERCENT * reach:.0f} % of its travel",
                 f"Open the throttle over {_PERCENT * _REACH:.0f} % of its travel at least, engine off."),
        LogCheck("moves often enough", moves >= _MOVES, True,
                 f"{moves} moves of 5 % of the travel or more",
                 "Record 20 s of brisk strokes and steps of the pedal, engine off: the ECU's bench test will do."),
    )  # fmt: skip


def _moves(share: np.ndarray, size: float) -> int:
    """Number of strokes of at least this size, from one turning point to the next."""
    count, way, low, high = 0, 0, share[0], share[0]
    for value in share:
        # during a stroke only the end that it runs towards matters, otherwise both
        low, high = min(low, value), max(high, value)
        if way <= 0 and value - low >= size:
            count, way, high = count + 1, 1, value
        elif way >= 0 and high - value >= size:
            count, way, low = count + 1, -1, value
    return count


def _saturation(logs: Sequence[Measurement], known: KnownEcu) -> LogCheck:
    """Check of the share of rows with the duty at its limit."""
    duties = [log.channels["duty"].value for log in logs if "duty" in log.channels]
    if not duties:
        return LogCheck("duty within its limit", True, False, "no duty was logged, so its limit is not seen")
    duty = np.abs(np.concatenate(duties))
    share = float(np.mean(duty >= _AT_LIMIT * known.ecu.duty))
    says = f"the duty is at its limit in {_PERCENT * share:.1f} % of the rows"
    cure = "A duty at its limit does not show the gains: record smaller steps, or begin with smaller gains."
    return LogCheck("duty within its limit", share <= _SATURATED, share > _BLIND, says, cure)


def at_ticks(log: Measurement, period: float) -> Measurement | None:
    """A log with its rows moved to their ticks of the ECU; None if they are not in step with its clock."""
    fresh = np.ones(log.time.size, dtype=bool)
    if "duty" in log.channels:
        fresh[1:] = np.diff(_on(log.channels["duty"], log.time)) != 0.0
    found = ticks(log.time, fresh, period)
    if found is None:
        return None
    kept, instants = found
    channels = {}
    for quantity, channel in log.channels.items():
        value = _on(channel, log.time)[kept]
        there = np.isfinite(value)
        channels[quantity] = replace(channel, time=instants[there], value=value[there])
    return replace(log, time=instants, channels=channels, edge_turn=None)


def limp_home_angle(logs: Sequence[Measurement]) -> float | None:
    """Angle at which the springs hold the plate without a duty, rad, from logs with a duty.

    Below it a resting plate is held by a negative duty, above it by a positive one: the result is the angle that best
    separates the signs, over the slower part of the rows. None if hardly any row is on one side, or no log has a duty.
    """
    angles, signs = [], []
    for log in logs:
        if "duty" in log.channels:
            angle, duty = (_on(log.channels[name], log.time) for name in ("position", "duty"))
            speed = np.abs(np.gradient(angle, log.time))
            slow = np.isfinite(angle + duty) & (speed < np.nanquantile(speed, _SLOWER))
            angles.append(angle[slow])
            signs.append(np.sign(duty[slow]))
    if not angles or not (angle := np.concatenate(angles)).size:
        return None
    order = np.argsort(angle)
    sign = np.concatenate(signs)[order]
    # count the rows with a negative duty among the k lowest, and those with a positive one among the others
    agree = np.sum(sign) - 2.0 * np.concatenate(([0.0], np.cumsum(sign)[:-1]))
    k = int(np.argmax(agree))
    return float(angle[order][k]) if agree[k] - agree[0] > _OTHER_SIDE * sign.size else None


def _texts(
    logs: Sequence[Measurement], name: str, model: str, known: KnownEcu, within: float, settings: TuneSettings
) -> tuple[dict[str, str], str]:
    """The files of the folder, and the held-out file."""
    longest = max(logs, key=lambda log: float(log.time[-1] - log.time[0]))
    files, held_out, parts = dict[str, str](), "", list[tuple[Measurement, int, int]]()
    for log in logs:
        end = log.time.size
        if log is longest and settings.hold_out > 0.0:
            whole_time = float(log.time[-1] - log.time[0])
            end = int(np.searchsorted(log.time, log.time[-1] - settings.hold_out * whole_time))
            held_out = f"drive/{_stem(log)}_held_out.csv"
            files[held_out] = _csv(log, model, *_busiest(log, end, log.time.size, settings.most_samples))
        # with an ECU in the model feedback keeps the error small, and each piece would need its own initial integral
        most = settings.most_samples
        cuts = _cuts(log, end) if model == DUTY else list(_busiest(log, 0, end, most))
        parts += [(log, a, b) for a, b in pairwise(cuts)]
    for k, (log, a, b) in enumerate(_most_telling(parts, settings.most_samples), 1):
        files[f"drive/{_stem(log)}_{k}.csv"] = _csv(log, model, a, b)
    toml = _rig_toml(name, model, known, within, held_out, limp_home_angle(logs))
    return {"rig.toml": toml, **files}, held_out


def _stem(log: Measurement) -> str:
    return re.sub(r"[^A-Za-z0-9]+", "_", PurePosixPath(log.file).stem).strip("_").casefold() or "log"


def _way(log: Measurement) -> np.ndarray:
    """Distance travelled by the plate up to each row, rad, shape (n,)."""
    position = log.channels["position"]
    way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(position.value)))))
    return np.interp(log.time, position.time, way)


def _cuts(log: Measurement, end: int) -> list[int]:
    """Rows at which to cut the part before `end`: about `PIECE` s apart, where the plate moves least."""
    time, way = log.time[:end], _way(log)[:end]
    moved = np.interp(time + _STILL, time, way) - np.interp(time - _STILL, time, way)
    cuts = [0]
    while time[-1] - time[cuts[-1]] > 1.5 * PIECE:
        low, high = np.searchsorted(time, time[cuts[-1]] + PIECE * np.array([0.6, 1.4]))
        cuts.append(int(low + np.argmin(moved[low : high + 1])))
    return [*cuts, end]


def _most_telling(parts: Sequence[tuple[Measurement, int, int]], most: int) -> list[tuple[Measurement, int, int]]:
    """The pieces with the most motion per row, at most `most` samples, in their order."""
    way = {id(log): _way(log) for log, _, _ in parts}
    telling = sorted(parts, key=lambda part: (way[id(part[0])][part[1]] - way[id(part[0])][part[2] - 1])
                     / (part[2] - part[1]))  # fmt: skip
    room = np.cumsum([b - a for _, a, b in telling]) <= most
    chosen = telling[: max(1, int(room.sum()))]
    return [part for part in parts if part in chosen]


def _busiest(log: Measurement, begin: int, end: int, most: int) -> tuple[int, int]:
    """The stretch of `most` rows within a part of a log in which the plate moves most."""
    if end - begin <= most:
        return begin, end
    way = _way(log)[begin:end]
    k = begin + int(np.argmax(way[most - 1 :] - way[: 1 - most]))
    return k, k + most


_WRITTEN = {
    "position": ("deg", 180.0 / math.pi),
    "setpoint": ("deg", 180.0 / math.pi),
    "duty": ("1", 1.0),
    "supply": ("V", 1.0),
}


def _csv(log: Measurement, model: str, begin: int, end: int) -> str:
    """The CSV of one trace, from a row up to another; without the duty if an ECU in the model computes it."""
    wanted = ("position", "setpoint") if model == ECU else ("position", "setpoint", "duty", "supply")
    columns = {"time [s]": log.time}
    for quantity in wanted:
        if quantity in log.channels:
            unit, factor = _WRITTEN[quantity]
            columns[f"{quantity} [{unit}]"] = factor * _on(log.channels[quantity], log.time)
    rows = np.column_stack(list(columns.values()))[begin:end]
    lines = [",".join("" if math.isnan(cell) else f"{cell:.10g}" for cell in row) for row in rows]
    return "\n".join([f"# from {log.file}", ",".join(columns), *lines, ""])


def _on(channel: Channel, time: np.ndarray) -> np.ndarray:
    """A channel at the rows' times; NaN where it was not logged."""
    out = np.full(time.size, np.nan)
    out[np.searchsorted(time, channel.time)] = channel.value
    return out


def _rig_toml(name: str, model: str, known: KnownEcu, within: float, held_out: str, limp_home: float | None) -> str:
    held = HELD_AT_NOMINAL | ({"t_a": known.ecu.delay} if model == DUTY else {})
    lines = ["# written by `etcfit tune`", "[rig]", f"name = {toml_string(name)}", f"supply_V = {known.supply:.6g}", "",
             "[noise]  # sensor, and rows that are up to a tick of the ECU old",
             f"position_deg = {math.degrees(within):.6g}", "", "[model]",
             f"effects = [{', '.join(map(toml_string, (*EFFECTS, *([LATE] if model == DUTY else []))))}]"]  # fmt: skip
    lines += ["", "[parameters]", *(f"{symbol} = {{ fixed = {value:.10g} }}" for symbol, value in held.items())]
    lines += [] if limp_home is None else [f"theta_lh = {limp_home:.6g}  # where the fit starts"]
    if held_out:
        lines += ["", "[holdout]", f"files = [{toml_string(held_out)}]"]
    if model == ECU and known.gains is not None:
        lines += ["", *ecu_lines(known.ecu, known.notation, known.gains, known.bias)]
    return "\n".join([*lines, ""])
