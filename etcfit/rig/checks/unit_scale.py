"""A unit that is off by 1000, 60, 2 pi ... in one rig test and stayed plausible, and a gear ratio that was miscounted.

    logged = c x true:  current  R -> R/c            voltage  R -> c R, k -> c k
                        position k -> k/c            EMF      k -> c k           motor speed  k -> k/c

R and k of `circuit.py` are the same in every test: N K_b at the plate and K_b at the motor. The test that differs from
the median of the others by one of the usual factors has the slip; where every test at the plate differs from the motor
alone by one factor that is no unit's, it is the gear ratio.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import exp, log, pi
from statistics import median
from typing import ClassVar

from ...ranges import real
from .. import TEST_BY_NAME
from ..finding import Finding
from .base import AbstractDetector, Records, scaled_unit
from .circuit import Value

# factors by which the numbers of a channel may be too large, and too small
SLIPS: Mapping[str, tuple[float, ...]] = {
    "voltage": (1e3, 1e6),
    "emf": (1e3, 1e6),
    "current": (1e3, 1e6),
    "position": (180.0 / pi, 1e3, 2.0 * pi, 360.0),
    "motor_speed": (30.0 / pi, 60.0, 2.0 * pi, 180.0 / pi),
}
# logged unit, factor -> what the numbers are really in; any other pair is written as a number and a unit
BETTER: Mapping[tuple[str, int], str] = {
    ("A", 1000): "mA", ("mA", -1000): "A", ("V", 1000): "mV", ("mV", -1000): "V",
    ("rad", 57): "deg", ("deg", -57): "rad", ("rad/s", 10): "rpm", ("rpm", -10): "rad/s",
}  # fmt: skip


@dataclass(frozen=True)
class UnitScale(AbstractDetector):
    """See the module.

    Args:
        near: relative deviation from a usual factor that counts as it.
        surely: factor beyond which no rig explains it.
        closely: deviation from a usual factor below which nothing else explains a smaller one either: a gear ratio
            that is miscounted by 30/pi within a few per cent is less likely than rad/s under the head rpm.
        errors: of a reading, in standard errors: one that is less sure says nothing.
    """

    near: float = real(0.2, 0.0, 1.0)
    surely: float = real(100.0, 1.0)
    closely: float = real(0.03, 0.0, 1.0)
    errors: float = real(8.0, 0.0)
    kind: ClassVar[str] = "unit_scale"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        R, k = self._read(records, "R"), self._read(records, "k")
        for test in records.circuits:
            r, s = _against(R, test), _against(k, test)
            for channel, c, seen in self._slips(records, test, r, s):
                logged = next(t.channels[channel] for t in records.tests[test] if channel in t.channels)
                unit = _unit(logged.unit, c)
                name = logged.header.partition("[")[0].strip()
                what = f"{c:.4g} times too large" if c > 1.0 else f"{1.0 / c:.4g} times too small"
                found = (f"The numbers of {test}'s '{logged.header}' are {what}: its circuit shows {_words(r, s)} what "
                         "the other tests show.")  # fmt: skip
                gear = " If the unit is right, gear_ratio in rig.toml is wrong." if channel == "motor_speed" else ""
                sure = max(c, 1.0 / c) > self.surely or abs(log(abs(seen) / c)) < self.closely
                yield Finding(self.kind, c, "", 0.0, found, f"Head the column '{name} [{unit}]' there.{gear}", test,
                              channel=channel, sure=sure)  # fmt: skip

    def _read(self, records: Records, name: str) -> dict[str, float]:
        """Sure readings by test; k as of the motor."""
        values: dict[str, float] = {}
        for test, circuit in records.circuits.items():
            value: Value | None = getattr(circuit, name)
            if value is not None and value.value > self.errors * value.error:
                apart = TEST_BY_NAME[test].boundary.gear_apart
                values[test] = value.value / (1.0 if name == "R" or apart else records.config.gear_ratio)
        return values

    def _slips(
        self, records: Records, test: str, r: float | None, s: float | None
    ) -> Iterator[tuple[str, float, float]]:
        """Channel, usual slip and factor seen."""
        boundary = TEST_BY_NAME[test].boundary
        if boundary.terminals_open:
            if s is not None and (c := self._usual("emf", s)):
                yield ("emf" if any("emf" in t.channels for t in records.tests[test]) else "voltage"), c, s
        elif r is not None and (c := self._usual("voltage", r)) and (s is None or self._usual("voltage", s)):
            if s is not None:
                yield "voltage", c, r
            else:
                yield "current", self._usual("current", 1.0 / r) or 1.0 / c, 1.0 / r
        elif r is not None and (c := self._usual("current", 1.0 / r)):
            yield "current", c, 1.0 / r
        elif s is not None:
            channel = "motor_speed" if boundary.gear_apart else "position"
            if c := self._usual(channel, 1.0 / s):
                yield channel, c, 1.0 / s

    def _usual(self, channel: str, factor: float) -> float | None:
        """The usual slip that a factor is, or None."""
        for slip in SLIPS[channel]:
            for c in (slip, 1.0 / slip):
                if abs(log(abs(factor) / c)) < self.near:
                    return c
        return None


def _against(values: Mapping[str, float], test: str) -> float | None:
    """A test's reading over the median (of logarithms) of the others'; None where either is missing."""
    others = [log(value) for name, value in values.items() if name != test]
    return values[test] / exp(median(others)) if test in values and others else None


def _words(r: float | None, s: float | None) -> str:
    parts = [f"{ratio:.3g} times the {name}" for ratio, name in ((r, "resistance"), (s, "back-EMF constant"))
             if ratio is not None and abs(log(ratio)) > 0.2]  # fmt: skip
    return " and ".join(parts)


def _unit(unit: str, c: float) -> str:
    """What the numbers are in, if they are c times too large in `unit`."""
    key = round(c) if c > 1.0 else -round(1.0 / c)
    return BETTER.get((unit, key)) or scaled_unit(unit, 1.0 / c)
