"""Other orders of effects, carried on where the model stays far from its data.

There the effect that a round adds decides in which valley the later ones end. So wherever another effect was as likely
as the one added (BIC, the held-out traces left aside), the rounds are carried on from that effect too, with its own
refit as the start. The free runs of the ends decide between them (`free_sets`).

Source: beam search (Lowerre 1976), of a width that the data ask for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from ..estimation.joint_fit import Report
from ..estimation.result import FitResult
from .candidate_model import CandidateModel
from .choice import TIED_LIKELIHOOD
from .exchange import Found
from .findings import RoundReport
from .refit import refit_fully
from .rounds import Progress, forward, looked_back
from .settings import DiagnosisSettings


class Turn(NamedTuple):
    """A round in which another effect was as likely as the one added."""

    apart: float  # how far the BIC of the two are apart
    round: int  # number of the round, from 0
    instead: str  # name of the other


def other_turns(rounds: Sequence[RoundReport], found: Sequence[Found], settings: DiagnosisSettings) -> list[Turn]:
    """Where the rounds could have taken another turn, the nearest in BIC first; `orders` at most.

    An effect is as likely as the one added where BIC accepts it and differs by less than `TIED_LIKELIHOOD`. Its refit
    is needed (`Found.rivals`), and no effect before it may have taken the place of another since.

    Args:
        found: the effects that the rounds added, in this order.
    """
    turns = []
    for k, (each, own) in enumerate(zip(rounds, found, strict=False)):
        if own.effect.name != each.added:
            break
        changes = {c.effect: c.bic_change for c in each.candidates if c.bic_change is not None}
        if each.added in changes:
            strong = (e.name for e in own.rivals if changes.get(e.name, 0.0) < settings.strong_bic_change)
            turns += [Turn(abs(changes[name] - changes[each.added]), k, name) for name in strong]
    return sorted(turn for turn in turns if turn.apart < TIED_LIKELIHOOD)[: settings.orders]


def other_orders(result: FitResult, first: CandidateModel, progress: Progress, report: Report) -> Iterator[Progress]:
    """The progress of the rounds that take each other turn.

    Args:
        first: the model before any round.
    """
    for turn in other_turns(progress.rounds, progress.found, first.settings):
        report(f"carrying the rounds on from {turn.instead}", 0.86)
        yield looked_back(result, forward(result, _turned(turn, first, progress, report), report), report)


def _turned(turn: Turn, first: CandidateModel, progress: Progress, report: Report) -> Progress:
    """The progress up to a round that takes another turn, and that round."""
    before, own, turned = progress.found[: turn.round], progress.found[turn.round], progress.rounds[turn.round]
    effect, values = next((e, values) for e, values in own.rivals.items() if e.name == turn.instead)
    s = refit_fully(first.at_end_of((*(each.effect for each in before), effect), values), report)
    why = f"{effect.name} is as likely as {turned.added}: the rounds are carried on from it too."
    turned = replace(turned, added=effect.name, ties=(str(turned.added),), why=why)
    return Progress(s, (*before, Found(effect, {}, {})), (*progress.rounds[: turn.round], turned))
