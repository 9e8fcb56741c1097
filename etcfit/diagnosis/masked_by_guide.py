"""What a guide hides: a sensor whose reading is not where the plate is, or a mistake of the rig.

Far from the data candidates are compared in runs that are drawn along the measured angle. A plate drawn to where a slow
sensor has it has no lag left to show, a clock that is slow leaves it where it was measured, and the parameters have
bent to make up for it. So where the first effect found does not bring the model near its data, the joint fit is made
once more with such an effect in it; of the rig's, with those that promise most in a run that is not drawn.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

from ..estimation.joint_fit import Report, fit_near
from ..estimation.result import FitResult
from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .candidate_model import CandidateModel
from .choice import Choice, Outcome, first_of
from .composition import Effect, carried
from .evidence import is_white
from .loop import Round, screened
from .refit import holds, refit_fully
from .score import Score, score
from .trial import Trial, judged


class Unmasked(NamedTuple):
    """A round that adds an effect hidden by the guide, and the model after it."""

    turned: Round
    model: CandidateModel


def maskable(candidates: Iterable[Effect]) -> tuple[Effect, ...]:
    """The candidates that a run drawn along the measured angle does not show."""
    return tuple(effect for effect in candidates if effect.hidden)


def hidden(result: FitResult, turned: Round, report: Report) -> Unmasked | None:
    """The effect hidden by the guide with which a fit comes nearest to the data; None where none comes near.

    Several may: two gains that read half bend the data much as one gear does. So while more than noise is left the
    next one is tried too.

    Args:
        result: the first fit.
        turned: the first round as it went, after which the model is still far from the data.
        report: progress.
    """
    candidates = (*maskable(turned.before.composition.candidates), *_of_the_rig(result, turned.before))
    found = nearest(_near(candidates, result, turned, report))
    if found is None:
        return None
    trial = trial_of(found.effect, turned.before, found.model)
    why = (
        f"Drawn along the measured angle no effect comes near the data at once. That hides {found.effect.name}, and a "
        f"fit with it comes near them: fitted error x {trial.verdict.fit_rms_ratio:.3f}."
    )
    seen = tuple(g for g in turned.screened if g.variant.effect is found.effect)
    choice = Choice(Outcome.ADDED, found.effect, (), why)
    return Unmasked(replace(turned, screened=seen, trials=(trial,), choice=choice), found.model)


class Near(NamedTuple):
    """A model that came near its data with one effect in it.

    Args:
        effect: which.
        model: refitted.
        left: its chi2 per sample.
        white: whether that is noise.
    """

    effect: Effect
    model: CandidateModel
    left: float
    white: bool


def nearest(found: Iterable[Near]) -> Near | None:
    """The first that leaves nothing but noise, and no further one is asked for then; else the one that leaves least."""
    least = None
    for each in found:
        if each.white:
            return each
        least = each if least is None or each.left < least.left else least
    return least


def _near(candidates: Iterable[Effect], result: FitResult, turned: Round, report: Report) -> Iterator[Near]:
    """Refits with one candidate each that reach the noise, one after the other."""
    for effect in candidates:
        report(f"fitting anew with {effect.name}", 0.9)
        s = fitted_with(effect, result, turned.before, turned.score, report)
        if s is not None:
            yield Near(effect, s, s.chi2_per_sample, is_white(s))


def _of_the_rig(result: FitResult, s: CandidateModel) -> tuple[Effect, ...]:
    """The effects of the rig that promise most in the free run of the first fit, at most `rig_refits` of them, and as
    many of single channels of single traces after them."""
    candidates = [e for e in s.composition.of_the_rig if not s.at_work(e)]
    if not candidates:
        return ()
    free = replace(s, problem=result.problem, weighted=result.weighted, x=result.x).lean()
    found = first_of(screened(free, candidates), s.settings.rig_refits, s.settings)
    return tuple(g.variant.effect for g in found)


def fitted_with(
    effect: Effect,
    result: FitResult,
    before: CandidateModel,
    was: Score,
    report: Report,
    stated: float | None = None,
) -> CandidateModel | None:
    """The model after a joint fit made anew with one effect more; None where it stays far from the data or is worse.

    Where a number of rig.toml is wrong by what is stated, the rig is fitted that has the right one: readings, starts
    and the steps of the integrator are of a rig that can be, and its optimum is where the effect's refit begins.

    Args:
        effect: the one more.
        result: the first fit.
        before: the model that it is to take the place of.
        was: score of that.
        report: progress.
        stated: the effect's first parameter, SI, by the rig's checks; the graph readings and nominal values where None.
    """
    config, first = result.rig.config, parameters_of(effect)[0]
    of_the_rig = effect if issubclass(effect, AbstractRigEffect) else None
    cured = None if stated is None or of_the_rig is None else of_the_rig.cured(config, stated)
    effects = (*config.effects, *(e.name for e in before.added), effect.name)
    rig = replace(result.rig, config=replace(cured or config, effects=effects))
    about = None if stated is None or cured is not None else {first.symbol: stated}
    again = fit_near(rig, report, about=about)
    if again is None:
        return None
    s = before.with_effects((*before.added, effect), again.values)
    x = carried(again.x, again.problem.layout, s.problem.free_parameters, again.values)
    if stated is not None and of_the_rig is not None and cured is not None:
        size = of_the_rig.compounded(stated, again.values[first.symbol])
        x[s.problem.layout.free.index(first.symbol)] = first.domain.coordinate(size)
    s = refit_fully(replace(s, x=x), report)
    return None if s.far or not holds(s, before, was) else s


def trial_of(effect: Effect, before: CandidateModel, s: CandidateModel) -> Trial:
    """The verdict on a model that was fitted anew with an effect, beside the one before it.

    Both are compared under the whitening of the new one: drawn along the angle they would not differ.
    """
    less = s.without(effect)
    less = replace(less, x=carried(before.x, before.problem.layout, less.problem.free_parameters, {}))
    return judged(effect, score(less), s)
