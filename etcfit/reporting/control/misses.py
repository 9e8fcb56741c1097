"""What a rule misses on the nominal model, and in which scenario it has the hardest time."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

from ...control.judged import Tuned
from ...control.pid.figures import MARGINS, OF_THE_PAPER, REQUIRED, Requirements
from .words import Hardest, hardest, missed_margins

UNSTABLE = "UNSTABLE"


class Place(NamedTuple):
    """The scenario in which a response comes nearest to a limit, or misses it by most.

    Args:
        scenario: its name.
        hardest: the requirement on the response.
    """

    scenario: str
    hardest: Hardest


def misses(tuned: Tuned, asked: Requirements, but: Collection[str] = ()) -> list[str]:
    """Every requirement and margin that the gains of a rule miss, in words, the worst first; "UNSTABLE" alone.

    Args:
        tuned: a rule that has gains.
        asked: what is required.
        but: requirements that do not count.
    """
    assert tuned.nonlinear is not None, "a rule with gains has been tried"
    if not tuned.stable:
        return [UNSTABLE]
    figures, limits = tuned.nonlinear.known(), asked.limits((*REQUIRED, *MARGINS))
    each = [hardest(figures, {symbol: limits[symbol]}) for symbol in REQUIRED if symbol not in but]
    missed = sorted((one for one in each if one is not None and not one.met), key=lambda one: -one.strain)
    return [one.says for one in missed] + missed_margins(figures, limits)


def hardest_place(tuned: Tuned, asked: Requirements) -> Place | None:
    """Where the response is hardest for the gains of a rule; None where no scenario is judged."""
    limits = asked.limits(OF_THE_PAPER)
    every = []
    for name, figures in tuned.scenarios.items():
        judged = {symbol: value for symbol, value in figures.known().items() if symbol in limits and value == value}
        worst = hardest(judged, {symbol: limits[symbol] for symbol in judged})
        every += [] if worst is None else [Place(name, worst)]
    return max(every, key=lambda place: place.hardest.strain, default=None)
