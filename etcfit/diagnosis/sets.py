"""Alternative sets of effects to the one that the rounds found: pairs are scored together and the best refitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..estimation.identifiability import listed
from ..estimation.joint_fit import Report
from ..estimation.result import FitResult
from ..model.parameters import parameters_of
from ..problem.cores import concurrently
from .candidate_model import CandidateModel
from .choice import TIED_LIKELIHOOD, Choice, Outcome, is_accepted
from .composition import Composition, Effect, resting
from .exchange import EXCHANGE_RIVAL, Found
from .findings import SetTried
from .loop import Round, ScoredCandidates, score_candidates
from .refit import is_no_worse, refit_fully
from .rounds import Progress, forward, reported
from .score import Apart, Score, baseline, distance_to, holdout_worsened, score
from .screen import Background, Signature, bounded, lowest, ranked
from .settings import DiagnosisSettings
from .trial import Cost, Trial, bic_change, judge_trial

# ---- Every pair of candidates scored together: what two effects explain together that neither explains alone
#
#     gain_ab = max |r|^2 - |r + C_a' a + C_b' b|^2
#
# One QR of all signatures side by side, [C', r] = Q R, replaces n samples by as many rows as there are columns, so that
# a pair costs the solution of a few equations: thousands of pairs a second. The bounds of amplitudes are left out at
# first. Without them a pair gains no less, so only pairs that may still be among the best are solved with them.
#
# Source: Rao 1948 (score test), all subsets of size two (Miller 2002, Subset Selection in Regression, ch. 2). Differs
# from source: amplitudes are bounded.


_NOTHING = 1e-5  # length of a column, originally 1, below which another effect imitates all of it


@dataclass(frozen=True, eq=False)
class Pair:
    """Two effects, and the fall of chi2 that they promise together."""

    effects: tuple[Effect, Effect]  # the two
    gain: float  # fall of chi2 by the linearised model
    values: Mapping[str, float] = field(repr=False)  # all their parameters at the lowest chi2, SI by symbol


class _Block(NamedTuple):
    """A signature's columns among all of them, and its amplitudes' scales and lower bounds over these."""

    signature: Signature
    own: slice
    scale: np.ndarray
    low: np.ndarray
    fixed: np.ndarray | None


def pairs(signatures: Sequence[Signature], r: np.ndarray, most: int) -> tuple[Pair, ...]:
    """The pairs that lower chi2 most, each of two effects at their best shapes, the largest gain first.

    Args:
        signatures: of every variant of every candidate, their columns projected off the fitted parameters.
        r: the residual projected likewise, shape (n,).
    """
    blocks = _blocks([s for s in signatures if s.own > 0.0])
    if len(blocks) < 2:
        return ()
    columns = np.concatenate([b.signature.columns for b in blocks], axis=1)
    length = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    triangle = np.asarray(np.linalg.qr(np.column_stack((columns / length, r)), mode="r"))
    system = _System(triangle[:, :-1], -triangle[:, -1], length)
    bounds, best = _without_bounds(blocks, system), dict[frozenset[Effect], Pair]()
    for gain, a, b in bounds:
        if len(best) >= most and gain <= sorted((p.gain for p in best.values()), reverse=True)[most - 1]:
            break
        found = _solved(blocks[a], blocks[b], system)
        key = frozenset(found.effects)
        if key not in best or found.gain > best[key].gain:
            best[key] = found
    return tuple(sorted(best.values(), key=lambda p: -p.gain)[:most])


class _System(NamedTuple):
    """min |R a - t|^2 over amplitudes a whose columns were brought to length 1."""

    columns: np.ndarray
    target: np.ndarray
    length: np.ndarray


def _blocks(signatures: Sequence[Signature]) -> list[_Block]:
    found, start = [], 0
    for s in signatures:
        domains = {p.symbol: p.domain for p in parameters_of(s.variant.effect)}
        mine = [domains[symbol] for symbol in s.variant.amplitudes]
        own = slice(start, start := start + len(mine))
        scale = np.array([d.scale for d in mine])
        low = lowest(mine)
        scanned = any(symbol in s.variant.shape for symbol in s.variant.amplitudes)
        fixed = np.array([s.variant.shape[symbol] for symbol in s.variant.amplitudes]) / scale if scanned else None
        found.append(_Block(s, own, scale, low, fixed))
    return found


def _without_bounds(blocks: Sequence[_Block], system: _System) -> list[tuple[float, int, int]]:
    """Gain of each pair of different effects, amplitudes free, the largest first.

    All columns and the target are projected off the first effect; the gain of the second then adds to that of the
    first.
    """
    out = []
    for a, first in enumerate(blocks):
        basis = np.linalg.qr(system.columns[:, first.own])[0]
        rest, target = (Background.free_of(basis, m) for m in (system.columns, system.target))
        alone = float(system.target @ system.target - target @ target)
        for b in range(a + 1, len(blocks)):
            second = blocks[b]
            if second.signature.variant.effect is first.signature.variant.effect:
                continue
            mine = rest[:, second.own]
            kept = mine[:, np.linalg.norm(mine, axis=0) > _NOTHING]
            more = np.linalg.qr(kept)[0].T @ target if kept.size else np.zeros(0)
            out.append((alone + float(more @ more), a, b))
    return sorted(out, reverse=True)


def _solved(first: _Block, second: _Block, system: _System) -> Pair:
    """The pair with its amplitudes within their bounds; scanned ones stay at their scanned values."""
    target, free, at = system.target, [], {}
    for block in (first, second):
        columns, length = system.columns[:, block.own], system.length[block.own]
        if block.fixed is None:
            free.append(block)
        else:
            target = target - columns @ (block.fixed * length)
            at |= _values(block, block.fixed)
    left = float(target @ target)
    if free:
        columns = np.concatenate([system.columns[:, b.own] for b in free], axis=1)
        solution = bounded(columns, target, np.concatenate([b.low for b in free]))
        left = float(np.sum((columns @ solution - target) ** 2))
        for block in free:
            own, solution = np.split(solution, [len(block.scale)])
            at |= _values(block, own / system.length[block.own])
    gain = float(system.target @ system.target) - left
    both = (first.signature, second.signature)
    effects = (first.signature.variant.effect, second.signature.variant.effect)
    shapes = {k: v for s in both for k, v in s.variant.shape.items()}
    return Pair(effects, max(gain, 0.0), {**shapes, **at})


def _values(block: _Block, amplitudes: np.ndarray) -> dict[str, float]:
    """SI by symbol, of amplitudes over their scales."""
    symbols = block.signature.variant.amplitudes
    return {s: float(a * k) for s, a, k in zip(symbols, amplitudes, block.scale, strict=True)}


# ---- Alternative sets of effects: the best pairs, refitted from the first model
#
# A round adds the one effect that explains most alone. Where the model lacks two, a third that explains a part of both
# may be that one and hide them. So where the rounds leave more than noise or found several effects, all pairs are
# scored together at the first model, and the best few that the rounds did not find are refitted from there, with
# further rounds after them. That model and the rounds' own are compared by BIC, both under the whitening of the latter.
#
# Source: all subsets compared with stepwise selection (Miller 2002, Subset Selection in Regression, ch. 3). Differs
# from source: subsets of two, ranked by the score test; only the best few are refitted.

_SCORED = 60  # pairs kept of the score test: enough to include the pairs of rivals of the two


def searched(
    result: FitResult, first: CandidateModel, progress: Progress, report: Report
) -> tuple[Progress, tuple[SetTried, ...]]:
    """The rounds' progress, or one that begins with a pair and explains clearly more; and the sets compared."""
    if first.far or not is_open(len(progress.model.added), progress.rounds[-1].evidence.white):
        return progress, ()
    report("scoring pairs of effects together", 0.86)
    best, before, compared = progress, score(first), []
    data = score_candidates(first, first.composition.candidates)
    every = pairs(data.signatures, data.background.r, _SCORED)
    promise = Promise.of_candidates(before, data, first.composition)
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
    return best, tuple(compared)


