"""The result of a fit: parameters, their uncertainty, errors of prediction, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ..problem.free_parameters import FreeParameters
from ..problem.prediction_error import PredictionError, rows
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace
from ..rig.base import Rig
from ..rig.paper_readings import Readings
from .agreement import Z_95, Compromise, Influence, agreement, root
from .contradiction import Contradiction
from .explained import drives_of_another_session
from .fitted_model import FitState, Fitted
from .goodness import Goodness, goodness_of, inflation, warnings_of, widen
from .identifiability import WEAK, Identifiability, analyse
from .settings import FitSettings
from .statement import Piece, information_in, pieces_at
from .statement import whitened as whitened_of

# ---- The uncertainty budget: which source makes which share of an interval


@dataclass(frozen=True, eq=False)
class Budget:
    """Where the uncertainty of the parameters comes from."""

    sources: tuple[str, ...]  # names of the sources: "scale of current", "zero of position", "gear ratio"
    moves: np.ndarray  # shift of the coordinates by one standard deviation of each source, shape (S, P)
    statistical: np.ndarray  # covariance of the coordinates without them, shape (P, P)

    def shares(self) -> np.ndarray:
        """Share of each source in each parameter's variance, the statistical one last, shape (S + 1, P)."""
        parts = np.vstack((self.moves**2, np.maximum(np.diag(self.statistical), 0.0)))
        return parts / np.maximum(parts.sum(axis=0), 1e-300)


class Reason(StrEnum):
    """Why a fit ended, for programs; `Termination.reason` is the text for people, with numbers."""

    OPTIMUM = "optimum"  # the gradient vanishes and the last round hardly moved
    ALTERNATING = "alternating"  # two optima alternate, nearer to each other than the intervals are wide
    SEARCHED = "searched"  # chi2 is too rough for a gradient, and a search found nothing lower
    ROUGH = "rough"  # not converged: points drawn about the end still lower chi2
    WANDERING = "wandering"  # not converged: the last round still moved a parameter far
    NOT_COMPUTABLE = "not computable"  # not converged: the model has no finite value at the end


@dataclass(frozen=True)
class StartSummary:
    """Start and end of one descent of the fit."""

    name: str  # "reading" or the number of a perturbed start
    # chi2_before, chi2_after: sums of squared residuals, each whitened by its own noise alone
    chi2_before: float
    chi2_after: float
    steps: int  # Levenberg-Marquardt steps


@dataclass(frozen=True, eq=False, repr=False)
class FitResult:
    """The joint fit of a rig.

    Args:
        rig: the rig as read.
        free_parameters: the free parameters.
        x: coordinates at the optimum, shape (P,).
        values: SI by symbol, all parameters.
        covariance: covariance of the coordinates, widened if the noise is correlated or if traces or tests scatter by
            more than their noise, shape (P, P).
        identifiability: which parameters these data determine.
        readings: the readings of the paper's graphs.
        problem: the data as fitted, for later stages.
        holdout: the traces held out of the fit, or None.
        weighted: the weighted data of the minimised residual.
        whitened: residual of each fitted trace, shape (n, M) each.
        predicted: free-run simulation of each fitted trace and each held-out one, by file, shape (n, M) each.
        score_fit, score_holdout: free-run errors per trace and channel.
        chi2_per_dof: chi2 per degree of freedom of the whitened residual.
        converged, reason: whether the end is an optimum, and in words why (not).
        starts: the end of each start.
        widening: factor by which correlated noise and the scatter of traces and tests widened the intervals, by symbol.
        warnings: warnings, one sentence each.
        far: whether the model is far from the data and was fitted free-running.
        formulas: effects whose formulas may be off by their `inexact`; the covariance includes this.
        budget: contribution of [accuracy] of rig.toml to the covariance; None if it states none: intervals are then
            statistical only.
        exact_covariance: covariance with these formulas taken as exact; None if it equals `covariance`.
        settings: settings of the fit.
        reason_code: `reason` for programs; None if the end was not judged by the joint fit.
        influence: which test and trace pulls which parameter.
        contradictions: rig tests that contradict the others, worst first.
        compromise: results of subsets of the data, if parameters are no estimates; None if they are.
    """

    rig: Rig
    free_parameters: FreeParameters
    x: np.ndarray
    values: Mapping[str, float]
    covariance: np.ndarray
    identifiability: Identifiability
    readings: Readings
    problem: EstimationProblem
    holdout: EstimationProblem | None
    weighted: WeightedData
    whitened: tuple[np.ndarray, ...]
    predicted: Mapping[str, np.ndarray]
    score_fit: tuple[PredictionError, ...]
    score_holdout: tuple[PredictionError, ...]
    chi2_per_dof: float
    converged: bool
    reason: str
    starts: tuple[StartSummary, ...]
    widening: Mapping[str, float]
    warnings: tuple[str, ...]
    far: bool = False
    formulas: tuple[str, ...] = ()
    settings: FitSettings = FitSettings()
    reason_code: Reason | None = None
    exact_covariance: np.ndarray | None = None
    budget: Budget | None = None
    influence: Influence = field(default_factory=Influence)
    contradictions: tuple[Contradiction, ...] = ()
    compromise: Compromise | None = None

    def taken_as_exact(self) -> FitResult:
        """The fit with the intervals for exact formulas and instruments, as the posterior assumes them."""
        if self.exact_covariance is not None:
            return replace(self, covariance=self.exact_covariance, formulas=(), exact_covariance=None, budget=None)
        return self if self.budget is None else replace(self, covariance=self.budget.statistical, budget=None)

    def __repr__(self) -> str:
        return f"FitResult({self.rig.config.name!r}, chi2_per_dof={self.chi2_per_dof:.4g}, converged={self.converged})"

    @property
    def goodness(self) -> tuple[Goodness, ...]:
        """The verdict on the residual of every fitted channel."""
        return goodness_of(self.problem.batch.traces, self.whitened, self.score_fit, self.settings)

    @property
    def state(self) -> FitState:
        """The state of the fit, for every later stage."""
        why = None if self.compromise is None else self.compromise.why
        return FitState(float(self.chi2_per_dof), self.converged, self.reason, why)

    def fitted(self) -> Fitted:
        """The model alone, without the data."""
        logged = (measurement.channels.get("position") for measurement in self.rig.measurements)
        sigma = [channel.sigma for channel in logged if channel is not None]
        return Fitted(
            self.rig.config,
            self.free_parameters,
            self.x,
            self.stated_covariance,
            self.settings.identifiability,
            self.state,
            position_noise=float(np.median(sigma)) if sigma else 0.0,
        )

    @property
    def stated_covariance(self) -> np.ndarray:
        """Covariance of the coordinates for later stages, shape (P, P); of a compromise as wide as the ranges from
        subsets of the data."""
        if self.compromise is None:
            return self.covariance
        most = WEAK * self.free_parameters.layout.reach(self.x)
        return self.compromise.covariance(Z_95, self.covariance, self.x, most)


