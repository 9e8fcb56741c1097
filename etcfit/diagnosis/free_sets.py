"""Sets of effects compared in the free run, where the model stays far from its data.

There the rounds compare effects in a run that a guide draws along the measured angle. Such a run shows little of how an
effect changes the motion of a free plate, so the set that the rounds found need not have the best free run. So it is
compared with the ends of other orders (`orders`). And a further set is grown, from the free run of the first fit: of
the effects that were accepted in any round, the one whose guided start (`free_run.guided_start`, as in a fit of named
effects) has the lowest misfit is taken first, then the next, as long as

    -2 log L = 2 n log(error) + k log n,    n = number of independent samples,

falls by as much as BIC requires of an effect and the held-out free run does not become worse. Of all sets the
likeliest one is kept; where these data do not tell them apart, the one with fewer parameters. The free run of a set is
the better of two searches: from the starts of a fit, and from the free run of the set before.

Source: forward selection (Miller 2002, Subset Selection in Regression, ch. 3); BIC: Schwarz 1978. Differs from source:
n counts independent samples of the residual.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..estimation.free_run import free_run_cost, freed, likeliest_addition, lower_end
from ..estimation.identifiability import listed
from ..estimation.joint_fit import Report, from_own_starts, model_of
from ..estimation.result import FitResult
from ..problem.prediction_error import pooled, rows
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from .candidate_model import CandidateModel
from .choice import TIED_LIKELIHOOD
from .composition import Effect
from .exchange import Found
from .findings import RoundReport, SetTried
from .orders import other_orders
from .refit import refit_fully
from .rounds import Progress
from .score import holdout_worsened, independent
from .settings import DiagnosisSettings

FREE_SPREAD = 0.1  # of the search for the best free run, in units of each coordinate's reach (1: a change of 100 %)


@dataclass(frozen=True, eq=False)
class FreeRun:
    """The best free run of a set of effects."""

    effects: tuple[str, ...]  # names, in the order in which they were added
    problem: EstimationProblem = field(repr=False)  # the fitted traces
    x: np.ndarray  # coordinates, shape (P,)
    unlikely: float  # -log L of all samples, as if they were independent
    count: float  # number of independent samples
    samples: float  # number of all samples
    holdout_rms: float | None  # free-run error of the held-out traces, in sigma; None where there are none

    @property
    def values(self) -> dict[str, float]:
        """SI by symbol."""
        return self.problem.free_parameters.values(self.x)

    @classmethod
    def of_model(
        cls, effects: tuple[str, ...], problem: EstimationProblem, x: np.ndarray, held_out: tuple[Trace, ...]
    ) -> FreeRun:
        """The free run of a model at coordinates x, shape (P,)."""
        free, traces = problem.free_run(x), problem.batch.traces
        left = [(t.data - y) / t.sigma for t, y in zip(traces, free, strict=True)]
        channels = [r[np.isfinite(r[:, m]), m] for r in left for m in range(r.shape[1])]
        beside = problem.for_traces(held_out, x) if held_out else None
        error = None if beside is None else pooled(rows(held_out, beside.free_run(x)))
        samples = float(sum(c.size for c in channels))
        return cls(effects, problem, x, free_run_cost(problem, x), independent(channels), samples, error)


def bic_change(new: FreeRun, old: FreeRun) -> float:
    """Change of BIC from one free run to another.

    2 (u_1 - u_0) n / N + (k_1 - k_0) log n,    n the smaller number of independent samples of N, at least 2
    """
    count = max(2.0, min(new.count, old.count))
    likelihood = 2.0 * (new.unlikely - old.unlikely) * count / old.samples
    return float(likelihood + (new.x.size - old.x.size) * np.log(count))


def preferred(other: FreeRun, own: FreeRun, settings: DiagnosisSettings) -> bool:
    """Whether another set replaces the one kept so far: it is likelier, or as likely with fewer parameters."""
    change = bic_change(other, own)
    if holdout_worsened(other.holdout_rms, own.holdout_rms, settings.refit_rise):
        return False
    return change < -TIED_LIKELIHOOD or (change < TIED_LIKELIHOOD and other.x.size < own.x.size)


def pool(rounds: Sequence[RoundReport], settings: DiagnosisSettings) -> tuple[str, ...]:
    """Names of the effects that were worth their parameters in any round, the likeliest first; `free_pool` at most."""
    best: dict[str, float] = {}
    for candidate in (c for turned in rounds for c in turned.candidates):
        if candidate.bic_change is not None and candidate.bic_change < settings.strong_bic_change:
            best[candidate.effect] = min(candidate.bic_change, best.get(candidate.effect, 0.0))
    return tuple(sorted(best, key=lambda name: best[name]))[: settings.free_pool]


def grown(result: FitResult, names: Sequence[str], report: Report, settings: DiagnosisSettings) -> FreeRun:
    """A set of effects grown from the first fit's free run, one effect after the other."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    known, plan = result.rig.config.effects, result.settings
    here, rest = FreeRun.of_model((), result.problem, result.x, held_out), tuple(names)
    while rest:
        report("growing a set of effects in the free run" + "".join(f", {name}" for name in here.effects), 0.87)
        config = replace(result.rig.config, effects=(*known, *here.effects))
        rigs = {name: replace(result.rig, config=replace(config, effects=(*config.effects, name))) for name in rest}
        models = {name: model_of(rig) for name, rig in rigs.items()}
        best, point = likeliest_addition(here.problem, here.x, models, plan)
        end = lower_end(models[best], from_own_starts(models[best], plan), point, plan)
        new = FreeRun.of_model((*here.effects, best), end.problem, end.x, held_out)
        rest = tuple(name for name in rest if name != best)
        if holdout_worsened(new.holdout_rms, here.holdout_rms, settings.refit_rise):
            continue
        if not bic_change(new, here) < settings.strong_bic_change:
            break
        here = new
    return here


