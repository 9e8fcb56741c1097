"""A clock that is slow or fast in one test."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import STATIC, AbstractRigEffect, Logged, Place


class TimeScale(AbstractRigEffect):
    """dt = (1 + s) dt_logged, in the traces of one test.

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a scale. Differs from source: one test alone has it.
    """

    kind = "time_scale"
    told_by = "a signal of known frequency logged in that test"
    off: ClassVar[Mapping[str, float] | None] = {"stretch": 0.0}
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"time_scale": lambda logged: 1.0 / logged - 1.0}
    stretch: Scalar = parameter("", Real(0.02), 0.0, "relative error of a clock", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each test, where there is another."""
        tests = [test for test in logged if test != STATIC]
        return tuple(Place(test) for test in tests) if len(tests) > 1 else ()

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        factor = 1.0 + self.here(test_of, steps.trace) * self.stretch
        return steps._replace(dt=factor * steps.dt, time=factor * steps.time)
