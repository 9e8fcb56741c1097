"""A channel that is logged late against the others, in one test or in one trace."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import Real, Scalar, parameter
from .base import DRIVING, OBSERVED, STATIC, AbstractRigEffect, Logged, Place
from .one_trace import channels_of_traces


class ChannelLate(AbstractRigEffect):
    """y_logged(t) = y(t - late), in the traces of one test, or in one of them.

    A late voltage makes every other channel early by as much. It is read off the simulated path itself, so it holds for
    any number of samples and for either sign. Between the ends of integration steps h the path is a cubic: exact to the
    third order in h where it is smooth, off by up to 0.074 h times the jump of its slope where it bends within a step
    of that instant. Before a trace begins and after it ends its first and last values stand.

    Source: Kester 2005 (multiplexed acquisition; group delay of a filter). Differs from source: a dead time alone, no
    change of shape.
    """

    kind = "channel_late"
    of_a_channel: ClassVar[bool] = True
    acts_on: ClassVar[tuple[str, ...]] = (*OBSERVED, *DRIVING)
    told_by = "a step, with that channel and another on one trigger"
    off: ClassVar[Mapping[str, float] | None] = {"late": 0.0}
    delays: ClassVar[bool] = True
    late: Scalar = parameter("s", Real(1e-3), 0.0, "by how much a channel is logged late", "Kester 2005")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """Each channel of each test that logged two signals at least, where there is another test. What drives it only
        where two channels answer: with one, either of the two may be called late."""
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
        """Each measured channel of a trace that measured two; of one that measured a single channel that is a trace
        that is late."""
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
