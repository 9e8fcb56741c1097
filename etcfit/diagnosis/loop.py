"""One round of the diagnosis: screen every effect, refit the best few, choose the one that explains most."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..estimation.joint_fit import Report
from ..model.parameters import parameters_of
from .candidate_model import CandidateModel
from .choice import RIVAL_PROMISE, Choice, deserves_second_trial, in_turn, is_accepted, promising
from .composition import Effect, is_of_the_rig, resting
from .formula_errors import EXACT, FormulaErrors
from .refit import is_no_worse, refit_fully
from .rig_screen import of_whole_tests, screen_of_late, screen_of_single_traces
from .score import Score, baseline, folds, left_out, score
from .screen import Background, Signature, ranked, screen_of_the_rig
from .tangents import Tangents, tangents_inside, variants
from .trial import Cost, Trial, judge_trial, run_trial, second_trial

ROUGH_CHI2 = 1.2  # chi2 per sample after the trial of a rough effect above which a population searches on
STARTS = 4  # variants of an effect from which its refit starts, at most
SURPRISING = 2.0  # fall of chi2 in a trial over the promise, above which the model before is tried from its end too
NOT_ITS_OWN = 0.5  # share of that fall which the model before must reach without the effect to begin the round anew


@dataclass(frozen=True, eq=False)
class Round:
    """One round of the diagnosis."""

    before: CandidateModel  # the model that it began with
    score: Score  # of that model, under its own formula errors (`baseline`)
    screened: tuple[Signature, ...]  # every candidate's signature, the most promising first
    trials: tuple[Trial, ...]  # of the candidates refitted, the lowest BIC first
    choice: Choice  # the effect that is added, and why
    instead: tuple[Choice, ...] = ()  # the choices that would follow without the effects chosen before each of them

    @property
    def added(self) -> Effect | None:
        """The effect that was added."""
        return self.choice.effect

    @property
    def best(self) -> Trial:
        """The trial of the effect that was added.

        Raises:
            LookupError: none was added.
        """
        for trial in self.trials:
            if trial.verdict.effect is self.added:
                return trial
        raise LookupError("no effect was added in this round: test `added` before `best`")


def run_round(s: CandidateModel, report: Report) -> Round:
    """One round; made anew from a deeper optimum of the model before, where the trial of the effect chosen leads to
    one."""
    turned = _one_round(s, report)
    deeper = None if s.far else deeper_optimum(turned, report)
    return turned if deeper is None else _one_round(deeper, report)


def deeper_optimum(turned: Round, report: Report) -> CandidateModel | None:
    """The model before, refitted from where the trial of the effect chosen ended, if that explains most of what the
    effect seemed to explain; None where it does not, or where the effect explains what it promised."""
    effect = turned.added
    promises = [g.gain for g in turned.screened if g.variant.effect is effect]
    if effect is None or not promises or turned.best.verdict.gain < SURPRISING * promises[0]:
        return None
    report(f"refitting without {effect.name}", 0.8)
    less = turned.best.model.without(effect).optimised()
    fall = turned.score.chi2 - score(less, turned.score.errors).chi2
    return less if fall > NOT_ITS_OWN * turned.best.verdict.gain else None


def _one_round(s: CandidateModel, report: Report) -> Round:
    before = baseline(s)
    candidates = [e for e in s.composition.candidates if not s.at_work(e)]
    report(f"screening {len(candidates)} effects", 0.1)
    every = score_candidates(s, candidates, before.errors)
    signatures = ranked(every)
    cost = partial(Cost.of_effect, composition=s.composition)
    chosen = promising(signatures, before, s.far, cost, s.settings)
    starts = {g.variant.effect: [near.values for near in starts_of(g, every)] for g in chosen}
    trials = _refitted(s, {**starts, **_stated(s, starts)}, before, report)
    if s.holdout is None:
        trials = _cross_validated(s, trials)
    # far from the data every sample is weighed by its own residual, so chi2 cannot be compared with noise
    noise = np.inf if s.far else s.weighted.samples
    choices = in_turn([t.verdict for t in trials], s.settings, noise)
    return Round(s, before, signatures, tuple(trials), choices[0], choices[1:])


def screened(s: CandidateModel, candidates: Sequence[Effect]) -> tuple[Signature, ...]:
    """Every candidate's best signature without its columns, the most promising first."""
    return ranked(score_candidates(s, candidates))


def starts_of(best: Signature, every: Sequence[Signature]) -> list[Signature]:
    """The best few variants of an effect. A refit starts from each, because the deepest valley of chi2 is often not the
    one that promises most."""
    rivals = [g for g in every if g.variant.effect is best.variant.effect and g.gain > RIVAL_PROMISE * best.gain]
    return sorted(rivals, key=lambda g: -g.gain)[:STARTS]