def searched_free(
    result: FitResult, first: CandidateModel, progress: Progress, report: Report
) -> tuple[Progress, tuple[SetTried, ...]]:
    """The progress whose free run is preferred: that of the rounds, one of another order of effects, or one with the
    grown set; and the sets compared."""
    settings, others = first.settings, list(other_orders(result, first, progress, report))
    names = pool([each for end in (progress, *others) for each in end.rounds], settings)
    if not names:
        return progress, ()
    own = best_free_run(progress.model, result)
    tried: list[SetTried] = []
    for end in others:
        run = best_free_run(end.model, result)
        tried.append(_compared(run, own, settings))
        if tried[-1].taken:
            why = _gave_way(own, run)
            progress, own = replace(end, changed=(*end.changed, why)), run
    set_grown = grown(result, names, report, settings)
    found = {e.name: e for e in first.composition.candidates}
    effects = tuple(found[name] for name in set_grown.effects)
    if set(effects) == set(progress.model.added):
        return replace(progress, free=min((set_grown, own), key=lambda run: run.unlikely).values), tuple(tried)
    if effects:
        tried.append(_compared(set_grown, own, settings))
        if tried[-1].taken:
            why = _gave_way(own, set_grown)
            return _in_its_place(progress, effects, set_grown.values, why, report), tuple(tried)
    return replace(progress, free=own.values), tuple(tried)


def best_free_run(s: CandidateModel, result: FitResult) -> FreeRun:
    """The best free run near a model."""
    lean = s.lean()
    run = freed(lean.problem.guided(0.0), lean.x, FREE_SPREAD, result.settings)
    return FreeRun.of_model(tuple(e.name for e in s.added), run.problem, run.x, s.held_out)


def _compared(other: FreeRun, own: FreeRun, settings: DiagnosisSettings) -> SetTried:
    return SetTried(other.effects, bic_change(other, own), preferred(other, own, settings))


def _gave_way(old: FreeRun, new: FreeRun) -> str:
    change = bic_change(new, old)
    if {*old.effects} == {*new.effects}:
        return f"Found in another order, {listed(new.effects)} have a likelier free run (BIC {change:+.1f})."
    before = f"{listed(old.effects)} gave way to" if old.effects else "Nothing was found under the guide; there is"
    return f"{before} {listed(new.effects)}, whose free run is likelier (BIC {change:+.1f})."


def _in_its_place(
    progress: Progress, effects: tuple[Effect, ...], values: Mapping[str, float], why: str, report: Report
) -> Progress:
    """The progress with another set of effects, refitted from these values, SI by symbol."""
    new = refit_fully(progress.model.with_effects(effects, values), report)
    known = {each.effect: each for each in progress.found}
    found = tuple(known.get(e, Found(e, {}, {})).without_ties_to(effects) for e in effects)
    return replace(progress, model=new, found=found, changed=(*progress.changed, why), free=dict(values))
