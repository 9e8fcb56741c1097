"""A supply that sags under the current that the bridge draws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ..parameters import NonNegative, Scalar, parameter
from .base import AbstractRigEffect, Logged, Place


class SupplySag(AbstractRigEffect):
    """v = d V_s,    V_s = V_0 - R_s i_s,    i_s = d i    so    v = d V_0 - d^2 R_s i, where a duty d drives.

    The bridge takes no power for itself: d V_s i = V_s i_s. That is a resistance of d^2 R_s in the armature's circuit:
    it shows where the duty changes; where every trace has one and the same |d| it is a part of R_a.

    Source: Mohan, Undeland and Robbins 2003, ch. 7 (full bridge: mean current of its source). Differs from source: the
    source has a resistance, R_s of supply and leads. V_s is the mean over a period of the PWM, smooth where a capacitor
    feeds the pulses (without one the sag is |d| R_s i), and what brakes feeds current back, as a battery allows.
    """

    kind = "supply_sag"
    scope = "rig"
    acts_on: ClassVar[tuple[str, ...]] = ("duty",)
    told_by = "the supply's voltage logged beside the duty"
    off: ClassVar[Mapping[str, float] | None] = {"supply_ohm": 0.0}
    supply_ohm: Scalar = parameter("ohm", NonNegative(0.1), 0.05, "resistance of supply and leads", "Mohan 2003, ch. 7")

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """The rig, where a duty drove from a supply that nobody logged, and a current says how much it gave.

        By a plate's angle alone a resistance of the supply is told from nothing else that holds a fast plate back.
        """
        return (Place(),) if any({"duty", "current"} <= channels for channels in logged.values()) else ()

    @classmethod
    def mend(cls, value: float) -> str:
        return '[model] effects = ["supply_sag"], or log the supply beside the duty'

    def driven(self, steps: Any, test_of: Scalar) -> Any:
        return steps if steps.duty is None else steps._replace(series=steps.series + self.supply_ohm * steps.duty**2)
