"""Finds mains hum, a time base that runs fast or slow, and lost samples.

Mains hum is a line at 50 or 60 Hz in a channel, the same in every trace of a test.

    chance = P(chi2_(2n) > -2 sum log p_j),   p_j from `line.py`, over the n traces of the test

It must be far clearer than the clearest line in the neighbouring bands, because periodic motion makes lines too.

A time base that runs fast or slow in one rig test, where the records show it without a fit.

    logged = s x true time:  mains hum at f/s   or   back-EMF constant s k and duration of the fall s T, both alike

There are two references: the mains, where it hums in a channel; and the same plate released from open in two tests,
whose
EMF over speed and whose fall are stretched by the same factor. A gain error of the EMF would stretch only the first.

Samples lost by an even clock: intervals of two, three ... periods among many of one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from math import log
from statistics import median
from typing import NamedTuple

import numpy as np

from .. import TEST_BY_NAME
from ..base import Finding, Measurement, RigConfig
from .base import COMMANDS, Records, found_in, scaled_unit
from .circuit import Value, weighted_mean
from .line import Line, Spectrum, line_near

MAINS = (50.0, 60.0)  # Hz
HUM_CHANCE = 1e-6  # largest chance of a finding
HUM_BAND = 0.01  # relative deviation of the mains frequency within which it is sought
HUM_NOISES = 0.15  # least amplitude over the noise of one sample

CLOCK_BAND = 0.06  # relative deviation of a clock within which it is sought
CLOCK_CHANCE = 1e-10  # largest chance of the line that serves as a reference
CLEAR = 1e-3  # chance of a line in one trace below which its frequency counts
GRID = 0.006  # largest relative deviation of the mains itself
ERRORS = 4.5  # standard errors of a finding
FALL_SHARE = 0.012  # least relative deviation of a fall
ALIKE, AGREE = 0.25, 0.006  # allowed difference of the two stretches: relative to the larger one, and absolute
FIRST, LAST = 0.8, 0.2  # shares of the stroke between which a fall is timed

EVEN = 0.9  # least share of the intervals that are one period; otherwise the logger has no even clock
WHOLE = 0.2  # periods: allowed deviation from a whole number of periods
LOST_SHARE = 1e-4  # least share of lost samples


class Mains(NamedTuple):
    """The line of the mains in one channel of one rig test."""

    nominal: float  # Hz
    lines: tuple[Line, ...]  # the line in each trace in which one could be sought
    chance: float  # chance of all of them together
    neighbours: float  # chance of the clearest lines in the neighbouring bands
    amplitude: float  # median, SI
    frequency: float  # weighted mean by the log's clock, Hz
    error: float  # of the frequency, Hz

    def is_clear(self, chance: float) -> bool:
        """Whether the line is rarer than this chance, and than the square of that of the neighbouring bands."""
        return self.chance < chance and self.chance < max(self.neighbours, 1e-150) ** 2


def _mains_in(records: Records, test: str, name: str, band: float) -> Mains | None:
    """The clearer of the two mains frequencies in a channel of a test's traces; None where no trace allows it."""
    spectra = [s for t in records.tests[test] if (s := records.spectra.get((t.file, name))) is not None]
    found = [_at(spectra, nominal, band) for nominal in MAINS] if spectra else []
    return min(found, key=lambda m: m.chance, default=None)


def _at(spectra: Sequence[Spectrum], nominal: float, band: float) -> Mains:
    lines = tuple(line_near(s, nominal, band) for s in spectra)
    return Mains(nominal, lines, _together([line.chance for line in lines]), _together([x.neighbours for x in lines]),
                 float(np.median([line.amplitude for line in lines])),
                 *weighted_mean(Value(line.frequency, line.error) for line in lines))  # fmt: skip


def _together(chances: Sequence[float]) -> float:
    """Combined chance of n independent chances, by chi2 of 2n degrees of freedom (Fisher 1932).

    exp(-h) sum_(k < n) h^k / k!,    h = -sum log chance
    """
    h = -float(np.sum(np.log(np.maximum(chances, 1e-300))))
    if h == 0.0:
        return 1.0
    return math.fsum(math.exp(k * math.log(h) - h - math.lgamma(k + 1)) for k in range(len(chances)))


def hum(records: Records) -> Iterator[Finding]:
    """Measured channels that carry a line of the mains."""
    for test, traces in records.tests.items():
        for name in _measured(traces):
            mains = _mains_in(records, test, name, HUM_BAND)
            channel = next(t.channels[name] for t in traces if name in t.channels)
            if mains and mains.is_clear(HUM_CHANCE) and mains.amplitude > HUM_NOISES * channel.sigma:
                size, unit = mains.amplitude / abs(channel.scale), channel.unit
                key = f"{channel.name.replace(' ', '_')}_{unit.replace('/', '_').replace(' ', '')}"
                noise = np.hypot(channel.sigma / abs(channel.scale), size / np.sqrt(2))
                yield Finding("hum", size, unit, mains.chance,
                              f"In {test} '{channel.header}' carries a line of {mains.nominal:g} Hz, amplitude "
                              f"{size:.3g} {unit}.",
                              "Ground or twist the sensor's leads and log again; until then "
                              f"[noise] in rig.toml must include it: {key} = {noise:.3g}.", test,
                              channel=name)  # fmt: skip


def _measured(traces: Sequence[Measurement]) -> list[str]:
    return list(dict.fromkeys(name for t in traces for name in t.channels if name not in COMMANDS))


