"""Runs rounds until one adds no effect; before them it adds effects that the rig's checks found or that a guide
hides."""

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
from .exchange import Found, exchanged, pruned
from .findings import Candidate, RoundReport
from .loop import Round, refit_chosen, run_round, screened
from .refit import is_no_worse, refit_fully, settled
from .score import Score, baseline
from .trial import Trial, judge_trial

# ---- Effects that a guide hides: a sensor that does not show where the plate is, or a mistake of the rig
#
# Far from the data candidates are compared in runs that a guide draws along the measured angle. The guide removes the
# lag that a slow sensor would show, and it places the plate as measured where a clock is slow; the fitted parameters
# have moved to compensate for either. So where the first effect found does not bring the model near its data, the joint
# fit is repeated with each such effect; among effects of the rig, with those that promise most in a run without a
# guide.


MASKED_ROUNDS = 2  # rounds after which a hidden effect is sought: beside none, and beside the first effect found


def maskable(candidates: Iterable[Effect]) -> tuple[Effect, ...]:
    """The candidates that a run guided along the measured angle does not show."""
    return tuple(effect for effect in candidates if effect.hidden)


def find_masked_effect(result: FitResult, turned: Round, report: Report) -> tuple[Round, CandidateModel] | None:
    """A round that adds an effect hidden by the guide, the one with which a fit comes nearest to the data, and the
    model after it; None where no fit comes near.

    Several fits may come near: two gains that read half change the data much as one gear ratio does. So the next effect
    is tried while more than noise is left.

    Args:
        turned: a round after which the model is still far from the data. Effects of the rig are tried in the first
            alone, by the free run of the first fit.
    """
    before = turned.before
    hidden = (e for e in maskable(before.composition.candidates) if not before.at_work(e))
    candidates = (*hidden, *(() if before.added else _of_the_rig(result, before)))
    found = nearest(_near(candidates, result, turned, report))
    if found is None:
        return None
    trial = trial_of(found.effect, turned.before, found.model)
    why = (
        "In runs guided along the measured angle no effect brings the model near the data at once. Such runs hide "
        f"{found.effect.name}; a fit with it comes near them: fitted error x {trial.verdict.fit_rms_ratio:.3f}."
    )
    seen = tuple(g for g in turned.screened if g.variant.effect is found.effect)
    choice = Choice(Outcome.ADDED, found.effect, (), why)
    return replace(turned, screened=seen, trials=(trial,), choice=choice), found.model


class Near(NamedTuple):
    """A model that came near its data with one effect in it."""

    effect: Effect  # the effect
    model: CandidateModel  # the refitted model
    left: float  # its chi2 per sample
    white: bool  # whether its residual is noise


def nearest(found: Iterable[Near]) -> Near | None:
    """The first that leaves only noise (later ones are then not computed); else the one with the smallest chi2."""
    least = None
    for each in found:
        if each.white:
            return each
        least = each if least is None or each.left < least.left else least
    return least


def _near(candidates: Iterable[Effect], result: FitResult, turned: Round, report: Report) -> Iterator[Near]:
    """Refits with one candidate each, in turn; those that come near the data."""
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

    Where a check states that a number of rig.toml is wrong, the rig with the right number is fitted first, so that
    readings, starts and integrator steps are sound; the refit with the effect begins at its optimum.

    Args:
        stated: the effect's first parameter by the rig's checks, SI; None: the graph readings and nominal values.
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
    """The verdict on a model that was fitted anew with an effect, compared with the model before.

    Both are compared under the whitening of the new one, because guided along the angle they would not differ.
    """
    less = s.without(effect)
    less = replace(less, x=carried(before.x, before.problem.layout, less.problem.free_parameters, {}))
    return judge_trial(effect, baseline(less), s)


# ---- Rounds until one adds no effect, and each round as data for the report


@dataclass(frozen=True, eq=False)
class Progress:
    """How far the diagnosis has come."""

    model: CandidateModel  # the model with all added effects
    found: tuple[Found, ...] = ()  # the effects added, in the order found
    rounds: tuple[RoundReport, ...] = ()  # the rounds made so far
    changed: tuple[str, ...] = ()  # a sentence for each effect that gave way to another or was taken away again
    # values of the best known free run of this model, SI by symbol; empty where none is known
    free: Mapping[str, float] = field(default_factory=dict)

    @property
    def is_at_an_end(self) -> bool:
        """Whether the last round added nothing."""
        return bool(self.rounds) and self.rounds[-1].added is None

    def back_to(self, first: CandidateModel, *words: str) -> Progress:
        """The progress with the first model in place of the one reached."""
        return replace(self, model=first, changed=(*self.changed, *words), free={})


Keep = Callable[[Progress], None]  # called with the progress after every round


def keep_nothing(progress: Progress) -> None:
    """Keeps nothing."""


