"""How gains fare on the parts of one design: units that were measured, and units not made yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .fleet_verdict import OddOne, OneByOne, Share


class OnParts(NamedTuple):
    """One set of gains.

    Args:
        measured: on each unit of the fleet.
        drawn: on units drawn from its population.
    """

    measured: OneByOne
    drawn: OneByOne

    @property
    def worst(self) -> OddOne:
        """The measured unit that fares worst."""
        return self.measured.named(1)[0]


@dataclass(frozen=True, eq=False)
class PartsVerdict:
    """Gains of every rule on the parts, at the bench and, those that are proposed, outside it.

    Args:
        where, name: of the fleet, see `Parts`.
        of_run: parameters that the fleet does not tell, taken from the run.
        left_out: units that are none of the parts, with why.
        rules: by name, those that have gains.
        corners: of supply, winding and friction, the proposed gains on every measured unit at each of them; a unit's
            corners one after another.
        anywhere: the proposed gains on the drawn units, each under conditions drawn for it.
    """

    where: str
    name: str
    of_run: tuple[str, ...]
    left_out: Mapping[str, str]
    rules: Mapping[str, OnParts]
    corners: OneByOne
    anywhere: OneByOne

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the measured ones."""
        return next(iter(self.rules.values())).measured.units

    @property
    def share_at_corners(self) -> Share:
        """Of the measured units, those that meet everything at every corner."""
        return Share.counted(np.all(self.corners.met.reshape(len(self.units), -1), axis=1))
