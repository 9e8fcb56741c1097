"""Evaluates two sensors of one plate: their end values, whether they agree, and faults of the pair.

    x = (s_1 - closed_1)/(open_1 - closed_1),    s_2 = closed_2 + (open_2 - closed_2) min(x/x_s, 1)

x_s < 1 where the second sensor reaches its end before the plate does (Ford about 0.53, Toyota ETCS-i about 0.65).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .log import Series
from .steps import noise_sd
from .tracking import longest

_NEAR = 0.015  # of the span: samples this close to an end count as at the end
_DWELL = 0.2  # s that a sweep must rest at an end for the end to count as that of the stop
_FULL = 0.93  # of the travel: a second sensor that stops later covers the whole travel
_BINS = 50
_BEND = 0.02  # of the second sensor's span: rms error of a straight line from which on a bend is tried
_CLOSER = 0.5  # largest ratio of the error with a bend to that of the line
_HIGH = 0.65  # share of the span: no plate rests this far open without current
_BLIND = 0.1  # of the span: where one sensor moves this far while the other stays at its end, the other one stops early
_SAME = 0.05  # of the span of rig.toml's [tps] within which two ends are the same
_LASTS = 0.1  # s that a difference must last
_COUNTS = 200.0  # of rusEFI, a volt


@dataclass(frozen=True)
class Ends:
    """The values of a sensor with the plate closed and open, in `Sensors.unit`."""

    closed: float  # with the plate closed
    opened: float  # with the plate open

    @property
    def span(self) -> float:
        """opened - closed; below 0 where it falls while the plate opens."""
        return self.opened - self.closed


@dataclass(frozen=True)
class Sensors:
    """Both sensors of a plate, from one sweep or drive."""

    unit: Literal["V", "%"]  # "%" where the log holds the ECU's positions
    # first, second: their end values, as far as the log shows them
    first: Ends
    second: Ends
    stops: float  # share of the travel at which the second is at its end, per cent; 100 where it covers all of it
    late: float  # share of the travel at which the second begins to move, per cent; 0 where it moves at once
    crossed: str  # why the two seem to be exchanged; "" where they do not
    # whether the plate rests at (closed, open) for 0.2 s; otherwise these end values may not be those of the stops
    dwelt: tuple[bool, bool]
    apart: float  # largest difference that lasts 0.1 s, per cent of travel
    apart_rms: float  # root mean square of the difference, likewise

    @property
    def findings(self) -> tuple[str, ...]:
        """The findings on the pair, one sentence each."""
        return tuple(self._findings())

    def _findings(self) -> Iterator[str]:
        if self.crossed:
            yield f"The two sensors seem to be exchanged: {self.crossed}"
        for name, ends in (("first", self.first), ("second", self.second)):
            if ends.span < 0.0:
                yield (f"The {name} sensor is turned: it falls from {ends.closed:.3g} to {ends.opened:.3g} {self.unit} "
                       f"while the plate opens.{self._usual(name)}")  # fmt: skip
        if self.stops < 100.0:
            yield (f"The second sensor stops at {self.stops:.0f} % of the travel: beyond it only the first one shows "
                   "the position of the plate.")  # fmt: skip
        if self.late > 0.0:
            yield f"The second sensor does not move before {self.late:.0f} % of the travel."
        for dwelt, name in zip(self.dwelt, ("closed", "open"), strict=True):
            if not dwelt:
                yield (f"The plate does not rest at the {name} end of this log: the {name} values may not be the "
                       f"stop's. Hold it against the {name} stop for a second.")  # fmt: skip

    def _usual(self, name: str) -> str:
        if name == "second" and self.first.span > 0.0:
            return " Many bodies are made so; the ECU then wants the higher value as closed."
        return ""

    @property
    def table(self) -> tuple[Setting, ...]:
        """The settings to type into ECUs; empty where the log holds per cent, because an ECU is calibrated in volts."""
        return tuple(self._table()) if self.unit == "V" else ()

    def _table(self) -> Iterator[Setting]:
        names = ("tpsMin", "tpsMax", "tps1SecondaryMin", "tps1SecondaryMax")
        values = (self.first.closed, self.first.opened, self.second.closed, self.second.opened)
        for name, value in zip(names, values, strict=True):
            yield Setting("rusEFI, FOME", name, round(_COUNTS * value), "counts of 5 mV")
        partial = round(self.stops) if self.stops < 100.0 else 0
        yield Setting("rusEFI, FOME", "tpsSecondaryMaximum", partial, "% (0: it goes all the way)")
        places = ("first, 0 %", "first, 100 %", "second, 0 %", f"second, {self.stops:.0f} %")
        for name, value in zip(places, values, strict=True):
            yield Setting("Haltech and others", name, round(value, 3), "V")


@dataclass(frozen=True)
class Setting:
    """One cell of an ECU's calibration.

    Source: rusEFI's tps.h (TPS_TS_CONVERSION 200 counts a volt) and its configuration; the FOME wiki's "ETB
    redundancy"; Haltech's "Throttle Position Sensor": voltages at 0 % and 100 %.
    Assumed: FOME uses the same counts as rusEFI.
    """

    ecu: str  # the ECU
    name: str  # name of the setting in that ECU
    value: float  # in `unit`
    unit: str  # of it


def two_sensors(
    first: Series, second: Series, unit: Literal["V", "%"], opens: float, tps: tuple[float, float] | None = None
) -> Sensors | None:
    """Evaluate a pair; None where the first sensor hardly moves.

    Args:
        first, second: as logged, in `unit`.
        unit: "V" or "%".
        opens: 1 where the first rises while the plate opens, -1 where it falls, 0 where this is unknown: the plate is
            then assumed to begin near its closed end, where its springs hold it.
        tps: (closed, open) of the first sensor by [tps] of rig.toml, V.
    """
    inside = (first.time >= second.time[0]) & (first.time <= second.time[-1])
    time, one = first.time[inside], first.value[inside]
    two = np.interp(time, second.time, second.value)
    if time.size < 20 or np.ptp(one) < 10.0 * noise_sd(one) or np.ptp(one) == 0.0:
        return None
    blind, other = _blind(one, two), _blind(two, one)
    crossed = ""
    if blind > _BLIND and other < _BLIND:
        crossed = "the first one stops half way while the second goes on. Exchange their inputs."
        one, two, opens = two, one, opens * (float(np.sign(np.cov(one, two)[0, 1])) or 1.0)
    ends, dwelt = _ends(time, one, opens)
    share = (one - ends.closed) / ends.span
    low, high, late, stops = _second(share, two)
    pair = Ends(low, high)
    if not crossed and tps is not None and _like(pair, tps) and not _like(ends, tps):
        crossed = "the second one has the voltages that [tps] of rig.toml gives for the first. Exchange their inputs."
    shown = np.clip((two - low) / (high - low) if high != low else 0.0 * two, -0.5, 1.5) * (stops - late) + late
    # where the log holds per cent, the ECU's own positions are compared, without new end values
    if unit == "V":
        apart = (shown - np.clip(share, late, stops)) * 100.0
    else:
        apart = np.where(share <= stops, two - one, 0.0) if stops < 1.0 else two - one
    if crossed and blind > _BLIND:
        ends, pair = pair, ends
    return Sensors(unit, ends, pair, 100.0 * stops, 100.0 * late, crossed, dwelt, _lasting(np.abs(apart), time),
                   float(np.sqrt(np.mean(apart**2))))  # fmt: skip


def _like(ends: Ends, tps: tuple[float, float]) -> bool:
    room = _SAME * abs(tps[1] - tps[0])
    return abs(ends.closed - tps[0]) < room and abs(ends.opened - tps[1]) < room


def _blind(one: np.ndarray, two: np.ndarray) -> float:
    """Share of its span that the second moves while the first stays at one of its ends, 0 to 1."""
    low, high = np.quantile(one, [0.005, 0.995])
    near = 0.02 * (high - low)
    span = np.ptp(np.quantile(two, [0.005, 0.995]))
    moved = [
        np.ptp(np.quantile(two[part], [0.02, 0.98])) for part in (one <= low + near, one >= high - near) if part.any()
    ]
    return float(max(moved) / span) if span > 0.0 else 0.0


def _ends(time: np.ndarray, value: np.ndarray, opens: float) -> tuple[Ends, tuple[bool, bool]]:
    """Closed and open value of a sensor, and whether the plate rests there."""
    low, high = np.quantile(value, [0.002, 0.998])
    room = max(_NEAR * (high - low), 4.0 * noise_sd(value))
    at = (value <= low + room), (value >= high - room)
    means = [float(np.median(value[part])) for part in at]
    dwelt = [longest(time, part) >= _DWELL for part in at]
    if opens == 0.0:
        begin = float(np.median(value[time <= time[0] + 0.2]))
        opens = -1.0 if (begin - low) / (high - low) > _HIGH else 1.0
    if opens < 0.0:
        means, dwelt = means[::-1], dwelt[::-1]
    return Ends(*means), (dwelt[0], dwelt[1])


def _second(share: np.ndarray, two: np.ndarray) -> tuple[float, float, float, float]:
    """End values of the second sensor, and the shares of the travel between which it moves.

    They are from the best line, with a bend where that fits better; many places of the bend are tried. The line is
    fitted to the medians in 50 bins of the travel.
    """
    edges = np.linspace(0.0, 1.0, _BINS + 1)
    place = np.clip(np.searchsorted(edges, share) - 1, 0, _BINS - 1)
    full = [k for k in range(_BINS) if np.any(place == k)]
    x = np.array([np.median(np.clip(share[place == k], 0.0, 1.0)) for k in full])
    y = np.array([np.median(two[place == k]) for k in full])
    tried = [
        (0.0, 1.0),
        *((0.0, s) for s in np.arange(0.2, _FULL, 0.005)),
        *((s, 1.0) for s in np.arange(0.07, 0.8, 0.01)),
    ]
    costs = [_line(x, y, *each) for each in tried]
    straight, best = costs[0], min(range(len(tried)), key=lambda k: costs[k][0])
    span = float(np.ptp(y))
    if straight[0] <= _BEND * span or costs[best][0] > _CLOSER * straight[0]:
        best = 0
    _, low, high = costs[best]
    return low, high, *tried[best]


def _line(x: np.ndarray, y: np.ndarray, begin: float, end: float) -> tuple[float, float, float]:
    """Root mean square error, and both ends, of a line from `begin` to `end` that is flat outside."""
    bent = np.clip((x - begin) / (end - begin), 0.0, 1.0)
    matrix = np.stack([1.0 - bent, bent], axis=1)
    found = np.linalg.lstsq(matrix, y, rcond=None)[0]
    return float(np.sqrt(np.mean((matrix @ found - y) ** 2))), float(found[0]), float(found[1])


def _lasting(size: np.ndarray, time: np.ndarray) -> float:
    """The largest value that lasts for 0.1 s."""
    from scipy.ndimage import minimum_filter1d

    count = max(round(_LASTS / float(np.median(np.diff(time)))), 1)
    return float(minimum_filter1d(size, count)[count // 2 : size.size - count // 2].max()) if size.size > count else 0.0
