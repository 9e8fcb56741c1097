"""Round after round until one adds nothing; before them what the rig's checks found, and what a guide hides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from ..estimation.joint_fit import Report, fit_near
from ..estimation.result import FitResult
from ..model.parameters import parameters_of
from ..model.rig_effects import AbstractRigEffect
from .candidate_model import CandidateModel
from .choice import Choice, Outcome, first_of, is_accepted
from .composition import Effect, carried
from .evidence import evidence, is_white
from .exchange import Found
from .findings import Candidate, RoundReport
from .loop import Round, refit_chosen, run_round, screened
from .model_discrepancy import formula_error_chi2
from .refit import is_no_worse, refit_fully
from .score import Apart, Score, score
from .trial import Trial, judge_trial

# ---- What a guide hides: a sensor whose reading is not where the plate is, or a mistake of the rig
#
# Far from the data candidates are compared in runs that are drawn along the measured angle. A plate drawn to where a
# slow sensor has it has no lag left to show, a clock that is slow leaves it where it was measured, and the parameters
# have bent to make up for it. So where the first effect found does not bring the model near its data, the joint fit is
# made once more with such an effect in it; of the rig's, with those that promise most in a run that is not drawn.


def maskable(candidates: Iterable[Effect]) -> tuple[Effect, ...]:
    """The candidates that a run drawn along the measured angle does not show."""
    return tuple(effect for effect in candidates if effect.hidden)


def find_masked_effect(result: FitResult, turned: Round, report: Report) -> tuple[Round, CandidateModel] | None:
    """A round that adds the effect hidden by the guide with which a fit comes nearest to the data, and the model after
    it; None where none comes near.

    Several may: two gains that read half bend the data much as one gear does. So while more than noise is left the
    next one is tried too.

    Args:
        turned: the first round as it went, after which the model is still far from the data.
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
    return replace(turned, screened=seen, trials=(trial,), choice=choice), found.model


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
    return None if s.far or not is_no_worse(s, before, was) else s


def trial_of(effect: Effect, before: CandidateModel, s: CandidateModel) -> Trial:
    """The verdict on a model that was fitted anew with an effect, beside the one before it.

    Both are compared under the whitening of the new one: drawn along the angle they would not differ.
    """
    less = s.without(effect)
    less = replace(less, x=carried(before.x, before.problem.layout, less.problem.free_parameters, {}))
    return judge_trial(effect, score(less), s)


# ---- Round after round until one adds nothing, and each of them as data for the report


@dataclass(frozen=True, eq=False)
class Progress:
    """How far the diagnosis has come.

    Args:
        model: the model with all that was added.
        found: the effects added, in the order found.
        rounds: those made.
        changed: a sentence for each effect that gave way to another or was taken away again.
        even: other sets of effects that these data do not choose against, and how far their fits are.
        free: values of the best free run of this model that is known, SI by symbol; empty where none is.
    """

    model: CandidateModel
    found: tuple[Found, ...] = ()
    rounds: tuple[RoundReport, ...] = ()
    changed: tuple[str, ...] = ()
    even: Mapping[frozenset[Effect], Apart] = field(default_factory=dict)
    free: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_at_an_end(self) -> bool:
        """Whether the last round added nothing."""
        return bool(self.rounds) and self.rounds[-1].added is None

    @property
    def beside_ties(self) -> dict[frozenset[Effect], Apart]:
        """Of the even sets those that differ from the model's own by more than what is said to be a tie."""
        here = frozenset(self.model.added)
        tied = [frozenset((each.effect, *each.ties)) for each in self.found]
        return {s: apart for s, apart in self.even.items() if not any(s ^ here <= group for group in tied)}

    def back_to(self, first: CandidateModel, *words: str) -> Progress:
        """With the first model in place of the one reached."""
        return replace(self, model=first, changed=(*self.changed, *words), even={}, free={})


Keep = Callable[[Progress], None]  # is given the progress after every round


def keep_nothing(progress: Progress) -> None:
    """Keeps nothing."""


