"""A current that is logged late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State


class ChannelDelay(AbstractEffect):
    """The current logged at time t is that of t - t_c: channels sampled in turn, or sent on different buses.

    Source: Kester 2005 (multiplexed acquisition). Differs from source: the delay may be longer than a sample.
    """

    name = "channel_delay"
    scope = "channel"
    told_by = "a voltage step with voltage and current on one trigger"
    off: ClassVar[Mapping[str, float] | None] = {"t_c": 0.0}
    inexact: ClassVar[float] = 0.1
    delays: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("current", "circuit")
    t_c: Scalar = parameter("s", NonNegative(0.002), 0.0, "delay of the logged current", "Kester 2005")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(current_delay=self.t_c)
