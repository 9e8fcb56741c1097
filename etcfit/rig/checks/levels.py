"""Finds channels at a wrong level: offsets before anything happens, and samples on the rail of an ADC.

Offset: a channel that does not read zero where it must: current and speed before the first voltage, EMF before the
release.

offset = mean(y),   standard error sigma / sqrt n,   over the first stretch in which nothing happens yet

A voltage below its noise cannot be seen but drives a current, for example a ramp that begins with the record. So the
current mean(v)/R is subtracted, and the error of mean(v)/R is included.

Saturation: a channel whose samples accumulate on one extreme value while it varies everywhere else. Physical limits are
exempt: an angle at an end stop, a voltage or duty at the limit of the supply.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Finding, Measurement, RigConfig
from ..signals import drive_voltage, runs
from .base import COMMANDS, Records, by_chance, found_in
from .circuit import Value, weighted_mean

OFFSET_ERRORS = 8.0  # standard errors of the mean
OFFSET_NOISES = 0.7  # least offset over the noise of one sample
OFFSET_STEPS = 0.75  # least offset over the logger's resolution
STRETCH = 12  # least number of samples of the stretch
QUIET = 6.0  # standard deviations of the noise within which the voltage counts as 0, and the EMF as resting
CREEPS = 4.0  # standard errors: within them current or speed of a motor alone must be 0 for the other to be judged
OFFSET_SHARE = 0.8  # least share of the traces of a test that show it

# saturated: a run of equal samples at the extreme of at least RUN samples and RUN_SHARE of the trace; or, over all
# traces of a test, at least PILE samples on the extreme value, and OVER times as many as on each of the LEVELS steps
# below it
RUN, RUN_SHARE = 4, 0.005
PILE, OVER, LEVELS = 4, 8.0, 10
REPEATS = 0.25  # largest share of equal neighbours elsewhere: a channel that varies more does not rest by chance
AT_LIMIT = 0.03  # share of the supply, or of the travel, within which a rest is at a physical limit


def channel_offset(records: Records) -> Iterator[Finding]:
    """Offsets of current, EMF and motor speed; one finding for all tests where they look like one sensor's."""
    for name in ("current", "emf", "motor_speed"):
        off = {test: value for test, traces in records.tests.items()
               if (value := _offset(traces, name, records)) is not None}  # fmt: skip
        sizes = [value.value for value, _ in off.values()]
        of_one_sign = len(off) > 1 and min(sizes) * max(sizes) > 0.0
        if of_one_sign and max(map(abs, sizes)) < 2.0 * min(map(abs, sizes)):
            mean = weighted_mean([value for value, _ in off.values()])
            yield _reads(None, name, mean, next(iter(off.values()))[1])
        else:
            yield from (_reads(test, name, *value) for test, value in off.items())


def _reads(test: str | None, name: str, offset: Value, channel: Channel) -> Finding:
    mean, error = offset
    size, unit = mean / abs(channel.scale), channel.unit
    before = "the plate is let go" if name == "emf" else "a voltage is there"
    otherwise = ', or take [model] effects = ["current_sensor_offset"] in rig.toml' if name == "current" else ""
    mend = f"Subtract {size:.4g} from the column '{channel.header}'{' there' if test else ''}{otherwise}."
    return Finding("channel_offset", size, unit, by_chance(abs(mean) / error),
                   f"In {test or 'every test'} '{channel.header}' reads {size:.4g} {unit} before {before} "
                   f"({abs(mean) / error:.0f} standard errors), where it must read 0.", mend, test,
                   channel=name)  # fmt: skip


def _offset(traces: Sequence[Measurement], name: str, records: Records) -> tuple[Value, Channel] | None:
    """Mean offset of all traces of a test, SI, if most of them show it; and the channel of the first."""
    read = [(t.channels[name], v) for t in traces if (v := _zero(t, name, records)) is not None]
    off = [v for channel, v in read if abs(v.value) > max(OFFSET_ERRORS * v.error, OFFSET_NOISES * channel.sigma,
                                                          OFFSET_STEPS * channel.quantum)]  # fmt: skip
    if not off or len(off) < OFFSET_SHARE * len(read) or len({np.sign(v.value) for v in off}) > 1:
        return None
    return weighted_mean(off), read[0][0]


