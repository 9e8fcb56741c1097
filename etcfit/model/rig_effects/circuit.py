"""Resistances of a test's circuit that rig.toml does not state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from ..parameters import NonNegative, Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


# A resistance in the circuit of one test: a shunt, a harness, a warm winding
class SeriesResistance(AbstractRigEffect):
    """v = ... - R_t i in the circuit of one test.

    A winding that is dT warmer there than in the other tests has the same effect, R_t = alpha R_a dT with
    alpha = 0.0039/K for copper, and no data of that test distinguish the two: the magnets, which would weaken and lower
    K_b, warm up much later than the winding. 40 K are 16 % of R_a.

    Source: the paper's R_t of the inductance test. Differs from source: any test may have one.
    """

    kind = "series_resistance"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "an ohmmeter at the terminals of that test's circuit, with a cold winding, and again with a warm one"
    off: ClassVar[Mapping[str, float] | None] = {"series_ohm": 0.0}
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"series_resistance": lambda ohm: ohm}
    series_ohm: Scalar = parameter("ohm", NonNegative(1.0), 0.5, "extra circuit resistance", "DESIGN, R_t of the paper")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each test with a driven winding, if another test determines R_a."""
        driven = [test for test, channels in logged.items() if "voltage" in channels and "current" in channels]
        return tuple(Place(test) for test in driven) if len(driven) > 1 else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return f'[tests.{cls.place.test}] series_ohm = "free"'

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(series=steps.series + self.here(test_of, steps.trace) * self.series_ohm)


# A supply that sags under the current that the bridge draws
class SupplySag(AbstractRigEffect):
    """v = d V_s,    V_s = V_0 - R_s i_s,    i_s = d i    so    v = d V_0 - d^2 R_s i, with a duty d as input.

    The bridge consumes no power: d V_s i = V_s i_s. The sag is a resistance of d^2 R_s in the armature's circuit: it
    shows if the duty changes; if all traces have the same |d| it is a part of R_a.

    Source: Mohan, Undeland and Robbins 2003, ch. 7 (full bridge: mean current of its source). Differs from source: the
    source has a resistance, R_s of supply and leads. V_s is the mean over a period of the PWM, smooth if a capacitor
    feeds the pulses (without one the sag is |d| R_s i), and braking feeds current back, as a battery allows.
    """

    kind = "supply_sag"
    scope = "rig"
    acts_on: ClassVar[tuple[str, ...]] = ("duty",)
    told_by = "the supply's voltage logged together with the duty"
    off: ClassVar[Mapping[str, float] | None] = {"supply_ohm": 0.0}
    supply_ohm: Scalar = parameter("ohm", NonNegative(0.1), 0.05, "resistance of supply and leads", "Mohan 2003, ch. 7")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """The rig, if a duty is the input, the supply was not logged, and the current was logged.

        With the plate's angle alone, a resistance of the supply cannot be distinguished from other brakes of a fast
        plate.
        """
        return (Place(),) if any({"duty", "current"} <= channels for channels in logged.values()) else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return '[model] effects = ["supply_sag"], or log the supply beside the duty'

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps if steps.duty is None else steps._replace(series=steps.series + self.supply_ohm * steps.duty**2)


# A winding that was warmer when one trace began than it was in the others of its test
class WarmStart(AbstractRigEffect):
    """v = ... - R_w i in one trace,    R_w = alpha R_a dT,    alpha = 0.0039/K of copper.

    dT is the temperature of the winding above that in the other traces (negative if it was colder). It is constant over
    the trace, because a winding takes far longer to cool than a trace lasts. 40 K are 16 % of R_a. A whole test with a
    warm winding is a `series_resistance` of its circuit: no data of that test distinguish the two.

    Source: IEC 60034-1 (rise of a winding's temperature by its resistance). Differs from source: the reference is the
    resistance in the other traces.
    """

    kind = "warm_start"
    scope = "trace"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "the resistance at the terminals right before that trace, motor held"
    like = "R_a"
    off: ClassVar[Mapping[str, float] | None] = {"warm_ohm": 0.0}
    warm_ohm: Scalar = parameter("ohm", Real(0.1), 0.0, "additional resistance of a warmer winding", "IEC 60034-1")

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each trace with a driven winding and its current, if its test has another one."""
        driven = [Place.named(file) for file, channels in logged.items() if {"voltage", "current"} <= channels]
        tests = [place.test for place in driven]
        return tuple(place for place in driven if tests.count(place.test) > 1)

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(series=steps.series + self.here(test_of, steps.trace) * self.warm_ohm)
