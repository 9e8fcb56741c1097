"""The course of a diagnosis: rounds, exchanges, sets of effects, data of another rig, final fit, statements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimation.agreement import compromise_reason, in_words
from ..estimation.free_run import free_run_cost, freed
from ..estimation.identifiability import listed
from ..estimation.intervals import Z_95, with_accuracy
from ..estimation.joint_fit import Report, quiet
from ..estimation.result import FitResult, Optimum, Termination, outcome
from ..rig.base import SLOW_LOG
from .candidate_model import CandidateModel
from .credit import UNSAID, doubted_effects, largest_probability
from .evidence import is_white, motions
from .faint_effects import allowing_for_faint_effects
from .findings import Diagnosis, Question, SetTried, Unexplained
from .formula_errors import formula_covariance, percent_off
from .free_sets import FREE_SPREAD, searched_free
from .other_rig import Strange, explains_misfit, of_another_rig
from .probabilities import SOMETHING_ELSE, named_effects, with_effect_before_rounds
from .refit import held_out_shows_noise, start
from .rounds import Keep, Progress, first_from_checks, forward, keep_nothing, looked_back
from .score import score, tie_covariance
from .settings import DEFAULT, DiagnosisSettings
from .statements import rig_mistakes, runs_free_worse, statements, tie, verdict
from .unexplained import Allowed, allowing_for_the_rest, unexplained

# ---- The final model as a fit of its own: run free, its intervals wide enough for ties and for inexact formulas


def final_fit(result: FitResult, progress: Progress, report: Report) -> FitResult:
    """The final model as the result of a fit; the first fit itself where nothing was added.

    Args:
        progress: the final model and what is known of its effects; a model that was guided along the data is fitted
            free-running.
    """
    s = progress.model
    if not s.added:
        return result  # a guided optimum let run free may end worse than the fit that began free
    s = s.lean()
    problem, weighted, x, end = s.problem, s.weighted, s.x, s.end
    if s.far:
        report("fitting the final model free-running", 0.95)
        known = problem.layout.coordinates({**s.values, **progress.free})
        x = min((x, known), key=lambda at: free_run_cost(problem, at))
        problem, weighted, x, _ = freed(problem.guided(0.0), x, FREE_SPREAD, result.settings)
        end = Termination(True, "best free run found from the optimum of the guided residual", far=True)
    optimum = Optimum(result.rig, result.readings, problem, s.held_out, weighted, x, end, settings=result.settings)
    after = outcome(optimum)
    return with_accuracy(_widened(after, s, progress))


def _widened(after: FitResult, s: CandidateModel, progress: Progress) -> FitResult:
    """The fit with a covariance that allows for ties and for inexact formulas, and a remark on each."""
    tied = [each for each in progress.found if s.at_work(each.effect) and each.ties]
    unsure = tie_covariance(s.problem.layout.free, [tie for each in tied for tie in each.ties.values()])
    remarks = [
        f"Intervals allow for {each.effect.name} being {listed(e.name for e in each.ties)} instead: a tie."
        for each in tied
    ]
    formulas, allowed = (), formula_covariance(s)
    if allowed.any():
        formulas = tuple(e.name for e in s.added if e.inexact)
        remarks.append(f"Intervals allow for formulas of {listed(formulas)} that are {percent_off(formulas)} off.")
    covariance, warnings = after.covariance + allowed + unsure, (*after.warnings, *remarks)
    wide = replace(
        after, covariance=covariance, exact_covariance=after.covariance, formulas=formulas, warnings=warnings
    )
    return reconciled(wide)


def reconciled(after: FitResult) -> FitResult:
    """The fit; its parameters count as estimates again where the intervals cover every test that contradicts others.

    A contradiction is measured by noise alone. Where ties and inexact formulas widen the intervals, a fit without that
    test may lie well within them: then a warning says so, and the parameters are no compromise.
    """
    subsets = after.compromise
    if subsets is None or compromise_reason(after.far, after.chi2_per_dof, (), after.settings) is not None:
        return after
    sd = np.sqrt(np.diag(after.covariance))
    for each in after.contradictions:
        k = subsets.without.index(each.test)
        if not covers(subsets.points[k] - after.x, sd, np.sqrt(np.diag(subsets.covariances[k]))):
            return after
    layout = after.free_parameters.layout
    said = {in_words(each, layout.parameter(each.parameter).unit) for each in after.contradictions}
    remarks = (
        f"Without {each.test} {each.parameter} would move by {abs(each.pull):.2g} standard errors of noise alone; the "
        "widened intervals hold the value that it would then have."
        for each in after.contradictions
    )
    warnings = (*(words for words in after.warnings if words not in said), *remarks)
    return replace(after, compromise=None, contradictions=(), warnings=warnings)


def covers(moved: np.ndarray, sd: np.ndarray, sd_without: np.ndarray) -> bool:
    """Whether 95 % intervals hold the value of each coordinate that a fit without a part of the data gives.

        |moved| <= 1.96 sqrt(sd^2 + sd_without^2)

    Args:
        moved: change of each coordinate, shape (P,).
        sd: standard errors of all the data, widened, shape (P,).
        sd_without: standard errors without the part, shape (P,).
    """
    return bool(np.all(np.abs(moved) <= Z_95 * np.hypot(sd, sd_without)))


# ---- the course


def diagnose(
    result: FitResult,
    report: Report = quiet,
    settings: DiagnosisSettings = DEFAULT,
    begun: Progress | None = None,
    keep: Keep = keep_nothing,
) -> Diagnosis:
    """Trace the residual of a fit to the effects that its model lacks.

    Args:
        result: a fit, of Eqs. 1-2 or of whatever rig.toml names.
        report: called with the current step in words and the share done, from 0 to 1.
        settings: the thresholds and limits of the diagnosis.
        begun: rounds that a diagnosis of this fit, with these settings, made before it was interrupted.
        keep: called with the progress after each round, to store it.
    Returns:
        the rounds, the effects found, what no effect explains, and the fits before and after.
    """
    report("listing the effects that these data could show", 0.0)
    first = start(result, settings)
    progress, strange = (begun, None) if begun is not None else _simplest(result, Progress(first), report)
    if strange is not None:
        return _diagnosis_without_piece(strange, result, report, settings)
    keep(progress)
    if not progress.is_at_an_end:
        progress = forward(result, progress, report, keep=keep)
    progress = looked_back(result, progress, report)
    sets: tuple[SetTried, ...] = ()
    if first.far and progress.model.far:
        progress, sets = searched_free(result, first, progress, report)
    if progress.model.added and _astray(progress.model, result):
        strange = of_another_rig(result, progress.model, score(progress.model).fit_rows, report)
        if strange is not None:
            return _diagnosis_without_piece(strange, result, report, settings)
    left = None if progress.rounds[-1].evidence.white else unexplained(result, progress.model, report)
    report("the fit of the final model", 0.95)
    after = final_fit(result, progress, report)
    worse = progress.model.added and runs_free_worse(after, result, settings)
    if worse and not held_out_shows_noise(progress.model, first):
        added = listed(e.name for e in progress.model.added)
        why = f"Run free, the model with {added} is further from the data: all these effects are taken away again."
        progress = progress.back_to(first, why)
        left, after = unexplained(result, first, report), result
    rest = Allowed(after)
    if left is not None or not progress.rounds[-1].evidence.white:
        rest = allowing_for_the_rest(result, after, progress.model, report)
    rest = replace(rest, after=allowing_for_faint_effects(rest.after, progress.model, report))
    return _assembled(result, rest, first, progress, left, sets)


def _simplest(result: FitResult, progress: Progress, report: Report) -> tuple[Progress, Strange | None]:
    """The progress with the simplest explanation that leaves noise, where the misfit makes the parameters a compromise;
    elsewhere the progress unchanged.

    The effects that the rig's checks found are tried first, then any single effect, then a piece of the data that is of
    another rig: data are set aside only where no single effect explains all of them.
    """
    first = progress.model
    if not _astray(first, result):
        return progress, None
    progress = first_from_checks(result, progress, report)
    before = progress.model
    if not _astray(before, result):
        return progress, None
    progress = forward(result, progress, report, most=len(progress.rounds) + 1)
    one = None if progress.is_at_an_end else progress.model
    if one is not None and explains_misfit(one, result) and is_white(one):
        return progress, None
    # a file of another rig can look like a mistake that the checks know: it is sought without their effects first
    strange = of_another_rig(result, first, result.score_fit, report, one)
    if strange is None and before.added:
        strange = of_another_rig(result, before, score(before).fit_rows, report, one)
    return progress, strange


def _astray(s: CandidateModel, result: FitResult) -> bool:
    """Whether the misfit alone makes the parameters a compromise, so that a piece of the data may be of another rig."""
    return s.far or s.chi2_per_sample >= result.settings.contradiction.compromise


def _diagnosis_without_piece(
    strange: Strange, result: FitResult, report: Report, settings: DiagnosisSettings
) -> Diagnosis:
    """The diagnosis of the other data where a piece of the data is set aside, with the statement on that piece."""
    report(strange.why, 0.0)
    rest = diagnose(strange.rest, report, settings)
    likely = largest_probability(strange.name, rest.rounds, rest.unexplained is not None, settings)
    stated = strange.statement(likely, settings)
    mistake = strange.mistake(stated)
    before_rounds = Question("Before any round: what explains the misfit?",
                     {strange.name: stated.probability, SOMETHING_ELSE: 1.0 - stated.probability})  # fmt: skip
    return replace(
        rest,
        before=result,
        start=tuple(name for name in rest.start if name != strange.name),
        added=(strange.name, *rest.added),
        removed=(strange.why, *rest.removed),
        rig=(mistake, *rest.rig),
        aside=(*strange.traces, *rest.aside),
        probabilities=with_effect_before_rounds(strange.name, likely, rest.probabilities),
        questions=(before_rounds, *rest.questions),
        statements=(stated, *rest.statements),
        verdict=(stated.sentence, *rest.verdict),
    )


def _assembled(
    result: FitResult,
    rest: Allowed,
    first: CandidateModel,
    progress: Progress,
    left: Unexplained | None,
    sets: tuple[SetTried, ...],
) -> Diagnosis:
    """All that was found as plain data."""
    s, after, settings = progress.model, rest.after, first.settings
    corrected = left.corrects if left else ()
    fitted = {trace.measurement.test for trace in result.problem.batch.traces}
    slow = any(found.kind == SLOW_LOG and found.test in fitted for found in result.rig.findings)
    present = tuple(e.name for e in s.added)
    doubts = () if s.far else doubted_effects(progress.rounds, present, corrected)
    added, doubts, questions, chance = named_effects(
        progress.rounds, present, doubts, left is not None, settings, slow, corrected
    )
    ties = tuple(tie(each) for each in progress.found if each.ties and each.effect.name in added)
    proven = [e for e in s.added if e.name in added]
    stated = statements(proven, after.values, chance, progress.rounds, questions, settings)
    rig = rig_mistakes(proven, after.values, stated)
    known = tuple(e.name for e in first.composition.known if e.name in result.rig.config.effects)
    return Diagnosis(
        before=result,
        after=after,
        start=known,
        final=(*known, *present),
        rounds=progress.rounds,
        added=added,
        removed=(*progress.changed, *(f"{name} {UNSAID}" for name in doubts)),
        sets=sets,
        ties=ties,
        unexplained=left,
        motions=(*motions(first, s, False), *(motions(first, s, True) if s.holdout else ())),
        rig=rig,
        probabilities=chance,
        questions=questions,
        statements=stated,
        discrepancy=rest.found,
        verdict=verdict(stated, ties, left, progress.rounds, rig),
        settings=settings,
    )
