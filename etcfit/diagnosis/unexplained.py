"""Describes structure that no effect of the catalogue explains as a smooth curve, and widens intervals for the rest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..estimation.free_run import guide_stiffness_of
from ..estimation.identifiability import listed
from ..estimation.joint_fit import Report
from ..estimation.levenberg_marquardt import prior_information
from ..estimation.result import FitResult
from ..model.effects import fraction
from ..model.smooth import UNKNOWNS, AbstractSmooth
from ..problem.cores import concurrently
from .candidate_model import CandidateModel
from .choice import is_accepted, promises
from .composition import Effect, compose
from .evidence import signals
from .findings import Discrepancy, Unexplained
from .formula_errors import step_that_doubles
from .loop import screened
from .random_curves import CURVE_STRETCHES, Curve, CurveDiscrepancy, curve_discrepancy
from .score import Score, score
from .screen import Background, Signature, orthonormal
from .settings import DiagnosisSettings
from .tangents import fitted_samples, stretch_of_samples, tangents_inside, variants
from .trial import Cost, Trial, TrialVerdict, judge_trial

# ---- Structure that no effect of the catalogue explains: a smooth curve


CURVE_REFITS = 1  # smooth curves refitted, the most promising first
_POINTS = 60  # of the curve that is drawn

Smooth = type[AbstractSmooth]


def unexplained(result: FitResult, s: CandidateModel, report: Report) -> Unexplained | None:
    """The smooth curve that explains most of the residual; None where it is not worth its parameters."""
    report("looking for structure without a name", 0.9)
    s = widened(result, s)
    best = _best(s, score(s))
    return None if best is None else _finding(best)


# ---- A curve that corrects the formula of a named effect
#
# c and h are what a named effect and the curve do to the residual, without what the other parameters could do instead.
# The curve corrects that effect's formula where it could be nearly all of the effect, and where the effect's own
# amplitudes could be nearly all of both:
#
#     |P_H c|^2 >= 0.9 |c|^2    and    |(1 - P_E)(c + h)| <= 0.3 |c + h|
#
# P_H and P_E project on what the curve's and the effect's amplitudes do. Then the catalogue lacks no effect: one of its
# formulas is inexact.


ONE_SHAPE = 0.9  # share of the effect that the curve could be
FORMULA_CORRECTION = 0.3  # largest size of a correction, relative to effect and curve


def corrected_formulas(s: CandidateModel, curve: Smooth, jacobian: np.ndarray) -> tuple[str, ...]:
    """Effects of a model with a curve whose formulas that curve corrects; none far from the data.

    Args:
        jacobian: of the residual of the fitted samples, shape (n, P).
    """
    if s.far:
        return ()
    jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
    amplitudes = {e: np.isin(s.problem.layout.free, list(e.off or ())) for e in s.added}
    rest = orthonormal(jacobian[:, ~np.any([*amplitudes.values()], axis=0)])

    def contribution(effect: Effect) -> tuple[np.ndarray, np.ndarray]:
        """What the effect does to the residual, and a basis of what its amplitudes could do."""
        doubled = Background.free_of(rest, jacobian @ step_that_doubles(s, effect))
        return doubled, orthonormal(Background.free_of(rest, jacobian[:, amplitudes[effect]]))

    h, of_curve = contribution(curve)
    named = ((e.name, *contribution(e)) for e in s.added if e is not curve)
    return tuple(name for name, c, of_effect in named if corrects(c, h, of_effect, of_curve))


def corrects(c: np.ndarray, h: np.ndarray, effect: np.ndarray, curve: np.ndarray) -> bool:
    """Whether a curve corrects the formula of an effect.

    Args:
        c, h: what the effect and the curve do to the residual, shape (n,) each.
        effect, curve: orthonormal bases of what their amplitudes do, shape (n, k) each.
    """
    of_its_shape = np.sum(Background.free_of(curve, c) ** 2) <= (1.0 - ONE_SHAPE) * np.sum(c**2)
    both = c + h
    left = np.linalg.norm(Background.free_of(effect, both))
    return bool(of_its_shape and left <= FORMULA_CORRECTION * np.linalg.norm(both))


# ---- decisions


def curves(candidates: Iterable[Effect]) -> list[Smooth]:
    """The smooth curves among the candidates."""
    return [e for e in candidates if issubclass(e, AbstractSmooth)]


def best_curve(verdicts: Sequence[TrialVerdict], settings: DiagnosisSettings) -> int | None:
    """Number of the verdict with the lowest BIC among those accepted; None where none is accepted."""
    good = [k for k, v in enumerate(verdicts) if is_accepted(v, settings)]
    return min(good, key=lambda k: verdicts[k].bic_change, default=None)


# ---- models with a curve


def widened(result: FitResult, s: CandidateModel) -> CandidateModel:
    """The lean model in a composition of its own effects and the smooth curves."""
    composition = compose(result.rig, s.problem.batch.traces, UNKNOWNS, s.added, s.held_out)
    return s.within(composition, s.added, {})


def _best(s: CandidateModel, before: Score) -> Trial | None:
    """The accepted smooth curve that explains most; None where no curve is accepted."""
    likely = screened(s, curves(s.composition.candidates))[:CURVE_REFITS]
    worth_it = [g for g in likely if promises(g, _cost(g), before, s.settings)]
    trials = concurrently(lambda g: _tried(s, g, before), worth_it)
    best = best_curve([t.verdict for t in trials], s.settings)
    return None if best is None else trials[best]


def _tried(s: CandidateModel, g: Signature, before: Score) -> Trial:
    """The trial of a curve."""
    trial = s.trying((g.variant.effect,), g.values).optimised()
    return judge_trial(g.variant.effect, before, trial, _cost(g))


def _cost(g: Signature) -> Cost:
    """The cost of a curve; amplitudes that these data do not show cost nothing."""
    return Cost(g.seen, len(UNKNOWNS))


# ---- the finding


def _finding(best: Trial) -> Unexplained:
    """The curve over the range that was measured, with its standard deviation."""
    s, v, effect = best.model, best.verdict, best.verdict.effect
    assert issubclass(effect, AbstractSmooth)
    curve = effect(**{symbol: s.values[symbol] for symbol in effect.symbols})
    r, jacobian = fitted_samples(s.problem, s.x, s.weighted)
    covariance = covariance_of(r, jacobian, s.weighted.samples)
    rows = [s.problem.layout.free.index(symbol) for symbol in effect.symbols]
    scale = [s.problem.layout.parameter(symbol).domain.scale for symbol in effect.symbols]
    along = signals(s.problem, s.x, guide_stiffness_of(s.problem, s.x))
    where = np.linspace(*measured_range(effect, along, s.problem.config.travel), _POINTS)
    shape = np.asarray(curve.shape(where))
    size = float(np.sqrt(np.mean((shape - shape.mean()) ** 2)))
    held = "" if v.holdout_rms_ratio is None else f", held-out error x {v.holdout_rms_ratio:.3f}"
    corrects = corrected_formulas(s, effect, jacobian)
    correction = f" It corrects the formula of {listed(corrects)}, which is not exact." if corrects else ""
    sentence = (
        f"The rest enters as {effect.enters} and depends on {effect.axis}: a curve of {size:.3g} {effect.unit} rms "
        f"(fitted error x {v.fit_rms_ratio:.3f}{held}, BIC {v.bic_change:+.0f}).{correction}"
    )
    return Unexplained(
        enters=effect.enters,
        depends_on=effect.axis,
        unit=effect.unit,
        axis_unit=effect.along.unit,
        axis=where,
        curve=shape,
        sd=curve_sd(effect, where, covariance[np.ix_(rows, rows)], np.array(scale)),
        size=size,
        fit_rms_ratio=v.fit_rms_ratio,
        holdout_rms_ratio=v.holdout_rms_ratio,
        bic_change=v.bic_change,
        fit=v.score.fit_rows,
        holdout=v.score.holdout_rows,
        sentence=sentence,
        corrects=corrects,
    )


def measured_range(
    effect: Smooth, along: Sequence[Mapping[str, np.ndarray]], travel: tuple[float, float]
) -> tuple[float, float]:
    """Least and largest value of a curve's axis while the plate moved; of all samples where the missing torque is
    unknown everywhere.

    Args:
        along: signals of each trace by name, shape (n,) each; "torque" is NaN where the plate rests.
        travel: closed and open, rad.
    """
    name = effect.axis
    moving = np.concatenate([a[name][np.isfinite(a["torque"])] for a in along])
    values = moving if moving.size else np.concatenate([a[name] for a in along])
    if name == "angle":
        values = np.asarray(fraction(values, *travel))
    if effect.along.low >= 0.0:
        values = np.abs(values)
    return float(np.min(values)), float(np.max(values))


def covariance_of(r: np.ndarray, jacobian: np.ndarray, samples: float) -> np.ndarray:
    """max(1, chi2 / n) (J^T J)^+, shape (P, P).

    Args:
        r: whitened residual, shape (T, L, M).
        samples: n, how many entries hold a sample; the others are 0.
    """
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    unit = max(1.0, float(np.sum(r**2)) / samples)
    return unit * np.linalg.pinv(flat.T @ flat, rcond=1e-12, hermitian=True)


def curve_sd(effect: Smooth, where: np.ndarray, covariance: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """sqrt(diag(H C H^T)), H_jk = scale_k hat_k(a_j): the curve is linear in its K amplitudes.

    Args:
        where: a, values of its axis, shape (n,).
        covariance: C, of the amplitudes' coordinates, shape (K, K).
        scale: amplitude over coordinate, shape (K,).
    Returns:
        shape (n,), in the curve's unit.
    """
    ones = [{symbol: float(n == k) for n, symbol in enumerate(effect.symbols)} for k in range(len(scale))]
    hats = np.stack([np.asarray(effect(**one).shape(where)) for one in ones], axis=1) * scale
    spread = hats @ covariance @ hats.T
    return np.sqrt(np.maximum(np.diag(spread), 0.0))


# ---- Intervals of the final model that allow for what is left in its residual, see `random_curves`


@dataclass(frozen=True, eq=False)
class Allowed:
    """A fit whose intervals allow for the remaining residual, and the curves that it may contain."""

    after: FitResult
    found: tuple[Discrepancy, ...] = ()


def allowing_for_the_rest(result: FitResult, after: FitResult, s: CandidateModel, report: Report) -> Allowed:
    """The final fit with intervals that allow for curves in the remaining residual; the fit unchanged where there are
    none.

    Far from the data the fit is unchanged too: it is a compromise, and the noise is no measure of the residual there.
    """
    if s.far or after.far:
        return Allowed(after)
    report("estimating how far the remaining residual may have moved the parameters", 0.97)
    s = widened(result, s)
    smooth = curves(s.composition.candidates)
    bent = _bent(s, smooth)
    found = tuple(Discrepancy(e.enters, e.axis, bent.sizes[e], e.unit) for e in smooth if e in bent.sizes)
    return Allowed(grown(after, bent.covariance, _words(found)), found) if found else Allowed(after)


def grown(after: FitResult, covariance: np.ndarray, words: str) -> FitResult:
    """The fit with a covariance, shape (P, P), added to all covariances but the one that takes formulas as exact, and a
    remark."""
    exact = after.taken_as_exact().covariance
    budget = None if after.budget is None else replace(after.budget, statistical=after.budget.statistical + covariance)
    warnings = (*after.warnings, words)
    wide = after.covariance + covariance
    return replace(after, covariance=wide, exact_covariance=exact, budget=budget, warnings=warnings)


def _words(found: Sequence[Discrepancy]) -> str:
    each = listed(f"{d.enters} over {d.depends_on} ({d.size:.2g} {d.unit})" for d in found)
    return f"Intervals allow for curves in the remaining residual, which may have moved parameters: {each}."


def _bent(s: CandidateModel, smooth: Sequence[type[AbstractSmooth]]) -> CurveDiscrepancy:
    lean = s.lean()
    r, jacobian = fitted_samples(lean.problem, lean.x, lean.weighted)
    priors = prior_information(lean.problem.layout, lean.x, lean.weighted.prior_sd)
    scales, effects = [variants(e)[0] for e in smooth], {e.name: e for e in smooth}
    each = tangents_inside(lean, scales, lambda v, c: Curve(effects[v.effect.name], np.where(np.isfinite(c), c, 0.0)))
    events = stretch_of_samples(lean.problem, lean.weighted, CURVE_STRETCHES)
    return curve_discrepancy(r, jacobian, priors, each, events)
