"""Other orders of effects, carried on where the model stays far from its data.

There the effect that a round adds decides in which valley the later ones end. So wherever another effect was as likely
as the one added (BIC, the held-out traces left aside), the rounds are carried on from that effect too. The free runs of
the ends decide between them (`free_sets`).

Source: beam search (Lowerre 1976), of a width that the data ask for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from ..estimation.joint_fit import Report
from ..estimation.result import FitResult
from .candidate_model import CandidateModel
from .choice import TIED_LIKELIHOOD
from .composition import Effect
from .exchange import Found
from .findings import RoundReport
from .refit import refit_fully
from .rounds import Progress, forward, looked_back
from .settings import DiagnosisSettings


class Turn(NamedTuple):
    """A round in which another effect was as likely as the one added."""

    behind: float  # change of BIC of the other less that of the one added
    round: int  # number of the round, from 0
    instead: str  # name of the other


def other_turns(rounds: tuple[RoundReport, ...], settings: DiagnosisSettings) -> list[Turn]:
    """Where the rounds could have taken another turn, the likeliest first; `orders` at most.

    An effect is as likely as the one added where BIC accepts it and is no more than `TIED_LIKELIHOOD` larger.
    """
    found = []
    for k, each in enumerate(rounds):
        changes = {c.effect: c.bic_change for c in each.candidates if c.bic_change is not None}
        if each.added not in changes:
            continue
        behind = {name: change - changes[each.added] for name, change in changes.items() if name != each.added}
        found += [
            Turn(more, k, name)
            for name, more in behind.items()
            if more < TIED_LIKELIHOOD and changes[name] < settings.strong_bic_change
        ]
    return sorted(found)[: settings.orders]


def other_orders(result: FitResult, first: CandidateModel, progress: Progress, report: Report) -> Iterator[Progress]:
    """The progress of the rounds that take each other turn.

    Args:
        first: the model before any round.
    """
    for turn in other_turns(progress.rounds, first.settings):
        k = turn.round
        if k >= len(progress.found) or progress.found[k].effect.name != progress.rounds[k].added:
            continue  # an effect that took another's place later
        rivals = {e.name: (e, values) for e, values in progress.found[k].rivals.items()}
        if turn.instead not in rivals:
            continue  # it explained less than half as much, and had fewer parameters
        effect, values = rivals[turn.instead]
        report(f"carrying the rounds on from {turn.instead}", 0.86)
        begun = _begun(first, progress, k, effect, dict(values), report)
        yield looked_back(result, forward(result, begun, report), report)


def _begun(
    first: CandidateModel, progress: Progress, k: int, effect: Effect, values: dict[str, float], report: Report
) -> Progress:
    """The progress after k rounds and one that adds another effect, whose refit ended at these values."""
    before, turned = progress.found[:k], progress.rounds[k]
    s = first.with_effects((*(each.effect for each in before), effect), values)
    s = refit_fully(replace(s, x=s.problem.layout.coordinates({**s.values, **values})), report)
    why = f"{effect.name} is as likely as {turned.added}: the rounds are carried on from it too."
    rounds = (*progress.rounds[:k], replace(turned, added=effect.name, ties=(), why=why))
    return Progress(s, (*before, Found(effect, {}, {})), rounds)
