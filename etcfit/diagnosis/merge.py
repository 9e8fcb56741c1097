"""One effect in place of two: what two of the effects found imitate together may be what is really missing.

A voltage and a current of one test that both read half, and motion in agreement with neither, are a gear ratio half of
the true one, which no round could tell: near the first model it did nothing that the parameters could not do. So where
several effects were found, one that the model imitates by now is put beside two of them, and their amplitudes are
led to their off values while all other coordinates follow by Gauss-Newton steps,

    d = arg min |r + J_held h + J d|^2,    h = (off - amplitude)/(steps left)

for from the model without the two there is no way to where the one has to be.

Source: stepwise selection with exchange (Miller 2002, Subset Selection in Regression, ch. 3); continuation (Allgower
and Georg 2003, Introduction to Numerical Continuation Methods, ch. 2). Differs from source: two are exchanged for one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ..estimation.joint_fit import Report
from .candidate_model import CandidateModel
from .composition import Effect, resting
from .exchange import Found, LookBack, contradicted
from .loop import screened
from .refit import holds, refit_fully
from .score import score
from .trial import Cost, bic_change

Two = tuple[Effect, Effect]


def merged(s: CandidateModel, found: Sequence[Found], report: Report) -> LookBack:
    """The model with one effect in place of two that were added, where that explains as much for fewer parameters.

    Args:
        s: the model.
        found: the effects added, and what is known of them.
        report: progress in words.
    """
    if s.far or len(s.added) < 2:
        return LookBack(s, tuple(found), ())
    before = score(s)
    for one in _imitated(s):
        for two in combinations(s.added, 2):
            report(f"trying {one.name} in place of {two[0].name} and {two[1].name}", 0.89)
            new = handed_over(s, two, one)
            if new is None or not (change := bic_change(before, score(new), cost(s, two, one))) < 0.0:
                continue
            new = refit_fully(new, report)
            if not holds(new, s, before) or contradicted(new, s):
                continue
            return LookBack(
                new, (*found, Found(one, {}, _worth(found, two) - change, {})), (gave_way(two, one, change),)
            )
    return LookBack(s, tuple(found), ())


def cost(s: CandidateModel, two: Two, one: Effect) -> Cost:
    """What one effect costs in BIC less what the two did."""
    mine, theirs = Cost.of(one, s.composition), [Cost.of(e, s.composition) for e in two]
    return Cost(mine.parameters - sum(c.parameters for c in theirs), mine.variants)


def gave_way(two: Two, one: Effect, change: float) -> str:
    """One sentence for an exchange."""
    return f"{two[0].name} and {two[1].name} gave way to {one.name}, which does for both (BIC {change:+.1f})."


def handed_over(s: CandidateModel, two: Two, one: Effect) -> CandidateModel | None:
    """The model with one effect in place of two, at the nearest optimum; None where no way leads there."""
    m = s.with_effects((*s.added, one), resting(one))
    layout, x = m.problem.layout, m.x
    off = {symbol: value for e in two for symbol, value in (e.off or {}).items()}
    held = np.array([layout.free.index(symbol) for symbol in off])
    goal = np.array([layout.parameter(symbol).domain.coordinate(value) for symbol, value in off.items()])
    if not np.all(np.isfinite(goal)):
        return None
    free, reach = np.setdiff1d(np.arange(x.size), held), layout.reach(x)
    for left in range(s.settings.handing_over, 0, -1):
        r, _, jacobian = m.problem.linearise(x, m.weighted)
        columns, toward = jacobian.reshape(-1, x.size) * reach, (goal - x[held]) / left
        ahead = r.ravel() + columns[:, held] @ (toward / reach[held])
        if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(ahead))):
            return None
        follow = np.linalg.lstsq(columns[:, free], -ahead, rcond=1e-6)[0]
        x = x.copy()
        x[held] += toward
        x[free] += reach[free] * follow
    new = replace(m, x=x)
    for effect in two:
        new = new.without(effect)
    return new.optimised()


def _imitated(s: CandidateModel) -> Iterator[Effect]:
    """Effects not at work of which the parameters at work do nearly all, the most imitated first."""
    signatures = screened(s, [e for e in s.composition.candidates if not s.at_work(e)])
    alike = sorted((g for g in signatures if 0.0 < g.own < s.settings.imitated), key=lambda g: g.own)
    yield from (g.variant.effect for g in alike[: s.settings.merges])


def _worth(found: Sequence[Found], two: Two) -> float:
    return sum(each.worth for each in found if each.effect in two)
