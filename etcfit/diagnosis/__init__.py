"""Close the loop: find what the model lacks, add it, and say how much better it gets on traces it never saw."""

from __future__ import annotations

from dataclasses import replace

from ..estimation.joint_fit import Report, freed, quiet
from ..estimation.remedies import listed
from ..estimation.result import FitResult, Termination, outcome
from ..problem.prediction_error import pooled
from .ambiguity import between
from .evidence import evidence
from .exchange import Found, exchanged, pruned
from .findings import Candidate, Diagnosis, RoundReport, Tie, Unexplained
from .loop import ROUNDS, Round, refit_fully, start, turn
from .masked_by_guide import hidden
from .missing_torque import motions
from .model_discrepancy import blur, percent_off, spread
from .trial import CandidateModel, clearly_worse
from .unexplained import outdone, unexplained

__all__ = ["Diagnosis", "diagnose"]

_SPREAD = 0.1  # of the search about the optimum of a guided residual, in units of each coordinate's reach


def diagnose(result: FitResult, report: Report = quiet) -> Diagnosis:
    """Trace the residual of a fit to the effects that its model lacks.

    Args:
        result: a fit, of Eqs. 1-2 or of whatever rig.toml names.
        report: called with what is going on and the share done.
    Returns:
        the rounds, the effects found, what no effect explains, and the fits before and after.
    """
    report("composing the model of all effects", 0.0)
    first = start(result)
    rounds: list[RoundReport] = []
    s, found = _forward(result, first, (), rounds, report)
    s, found, instead = exchanged(s, found, report)
    if instead:
        s, found = _forward(result, s, found, rounds, report)
    s, removed = pruned(s, report)
    left = outdone(result, first, s, report)
    if left is not None:
        s = first
    elif rounds[-1].candidates and not rounds[-1].evidence.white:
        left = unexplained(result, s, {each.effect: each.worth for each in found}, report)
    report("the fit of the final model", 0.95)
    after = _final(result, s, found, report)
    if s.added and _astray(after, result):
        names = listed(e.name for e in s.added)
        removed = (*removed, f"Run free, the model with {names} is further from the data: all taken away again.")
        s = first
        left = unexplained(result, s, {}, report)
        after = _final(result, s, (), report)
    doubts = left.doubts if left else ()
    added = tuple(e.name for e in s.added if e.name not in doubts)
    along = (*motions(first, s, False), *(motions(first, s, True) if s.holdout else ()))
    known = tuple(e.name for e in first.composition.known if e.off is not None)
    final = (*known, *(e.name for e in s.added))
    ties = tuple(_tie(each) for each in found if each.ties and s.at_work(each.effect))
    verdict = _verdict(added, ties, left, rounds)
    changed = (*instead, *removed)
    return Diagnosis(result, after, known, final, tuple(rounds), added, changed, ties, left, along, verdict)


def _astray(after: FitResult, before: FitResult) -> bool:
    """Run free, the final model predicts what was held out (what was fitted, where nothing was) worse than the first.

    Far from the data effects are judged in a guided residual, which a wrong one may lower too.
    """
    end, beginning = (pooled(result.score_holdout or result.score_fit) for result in (after, before))
    return clearly_worse(end, beginning)


def _forward(
    result: FitResult, s: CandidateModel, found: tuple[Found, ...], rounds: list[RoundReport], report: Report
) -> tuple[CandidateModel, tuple[Found, ...]]:
    """Round after round from s until one adds nothing; each is appended to `rounds`."""
    while len(rounds) < ROUNDS:
        told = _in_stage(report, f"round {len(rounds) + 1}", len(rounds))
        turned, new = _settled(turn(s, told, blur(result, s)), told)
        if not rounds and new.far:
            turned, new = hidden(result, turned, told) or (turned, new)
        s = new
        rounds.append(_reported(turned))
        report(f"round {len(rounds)}: {turned.why}", (len(rounds) - 0.5) / ROUNDS)
        if turned.added is None:
            break
        found = (*found, Found.of(turned))
    return s, found


