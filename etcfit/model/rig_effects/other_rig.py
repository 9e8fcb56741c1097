"""Traces of another rig: another body, or this one after something was changed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from .base import AbstractRigEffect, Logged, Place


class OtherRig(AbstractRigEffect):
    """One trace, or one test, is of a body with parameters of its own: it is not fitted with the others.

    It changes nothing in the model; where rig.toml names it, those traces are set aside (`RigConfig.sets_aside`).

    Source: mixed-up files. Differs from source: no.
    """

    kind = "other_rig"
    scope = "trace"
    told_by = "the serial number on the body, or that trace taken again"
    off: ClassVar[Mapping[str, float] | None] = {}

    @classmethod
    def places(cls, logged: Logged) -> tuple[Place, ...]:
        """None: what it explains is asked in another way than of effects, see `diagnosis.other_rig`."""
        return ()