def forward(
    result: FitResult, progress: Progress, report: Report, most: int | None = None, keep: Keep = keep_nothing
) -> Progress:
    """Rounds from here until one adds nothing or `most` are made in all.

    Args:
        most: rounds in all; `rounds` of the settings where None.
        keep: is given the progress after every round that added something.
    """
    limit = progress.model.settings.rounds
    most = limit if most is None else min(most, limit)
    while (made := len(progress.rounds)) < most:

        def in_round(text: str, share: float, made: int = made) -> None:
            report(f"round {made + 1}: {text}", (made + share) / limit)

        turned, s = _round(result, progress.model, in_round, first=not made)
        progress = replace(progress, model=s, rounds=(*progress.rounds, reported(turned)))
        report(f"round {made + 1}: {turned.choice.why}", (made + 0.5) / limit)
        if turned.added is None:
            break
        progress = replace(progress, found=(*progress.found, Found.of_round(turned)))
        keep(progress)
    return progress


def _round(result: FitResult, s: CandidateModel, report: Report, first: bool) -> tuple[Round, CandidateModel]:
    """One round and the model after it; a first one that stays far from the data is asked what the guide hides."""
    turned, new = refit_chosen(run_round(s, report, formula_error_chi2(result.chi2_per_dof, s)), report)
    if first and new.far:
        return find_masked_effect(result, turned, report) or (turned, new)
    return turned, new


def reported(turned: Round) -> RoundReport:
    """A round as plain data: candidates that were tried first, the lowest BIC first of them."""
    tried = {t.verdict.effect: t.verdict for t in turned.trials}
    screened = {g.variant.effect: (g.gain, g.own) for g in turned.screened}
    # one that was refitted without a screening, for a check found it: what the refit gained stands for its promise
    screened |= {effect: (v.gain, 0.0) for effect, v in tried.items() if effect not in screened}
    candidates = []
    for effect, (gain, own) in screened.items():
        v = tried.get(effect)
        bare = Candidate(effect.name, gain, own, v is not None)
        candidates.append(bare if v is None else replace(
            bare, fit_rms_ratio=v.fit_rms_ratio, holdout_rms_ratio=v.holdout_rms_ratio,
            holdout_chi2_change=v.holdout_chi2_change, bic_change=v.bic_change, prior=v.prior))  # fmt: skip
    candidates.sort(key=lambda c: (c.bic_change is None, c.bic_change or -c.screened))
    return RoundReport(
        effects=tuple(e.name for e in turned.before.added),
        evidence=evidence(turned.before),
        fit_rms=turned.score.fit_rms,
        holdout_rms=turned.score.holdout_rms,
        candidates=tuple(candidates),
        added=turned.added.name if turned.added else None,
        ties=tuple(e.name for e in turned.choice.ties),
        why=turned.choice.why,
    )


# ---- What the rig's checks found before any fit is tried first, each from the value that the check states
#
# A check reads a mistake of the rig off the records alone: the ratio of two back-EMF constants is twice the gear ratio
# given, the circuit of one test has 1.2 ohm more than that of another. A fit that does not know of it ends in a
# compromise, or in another valley, from which no linear screening leads to the mistake. So where the first fit is far
# from its data, the joint fit is made anew with each effect that a finding states, from the value that it states.


def first_from_checks(result: FitResult, progress: Progress, report: Report) -> Progress:
    """The progress with each effect added that a finding of the rig's checks states, where a fit with it stands."""
    for effect, value in progress.model.composition.stated.items():
        if not progress.model.at_work(effect):
            progress = _with_effect(effect, value, result, progress, report)
    return progress


def _with_effect(effect: Effect, value: float, result: FitResult, progress: Progress, report: Report) -> Progress:
    """A round more, which adds the effect; the progress as it was where the fit with it does not stand."""
    before = progress.model
    was = score(before)
    report(f"fitting with {effect.name}, which the rig's checks found", 0.02)
    s = fitted_with(effect, result, before, was, report, stated=value)
    if s is None:
        return progress
    trial = trial_of(effect, before, s)
    if not is_accepted(trial.verdict, before.settings):
        return progress
    why = (
        f"The rig's checks found {effect.name} before any fit, and a fit with it stands: fitted error x "
        f"{trial.verdict.fit_rms_ratio:.3f}."
    )
    turned = Round(before, was, (), (trial,), Choice(Outcome.ADDED, effect, (), why))
    return Progress(
        s, (*progress.found, Found.of_round(turned)), (*progress.rounds, reported(turned)), progress.changed
    )
