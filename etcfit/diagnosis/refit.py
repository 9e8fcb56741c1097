"""Refits a model in full, whitens it anew until no parameter moves, and compares it with the model before."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..estimation.free_run import guide_stiffness_of
from ..estimation.joint_fit import MISFIT, Report
from ..estimation.levenberg_marquardt import descend, descend_in_stages
from ..estimation.result import FitResult, Optimum, Termination
from ..estimation.rounds import rounds
from ..estimation.rounds import whitened as fitted_in_rounds
from ..estimation.settings import FitSettings
from ..problem import weights
from ..problem.cores import concurrently
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace
from ..rig.base import Rig
from .candidate_model import CandidateModel
from .composition import compose
from .score import Score, holdout_rms, holdout_worsened
from .settings import DiagnosisSettings
from .trial import SPARED_GAIN, is_noise

REFIT_TOLERANCE = 1e-4  # relative change of chi2 that ends the descent before the first whitening
# chi2 per degree of freedom below which a model that was far from the data counts as near them
NEAR_CHI2_PER_DOF = 10.0
WHITENING_ROUNDS = 10  # most rounds of whitening and refitting
STILL = 0.2  # standard errors: a round of whitening that moves no parameter by more is the last
REWEIGHINGS = 2  # times that the samples are weighed by their residuals, far from the data
VANISHED = 0.02  # share of J_eq below which an inertia has vanished: no motor and no plate is without one
WORSE_CHI2 = 1.5  # chi2 per sample after a full refit over that before, from which on the refit is refused


class Weighed(NamedTuple):
    """Fitted and held-out traces with the weights of their residuals; no holdout where nothing is held out."""

    problem: EstimationProblem
    weighted: WeightedData
    holdout: tuple[EstimationProblem, WeightedData] | None


def _weigh(problem: EstimationProblem, held_out: tuple[Trace, ...], x: np.ndarray, far: bool) -> Weighed:
    """The traces weighed for a model at x: whitened where it is near the data; guided, and each sample weighed by its
    own residual, where it is far."""
    stiffness = guide_stiffness_of(problem, x)

    def one(b: EstimationProblem) -> tuple[EstimationProblem, WeightedData]:
        if not far:
            b = b.guided(0.0)
            return b, b.weighted(b.kalman(x))
        b = weights.discounted(b.guided(stiffness), x)
        return b, b.weighted(weights.free_running(b))

    problem, weighted = one(problem)
    return Weighed(problem, weighted, one(problem.for_traces(held_out, x)) if held_out else None)


def start(result: FitResult, settings: DiagnosisSettings) -> CandidateModel:
    """A fit as the model of the first round, no effect added."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    end = Termination(result.converged, result.reason, far=result.far)
    return _begun(result.rig, result.problem, held_out, result.x, end, settings)


def start_at(optimum: Optimum, settings: DiagnosisSettings) -> CandidateModel:
    """As `start`, from the optimum of a fit whose other results were not computed."""
    end = replace(optimum.end, wander=None)
    return _begun(optimum.rig, optimum.problem, optimum.held_out, optimum.x, end, settings)


def _begun(
    rig: Rig,
    problem: EstimationProblem,
    held_out: tuple[Trace, ...],
    x: np.ndarray,
    end: Termination,
    settings: DiagnosisSettings,
) -> CandidateModel:
    composition = compose(rig, problem.batch.traces, held_out=held_out)
    problem = problem.with_parameters(composition.lean(()))
    s = CandidateModel(composition, (), *_weigh(problem, held_out, x, end.far), x, end, settings)
    return _reweighed(s, held_out) if s.far else s


def whitened(
    s: CandidateModel, problem: EstimationProblem, held_out: tuple[Trace, ...], x: np.ndarray, end: Termination
) -> CandidateModel:
    """The model at other coordinates, its residual weighed there.

    Args:
        held_out: the others; releases of their plates are sought from where these traces have them.
        end: how the refit that led there ended.
    """
    new = _weigh(problem, held_out, x, end.far)
    return replace(s, **new._asdict(), x=x, end=end)


def _reweighed(s: CandidateModel, held_out: tuple[Trace, ...]) -> CandidateModel:
    """Far from the data: the model at the optimum of the guided residual, each sample weighed by its residual there."""
    for _ in range(REWEIGHINGS):
        s = whitened(s, s.problem, held_out, s.optimised().x, s.end)
    return s