@dataclass(frozen=True)
class Termination:
    """How the fit ended."""

    # converged, reason: whether the end is an optimum, and why (not)
    converged: bool
    reason: str
    outliers: int = 0  # number of samples with reduced weight
    far: bool = False  # whether the model is far from the data and was fitted free-running
    # first row, shape (1, P): movement of the coordinates in the last round; if an impact or a slip falls on either
    # side of a sample, two whitenings alternate, and neither is better; the intervals include the difference. Further
    # rows: distances of nearby optima that the data hardly rule out (`likeliest_nearby`).
    wander: np.ndarray | None = None
    gain: float = 0.0  # fall of chi2 that the gradient predicts, in units of chi2 per degree of freedom
    reason_code: Reason | None = None  # `reason` for programs; None if the end was not judged by the joint fit


@dataclass(frozen=True, eq=False)
class Optimum:
    """The end of a fit."""

    rig: Rig  # the rig as read
    readings: Readings  # readings of the paper's graphs
    problem: EstimationProblem  # the data as fitted
    held_out: tuple[Trace, ...]  # traces that are only predicted
    weighted: WeightedData  # the weighted data of the minimised residual
    x: np.ndarray  # coordinates of the end, shape (P,)
    end: Termination  # why the fit ended
    starts: tuple[StartSummary, ...] = ()  # the end of each start
    notes: tuple[str, ...] = ()  # warnings in addition to the rig's own
    settings: FitSettings = FitSettings()  # settings of the fit

    @property
    def values(self) -> dict[str, float]:
        """SI by symbol, all parameters."""
        return self.problem.free_parameters.values(self.x)

    @property
    def chi2_per_dof(self) -> float:
        """chi2 per degree of freedom of the minimised residual, which near the data is the whitened one."""
        chi2 = self.problem.chi2(self.x, self.weighted)
        return chi2 / max(1.0, self.weighted.samples - self.x.size)


def outcome(optimum: Optimum) -> FitResult:
    """The result of a fit, computed at its end: intervals, verdict on the parameters, errors, warnings."""
    problem, weighted, x, end = optimum.problem, optimum.weighted, optimum.x, optimum.end
    pieces = pieces_at(problem, x, weighted)
    known, whitened = _spread(optimum, pieces), whitened_of(problem, pieces)
    predictions = _predictions(optimum)
    if end.far:
        whitened = tuple((t.data - predictions.predicted[t.measurement.file]) / t.sigma for t in problem.batch.traces)
    samples = sum(row.n for row in predictions.score_fit)
    chi2 = sum(float(np.nansum(part**2)) for part in whitened) / max(1.0, samples - x.size)
    agreed = agreement(problem, weighted, x, pieces, known.covariance, (end.far, chi2), optimum.settings)
    wider = np.diag(agreed.covariance) / np.maximum(np.diag(known.certain), 1e-300)
    return FitResult(
        rig=optimum.rig,
        free_parameters=problem.free_parameters,
        x=x,
        values=optimum.values,
        covariance=agreed.covariance,
        identifiability=_verdict_on_parameters(problem, x, weighted, pieces, optimum.settings),
        readings=optimum.readings,
        problem=problem,
        weighted=weighted,
        whitened=whitened,
        **predictions._asdict(),
        chi2_per_dof=chi2,
        converged=end.converged,
        reason=end.reason,
        starts=optimum.starts,
        widening=dict(zip(problem.layout.free, map(float, root(wider, np.nan)), strict=True)),
        warnings=(
            *optimum.rig.warnings,
            *optimum.notes,
            *_warnings(optimum, known, predictions, whitened, chi2),
            *agreed.words(lambda s: problem.layout.parameter(s).unit),
        ),
        far=end.far,
        settings=optimum.settings,
        reason_code=end.reason_code,
        influence=agreed.influence,
        contradictions=agreed.contradictions,
        compromise=agreed.compromise,
    )


