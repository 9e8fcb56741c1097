"""Finds one trace, or one test, that is of another rig: all others agree without it, and it fits a body of its own.

A file that was copied from another throttle changes every parameter, and effects of the catalogue then imitate it. So
where the misfit makes parameters a compromise, the fit is repeated without each of the pieces that are furthest from
it: at first with the weights of a piece set to zero, then, where the others come near their data, from scratch. A piece
is of another rig where hardly more than noise is left without it, where the others' parameters are far from the piece
and some of its own explain it, and where no single effect explains all data as well, neither from the first fit nor
from the others' parameters: a clock that is slow in one test looks like another body there, and so does a torque that
only one test reaches. Where the misfit is small the test is not made, because a body of its own could then imitate any
effect that shows in one trace.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MeasurementError
from ..estimation.contradiction import with_only_weights_of
from ..estimation.identifiability import listed
from ..estimation.intervals import intervals
from ..estimation.joint_fit import Report, finished, fit, fit_near
from ..estimation.levenberg_marquardt import LATE, ROUGH_TOLERANCE, descend
from ..estimation.ready import start_values
from ..estimation.result import FitResult, Optimum
from ..estimation.settings import FitSettings
from ..model.rig_effects import OtherRig, Place
from ..problem import weights
from ..problem.prediction_error import PredictionError, pooled, rows
from ..problem.problem import EstimationProblem
from ..rig.base import Rig
from .candidate_model import CandidateModel
from .choice import first_of
from .composition import carried
from .evidence import is_white
from .findings import RigMistake, SetAside, Statement
from .loop import screened
from .refit import NEAR_CHI2_PER_DOF, refit_fully, start_at
from .settings import DiagnosisSettings
from .statements import Named, statement

_DIFFERS = 3.0  # standard errors from which on a parameter is said to differ
_FORGIVEN = 2  # last steps by which a fit from far off forgives instants; only they are needed here, from a fit
_HOPELESS = 3.0  # times the misfit that counts as near: a descent stopped early may be that far above its end
_LEFT_SHARE = 0.05  # share of the misfit above noise that may remain without a piece: another effect may be there too
_LEFT = 1e-3  # share of the piece's misfit under the others' parameters that may remain under its own parameters
_NAMED = 4  # most parameters that are named as different


@dataclass(frozen=True, eq=False)
class Strange:
    """A piece of the data that is of another rig."""

    place: Place  # the trace, or the test
    rest: FitResult  # the fit to all other data; its config names the piece
    own: FitResult  # the fit to the piece alone
    traces: tuple[SetAside, ...]  # traces of the piece, under the parameters of the others and under its own
    why: str  # a sentence on how it was found

    @property
    def name(self) -> str:
        """Name of the effect."""
        return OtherRig.at(self.place).name

    def statement(self, probability: float, settings: DiagnosisSettings) -> Statement:
        """The statement on it."""
        apart = differences(self.own, self.rest)
        each = [f"{symbol} {100.0 * d:+.3g} %" for symbol, d in list(apart.items())[:_NAMED]]
        differs = listed(each) if each else "parameters that it does not determine"
        said = f"{OtherRig.kind} in {self.place.words}: another throttle body, which differs in {differs}"
        return statement(OtherRig.at(self.place), Named(said, self._mend), probability, {}, settings)

    @property
    def _mend(self) -> str:
        return f"{OtherRig.at(self.place).mend(0.0)}, or take the files out of the folder"

    def mistake(self, stated: Statement) -> RigMistake:
        """The finding; its size is the largest relative difference of a parameter that both fits determine."""
        return RigMistake(
            effect=self.name,
            kind=OtherRig.kind,
            test=self.place.test or None,
            channel=None,
            size=max((abs(d) for d in differences(self.own, self.rest).values()), default=0.0),
            unit="",
            mend=self._mend,
            sentence=stated.sentence,
            file=self.place.file or None,
        )


def of_another_rig(
    result: FitResult,
    s: CandidateModel,
    errors: Sequence[PredictionError],
    report: Report,
    one: CandidateModel | None = None,
) -> Strange | None:
    """The piece that is of another rig; None where no piece is shown to be.

    Args:
        errors: errors of the model's free run, fitted traces; the pieces that it predicts worst are tested.
        one: the model with the single effect that explains most of all data; None where no effect explains anything.
    """
    for places in _pieces(errors, s.settings):
        nearest = min(((_misfit_without(s, place, result), k, place) for k, place in enumerate(places)), default=None)
        if nearest is None or not nearest[0] < NEAR_CHI2_PER_DOF:
            continue
        place = nearest[2]
        report(f"fitting without {place.words}", 0.9)
        found = _shown(result, s, place, report, one)
        if found is not None:
            return found
    return None


def differences(own: FitResult, rest: FitResult) -> dict[str, float]:
    """Relative difference of each parameter that both fits determine and that differs by more than `_DIFFERS` standard
    errors, by symbol, the surest first."""
    mine, theirs, out = intervals(own), intervals(rest), {}
    for symbol, a in mine.items():
        b = theirs.get(symbol)
        if b is None or a.status == "tied" or not a.stderr or not b.stderr or b.value == 0.0:
            continue
        z = abs(a.value - b.value) / np.hypot(a.stderr, b.stderr)
        if z > _DIFFERS:
            out[symbol] = (z, a.value / b.value - 1.0)
    return {symbol: float(d) for symbol, (_, d) in sorted(out.items(), key=lambda item: -item[1][0])}


def _pieces(errors: Sequence[PredictionError], settings: DiagnosisSettings) -> tuple[list[Place], list[Place]]:
    """Traces, and tests of more than one trace, each group with the worst predicted first."""
    tests = {row.test for row in errors}
    files = {row.file: row.test for row in errors}
    if len(files) < 2:
        return [], []
    traces = _worst({Place.named(f): [row for row in errors if row.file == f] for f in files}, settings)
    several = [test for test in tests if [*files.values()].count(test) > 1] if len(tests) > 1 else []
    whole = _worst({Place(test): [row for row in errors if row.test == test] for test in sorted(several)}, settings)
    return traces, whole


def _worst(errors: dict[Place, list[PredictionError]], settings: DiagnosisSettings) -> list[Place]:
    return sorted(errors, key=lambda place: -pooled(errors[place]))[: settings.pieces]


def _misfit_without(s: CandidateModel, place: Place, result: FitResult) -> float:
    """chi2 per degree of freedom of all other traces where they are fitted alone; errors of instants are forgiven less
    and less.

    The descent starts at the model; far from the data, where the piece may have made the parameters useless, it starts
    at the graph readings too.
    """
    problem = _declared(s.lean().problem)
    begins = [(s.x, LATE[-_FORGIVEN:])]
    if s.far:
        free = problem.free_parameters
        values = {**s.values, **start_values(free, result.readings)}
        begins.append((free.layout.off_bounds(free.layout.coordinates(values)), LATE))
    left = np.inf
    for x, steps in begins:
        left = min(left, left_without(problem, x, steps, place, result.settings, NEAR_CHI2_PER_DOF))
        if left < NEAR_CHI2_PER_DOF:
            break
    return left


def left_without(
    problem: EstimationProblem, x: np.ndarray, late: Sequence[float], place: Place, settings: FitSettings, near: float
) -> float:
    """That chi2 at the end of the descents from x, each of which forgives errors of instants up to a given time, s.

    The descents stop where chi2 can no longer come below `near`: forgiving less only increases it.
    """
    left = np.inf
    counted = (t for t in problem.batch.traces if not _is_of(t.measurement.file, place))
    samples = sum(int(np.sum(np.isfinite(trace.data))) for trace in counted)
    for by in late:
        problem = problem.with_integrator_states(x)
        weighted = problem.weighted(weights.forgiving(problem, by))
        others = with_only_weights_of(problem, weighted, lambda trace: not _is_of(trace.measurement.file, place))
        x, _ = descend(problem, x, others, ROUGH_TOLERANCE, settings.steps)
        left = problem.chi2(x, others) / max(1.0, samples - x.size)
        if left > _HOPELESS * near and not problem.controlled:  # a restarted integral of an ECU may still bring it near
            break
    return left


def _is_of(file: str, place: Place) -> bool:
    return file == place.file if place.file else file.startswith(f"{place.test}/")


def _shown(
    result: FitResult, s: CandidateModel, place: Place, report: Report, one: CandidateModel | None
) -> Strange | None:
    """The piece, where the fit without it leaves noise and the fit to it alone succeeds."""
    effects = (*result.rig.config.effects, *(e.name for e in s.added))
    aside = OtherRig.at(place).name
    try:
        rest = fit_near(_with_effects(result, (*effects, aside)), report, result.settings, s.values)
        if rest is None or not explains_misfit(others := start_at(rest, s.settings), result):
            return None
        report(f"fitting {place.words} alone", 0.95)
        alone = _with_effects(result, effects)
        alone = replace(alone, measurements=tuple(m for m in alone.measurements if _is_of(m.file, place)))
        own = fit_near(alone, report, result.settings, rest.values)
    except MeasurementError:  # too few data are left to fit, or the piece alone has too few
        return None
    here = _at(s, rest)
    traces, predicted = here.problem.batch.traces, here.problem.free_run(here.x)
    misfit = pooled([row for row in rows(traces, predicted) if _is_of(row.file, place)]) ** 2
    if misfit < NEAR_CHI2_PER_DOF or own is None:
        return None
    # noise, or a very small share of the misfit: a fit to one trace may stop a little short of its optimum
    if own.chi2_per_dof > max(result.settings.contradiction.compromise, min(_LEFT * misfit, NEAR_CHI2_PER_DOF)):
        return None
    # sum of squares of two bodies, and the BIC cost of the P parameters of the second: P ln n
    second = start_at(own, s.settings)
    samples = others.weighted.samples + second.weighted.samples
    apart = others.chi2 + second.chi2 + second.x.size * float(np.log(samples))
    if (one is not None and _explains_all(one, result, apart)) or _one_effect_does(here, result, apart, report):
        return None
    itself = finished(own)
    if s.added:  # they may have imitated the piece
        theirs = fit(_with_effects(result, (*result.rig.config.effects, aside)), report, result.settings, rest.values)
    else:
        theirs = finished(rest)
    why = f"Without {place.words} the misfit is gone, and a throttle body of its own explains it: it is set aside."
    aside_traces = tuple(
        SetAside(trace, shown, itself.predicted[trace.measurement.file])
        for trace, shown in zip(traces, predicted, strict=True)
        if _is_of(trace.measurement.file, place)
    )
    return Strange(place, theirs, itself, aside_traces, why)


def _at(s: CandidateModel, rest: Optimum) -> CandidateModel:
    """The model of all data with the parameters of all others, run free, every sample with its own noise."""
    lean = s.lean()
    x = carried(rest.x, rest.problem.layout, lean.problem.free_parameters, rest.values)
    problem = _declared(lean.problem)
    return replace(lean, problem=problem, weighted=problem.weighted(weights.forgiving(problem)), x=x)


def _declared(problem: EstimationProblem) -> EstimationProblem:
    """The problem without a guide, every sample weighed by its declared noise."""
    return replace(problem.guided(0.0), sigma=problem.batch.slots.sigma)


def _explains_all(s: CandidateModel, result: FitResult, apart: float) -> bool:
    """Whether a model of all data explains the misfit, and leaves a smaller sum of squares than two bodies would."""
    return explains_misfit(s, result) and s.chi2 < apart


def explains_misfit(s: CandidateModel, result: FitResult) -> bool:
    """Whether a model leaves only noise, or a very small share of the misfit of the first fit."""
    if s.far:
        return False
    excess = _LEFT_SHARE * (result.chi2_per_dof - 1.0)
    nearly = s.chi2_per_sample < min(1.0 + excess, result.settings.contradiction.compromise)
    return nearly or is_white(s)


def _one_effect_does(here: CandidateModel, result: FitResult, apart: float, report: Report) -> bool:
    """Whether a single effect, among those that promise most at the fit to the others, explains all data too.

    Args:
        apart: sum of squares above which a second body explains more.
    """
    settings = here.settings
    candidates = [e for e in here.composition.candidates if not here.at_work(e)]
    for found in first_of(screened(here, candidates), settings.refits + settings.rig_refits, settings):
        effect = found.variant.effect
        report(f"trying {effect.name} instead", 0.95)
        near = here.trying((effect,), found.values).optimised()
        is_near = near.chi2_per_sample < NEAR_CHI2_PER_DOF
        if is_near and _explains_all(refit_fully(near, report), result, apart):
            return True
    return False


def _with_effects(result: FitResult, effects: tuple[str, ...]) -> Rig:
    return replace(result.rig, config=replace(result.rig.config, effects=effects))