def score_candidates(
    s: CandidateModel,
    candidates: Sequence[Effect],
    errors: FormulaErrors = EXACT,
    kept: Callable[[Signature], Signature] = Signature.briefly,
) -> list[Signature]:
    """The signature of every variant of the candidates in the residual.

    Effects of the rig, which act around the throttle and are cheap, are screened together; for those that act in it
    see `inside`.
    """
    every = [e for e in candidates if is_of_the_rig(e)]
    prompt, late = ([e for e in every if e.delays is delays] for delays in (False, True))
    of_the_rig, alone = ([e for e in prompt if (e.scope == "trace") is single] for single in (False, True))
    background = Background.of_model(s.problem, s.x, s.weighted, errors)
    inside = [variant for e in candidates if not is_of_the_rig(e) for variant in variants(e)]
    parameters = {p.symbol: p for p in s.composition.whole.layout.parameters}
    found = tangents_inside(s, inside, lambda variant, each: kept(background.signature(variant, each, parameters)))
    if prompt:
        rigged = s.with_the_rig()
        tangents = Tangents.of_model(rigged.problem, rigged.x, rigged.weighted, of_whole_tests(alone))
        found += screen_of_the_rig(background, tangents, of_the_rig, kept)
        singles = screen_of_single_traces(background, tangents, s.problem, s.x, s.weighted, alone, s.settings)
        found += map(kept, singles)
    if late:
        found += map(kept, screen_of_late(background, s.problem, s.x, s.weighted, late, s.settings))
    return found


def _cross_validated(s: CandidateModel, trials: Sequence[Trial]) -> list[Trial]:
    """The trials; those worth their parameters with the change of chi2 on traces left out in turn."""
    strong = [t.verdict.is_strong(s.settings) for t in trials]
    if not folds(s) or not any(strong):
        return list(trials)
    base = left_out(s)
    return [
        replace(t, verdict=replace(t.verdict, holdout_chi2_change=left_out(t.model) - base)) if good else t
        for t, good in zip(trials, strong, strict=True)
    ]


Starts = Mapping[Effect, Sequence[Mapping[str, float]]]  # values to start refits of an effect from, SI by symbol


def _stated(s: CandidateModel, starts: Starts) -> Starts:
    """Effects that the rig's checks found, each with the value that the check states as the start of its refit.

    They are refitted whatever the screening promises, because a tangent cannot predict a mistake as large as a factor
    of two. An effect whose stated value is 0 keeps the start of the screening, if it has one."""
    out = {}
    for effect, value in s.composition.stated.items():
        if not s.at_work(effect) and (value or effect not in starts):
            out[effect] = [resting(effect) | {parameters_of(effect)[0].symbol: value}]
    return out


def _refitted(s: CandidateModel, starts: Starts, before: Score, report: Report) -> list[Trial]:
    """A trial of each effect, the lowest BIC first; some run in parallel, because each compiles a model of its own."""
    trials = []
    with ThreadPoolExecutor(s.settings.refits_side_by_side) as pool:
        jobs = [pool.submit(_tried, s, effect, each, before, report) for effect, each in starts.items()]
        for k, (effect, job) in enumerate(zip(starts, jobs, strict=True)):
            report(f"refitting with {effect.name}", 0.2 + 0.6 * k / len(starts))
            trials.append(job.result())
    return sorted(trials, key=lambda t: t.verdict.bic_change)


def _tried(
    s: CandidateModel, effect: Effect, starts: Sequence[Mapping[str, float]], before: Score, report: Report
) -> Trial:
    """The trial of an effect, or its second trial where it deserves one and is accepted there."""
    every, settings = [run_trial(s, effect, values, before) for values in starts], s.settings
    trial = min(every, key=lambda t: t.verdict.score.chi2)
    if effect.rough and not s.far and trial.model.chi2_per_sample > ROUGH_CHI2:
        report(f"searching with {effect.name}", 0.7)
        trial = judge_trial(effect, before, trial.model.searched(effect))
    if not deserves_second_trial(trial.verdict, s.far, settings):
        return trial
    report(f"refitting with {effect.name} in full", 0.8)
    again = second_trial(trial, refit_fully(trial.model, report), s, before)
    return again if is_accepted(again.verdict, settings) else trial


def refit_chosen(turned: Round, report: Report) -> tuple[Round, CandidateModel]:
    """The round and the model after it, refitted in full with the effect added.

    Where that is worse than the model before, the next accepted effect is added; where all are worse, the model stays.
    """
    if turned.added is None:
        return turned, turned.before
    words = ""
    for choice in (turned.choice, *turned.instead):
        attempt = replace(turned, choice=replace(choice, why=f"{words}{choice.why}"), instead=())
        new = refit_fully(attempt.best.model, report)
        if is_no_worse(new, turned.before, turned.score):
            return attempt, new
        words = f"{attempt.choice.with_refit_refused().why} "
    return replace(turned, choice=turned.choice.with_refit_refused(), instead=()), turned.before