def _tie(found: Found) -> Tie:
    group = (found.effect, *found.ties)
    told_by = "; ".join(f"{e.name}: {e.told_by}" for e in group)
    return Tie(tuple(e.name for e in group), tuple(each.residual for each in found.ties.values()), told_by)


def _settled(turned: Round, report: Report) -> tuple[Round, CandidateModel]:
    """The model that a round leaves behind, refitted in full; one that ends further from the data takes nothing in."""
    if turned.added is None:
        return turned, turned.before
    new = refit_fully(turned.best.standing, report)
    if new.holds(turned.before, turned.score):
        return turned, new
    why = f"{turned.why} Refitted in full with it the model is further from the data: it is not added."
    return replace(turned, added=None, ties=(), why=why), turned.before


def _in_stage(report: Report, stage: str, turn: int) -> Report:
    return lambda text, share: report(f"{stage}: {text}", (turn + share) / ROUNDS)


def _reported(turned: Round) -> RoundReport:
    refitted = {v.effect: v for v in turned.verdicts}
    candidates = []
    for g in turned.screened:
        v = refitted.get(g.variant.effect)
        bare = Candidate(g.variant.effect.name, g.gain, g.own, v is not None)
        candidates.append(bare if v is None else replace(
            bare, fit_rms_ratio=v.fit_rms_ratio, holdout_rms_ratio=v.holdout_rms_ratio,
            holdout_chi2_change=v.holdout_chi2_change, bic_change=v.bic_change))  # fmt: skip
    candidates.sort(key=lambda c: (c.bic_change is None, c.bic_change or -c.screened))
    return RoundReport(
        tuple(e.name for e in turned.before.added), evidence(turned.before), turned.score.fit_rms,
        turned.score.holdout_rms, tuple(candidates),
        turned.added.name if turned.added else None, tuple(e.name for e in turned.ties), turned.why,
    )  # fmt: skip


def _final(result: FitResult, s: CandidateModel, found: tuple[Found, ...], report: Report) -> FitResult:
    """The final model as a fit of its own; one that was guided along the data is let run free."""
    if not s.added:
        return result  # a guided optimum let run free may end worse than the fit that began free
    problem, weighted, x, end = s.problem, s.weighted, s.x, s.end
    if s.far:
        report("letting the final model run free", 0.95)
        problem, weighted, x = freed(problem.guided(0.0), x, _SPREAD)
        end = Termination(True, "best free run found from the optimum of the guided residual", far=True)
    after = outcome(result.rig, result.readings, problem, s.held_out, weighted, x, (), end, ())
    tied = [each for each in found if s.at_work(each.effect) and each.ties]
    unsure = between(s, (tie for each in tied for tie in each.ties.values()))
    remarks = [
        f"Intervals allow for {each.effect.name} being {listed(e.name for e in each.ties)} instead: a tie."
        for each in tied
    ]
    formulas, allowed = (), spread(s)
    if allowed.any():
        formulas = tuple(e.name for e in s.added)
        remarks.append(f"Intervals allow for formulas of {listed(formulas)} that are {percent_off(formulas)} off.")
    covariance, warnings = after.covariance + allowed + unsure, (*after.warnings, *remarks)
    return replace(
        after, covariance=covariance, exact_covariance=after.covariance, formulas=formulas, warnings=warnings
    )


def _verdict(
    added: tuple[str, ...], ties: tuple[Tie, ...], left: Unexplained | None, rounds: list[RoundReport]
) -> tuple[str, ...]:
    """The whole in a few sentences."""
    words = []
    if added:
        words.append(f"The model lacked {listed(added)}.")
    elif rounds[0].evidence.white:
        words.append("The residual is noise: the model lacks nothing that these data show.")
    else:
        words.append("No effect of the catalogue is proven by these data.")
    words += [
        f"{' and '.join(tie.effects)} cannot be told apart by these data: their fits differ by at most "
        f"{max(tie.apart):.2g} times the noise."
        for tie in ties
    ]
    if left is not None:
        words.append(left.sentence)
    elif not rounds[-1].candidates:
        words.append(rounds[-1].why)
    elif not rounds[-1].evidence.white:
        words.append("The residual is not all noise, but nothing that was tried explains what is left.")
    return tuple(words)