def forward(
    result: FitResult, progress: Progress, report: Report, most: int | None = None, keep: Keep = keep_nothing
) -> Progress:
    """Rounds from here until one adds nothing or `most` are made in all.

    Args:
        most: rounds in all; `rounds` of the settings where None.
        keep: called with the progress after every round that added an effect.
    """
    limit = progress.model.settings.rounds
    most = limit if most is None else min(most, limit)
    while (made := len(progress.rounds)) < most:

        def in_round(text: str, share: float, made: int = made) -> None:
            report(f"round {made + 1}: {text}", (made + share) / limit)

        turned, s = round_and_model(result, progress.model, in_round, made)
        progress = replace(progress, model=s, rounds=(*progress.rounds, reported(turned)))
        report(f"round {made + 1}: {turned.choice.why}", (made + 0.5) / limit)
        if turned.added is None:
            break
        progress = replace(progress, found=(*progress.found, Found.of_round(turned)))
        keep(progress)
    return progress


def round_and_model(result: FitResult, s: CandidateModel, report: Report, made: int) -> tuple[Round, CandidateModel]:
    """One round and the model after it; after a first or second round that stays far from the data, effects that the
    guide hides are tried.

    Args:
        made: rounds before it.
    """
    turned, new = refit_chosen(run_round(s, report), report)
    if made < MASKED_ROUNDS and new.far:
        return find_masked_effect(result, turned, report) or (turned, new)
    return turned, new


def reported(turned: Round) -> RoundReport:
    """A round as plain data: candidates that were tried first, the lowest BIC first of them."""
    tried = {t.verdict.effect: t.verdict for t in turned.trials}
    screened = {g.variant.effect: (g.gain, g.own) for g in turned.screened}
    # an effect that a check found was refitted without a screening: the gain of its refit is reported as its promise
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
        evidence=evidence(turned.before, turned.score.errors),
        fit_rms=turned.score.fit_rms,
        holdout_rms=turned.score.holdout_rms,
        candidates=tuple(candidates),
        added=turned.added.name if turned.added else None,
        ties=tuple(e.name for e in turned.choice.ties),
        why=turned.choice.why,
        beside_formulas=bool(turned.score.errors),
        chi2_per_sample=None if turned.before.far else turned.before.chi2_per_sample,
    )


# ---- Looking back at the end of the rounds


def looked_back(result: FitResult, progress: Progress, report: Report) -> Progress:
    """The progress after effects were exchanged for better ones, with further rounds if one was; effects that are no
    longer worth their parameters are taken away, and the model that remains is fitted to its optimum.

    `found` keeps what is known of the removed effects too.
    """
    s, found, changed, turned = exchanged(progress.model, progress.found, report)
    rounds = (*progress.rounds, *map(reported, turned))
    progress = replace(progress, model=s, found=found, rounds=rounds, changed=(*progress.changed, *changed))
    if changed:
        progress = forward(result, progress, report)
    s, removed = pruned(progress.model, report)
    if s.added:
        s = settled(s, report, result.settings)
    return replace(progress, model=s, changed=(*progress.changed, *removed))


# ---- What the rig's checks found before any fit is tried first, each from the value that the check states
#
# A check finds a mistake of the rig in the records alone: the ratio of two back-EMF constants is twice the given gear
# ratio, or the circuit of one test has 1.2 ohm more than that of another. A fit without the mistake ends in a
# compromise or in another local optimum, from which no linear screening leads to the mistake. So where the first fit is
# far from its data, the joint fit is repeated with each effect that a finding states, from the stated value.


def first_from_checks(result: FitResult, progress: Progress, report: Report) -> Progress:
    """The progress with each effect added that a finding of the rig's checks states, where the fit with it is
    accepted."""
    for effect, value in progress.model.composition.stated.items():
        if not progress.model.at_work(effect):
            progress = _with_effect(effect, value, result, progress, report)
    return progress


def _with_effect(effect: Effect, value: float, result: FitResult, progress: Progress, report: Report) -> Progress:
    """The progress with one more round, which adds the effect; unchanged where the fit with it is not accepted."""
    before = progress.model
    was = baseline(before)
    report(f"fitting with {effect.name}, which the rig's checks found", 0.02)
    s = fitted_with(effect, result, before, was, report, stated=value)
    if s is None:
        return progress
    trial = trial_of(effect, before, s)
    if not is_accepted(trial.verdict, before.settings):
        return progress
    why = (
        f"The rig's checks found {effect.name} before any fit, and a fit with it confirms it: fitted error x "
        f"{trial.verdict.fit_rms_ratio:.3f}."
    )
    turned = Round(before, was, (), (trial,), Choice(Outcome.ADDED, effect, (), why))
    return Progress(
        s, (*progress.found, Found.of_round(turned)), (*progress.rounds, reported(turned)), progress.changed
    )