def _zero(trace: Measurement, name: str, records: Records) -> Value | None:
    """Mean of the channel where it must be zero, SI; None where no such stretch was logged."""
    channel, boundary = trace.channels.get(name), TEST_BY_NAME[trace.test].boundary
    judged = name == "emf" if boundary.terminals_open else name != "motor_speed" or boundary.gear_apart
    marker = channel if boundary.terminals_open else drive_voltage(trace, records.config)
    if channel is None or marker is None or not judged:
        return None
    level = float(np.median(marker.value[:STRETCH])) if boundary.terminals_open else 0.0
    away = np.abs(marker.value - level) > QUIET * max(marker.sigma, marker.quantum)
    inside = channel.value[channel.time < marker.time[np.argmax(away)]] if away.any() else np.empty(0)
    inside = inside[: int(0.9 * inside.size)]  # without the end of the stretch, which the event may affect
    if inside.size < STRETCH:
        return None
    half = inside.size // 2  # a second half that differs: a plate that falls already, a coil that discharges still
    change = float(np.mean(inside[half:]) - np.mean(inside[:half]))
    if abs(change) > 4.0 * channel.error / np.sqrt(half):
        return None
    other = trace.channels.get("current" if name == "motor_speed" else "motor_speed")
    if other is not None:  # not zero either: a motor alone that creeps into a slot, and sends a current
        early = other.value[: inside.size]
        if abs(float(np.mean(early))) > CREEPS * other.error / np.sqrt(max(early.size, 1)):
            return None
    found = Value(float(np.mean(inside)), channel.error / np.sqrt(inside.size))
    return found if name != "current" else _unexplained(found, marker, inside.size, trace, records)


def _unexplained(current: Value, volts: Channel, samples: int, trace: Measurement, records: Records) -> Value | None:
    """The part of a mean current that the voltage of these samples does not explain.

    The resistance is that of the trace's test, otherwise that of any test; None where it is unknown, because the
    voltage may then explain any current."""
    circuits = [records.circuits.get(trace.test), *records.circuits.values()]
    ohms = next((c.R.value for c in circuits if c is not None and c.R is not None and c.R.value > 0.0), None)
    mean, error = float(np.mean(volts.value[:samples])), volts.error / np.sqrt(samples)
    if ohms is None:
        return current if abs(mean) < CREEPS * error else None
    error = np.hypot(error, volts.quantum / np.sqrt(12.0))
    return Value(current.value - mean / ohms, float(np.hypot(current.error, error / ohms)))


def saturation(records: Records) -> Iterator[Finding]:
    """Measured channels on either rail, test by test."""
    for traces in records.tests.values():
        for name in dict.fromkeys(n for t in traces for n in t.channels if n not in COMMANDS):
            channels = {t.file: t.channels[name] for t in traces if name in t.channels}
            for side in (1.0, -1.0):
                rail = side * max(float(np.max(side * c.value)) for c in channels.values())
                rests = {file: n for file, c in channels.items() if (n := _on_rail(c, rail))}
                if _is_limit(name, rail, records.config) or not _is_piled(channels, rests, rail, side):
                    continue
                channel, count = channels[next(iter(rests))], sum(rests.values())
                value = float(channel.logged(np.array(rail)))
                yield found_in(rests, traces, Finding(
                    "saturation", count, "samples", 0.0,
                    f"'{channel.header}' rests on {value:.6g} {channel.unit} for {count} samples: saturated.",
                    "Log again with a wider range, or empty those cells.", channel=name,
                ))  # fmt: skip


def _on_rail(channel: Channel, rail: float) -> int:
    """Number of samples on the rail (SI); 0 where the channel rests elsewhere too: a staircase, or steps without
    noise."""
    on = channel.value == rail
    same = np.diff(channel.value) == 0.0
    elsewhere = ~on[1:]
    lively = elsewhere.sum() >= 4 * RUN and same[elsewhere].mean() <= REPEATS
    return int(on.sum()) if lively else 0


def _is_piled(channels: Mapping[str, Channel], rests: Mapping[str, int], rail: float, side: float) -> bool:
    """Whether one trace has a long rest on the rail, or all traces have far more samples there than on the steps
    below."""
    for file in rests:
        value = channels[file].value
        rest = max((stop - start for start, stop in runs(value == rail)), default=0)
        if rest >= max(RUN, round(RUN_SHARE * value.size)):
            return True
    step = max(c.quantum for c in channels.values()) or max(c.sigma for c in channels.values())
    below = side * (rail - np.concatenate([channels[file].value for file in rests])) if rests else np.empty(0)
    near = int(np.sum((below > 0.5 * step) & (below < (LEVELS + 0.5) * step)))
    count = sum(rests.values())
    return count >= PILE and count > OVER * max(near / LEVELS, 0.5)


def _is_limit(name: str, value: float, config: RigConfig) -> bool:
    """Whether a value is at an end stop, or at the limit of the supply."""
    if name == "position":
        low, high = config.travel
        reach = AT_LIMIT * (high - low) if np.isfinite(high - low) else 0.0
        return value < low + reach or value > high - reach
    return name == "voltage" and config.supply_V is not None and abs(value) > (1.0 - AT_LIMIT) * config.supply_V