def refit_fully(s: CandidateModel, report: Report) -> CandidateModel:
    """The model refitted in full: a descent, then rounds of whitening where it comes near the data.

    Where it stays far, its guided residual is minimised. Where the rounds make the model worse, they are repeated from
    the coordinates before the descent. They are tried from there too before a model that was near is called far: a
    whitened residual forgives one wrong stick, which spoils the rest of a free run. Where an inertia has vanished in a
    model near its data, the rounds are made from a shared one too.
    """
    problem = s.problem.reprepared(s.x).with_room_for(s.held_out, s.x)
    weighted = problem.weighted(weights.forgiving(problem))
    tolerance = REFIT_TOLERANCE
    ways = [lambda: descend(problem, s.x, weighted, tolerance), lambda: descend_in_stages(problem, s.x, tolerance)]
    ends = concurrently(lambda way: way()[0], ways if s.far else ways[:1])
    x = min(ends, key=lambda end: problem.chi2(end, weighted)) if s.far else ends[0]
    limit = NEAR_CHI2_PER_DOF if s.far else MISFIT
    if problem.chi2(x, weighted) / max(1.0, weighted.samples - x.size) > limit:
        if not s.far and not refit_worsened(new := _in_rounds(s, problem, s.x, report), s):
            return _with_both_inertias(new, report)
        end = Termination(True, "optimum of the guided residual", far=True)
        return _reweighed(whitened(s, problem, s.held_out, s.x, end), s.held_out)
    new = _in_rounds(s, problem, x, report)
    if refit_worsened(new, s):
        new = min(new, _in_rounds(s, problem, s.x, report), key=lambda end: end.deviance)
    return _with_both_inertias(new, report)


def _with_both_inertias(s: CandidateModel, report: Report) -> CandidateModel:
    """The model; where an inertia has vanished, the end of rounds from a shared one if the data are likelier there."""
    x = with_inertia_shared(s)
    return s if x is None else min(s, _in_rounds(s, s.problem, x, report), key=lambda end: end.deviance)


def with_inertia_shared(s: CandidateModel) -> np.ndarray | None:
    """Coordinates, shape (P,), at which motor and plate have half of J_eq = N^2 J_m + J_L each, where one of the two
    has vanished; None where none has, or one is not free.

    An inertia that a fit far from its data has brought to zero stays there: its coordinate moves nothing any more.
    """
    layout, values, squared = s.problem.layout, s.values, s.problem.config.gear_ratio**2
    if not {"J_m", "J_L"} <= {*layout.free}:
        return None
    motor = squared * values["J_m"]
    both = motor + values["J_L"]
    if min(motor, values["J_L"]) >= VANISHED * both:
        return None
    return layout.coordinates({**values, "J_m": 0.5 * both / squared, "J_L": 0.5 * both})


def _in_rounds(s: CandidateModel, problem: EstimationProblem, x: np.ndarray, report: Report) -> CandidateModel:
    """The model refitted from x and whitened anew until no parameter moves."""
    still, most = STILL, WHITENING_ROUNDS
    problem, _, x, end = rounds(problem.with_release_times(x), x, report, still, most)
    return whitened(s, problem, s.held_out, x, end)


def settled(s: CandidateModel, report: Report, settings: FitSettings) -> CandidateModel:
    """The model at the end of the rounds and the search that a fit makes; unchanged far from the data, and where its
    data are not likelier there. The end of a refit need not be an optimum."""
    if s.far:
        return s
    problem, _, x, end = fitted_in_rounds(s.problem.with_release_times(s.x), s.x, report, settings)
    new = whitened(s, problem, s.held_out, x, end)
    return new if new.deviance < s.deviance else s


def further_from_data(after: float | None, before: float | None) -> bool:
    """Whether a full refit ended further from the data than the model it began with.

    Args:
        after, before: chi2 per sample, each by its own whitening; None far from the data, where it is 1 by construction
            and cannot be compared.
    """
    if before is None:
        return False
    return after is None or not after < WORSE_CHI2 * before


def refit_worsened(new: CandidateModel, before: CandidateModel) -> bool:
    """`further_from_data` of two models."""
    after, was = (None if s.far else s.chi2_per_sample for s in (new, before))
    return further_from_data(after, was)


def is_no_worse(new: CandidateModel, before: CandidateModel, was: Score) -> bool:
    """Whether a full refit is neither further from the data nor clearly worse on the traces held out.

    It is no worse either where held-out samples are noise to it. A model that lacks a second effect may be further from
    the fitted data by its own whitening: without a rebound a plate rests on its stop, and the filter is sure of that.

    Args:
        before: the model it is to take the place of.
    """
    if held_out_shows_noise(new, before):
        return True
    rise = new.settings.rise_in_refit(new.far)
    return not (refit_worsened(new, before) or holdout_worsened(holdout_rms(new), was.holdout_rms, rise))


def held_out_shows_noise(new: CandidateModel, before: CandidateModel) -> bool:
    """Whether each held-out sample, predicted from those before it, differs from the new model by noise alone, and
    their chi2 rises by less than `SPARED_GAIN` of the fall of that of the fitted traces.

    Then nothing in them contradicts the new model, even where their free-run RMS rises: a free run adds up what the
    noise of the input and small errors of the parameters do. False far from the data, and where nothing is held out.
    """
    if new.far or before.far or new.holdout is None or before.holdout is None:
        return False
    (problem, data), (problem_before, data_before) = new.holdout, before.holdout
    after, was = problem.chi2(new.x, data), problem_before.chi2(before.x, data_before)
    return is_noise(after, data.samples) and after - was < SPARED_GAIN * (before.chi2 - new.chi2)