def time_scale(records: Records) -> Iterator[Finding]:
    """Clocks that run fast or slow, by the mains, otherwise by two falls."""
    hummed = []
    for test, traces in records.tests.items():
        found = [_mains_in(records, test, name, CLOCK_BAND) for name in _measured(traces)]
        clocks = [m for m in found if m and m.is_clear(CLOCK_CHANCE)]
        clock = min(clocks, key=lambda m: m.error, default=None)
        if clock is not None and _is_off(clock):
            hummed.append(test)
            yield _stretched(test, clock.nominal / clock.frequency, clock.chance,
                             f"its mains hums at {clock.frequency:.4g} Hz instead of {clock.nominal:g}")  # fmt: skip
    yield from (finding for finding in _by_falls(records) if finding.test not in hummed)


def _is_off(m: Mains) -> bool:
    off = abs(m.frequency / m.nominal - 1.0)
    clear = [line.frequency for line in m.lines if line.chance < CLEAR]
    together = max(clear) - min(clear) if len(clear) > 1 else np.inf
    return off > GRID + ERRORS * m.error / m.nominal and together < 0.5 * off * m.nominal


def _by_falls(records: Records) -> Iterator[Finding]:
    read: dict[str, tuple[float, float, float, float]] = {}
    for test, traces in records.tests.items():
        circuit = records.circuits.get(test)
        if not TEST_BY_NAME[test].boundary.released or circuit is None or circuit.k is None:
            continue
        falls = [fall for t in traces if (fall := _fall_time(t)) is not None]
        if falls and circuit.k.value > 0.0:
            spread = (max(falls) - min(falls)) / (len(falls) ** 0.5 * median(falls))
            read[test] = circuit.k.value, circuit.k.error, median(falls), spread
    if len(read) != 2:
        return
    (one, a), (other, b) = read.items()
    stretch, fall = log(a[0] / b[0]), log(a[2] / b[2])
    error = np.hypot(np.hypot(a[1] / a[0], b[1] / b[0]), np.hypot(a[3], b[3]))
    least = max(FALL_SHARE, ERRORS * error / 2**0.5)
    both = abs(stretch - fall) < max(ALIKE * max(abs(stretch), abs(fall)), AGREE)
    if stretch * fall <= 0.0 or min(abs(stretch), abs(fall)) < least or not both:
        return
    test, s = _odd_one(records, one, other, float(np.exp(0.5 * (stretch + fall))))
    yield _stretched(test, s, 0.0, f"the plate falls in {s:.4g} times the time of "
                     f"{other if test == one else one}, and its EMF over speed differs by this factor")  # fmt: skip


def _odd_one(records: Records, one: str, other: str, s: float) -> tuple[str, float]:
    """The test whose clock is wrong: the one whose back-EMF constant is farther from that of the other tests."""
    ratio = records.config.gear_ratio
    rest = [(t, c.k.value) for t, c in records.circuits.items() if t not in (one, other) and c.k]
    others = [log(k * (ratio if TEST_BY_NAME[t].boundary.gear_apart else 1.0)) for t, k in rest if k > 0.0]
    if not others:
        return other, 1.0 / s
    known = float(np.exp(median(others)))
    off = {t: abs(log(k.value / known)) for t in (one, other) if (k := records.circuits[t].k) and k.value > 0.0}
    return (one, s) if off[one] > off[other] else (other, 1.0 / s)


def _stretched(test: str, s: float, chance: float, words: str) -> Finding:
    way = "fast" if s > 1.0 else "slow"
    return Finding("time_scale", s, "", chance,
                   f"The clock of {test} runs {100.0 * abs(s - 1.0):.3g} % {way}: {words}.",
                   f"Name its time column 'time [{scaled_unit('s', 1.0 / s)}]' if it is in s now, or correct the "
                   "sample rate in the logger's settings.", test, channel="time")  # fmt: skip


def _fall_time(trace: Measurement) -> float | None:
    """Time of a released plate from 80 to 20 % of its stroke, s; None where it was not logged."""
    position = trace.channels.get("position")
    if position is None:
        return None
    high, low = float(np.quantile(position.value, 0.98)), float(np.quantile(position.value, 0.02))
    times = [_crossing(position.time, position.value, low + part * (high - low)) for part in (FIRST, LAST)]
    return times[1] - times[0] if times[0] is not None and times[1] is not None and times[1] > times[0] else None


def _crossing(time: np.ndarray, value: np.ndarray, level: float) -> float | None:
    """Time at which a fall crosses a level, by a line through the samples near it."""
    below = value < level
    if not below.any() or below[0]:
        return None
    k = int(np.argmax(below))
    near = slice(max(0, k - 4), k + 4)
    t, y = time[near] - time[k], value[near]
    slope, offset = np.polyfit(t, y, 1)
    return float(time[k] + (level - offset) / slope) if slope < 0.0 else None


def lost_samples(records: Records) -> Iterator[Finding]:
    """Tests in which an even clock lost samples."""
    for traces, lost in records.where(_lost):
        count = sum(lost.values())
        yield found_in(lost, traces, Finding(
            "lost_samples", count, "samples", 0.0, f"an even clock has lost {count} samples.",
            "No mend is needed, because times are read as logged; check whether the logger wrote its rows too late.",
            channel="time",
        ))  # fmt: skip


def _lost(trace: Measurement, _: RigConfig) -> int | None:
    """Number of samples that an even clock has lost; None for few."""
    periods = np.diff(trace.time) / np.median(np.diff(trace.time))
    whole = np.round(periods)
    if np.mean(np.abs(periods - 1.0) < WHOLE) < EVEN:
        return None
    lost = int(np.sum((whole - 1.0)[(whole > 1.0) & (np.abs(periods - whole) < WHOLE)]))
    return lost if lost > LOST_SHARE * trace.time.size else None
