"""Voltage and current under each other's header, or position and setpoint.

    v = R i + L di/dt + k w   read with v and i exchanged:   i = v/R - (L/R) di/dt - (k/R) w

so L and k come out negative while R > 0: current lags voltage, never the other way round. Where both stand still, R
comes out as 1/R of the other tests, or the steps of the two converters have changed places. A setpoint leads the
position that follows it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import log
from statistics import median
from typing import ClassVar

import numpy as np

from ...ranges import real
from .. import TEST_BY_NAME
from ..base import Channel, Measurement
from ..finding import Finding
from ..signals import on_times
from .base import AbstractDetector, Records, everywhere, in_files


@dataclass(frozen=True)
class SwappedColumns(AbstractDetector):
    """See the module.

    Args:
        errors: standard errors by which L must lie below zero.
        inverse: relative deviation of R from 1/R of the other tests that counts as the same.
        apart: factor by which R, or the steps of two converters, must differ to be told apart.
        leads: share of the samples of a trace that a position may lead its setpoint by, at most, in the search.
        better: correlation that the lead must gain over the lag.
    """

    errors: float = real(5.0, 0.0)
    inverse: float = real(0.15, 0.0, 1.0)
    apart: float = real(1.5, 1.0)
    leads: float = real(0.1, 0.0, 1.0)
    better: float = real(0.02, 0.0, 1.0)
    kind: ClassVar[str] = "swapped_columns"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        late = {test: [t for t in traces if self._runs_ahead(t, records)] for test, traces in records.tests.items()}
        sound = records.without(test for test, having in late.items() if having)
        for test, traces in records.tests.items():
            if late[test]:
                yield _finding(("voltage", "current"), test, late[test], traces, True,
                               "current runs ahead of voltage, as if the two had changed places")  # fmt: skip
            elif having := [t for t in traces if self._inverse(t, sound)]:
                yield _finding(("voltage", "current"), test, having, traces, False,
                               "voltage over current is what current over voltage is in the other tests")  # fmt: skip
            having = [t for t in traces if {"setpoint", "position"} <= set(t.channels) and self._follows(t)]
            if having:
                yield _finding(("position", "setpoint"), test, having, traces, False,
                               "the position runs ahead of its setpoint, as if the two had changed places")  # fmt: skip

    def _runs_ahead(self, trace: Measurement, records: Records) -> bool:
        """L < 0 and, where the plate moves, k < 0; a motor whose leads are turned has k < 0 too, but L > 0."""
        signs, boundary = records.signs(trace, self.errors), TEST_BY_NAME[trace.test].boundary
        if signs is None or signs.R <= 0 or boundary.terminals_open:
            return False
        if boundary.plate_held:
            return signs.L < 0
        return signs.k < 0 and (signs.L < 0 or (signs.L == 0 and self._nearer_inverse(trace, records)))

    def _nearer_inverse(self, trace: Measurement, records: Records) -> bool:
        """R is nearer to 1/R of the other tests than to their R."""
        own, others = self._resistances(trace, records)
        return own is not None and bool(others) and abs(log(own * median(others))) < abs(log(own / median(others)))

    def _inverse(self, trace: Measurement, records: Records) -> bool:
        """A held plate at rest: 1/R of the other tests, or their converters' steps exchanged; and not their R."""
        own, others = self._resistances(trace, records)
        circuit = records.circuits.get(trace.test)
        if own is None or not others or circuit is None or circuit.k is not None or circuit.L is not None:
            return False
        known = median(others)
        alike = abs(own / known - 1.0) < self.inverse and abs(own * known - 1.0) > self.inverse
        sure = max(own / known, known / own) > self.apart or _steps_exchanged(
            trace.test, records, self.apart, self.inverse
        )
        return not alike and sure and abs(own * known - 1.0) < self.inverse

    def _resistances(self, trace: Measurement, records: Records) -> tuple[float | None, list[float]]:
        """Of the trace's test, and of the others."""
        R = {test: c.R.value for test, c in records.circuits.items() if c.R and c.R.value > 0.0}
        return R.get(trace.test), [value for test, value in R.items() if test != trace.test]

    def _follows(self, trace: Measurement) -> bool:
        """The setpoint looks like the position some time ago, and the other way round it does not."""
        position, setpoint = trace.channels["position"], trace.channels["setpoint"]
        ahead, behind = (_best(*pair, self.leads) for pair in ((setpoint, position), (position, setpoint)))
        return ahead > behind + self.better and _roughness(setpoint) > _roughness(position)


def _steps_exchanged(test: str, records: Records, apart: float, alike: float) -> bool:
    """This test's voltage has the steps of the other tests' current, and the other way round."""
    here, there = ([t for t in records.traces if (t.test == test) is same] for same in (True, False))
    own, foreign = (tuple(_step(traces, name) for name in ("voltage", "current")) for traces in (here, there))
    if min(*own, *foreign) <= 0.0 or max(foreign[0] / foreign[1], foreign[1] / foreign[0]) < apart:
        return False
    return all(abs(a / b - 1.0) < alike for a, b in zip(own, reversed(foreign), strict=True))


def _step(traces: list[Measurement], name: str) -> float:
    """Median resolution of a channel's converter, SI; 0 where none is seen."""
    steps = [t.channels[name].quantum for t in traces if name in t.channels]
    return median(steps) if steps else 0.0


def _best(late: Channel, early: Channel, leads: float) -> float:
    """Greatest correlation of `late` with `early` shifted by up to so much of the trace, one sample or more."""
    a, b = late.value - np.mean(late.value), on_times(early, late.time) - np.mean(early.value)
    size = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    most = max(2, int(leads * a.size))
    steps = np.unique(np.geomspace(1, most, 60).astype(int))
    return max((float(np.sum(a[k:] * b[:-k])) / size for k in steps), default=0.0) if size > 0.0 else 0.0


def _roughness(channel: Channel) -> float:
    """Median change from sample to sample against the span: a setpoint is a clean command."""
    span = float(np.ptp(channel.value))
    return float(np.median(np.abs(np.diff(channel.value, 2)))) / span if span > 0.0 else 0.0


def _finding(
    names: tuple[str, str],
    test: str,
    having: list[Measurement],
    traces: tuple[Measurement, ...],
    sure: bool,
    words: str,
) -> Finding:
    files = [trace.file for trace in having]
    one, other = (having[0].channels[name].header for name in names)
    where = in_files(test, files, traces)
    return Finding("swapped_columns", 1.0, "", 0.0, f"{where[0].upper()}{where[1:]} {words}.",
                   f"Exchange the headers '{one}' and '{other}' there.",
                   test, everywhere(files, traces), names[0], sure)  # fmt: skip
