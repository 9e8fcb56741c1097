"""The final model as a fit of its own: run free, its intervals wide enough for ties and for inexact formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimation.accuracy import with_accuracy
from ..estimation.agreement import in_words
from ..estimation.compromise import reason
from ..estimation.free_run import freed
from ..estimation.guide import unlikely
from ..estimation.intervals import Z_95
from ..estimation.joint_fit import Report
from ..estimation.remedies import listed
from ..estimation.result import FitResult, Optimum, Termination, outcome
from .ambiguity import between
from .candidate_model import CandidateModel
from .model_discrepancy import percent_off, spread
from .rounds import Progress


def final_fit(result: FitResult, progress: Progress, report: Report) -> FitResult:
    """The final model as the result of a fit; the first fit itself where nothing was added.

    Args:
        result: the first fit.
        progress: the final model, where one that was guided along the data is let run free, and what is known of its
            effects.
        report: progress in words.
    """
    s = progress.model
    if not s.added:
        return result  # a guided optimum let run free may end worse than the fit that began free
    s = s.lean()
    problem, weighted, x, end = s.problem, s.weighted, s.x, s.end
    if s.far:
        report("letting the final model run free", 0.95)
        known = problem.layout.coordinates({**s.values, **progress.free})
        x = min((x, known), key=lambda at: unlikely(problem, at))
        problem, weighted, x, _ = freed(problem.guided(0.0), x, s.settings.free_spread, result.settings)
        end = Termination(True, "best free run found from the optimum of the guided residual", far=True)
    optimum = Optimum(result.rig, result.readings, problem, s.held_out, weighted, x, end, settings=result.settings)
    after = outcome(optimum)
    return with_accuracy(_widened(after, s, progress))


def _widened(after: FitResult, s: CandidateModel, progress: Progress) -> FitResult:
    """The fit with a covariance that allows for ties and for inexact formulas, and a remark on each."""
    tied = [each for each in progress.found if s.at_work(each.effect) and each.ties]
    even = progress.beside_ties
    unsure = between(s.problem.layout.free, [*(tie for each in tied for tie in each.ties.values()), *even.values()])
    remarks = [
        f"Intervals allow for {each.effect.name} being {listed(e.name for e in each.ties)} instead: a tie."
        for each in tied
    ]
    remarks += [
        f"Intervals allow for {listed(sorted(e.name for e in effects))} being what is missing instead: BIC is even."
        for effects in even
    ]
    formulas, allowed = (), spread(s)
    if allowed.any():
        formulas = tuple(e.name for e in s.added if e.inexact)
        remarks.append(f"Intervals allow for formulas of {listed(formulas)} that are {percent_off(formulas)} off.")
    covariance, warnings = after.covariance + allowed + unsure, (*after.warnings, *remarks)
    wide = replace(
        after, covariance=covariance, exact_covariance=after.covariance, formulas=formulas, warnings=warnings
    )
    return reconciled(wide)


def reconciled(after: FitResult) -> FitResult:
    """The fit, its parameters estimates again where intervals are wide enough for every test that contradicts others.

    A contradiction is measured by noise alone. Where ties and inexact formulas widen the intervals, a fit without that
    test may lie well within them: then it is said, and the parameters are no compromise.
    """
    subsets = after.compromise
    if subsets is None or reason(after.far, after.chi2_per_dof, (), after.settings) is not None:
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
        "intervals, widened as said here, hold what it would become."
        for each in after.contradictions
    )
    warnings = (*(words for words in after.warnings if words not in said), *remarks)
    return replace(after, compromise=None, contradictions=(), warnings=warnings)


def covers(moved: np.ndarray, sd: np.ndarray, sd_without: np.ndarray) -> bool:
    """Whether 95 % intervals hold what each coordinate becomes without a part of the data, as far as that knows it.

        |moved| <= 1.96 sqrt(sd^2 + sd_without^2)

    Args:
        moved: by how much each does, shape (P,).
        sd: standard errors of all the data, widened, shape (P,).
        sd_without: standard errors without the part, shape (P,).
    """
    return bool(np.all(np.abs(moved) <= Z_95 * np.hypot(sd, sd_without)))
