"""More resistance in the circuit of one rig test than in that of another: harness, shunt, a forgotten resistor.

    v = (R + R_s) i + L di/dt + k w + V_b sgn i

R and the brushes' V_b are read where several levels of current tell them apart, R_s off each other test. A resistor
only adds, so the test with the larger R has it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import erfc
from typing import ClassVar

from ...ranges import real
from ..finding import Finding
from .base import AbstractDetector, Records
from .circuit import Circuit, Value, excess

REFERENCE = ("resistance", "static_load", "response")  # told best first


@dataclass(frozen=True)
class SeriesResistance(AbstractDetector):
    """See the module.

    Args:
        errors: standard errors by which two tests must differ.
        share: of R, the least difference; below it a warm winding does as much.
        most: times R; beyond it a unit is the likelier slip.
        least: A, the least typical current that tells a resistance.
    """

    errors: float = real(8.0, 0.0)
    share: float = real(0.12, 0.0, 1.0)
    most: float = real(5.0, 1.0)
    least: float = real(0.05, 0.0)
    kind: ClassVar[str] = "series_resistance"

    def find(self, records: Records) -> Iterator[Finding]:
        read = {name: circuit for name, circuit in records.circuits.items() if self._sound(circuit)}
        base = next((name for name in REFERENCE if name in read and name not in records.config.series_ohm), None)
        if base is None:
            return
        R = read[base].R
        assert R is not None, "a sound circuit has one"
        others = {name: value for name, circuit in records.circuits.items()
                  if name != base and name not in records.config.series_ohm and circuit.amperes > self.least
                  and (value := excess(records.tests[name], records.config, read[base].drop)) is not None}  # fmt: skip
        larger = {name: value for name, value in others.items() if self._more(value, R)}
        smaller = {name: value for name, value in others.items() if self._more(R, value)}
        for name, value in larger.items():
            yield self._finding(name, value, base, R)
        if smaller and not larger:
            name, value = max(smaller.items(), key=lambda item: -item[1].error)
            yield self._finding(base, R, name, value)

    def _sound(self, c: Circuit) -> bool:
        right = c.R is not None and c.R.value > self.errors * c.R.error and c.amperes > self.least
        return right and (c.k is None or c.k.value > 0.0)

    def _more(self, a: Value, b: Value) -> bool:
        """a's resistance is larger than b's, by more than errors and warmth."""
        more, error = a.value - b.value, (a.error**2 + b.error**2) ** 0.5
        return b.value > 0.0 and self.share * b.value < more < self.most * b.value and more > self.errors * error

    def _finding(self, test: str, a: Value, other: str, b: Value) -> Finding:
        more, error = a.value - b.value, (a.error**2 + b.error**2) ** 0.5
        found = (f"The circuit of {test} shows {a.value:.4g} ohm, that of {other} {b.value:.4g}: {more:.3g} ohm more "
                 f"({more / error:.0f} standard errors).")  # fmt: skip
        return Finding(self.kind, more, "ohm", float(erfc(more / error / 2**0.5)), found,
                       f'Write [tests.{test}] series_ohm = "free" in rig.toml.', test)  # fmt: skip
