"""A resistance in the circuit of one test: a shunt, a harness, a warm winding."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


class SeriesResistance(AbstractRigEffect):
    """v = ... - R_t i in the circuit of one test.

    A winding that is dT warmer there than in the other tests is the same, R_t = alpha R_a dT with alpha = 0.0039/K of
    copper, and no data of that test tell the two apart: the magnets, which would weaken and lower K_b, warm up much
    later than the winding. 40 K are 16 % of R_a.

    Source: the paper's R_t of the inductance test. Differs from source: any test may have one.
    """

    kind = "series_resistance"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "an ohmmeter at the terminals of that test's circuit, its winding cold, and once more while it is warm"
    off: ClassVar[Mapping[str, float] | None] = {"series_ohm": 0.0}
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"series_resistance": lambda ohm: ohm}
    series_ohm: Scalar = parameter("ohm", NonNegative(1.0), 0.5, "extra circuit resistance", "DESIGN, R_t of the paper")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each test whose winding is driven, where another one tells R_a."""
        driven = [test for test, channels in logged.items() if "voltage" in channels and "current" in channels]
        return tuple(Place(test) for test in driven) if len(driven) > 1 else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return f'[tests.{cls.place.test}] series_ohm = "free"'

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(series=steps.series + self.here(test_of, steps.trace) * self.series_ohm)
