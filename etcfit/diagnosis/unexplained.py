"""What no effect of the catalogue explains: a smooth unknown in its place, and the names it puts in doubt.

A named effect keeps its name only where it explains nearly as much as a curve that is free to take any shape.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..estimation.joint_fit import Report
from ..estimation.result import FitResult
from ..model.effects import fraction
from ..model.smooth import UNKNOWNS, AbstractSmooth
from .composition import Effect, compose
from .findings import Unexplained
from .loop import STRONG, promises, refit_fully, screened
from .missing_torque import pull_of, signals
from .screen import Signature
from .trial import CandidateModel, Score, TrialVerdict, compare, score

_REFITS = 1
_KEEPS = 0.9  # share of what a free curve explains, from which on a named effect keeps its name
_SURE = _KEEPS / (1.0 - _KEEPS)  # an effect that explained so many times more than a curve beside it would add keeps it
_MUCH = 1.5  # chi2 per sample of the final model above which its effects are asked whether one curve does more
_HOLDS = 0.8  # share of the log-likelihood that one curve gains, from which on all effects together keep their names
_POINTS = 60  # of the curve that is drawn


def unexplained(
    result: FitResult, s: CandidateModel, worth: Mapping[Effect, float], report: Report
) -> Unexplained | None:
    """The smooth curve that the residual asks for most; None where it is not worth its parameters.

    Args:
        result: the first fit.
        s: the final model, at its optimum.
        worth: by how much BIC fell when each effect was added.
        report: progress.
    """
    report("looking for structure without a name", 0.9)
    s = widened(result, s)
    before = score(s)
    best = _best(s, before)
    if best is None:
        return None
    # with the effect as well, a curve explains no less than alone: who explained nearly all of both is not in doubt
    little = [e for e in s.added if worth[e] < -_SURE * best.bic_change]
    doubts = tuple(e.name for e in little if _in_doubt(s, e, before))
    return _told(best, doubts)


def outdone(result: FitResult, first: CandidateModel, s: CandidateModel, report: Report) -> Unexplained | None:
    """One smooth curve that does more for the first model than all the effects found together; None where none does.

    Names found one after the other may each imitate a part of something that has none. It is asked where much is left.
    Names that brought a model near its data give way only to a curve that does so too: far from them a guided residual
    is no proof.
    """
    if not s.added or (not s.far and s.left < _MUCH):
        return None
    report("asking whether one curve explains more than all effects found", 0.88)
    bare = widened(result, first)
    before = score(bare)
    curve = _best(bare, before)
    if curve is None:
        return None
    found = s.problem.layout.values(s.x, s.problem.free_parameters.held)
    named = first.with_effects(s.added, found).lean().optimised()
    if np.log(named.chi2 / before.chi2) < _HOLDS * np.log(curve.score.chi2 / before.chi2):  # both are negative
        return None
    if first.far and not s.far and refit_fully(curve.standing, report).spoilt(s):
        return None
    return _told(curve, tuple(e.name for e in s.added))


def widened(result: FitResult, s: CandidateModel) -> CandidateModel:
    """The same model in a composition of its own effects and the smooth unknowns."""
    return s.within(compose(result.rig, s.problem.batch.traces, UNKNOWNS, s.added), s.added, {}).lean()


Smooth = type[AbstractSmooth]


def _smooth(s: CandidateModel) -> list[Effect]:
    return [e for e in s.composition.candidates if issubclass(e, AbstractSmooth)]


def _best(s: CandidateModel, before: Score) -> TrialVerdict | None:
    """The smooth unknown that helps most, if any is worth it."""
    verdicts = [_tried(s, g, before) for g in screened(s, _smooth(s))[:_REFITS] if promises(g, before)]
    worth = [v for v in verdicts if v.bic_change < STRONG and v.helps_elsewhere()]
    return min(worth, key=lambda v: v.bic_change, default=None)


def _tried(s: CandidateModel, g: Signature, before: Score) -> TrialVerdict:
    trial = s.trying(g.variant.effect, g.values).lean().optimised()
    seen = sum(np.any(g.columns != 0.0, axis=0))
    return compare(g.variant.effect, before, trial, int(seen), len(UNKNOWNS))


def _in_doubt(s: CandidateModel, effect: Effect, here: Score) -> bool:
    """True where a free curve explains clearly more than a named effect does."""
    less = s.without(effect).lean().optimised()
    bare = score(less)
    curve = _best(less, bare)
    if curve is None:
        return False
    named, free = np.log(here.chi2 / bare.chi2), np.log(curve.score.chi2 / bare.chi2)
    return bool(named > _KEEPS * free)  # both are negative


def _told(best: TrialVerdict, doubts: tuple[str, ...]) -> Unexplained:
    """The curve over the range that was measured, with its standard deviation."""
    s, effect = best.standing, best.effect
    assert issubclass(effect, AbstractSmooth)
    problem, layout, axis = s.problem, s.problem.layout, effect.along
    values = layout.values(s.x, problem.free_parameters.held)
    curve = effect(**{symbol: float(values[symbol]) for symbol in effect.symbols})
    low, high = _range(s, effect)
    where = np.linspace(low, high, _POINTS)
    shape = np.asarray(curve.shape(where))
    sd = _sd(s, effect, where)
    size = float(np.sqrt(np.mean((shape - shape.mean()) ** 2)))
    rows = best.score
    held = "" if best.holdout_rms_ratio is None else f", held-out error x {best.holdout_rms_ratio:.3f}"
    doubt = f" It explains the data better than {' and '.join(doubts)}, which are not proven." if doubts else ""
    sentence = (
        f"What is left enters as {effect.enters} and depends on {effect.axis}: a curve of {size:.3g} {effect.unit} rms "
        f"(fitted error x {best.fit_rms_ratio:.3f}{held}, BIC {best.bic_change:+.0f}).{doubt}"
    )
    return Unexplained(
        effect.enters, effect.axis, effect.unit, axis.unit, where, shape, sd, size, best.fit_rms_ratio,
        best.holdout_rms_ratio, best.bic_change, rows.fit_rows, rows.holdout_rows, doubts, sentence,
    )  # fmt: skip


def _range(s: CandidateModel, effect: Smooth) -> tuple[float, float]:
    """What of the axis was measured."""
    along = signals(s.problem, s.x, pull_of(s.problem, s.x))
    name = effect.axis
    moving = np.concatenate([a[name][np.isfinite(a["torque"])] for a in along])
    values = moving if moving.size else np.concatenate([a[name] for a in along])
    if name == "angle":
        values = np.asarray(fraction(values, *s.problem.config.travel))
    if effect.along.low >= 0.0:
        values = np.abs(values)
    return float(np.min(values)), float(np.max(values))


def _sd(s: CandidateModel, effect: Smooth, where: np.ndarray) -> np.ndarray:
    """Standard deviation of the curve: its hats are linear in the amplitudes."""
    r, _, jacobian = s.problem.linearise(s.x, s.weighted)
    flat = jacobian.reshape(-1, s.x.size)
    unit = max(1.0, float(np.sum(r**2)) / s.weighted.samples)
    covariance = unit * np.linalg.pinv(flat.T @ flat, rcond=1e-12, hermitian=True)
    free, scale = s.problem.layout.free, [s.problem.layout.parameter(c).domain.scale for c in effect.symbols]
    rows = [free.index(c) for c in effect.symbols]
    hats = np.stack([np.asarray(effect(**_one(effect, k)).shape(where)) for k in range(len(rows))], axis=1) * scale
    spread = hats @ covariance[np.ix_(rows, rows)] @ hats.T
    return np.sqrt(np.maximum(np.diag(spread), 0.0))


def _one(effect: Smooth, k: int) -> dict[str, float]:
    return {symbol: float(n == k) for n, symbol in enumerate(effect.symbols)}
