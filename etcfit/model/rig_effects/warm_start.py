"""A winding that was warmer when one trace began than it was in the others of its test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


class WarmStart(AbstractRigEffect):
    """v = ... - R_w i in one trace,    R_w = alpha R_a dT,    alpha = 0.0039/K of copper.

    dT is what the winding was warmer by than in the other traces (negative where it was colder); it holds for the whole
    trace, for a winding takes far longer to cool than a trace lasts. 40 K are 16 % of R_a. A whole test that was run
    warm is a `series_resistance` of its circuit: no data of that test tell the two apart.

    Source: IEC 60034-1 (rise of a winding's temperature by its resistance). Differs from source: the resistance it is
    compared with is that of the other traces.
    """

    kind = "warm_start"
    scope = "trace"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "the resistance at the terminals right before that trace, motor held"
    like = "R_a"
    off: ClassVar[Mapping[str, float] | None] = {"warm_ohm": 0.0}
    warm_ohm: Scalar = parameter("ohm", Real(0.1), 0.0, "resistance that a warmer winding has more", "IEC 60034-1")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """None: of a whole test it is a series resistance."""
        return ()

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each trace with a driven winding and its current, where its test has another one."""
        driven = [Place.named(file) for file, channels in logged.items() if {"voltage", "current"} <= channels]
        tests = [place.test for place in driven]
        return tuple(place for place in driven if tests.count(place.test) > 1)

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps._replace(series=steps.series + self.here(test_of, steps.trace) * self.warm_ohm)