# ---- decisions


def is_open(added: int, white: bool) -> bool:
    """Whether other sets may do better: more than noise is left, or several effects were found one after the other."""
    return added > 1 or not white


@dataclass(frozen=True, eq=False)
class Promise:
    """The fall of BIC that sets of effects promise by the linearised model."""

    per_chi2: float  # fall of -2 log likelihood for one unit of chi2
    price: Mapping[Effect, float]  # BIC cost of each effect: its parameters and the variants that it was chosen from
    alone: Mapping[Effect, float]  # fall of chi2 by each effect alone

    @classmethod
    def of_candidates(cls, before: Score, data: ScoredCandidates, composition: Composition) -> Promise:
        """The promise of candidates whose signatures were taken at a model with this score."""
        alone = {g.variant.effect: g.gain for g in ranked(data.signatures)}
        price = {e: Cost.of_effect(e, composition).of_bic(before.count) for e in alone}
        return cls(before.likelihood_per_chi2, price, alone)

    def worth(self, effects: Iterable[Effect], gain: float) -> float:
        """Fall of BIC if the effects lower chi2 by this gain."""
        return gain * self.per_chi2 - sum(self.price[e] for e in effects)

    def of_one(self, effect: Effect) -> float:
        """`worth` of an effect alone."""
        return self.worth((effect,), self.alone[effect])


