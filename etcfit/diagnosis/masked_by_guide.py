"""What a guide hides: a sensor whose reading is not where the plate is.

Far from the data candidates are compared in runs that are drawn along the measured angle. A plate drawn to where a slow
sensor has it has no lag left to show, and the parameters have bent to make up for it. So where the first effect found
does not bring the model near its data, the joint fit is made once more with such an effect in it.
"""

from __future__ import annotations

from dataclasses import replace

from ..estimation.joint_fit import Report, fit
from ..estimation.result import FitResult
from .composition import Effect, carried
from .loop import Round, judged, refit_fully
from .trial import CandidateModel, score


def hidden(result: FitResult, turned: Round, report: Report) -> tuple[Round, CandidateModel] | None:
    """A round that adds the effect with which a fit comes near the data, and the model then; None where none does.

    Args:
        result: the first fit.
        turned: the first round as it went, after which the model is still far from the data.
        report: progress.
    """
    for effect in turned.before.composition.candidates:
        if effect.hidden:
            report(f"fitting anew with {effect.name}", 0.9)
            s = _with(result, turned, effect, report)
            if s is not None:
                return _round(turned, s, effect), s
    return None


def _with(result: FitResult, turned: Round, effect: Effect, report: Report) -> CandidateModel | None:
    config = result.rig.config
    again = fit(replace(result.rig, config=replace(config, effects=(*config.effects, effect.name))), report)
    if again.far:
        return None
    s = turned.before.with_effects((effect,), again.values)
    s = refit_fully(
        replace(s, x=carried(again.x, again.problem.layout, s.problem.free_parameters, again.values)), report
    )
    return None if s.far or not s.holds(turned.before, turned.score) else s


def _round(turned: Round, s: CandidateModel, effect: Effect) -> Round:
    """Both models are compared as the better one whitens: drawn along the angle they would not differ."""
    first, less = turned.before, s.without(effect)
    less = replace(less, x=carried(first.x, first.problem.layout, less.problem.free_parameters, {}))
    verdict = judged(effect, score(less), s)
    why = (
        f"Drawn along the measured angle no effect comes near the data at once. That hides {effect.name}, and a fit "
        f"with it comes near them: fitted error x {verdict.fit_rms_ratio:.3f}."
    )
    seen = tuple(g for g in turned.screened if g.variant.effect is effect)
    return replace(turned, screened=seen, verdicts=(verdict,), added=effect, ties=(), why=why)