class _Spread(NamedTuple):
    """Uncertainty of the coordinates, before the parts of the data are compared."""

    certain: np.ndarray  # covariance if the model and the noise are right, shape (P, P)
    covariance: np.ndarray  # widened for the residual of each channel and for rounds that alternate, shape (P, P)
    widest: float  # largest factor by which correlated channels widened a standard error; 1 if none
    alternating: tuple[str, ...]  # symbols in which the rounds alternate


def _spread(optimum: Optimum, pieces: tuple[Piece, ...]) -> _Spread:
    problem, x, wander, settings = optimum.problem, optimum.x, optimum.end.wander, optimum.settings
    information = information_in(pieces, optimum.weighted.prior_sd[: x.size])
    certain = analyse(problem.layout, x, information, settings.identifiability).covariance
    covariance, factor, _ = widen(certain, [(p.jacobian, p.r) for p in pieces])
    widest = float(np.max(factor, initial=1.0))
    if wander is None:
        return _Spread(certain, covariance, widest, ())
    far_off = np.sqrt(np.sum(wander**2, axis=0)) > 0.5 * np.sqrt(np.diag(covariance))
    alternating = tuple(s for s, off in zip(problem.layout.free, far_off, strict=True) if off)
    return _Spread(certain, covariance + wander.T @ wander, widest, alternating)


class _Predictions(NamedTuple):
    """Free-run predictions of every trace; the fields of `FitResult`."""

    holdout: EstimationProblem | None
    predicted: dict[str, np.ndarray]
    score_fit: tuple[PredictionError, ...]
    score_holdout: tuple[PredictionError, ...]


def _predictions(optimum: Optimum) -> _Predictions:
    problem, held_out, x = optimum.problem, optimum.held_out, optimum.x
    holdout = problem.for_traces(held_out, x) if held_out else None
    predicted: dict[str, np.ndarray] = {}
    for part in filter(None, (problem, holdout)):
        model = part.free_run(x)
        predicted |= {t.measurement.file: y for t, y in zip(part.batch.traces, model, strict=True)}

    def scored(traces: tuple[Trace, ...]) -> tuple[PredictionError, ...]:
        return rows(traces, [predicted[t.measurement.file] for t in traces])

    return _Predictions(holdout, predicted, scored(problem.batch.traces), scored(held_out))


def _verdict_on_parameters(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, pieces: tuple[Piece, ...], settings: FitSettings
) -> Identifiability:
    """Which parameters the data determine, with each channel weighted by its residual's size and independence.

    It is judged away from the bounds: a parameter on a bound would seem known, and so would those tied up with it.
    """
    inside = problem.layout.off_bounds(x)
    if not np.array_equal(inside, x):
        there = pieces_at(problem, inside, weighted)
        pieces = tuple(new._replace(r=piece.r) for new, piece in zip(there, pieces, strict=True))
    inflated = (inflation(piece.r) for piece in pieces)
    information = information_in(pieces, weighted.prior_sd[: x.size], inflated)
    return analyse(problem.layout, inside, information, settings.identifiability)


def _warnings(
    optimum: Optimum, known: _Spread, predictions: _Predictions, whitened: tuple[np.ndarray, ...], chi2: float
) -> Iterator[str]:
    """Warnings about the end of a fit, its residuals, and held-out traces."""
    problem, end, settings = optimum.problem, optimum.end, optimum.settings
    if end.far:
        yield (
            f"The model is far from the data (chi2/dof {chi2:.3g}): it lacks an effect. It was fitted free-running, "
            "each channel weighted by its residual; parameters are a compromise, not measurements."
        )
    yield from warnings_of(goodness_of(problem.batch.traces, whitened, predictions.score_fit, settings), known.widest)
    if end.outliers:
        yield f"The weight of samples far outside their trace's residuals was reduced: {end.outliers} of them."
    if not end.converged:
        yield f"NOT CONVERGED: {end.reason}"
    if known.alternating:
        yield (
            f"The rounds of the fit alternate in {', '.join(known.alternating)}: an impact or a slip falls on either "
            "side of a sample, and no reading of it is better. Their intervals are widened by the difference."
        )
    errors = predictions.score_fit, predictions.score_holdout
    for each in drives_of_another_session(problem, optimum.x, optimum.held_out, errors):
        yield each.words