def promising(
    every: Sequence[Pair], promise: Promise, added: Sequence[Effect], settings: DiagnosisSettings
) -> list[Pair]:
    """The pairs that promise more than each of their effects alone, and more than the effects that the rounds found.

    Args:
        added: the effects that the rounds found; of more than two, the best two are compared.
        settings: `pair_refits`, and `strong_bic_change` as what the second effect must promise.
    """
    worth = [promise.worth(p.effects, p.gain) for p in every]
    mine = [w for p, w in zip(every, worth, strict=True) if set(p.effects) <= set(added)]
    least = max((*mine, *(promise.of_one(e) for e in added if e in promise.alone)), default=0.0)

    def promises(p: Pair, w: float) -> bool:
        second = w - max(promise.of_one(e) for e in p.effects)
        return not set(p.effects) <= set(added) and w > least and second > -settings.strong_bic_change

    return [p for p, w in zip(every, worth, strict=True) if promises(p, w)][: settings.pair_refits]


def in_place_of(old: Sequence[Effect], new: Sequence[Effect]) -> str:
    """One sentence on a set of effects, which may be empty, that is replaced by another."""
    before = f"{listed(e.name for e in old)} gave way to" if old else "Nothing was found one by one; there is"
    return f"{before} {listed(e.name for e in new)}, scored together."


class Comparison(NamedTuple):
    """A comparison of two models: the change of BIC, None where they cannot be compared; whether the first is better;
    and how far their fits are, where these data do not choose between the two."""

    bic_change: float | None
    better: bool
    apart: Apart | None = None


def compared_with(other: CandidateModel, s: CandidateModel) -> Comparison:
    """One model in place of another, both under the whitening of the latter.

    A model near the data is better than one that is far from them; otherwise two models cannot be compared where one is
    far. A model that predicts held-out traces clearly worse is neither better nor equally good.
    """
    if other.far or s.far:
        return Comparison(None, s.far and not other.far)
    here, there = score(s), s.with_effects(other.added, other.values).optimised()
    after, least = score(there), TIED_LIKELIHOOD
    change = bic_change(here, after, Cost(there.x.size - s.x.size, 1))
    if holdout_worsened(after.holdout_rms, here.holdout_rms, s.settings.refit_rise):
        return Comparison(change, False)
    return Comparison(change, change < -least, distance_to(there, s) if abs(change) < least else None)


# ---- a pair taken in


def _begun_with(
    first: CandidateModel,
    before: Score,
    pair: Pair,
    every: Sequence[Pair],
    data: ScoredCandidates,
    promise: Promise,
    report: Report,
) -> Progress | None:
    """The first model refitted with a pair; None where one of the two is not worth its parameters with the other."""
    new = refit_fully(first.trying(pair.effects, pair.values).optimised(), report)
    if not is_no_worse(new, first, before):
        return None
    less = dict(zip(pair.effects, concurrently(lambda e: new.without(e).optimised(), pair.effects), strict=True))
    scores = {e: baseline(m) for e, m in less.items()}
    given = {e: judge_trial(e, was, new).verdict for e, was in scores.items()}
    if not all(is_accepted(v, first.settings) for v in given.values()):
        return None
    a, b = sorted(pair.effects, key=lambda e: -promise.alone[e])
    new = replace(new.with_effects((a, b), {}), end=new.end)
    opening = judge_trial(a, score(less[b].without(a).optimised()), less[b])
    closing = Trial(new, given[b])
    why = f"Scored together, {a.name} and {b.name} explain more than what was found one after the other"
    signatures = ranked(data.signatures)
    second = tuple(g for g in signatures if g.variant.effect is b)
    rounds = (
        Round(first, before, signatures, (opening,), Choice(Outcome.ADDED, a, (), f"{why}: the first of them.")),
        Round(less[b], scores[b], second, (closing,), Choice(Outcome.ADDED, b, (), f"{why}: the second.")),
    )
    found = tuple(Found(e, {}, -given[e].bic_change, rivals(e, pair, every, promise, first.settings)) for e in (a, b))
    return Progress(new, found, tuple(map(reported, rounds)))


def rivals(
    effect: Effect, pair: Pair, every: Sequence[Pair], promise: Promise, settings: DiagnosisSettings
) -> dict[Effect, dict[str, float]]:
    """Effects that explain a good part of the same in the place of one of a pair, with their parameters' values."""
    (other,) = (e for e in pair.effects if e is not effect)
    alone = promise.alone[other]
    least = EXCHANGE_RIVAL * (pair.gain - alone)
    found = {}
    for p in every:
        if other in p.effects and effect not in p.effects and p.gain - alone > least:
            (rival,) = (e for e in p.effects if e is not other)
            found[rival] = {symbol: p.values[symbol] for symbol in resting(rival)}
    return dict(list(found.items())[: settings.refits])
