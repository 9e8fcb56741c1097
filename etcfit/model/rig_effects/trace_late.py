"""One trace whose measured channels are all late against what drove it: started late, or by another logger."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import DRIVING, OBSERVED, STATIC, AbstractRigEffect, Logged, Place


class TraceLate(AbstractRigEffect):
    """y_logged(t) = y(t - late), of every measured channel of one trace.

    It holds as far as `channel_late` does: for either sign and any number of samples, the path a cubic within
    integration steps, its first and last values before it begins and after it ends.

    Source: Kester 2005 (acquisition on two clocks). Differs from source: a dead time alone.
    """

    kind = "trace_late"
    scope = "trace"
    told_by = "a mark that both loggers record"
    off: ClassVar[Mapping[str, float] | None] = {"late": 0.0}
    delays: ClassVar[bool] = True
    late: Scalar = parameter("s", Real(0.01), 0.0, "by how much a trace is logged late", "Kester 2005")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """None: no test as a whole."""
        return ()

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each trace that something drove, where there are others."""
        driven = [Place.named(file) for file, channels in logged.items() if channels & {*DRIVING}]
        timed = tuple(place for place in driven if place.test != STATIC)
        return timed if len(timed) > 1 else ()

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        return dict.fromkeys(OBSERVED, self.here(test_of, steps.trace) * self.late)
