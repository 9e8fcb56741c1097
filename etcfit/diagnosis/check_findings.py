"""What the rig's checks found before any fit is tried first, each from the value that the check states.

A check reads a mistake of the rig off the records alone: the ratio of two back-EMF constants is twice the gear ratio
given, the circuit of one test has 1.2 ohm more than that of another. A fit that does not know of it ends in a
compromise, or in another valley, from which no linear screening leads to the mistake. So where the first fit is far
from its data, the joint fit is made anew with each effect that a finding states, from the value that it states.
"""

from __future__ import annotations

from ..estimation.joint_fit import Report
from ..estimation.result import FitResult
from .choice import Choice, Outcome, stands
from .composition import Effect
from .exchange import Found
from .loop import Round
from .masked_by_guide import fitted_with, trial_of
from .rounds import Progress, reported
from .score import score


def first_from_checks(result: FitResult, progress: Progress, report: Report) -> Progress:
    """The progress with each effect added that a finding of the rig's checks states, where a fit with it stands.

    Args:
        result: the first fit, whose rig has the findings.
        progress: so far; a round is added for each effect.
        report: progress in words.
    """
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
    if not stands(trial.verdict, before.settings):
        return progress
    why = (
        f"The rig's checks found {effect.name} before any fit, and a fit with it stands: fitted error x "
        f"{trial.verdict.fit_rms_ratio:.3f}."
    )
    turned = Round(before, was, (), (trial,), Choice(Outcome.ADDED, effect, (), why))
    return Progress(s, (*progress.found, Found.of(turned)), (*progress.rounds, reported(turned)), progress.changed)
