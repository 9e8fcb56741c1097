"""Errors of time: of a clock, of a channel, of a whole trace."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import jax.numpy as jnp

from ..parameters import Real, Scalar, parameter
from .base import DRIVING, OBSERVED, STATIC, AbstractRigEffect, Logged, Place, channels_of_traces


# A clock that is slow or fast in one test
class TimeScale(AbstractRigEffect):
    """dt = (1 + s) dt_logged, in the traces of one test.

    Source: GUM (JCGM 100:2008), 4.3: a systematic error of a scale. Differs from source: only one test has it.
    """

    kind = "time_scale"
    told_by = "a signal of known frequency logged in that test"
    off: ClassVar[Mapping[str, float] | None] = {"stretch": 0.0}
    stated: ClassVar[Mapping[str, Callable[[float], float]]] = {"time_scale": lambda logged: 1.0 / logged - 1.0}
    stretch: Scalar = parameter("", Real(0.02), 0.0, "relative error of a clock", "JCGM 100:2008, 4.3")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each test, if there is another."""
        tests = [test for test in logged if test != STATIC]
        return tuple(Place(test) for test in tests) if len(tests) > 1 else ()

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        factor = 1.0 + self.here(test_of, steps.trace) * self.stretch
        return steps._replace(dt=factor * steps.dt, time=factor * steps.time)


_WITHIN = (0.0, 1.0)


# Output and logger on one clock: every edge of the voltage comes at the same place between two samples
class EdgePhase(AbstractRigEffect):
    """t_edge = t_k + s (t_(k+1) - t_k),    s = edge_phase + turn, in the traces of one test.

    Each edge has its own turn, 0 or 1: if edges coincide with the samples, a clock with jitter shows some of them one
    sample later than others. s stays within its interval: beyond it a step would run backwards, and meet stops that
    were never hit. `estimation.edges` decides whether s is at an end of the interval. It is a habit, not a mistake: the
    fit finds it (`estimation.edges`), and no diagnosis tries it.

    Source: GUM (JCGM 100:2008), 4.3, for an instant that is systematic, not random at each edge.
    """

    kind = "edge_phase"
    acts_on: ClassVar[tuple[str, ...]] = ("voltage",)
    told_by = "the timing of the rig's output and logger"
    off: ClassVar[Mapping[str, float] | None] = {"edge_phase": 0.5}
    edge_phase: Scalar = parameter(
        "", Real(1.0), 0.5, "share of a sample interval from a sample to the edge after it", "JCGM 100:2008, 4.3"
    )

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        edge = steps.edge
        if edge is None:
            return steps
        late = self.here(test_of, steps.trace) * (jnp.clip(self.edge_phase + edge.turn, *_WITHIN) - 0.5)
        return steps._replace(dt=steps.dt + late * edge.span, time=steps.time + late * edge.moves)


# A channel that is logged late against the others, in one test or in one trace
class ChannelLate(AbstractRigEffect):
    """y_logged(t) = y(t - late), in the traces of one test, or in one of them.

    A late voltage makes every other channel early by the same time. The reading comes from the simulated path itself,
    so any number of samples and either sign are possible. Between the ends of integration steps h the path is a cubic:
    exact to the third order in h if it is smooth, off by up to 0.074 h times the jump of its slope if it bends within a
    step of that instant. Before a trace begins and after it ends, its first and last values apply.

    Source: Kester 2005 (multiplexed acquisition; group delay of a filter). Differs from source: only a dead time, no
    change of shape.
    """

    kind = "channel_late"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = (*OBSERVED, *DRIVING)
    told_by = "a step, with that channel and another on one trigger"
    off: ClassVar[Mapping[str, float] | None] = {"late": 0.0}
    delays: ClassVar[bool] = True
    late: Scalar = parameter("s", Real(1e-3), 0.0, "lateness of a channel in the log", "Kester 2005")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel of each test that logged at least two signals, if there is another test. An input channel counts
        only if two channels respond: with one, either of the two may be the late one."""
        if len(logged) < 2:
            return ()
        found = []
        for test, channels in logged.items():
            seen = [channel for channel in OBSERVED if channel in channels]
            driving = [channel for channel in DRIVING if channel in channels]
            if test != STATIC and len(seen) + len(driving) > 1:
                found += [Place(test, channel) for channel in (*seen, *(driving if len(seen) > 1 else ()))]
        return tuple(found)

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each measured channel of a trace with at least two; in a trace with a single channel the whole trace is
        late."""
        timed = {
            file: seen
            for file, seen in logged.items()
            if Place.named(file).test != STATIC and len(seen & {*OBSERVED}) > 1
        }
        places = channels_of_traces(logged, OBSERVED, cls.places)
        return tuple(place for place in places if place.file in timed)

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        late = self.here(test_of, steps.trace) * self.late
        return dict.fromkeys(OBSERVED, -late) if self.place.channel in DRIVING else {self.place.channel: late}


# One trace whose measured channels are all late against what drove it: started late, or by another logger
class TraceLate(AbstractRigEffect):
    """y_logged(t) = y(t - late), for every measured channel of one trace.

    The interpolation is that of `channel_late`: either sign and any number of samples, a cubic path within integration
    steps, and the first and last values before and after the trace.

    Source: Kester 2005 (acquisition on two clocks). Differs from source: only a dead time.
    """

    kind = "trace_late"
    scope = "trace"
    told_by = "a mark that both loggers record"
    off: ClassVar[Mapping[str, float] | None] = {"late": 0.0}
    delays: ClassVar[bool] = True
    late: Scalar = parameter("s", Real(0.01), 0.0, "lateness of a trace in the log", "Kester 2005")

    @classmethod
    def in_traces(cls, logged: Logged) -> tuple[Place, ...]:
        """Each trace with an input, if there are others."""
        driven = [Place.named(file) for file, channels in logged.items() if channels & {*DRIVING}]
        timed = tuple(place for place in driven if place.test != STATIC)
        return timed if len(timed) > 1 else ()

    def lateness(self, steps: Any, test_of: Scalar) -> dict[str, Scalar]:
        return dict.fromkeys(OBSERVED, self.here(test_of, steps.trace) * self.late)
