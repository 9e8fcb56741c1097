"""Sets of effects beside the one that came round by round: the best pairs, refitted from the first model.

A round adds the one effect that explains most alone. Where two are missing, a third that does a little of both may be
that one, and hide them. So where the rounds leave more than noise or found several effects, all pairs are scored
together at the first model, and the best few that the rounds did not find are refitted from there, with further rounds
after them. That model and the rounds' own are compared under one whitening, the latter's, by BIC.

Source: all subsets beside stepwise selection (Miller 2002, Subset Selection in Regression, ch. 3). Differs from source:
subsets of two, ranked by the score test; only the best few are refitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..estimation.joint_fit import Report
from ..estimation.remedies import listed
from ..estimation.result import FitResult
from ..problem.cores import concurrently
from .ambiguity import Apart, apart
from .candidate_model import CandidateModel
from .choice import Choice, Outcome, stands
from .composition import Composition, Effect, resting
from .exchange import Found
from .findings import SetTried
from .loop import Measured, Round, measured
from .pairs import Pair, pairs
from .refit import holds, refit_fully
from .rounds import Progress, forward, reported
from .score import Score, score
from .screen import ranked
from .settings import DiagnosisSettings
from .trial import Cost, Trial, bic_change, judged

_SCORED = 60  # pairs kept of the score test: enough for those that rivals of the two make


class Searched(NamedTuple):
    """What a diagnosis goes on with, and the sets of effects that were compared."""

    progress: Progress
    tried: tuple[SetTried, ...]


def searched(result: FitResult, first: CandidateModel, progress: Progress, report: Report) -> Searched:
    """The rounds' progress, or one that begins with a pair of effects and explains clearly more.

    Args:
        result: the first fit.
        first: the model of the first round.
        progress: what the rounds came to.
        report: progress in words.
    """
    if first.far or not is_open(len(progress.model.added), progress.rounds[-1].evidence.white):
        return Searched(progress, ())
    report("scoring pairs of effects together", 0.86)
    best, before, compared = progress, score(first), []
    data = measured(first, first.composition.candidates)
    every = pairs(data.signatures, data.background.r, _SCORED)
    promise = Promise.of(before, data, first.composition)
    for pair in promising(every, promise, progress.model.added, first.settings):
        report(f"refitting with {listed(e.name for e in pair.effects)}", 0.87)
        begun = _begun_with(first, before, pair, every, data, promise, report)
        if begun is None:
            compared.append(SetTried(tuple(e.name for e in pair.effects), None, False))
            continue
        other = forward(result, begun, report)
        liked = compared_with(other.model, best.model)
        compared.append(SetTried(tuple(e.name for e in other.model.added), liked.bic_change, liked.better))
        if liked.better:
            words = in_place_of(best.model.added, other.model.added)
            best = replace(other, changed=(*progress.changed, *other.changed, words))
        elif liked.apart is not None:
            best = replace(best, even={**best.even, frozenset(other.model.added): liked.apart})
    return Searched(best, tuple(compared))


# ---- decisions


def is_open(added: int, white: bool) -> bool:
    """Whether other sets may do better: more than noise is left, or several effects were found one after the other."""
    return added > 1 or not white


@dataclass(frozen=True, eq=False)
class Promise:
    """What sets of effects promise by the linearised model: by how much BIC would fall.

    Args:
        per_chi2: fall of -2 log likelihood for one unit of chi2.
        price: BIC asked for each effect: its parameters and the variants that it was chosen from.
        alone: gain of chi2 of each effect alone.
    """

    per_chi2: float
    price: Mapping[Effect, float]
    alone: Mapping[Effect, float]

    @classmethod
    def of(cls, before: Score, data: Measured, composition: Composition) -> Promise:
        """That of candidates measured at a model with this score."""
        alone = {g.variant.effect: g.gain for g in ranked(data.signatures)}
        costs = {e: Cost.of(e, composition) for e in alone}
        price = {e: c.parameters * np.log(before.count) + 2.0 * np.log(c.variants) for e, c in costs.items()}
        return cls(before.likelihood_per_chi2, price, alone)

    def worth(self, effects: Iterable[Effect], gain: float) -> float:
        """Fall of BIC where effects lower chi2 by this gain."""
        return gain * self.per_chi2 - sum(self.price[e] for e in effects)

    def of_one(self, effect: Effect) -> float:
        """`worth` of an effect alone."""
        return self.worth((effect,), self.alone[effect])


def promising(
    every: Sequence[Pair], promise: Promise, added: Sequence[Effect], settings: DiagnosisSettings
) -> list[Pair]:
    """The pairs that promise more than each of their effects alone, and more than what the rounds found.

    Args:
        every: pairs, the largest gain first.
        promise: by which they are measured.
        added: what the rounds found; of more than two effects the best two are what is compared.
        settings: `pair_refits`, and `strong_bic_change` as what the second effect must promise.
    """
    worth = [promise.worth(p.effects, p.gain) for p in every]
    mine = [w for p, w in zip(every, worth, strict=True) if set(p.effects) <= set(added)]
    asked = max((*mine, *(promise.of_one(e) for e in added if e in promise.alone)), default=0.0)

    def promises(p: Pair, w: float) -> bool:
        second = w - max(promise.of_one(e) for e in p.effects)
        return not set(p.effects) <= set(added) and w > asked and second > -settings.strong_bic_change

    return [p for p, w in zip(every, worth, strict=True) if promises(p, w)][: settings.pair_refits]


def in_place_of(old: Sequence[Effect], new: Sequence[Effect]) -> str:
    """One sentence for a set of effects, or none, in whose place another is taken."""
    before = f"{listed(e.name for e in old)} gave way to" if old else "Nothing was found one by one; there is"
    return f"{before} {listed(e.name for e in new)}, scored together."


class Comparison(NamedTuple):
    """Of one model in place of another: the change of BIC, None where they do not compare; whether it is better; and
    how far its fit is, where these data do not choose between the two."""

    bic_change: float | None
    better: bool
    apart: Apart | None = None


def compared_with(other: CandidateModel, s: CandidateModel) -> Comparison:
    """One model in place of another, both under the whitening of the latter.

    A model near the data is better than one that is far from them; two of which either is far do not compare. One that
    predicts held-out traces clearly worse is neither better nor as good.
    """
    if other.far or s.far:
        return Comparison(None, s.far and not other.far)
    here, there = score(s), s.with_effects(other.added, other.values).optimised()
    after, asked = score(there), s.settings.tied_likelihood
    change = bic_change(here, after, Cost(there.x.size - s.x.size, 1))
    if after.strays(here, s.settings.refit_rise):
        return Comparison(change, False)
    return Comparison(change, change < -asked, apart(there, s) if abs(change) < asked else None)


# ---- a pair taken in


def _begun_with(
    first: CandidateModel,
    before: Score,
    pair: Pair,
    every: Sequence[Pair],
    data: Measured,
    promise: Promise,
    report: Report,
) -> Progress | None:
    """The first model refitted with a pair; None where one of the two is not worth its parameters beside the other."""
    new = refit_fully(first.trying(pair.effects, pair.values).optimised(), report)
    if not holds(new, first, before):
        return None
    less = dict(zip(pair.effects, concurrently(lambda e: new.without(e).optimised(), pair.effects), strict=True))
    given = {e: judged(e, score(less[e]), new).verdict for e in pair.effects}
    if not all(stands(v, first.settings) for v in given.values()):
        return None
    a, b = sorted(pair.effects, key=lambda e: -promise.alone[e])
    new = replace(new.with_effects((a, b), {}), end=new.end)
    opening = judged(a, score(less[b].without(a).optimised()), less[b])
    closing = Trial(new, given[b])
    why = f"Scored together, {a.name} and {b.name} explain more than what was found one after the other"
    signatures = ranked(data.signatures)
    second = tuple(g for g in signatures if g.variant.effect is b)
    rounds = (
        Round(first, before, signatures, (opening,), Choice(Outcome.ADDED, a, (), f"{why}: the first of them.")),
        Round(less[b], score(less[b]), second, (closing,), Choice(Outcome.ADDED, b, (), f"{why}: the second.")),
    )
    found = tuple(Found(e, {}, -given[e].bic_change, rivals(e, pair, every, promise, first.settings)) for e in (a, b))
    return Progress(new, found, tuple(map(reported, rounds)))


def rivals(
    effect: Effect, pair: Pair, every: Sequence[Pair], promise: Promise, settings: DiagnosisSettings
) -> dict[Effect, dict[str, float]]:
    """Effects that in the place of one of a pair explain a good part of it, with their parameters' values.

    Args:
        effect: the one of the pair.
        pair: the pair.
        every: pairs, the largest gain first.
        promise: what each explains alone.
        settings: `exchange_rival`, and `refits` as the most of them.
    """
    (other,) = (e for e in pair.effects if e is not effect)
    alone = promise.alone[other]
    asked = settings.exchange_rival * (pair.gain - alone)
    found = {}
    for p in every:
        if other in p.effects and effect not in p.effects and p.gain - alone > asked:
            (rival,) = (e for e in p.effects if e is not other)
            found[rival] = {symbol: p.values[symbol] for symbol in resting(rival)}
    return dict(list(found.items())[: settings.refits])
