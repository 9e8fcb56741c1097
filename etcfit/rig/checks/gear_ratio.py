"""A gear ratio that the tests contradict.

    N = k at the plate / k at the motor

k of `circuit.py`'s equation is N K_b where the plate turns and K_b where the motor runs alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import exp, log
from statistics import median
from typing import ClassVar

from ...ranges import real
from .. import TEST_BY_NAME
from ..finding import Finding
from .base import AbstractDetector, Records
from .unit_scale import SLIPS


@dataclass(frozen=True)
class GearRatio(AbstractDetector):
    """See the module.

    Args:
        share: by which the ratio must be off.
        errors: standard errors by which it must be off.
        unit: relative deviation from a usual slip of units, which is then the likelier mistake.
    """

    share: float = real(0.1, 0.0, 1.0)
    errors: float = real(8.0, 0.0)
    unit: float = real(0.03, 0.0, 1.0)
    kind: ClassVar[str] = "gear_ratio"

    def find(self, records: Records) -> Iterator[Finding]:
        sure = {t: c.k for t, c in records.circuits.items() if c.k and c.k.value > self.errors * c.k.error}
        alone = [k.value for t, k in sure.items() if TEST_BY_NAME[t].boundary.gear_apart]
        plate = [k.value for t, k in sure.items() if not TEST_BY_NAME[t].boundary.gear_apart]
        if not alone or len(plate) < 2 or max(plate) > (1.0 + self.share) * min(plate):
            return
        found, given = exp(median(map(log, plate))) / alone[0], records.config.gear_ratio
        off = log(found / given)
        slips = [abs(abs(off) - log(slip)) < self.unit for slip in SLIPS["motor_speed"]]
        if abs(off) < self.share or any(slips):
            return
        words = "is not given" if not records.config.gear_ratio_given else f"is {given:.6g}"
        yield Finding(
            self.kind, found / given, "", 0.0,
            f"The back-EMF constants of plate and motor alone have the ratio {found:.4g}, but gear_ratio {words} in "
            "rig.toml.",
            f"Count the teeth; where it is so, write [rig] gear_ratio = {found:.4g} in rig.toml.",
        )  # fmt: skip
