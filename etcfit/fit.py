"""The joint fit: all traces at once, by Levenberg-Marquardt on the whitened residual."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix

from .bench import Bench
from .correlation import inflation, widen
from .errors import MeasurementError
from .explore import evolve, settle
from .identifiability import WIDE, Identifiability, analyse
from .reading import Readings, read_graphs
from .residual import Problem, residual
from .rig.base import Rig
from .score import Row, columns, rows
from .trace import Trace, prepare
from .unknowns import Layout, Unknowns, unknowns

Report = Callable[[str, float], None]

_STEPS = 40  # of Levenberg-Marquardt in one go
_NEAR, _THERE = 1e-2, 3e-6  # relative change of chi2 and absolute one of stretched coordinates that end a descent
_STRETCH = 30.0  # Optimistix damps with the identity: this makes its first damping 1e-3 of the curvature
_ROUNDS = 10
_CLOCK_ROUNDS = 5  # of them in which the clock's jitter is estimated; the rest settle with it
_STARTS = 3  # besides the reading
_SPREAD = 0.35  # of the other starts about the reading, in coordinates
_SETTLED = 0.05  # a round that moves no parameter by more standard errors is the last
_DECREMENT = 1e-2  # chi2 still to be gained, by the gradient, at a point called converged
_MISFIT = 30.0  # chi2 per degree of freedom of the best start above which the model lacks something and may be trapped
_REWEIGHINGS = 3  # of the channels by what is left in them, where the model lacks something
_ROUGH = 0.1  # the same where the gradient is no guide and points drawn about the end are


@dataclass(frozen=True)
class StartSummary:
    """Where one start of the fit began and ended.

    Args:
        name: "reading" or the number of a perturbed start.
        chi2_before, chi2_after: sums of squared residuals, each whitened by its own noise alone.
        steps: Levenberg-Marquardt steps.
    """

    name: str
    chi2_before: float
    chi2_after: float
    steps: int


@dataclass(frozen=True, eq=False)
class FitResult:
    """The joint fit of a rig.

    Args:
        rig: as read.
        unknowns: what was free.
        x: coordinates at the optimum, shape (P,).
        values: SI by symbol, all parameters.
        covariance: of the coordinates, widened where the noise is correlated, shape (P, P).
        identifiability: what these data can tell.
        readings: the paper's graph by graph reading.
        bench: the data as fitted, for whoever goes on from here.
        holdout: the traces that were not, or None.
        problem: what the residual was minimised over.
        whitened: residual of each fitted trace, shape (n, M) each.
        predicted: free-run simulation of each fitted trace and each held-out one, by file, shape (n, M) each.
        score_fit, score_holdout: free-run errors a trace and channel.
        chi2_per_dof: of the whitened residual.
        converged, reason: whether this is an optimum, and in words why (not).
        starts: where each start ended.
        widening: factor by which correlated noise widened the intervals, by symbol.
        warnings: what a reader must know.
    """

    rig: Rig
    unknowns: Unknowns
    x: np.ndarray
    values: Mapping[str, float]
    covariance: np.ndarray
    identifiability: Identifiability
    readings: Readings
    bench: Bench
    holdout: Bench | None
    problem: Problem
    whitened: tuple[np.ndarray, ...]
    predicted: Mapping[str, np.ndarray]
    score_fit: tuple[Row, ...]
    score_holdout: tuple[Row, ...]
    chi2_per_dof: float
    converged: bool
    reason: str
    starts: tuple[StartSummary, ...]
    widening: Mapping[str, float]
    warnings: tuple[str, ...]


def _silent(**_: Any) -> None:
    """Optimistix reports every step; the rounds report enough."""


class _LevenbergMarquardt(optimistix.AbstractGaussNewton):
    """Optimistix's Levenberg-Marquardt with a trust region that grows on good steps, not on perfect ones only."""

    rtol: float
    atol: float
    norm: Callable[[Any], Any] = optimistix.max_norm
    descent: optimistix.DampedNewtonDescent = optimistix.DampedNewtonDescent(lineax.Normal(lineax.Cholesky()))
    search: optimistix.ClassicalTrustRegion = optimistix.ClassicalTrustRegion(
        high_cutoff=0.7, low_cutoff=0.1, high_constant=5.0, low_constant=0.2
    )
    verbose: Callable[..., None] = _silent


def _with_dense_jacobian(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """The same function, its Jacobian computed once a point by forward mode and then a matrix: a long loop's tangents
    are dear, and Optimistix asks for many products at one point."""
    wrapped = jax.custom_jvp(function)

    @wrapped.defjvp
    def _(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (y,), (dy,) = primals, tangents
        jacobian, value = jax.jacfwd(lambda y: (function(y),) * 2, has_aux=True)(y)
        return value, jacobian @ dy

    return wrapped


@partial(jax.jit, static_argnums=(0, 1))
def _minimise(
    layout: Layout, circuits: tuple[str, ...], x0: Any, scale: Any, anchor: Any, problem: Problem, tolerance: Any
) -> tuple[Any, Any]:
    """Levenberg-Marquardt from x0, in coordinates stretched by `scale` so that its damping treats all alike."""
    root = jnp.sqrt(jnp.sum(problem.slots.weight))

    def stacked(y: Any) -> Any:
        x = x0 + scale * y
        r, prior = residual(layout, circuits, x, problem)
        # the anchor keeps what the data do not determine from wandering; it weighs nothing beside any datum
        return jnp.concatenate((r.ravel(), prior, (x - x0) / anchor)) / root

    dense = _with_dense_jacobian(stacked)
    y0 = jnp.zeros_like(x0)
    solver = _LevenbergMarquardt(rtol=tolerance, atol=tolerance)
    solution = optimistix.least_squares(lambda y, _: dense(y), solver, y0, max_steps=_STEPS, throw=False)
    return x0 + scale * solution.value, solution.stats["num_steps"]


def quiet(text: str, share: float) -> None:
    """A progress report that says nothing."""


def start_values(unknowns: Unknowns, readings: Readings) -> dict[str, float]:
    """Where the fit starts: the reading; where it is silent rig.toml; where that is silent a nominal value."""
    values = {p.symbol: p.nominal for p in unknowns.layout.parameters}
    values |= unknowns.start
    read = {s: v for s, v in readings.values.items() if s in values and np.isfinite(v)}
    return values | read


def ready(rig: Rig) -> tuple[tuple[Trace, ...], tuple[Trace, ...], tuple[str, ...]]:
    """Traces to fit, traces held out, and a word on those the model cannot predict.

    Raises:
        MeasurementError: nothing is left to fit.
    """
    fitted, held_out, notes = [], [], []
    for measurement in rig.measurements:
        trace = prepare(measurement, rig.config)
        if trace is None:
            notes.append(f"{measurement.file}: no voltage, duty or torque was logged with it; it is not fitted")
        else:
            (held_out if measurement.held_out else fitted).append(trace)
    if not fitted:
        found = "has no trace that can be fitted."
        required = "At least one trace must log what drove it and what came of it, and not be held out."
        raise MeasurementError(rig.folder, found, required, "Add one, or take it out of [holdout].")
    return tuple(fitted), tuple(held_out), tuple(notes)


def fit(rig: Rig, report: Report = quiet) -> FitResult:
    """Fit Eqs. 1-2 (and the effects that rig.toml names) jointly to all traces that are not held out.

    Args:
        rig: a measurement folder.
        report: called with what is going on and the share done.
    Raises:
        MeasurementError: nothing to fit, or rig.toml names what does not exist.
    """
    known = unknowns(rig.config)
    fitted, held_out, notes = ready(rig)
    report("reading the paper's graphs", 0.02)
    readings = read_graphs(rig)
    start = known.layout.off_bounds(known.layout.coordinates(start_values(known, readings)))
    report("choosing integration steps", 0.05)
    bench = Bench.of(rig.config, known, fitted).refined(start)
    x, starts, unit = _from_several_starts(bench, start, report)
    bench = bench.released(x)
    bench, problem, x, state = _rounds(bench, x, report) if unit < _MISFIT else _free_running(bench, x, report)
    return _result(rig, readings, bench, held_out, problem, x, starts, state, notes)


def _scale(information: np.ndarray, count: float) -> np.ndarray:
    """Stretch of the coordinates that makes all columns of the Jacobian alike."""
    return _STRETCH / np.sqrt(np.maximum(np.diag(information) / count, 1e-12))


def _information(prior_sd: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    return flat.T @ flat + np.diag(1.0 / np.asarray(prior_sd) ** 2)


def _go(bench: Bench, x: np.ndarray, problem: Problem, tolerance: float) -> tuple[np.ndarray, int]:
    """Minimise from x; a point where the model cannot be computed stays where it is."""
    r, _, jacobian = bench.linearise(x, problem)
    if not np.isfinite(r).all() or not np.isfinite(jacobian).all():
        return x, 0
    scale = _scale(_information(problem.prior_sd, jacobian), float(np.sum(problem.slots.weight)))
    anchor = WIDE * bench.layout.reach(x)
    scale = np.minimum(scale, 1e4 * anchor)
    end, steps = _minimise(bench.layout, bench.tape.circuits, x, scale, anchor, problem, tolerance)
    return np.asarray(end), int(steps)


def _from_several_starts(
    bench: Bench, start: np.ndarray, report: Report
) -> tuple[np.ndarray, tuple[StartSummary, ...], float]:
    """The reading first, then points scattered about it; the deepest end wins. Its chi2 per degree of freedom last."""
    rng = np.random.default_rng(20230701)
    reach = _SPREAD * bench.layout.reach(start)
    others = [start + reach * rng.standard_normal(start.size) for _ in range(_STARTS)]
    problem = bench.problem(bench.forgiving())
    best, lowest, summaries = start, np.inf, []
    for k, first in enumerate([start, *others]):
        report(f"start {k + 1} of {_STARTS + 1}", 0.1 + 0.1 * k)
        end, steps = _go(bench, bench.layout.off_bounds(first), problem, _NEAR)
        before, after = _chi2(bench, first, problem), _chi2(bench, end, problem)
        summaries.append(StartSummary("reading" if k == 0 else f"scattered {k}", before, after, steps))
        if after < lowest:
            best, lowest = end, after
    return best, tuple(summaries), lowest / max(1.0, float(np.sum(problem.slots.weight)) - start.size)


def _chi2(bench: Bench, x: np.ndarray, problem: Problem) -> float:
    r, prior, _ = bench.linearise(x, problem)
    total = float(np.sum(r**2) + np.sum(prior**2))
    return total if np.isfinite(total) else float("inf")


@dataclass(frozen=True)
class _End:
    """How the fit ended; `far` where the model is far from the data and was fitted free-running."""

    converged: bool
    reason: str
    outliers: int = 0
    far: bool = False


def _rounds(bench: Bench, x: np.ndarray, report: Report) -> tuple[Bench, Problem, np.ndarray, _End]:
    """Renew the whitening, the releases and the outliers at each optimum until nothing moves any more."""
    moved, outliers = np.inf, 0
    for k in range(_ROUNDS):
        report(f"round {k + 1}: moved {moved:.2g} standard errors", 0.5 + 0.4 * k / _ROUNDS)
        problem = bench.problem(bench.kalman(x))
        end, _ = _go(bench, bench.layout.off_bounds(x) if k < 2 else x, problem, _THERE)
        local = _local(bench, end, problem)
        moved = float(np.max(np.abs(end - x) / np.sqrt(np.diag(local.covariance))))
        x = end
        if moved < _SETTLED and k > 0:
            break
        if k < _ROUNDS - 1:
            whitened = columns(bench.tape, local.r)
            bench = bench.timed(x, local.r) if k < _CLOCK_ROUNDS else bench
            bench, outliers = bench.released(x).outliers_weighed(whitened)
    if local.gain > _DECREMENT:
        return _searched(bench, x, problem, local, outliers, report)
    return bench, problem, x, _verdict(moved, local.gain, outliers)


def _free_running(bench: Bench, x: np.ndarray, report: Report) -> tuple[Bench, Problem, np.ndarray, _End]:
    """Least squares of the free-running simulation, for a model far from the data.

    What such a model lacks is larger than all that the whitening knows of, so the whitening would only let it follow
    the data; and there a fit may be trapped, so it is searched for as well as descended to. Each channel of each trace
    is weighed by the error that is left in it: what the model cannot explain must not spoil what it can.
    """
    for k in range(_REWEIGHINGS):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        bench = bench.discounted(x)
        problem = bench.problem(bench.free_running())
        spread = _SPREAD / 2.0**k * bench.layout.reach(x)
        x = evolve(bench.layout, bench.tape.circuits, x, problem, spread)
        x, _ = _go(bench, x, problem, _THERE)
    bench, problem, x, end = _searched(bench, x, problem, _local(bench, x, problem), 0, report)
    return bench, problem, x, replace(end, far=True)


@dataclass(frozen=True, eq=False)
class _Local:
    """The problem linearised at a point.

    Args:
        r: whitened residual, shape (T, L, M).
        unit: chi2 per degree of freedom, at least 1: what a difference in chi2 is measured by.
        covariance: of the coordinates, in that unit, shape (P, P).
        gain: chi2 that a full Gauss-Newton step would still gain, g^T F^-1 g, in that unit.
    """

    r: np.ndarray
    unit: float
    covariance: np.ndarray
    gain: float


def _local(bench: Bench, x: np.ndarray, problem: Problem) -> _Local:
    r, prior, jacobian = bench.linearise(x, problem)
    unit = max(1.0, float(np.sum(r**2)) / max(1.0, float(np.sum(problem.slots.weight)) - x.size))
    reach = bench.layout.reach(x)
    information = _information(problem.prior_sd, jacobian) + np.diag(1.0 / (WIDE * reach) ** 2)
    gradient = jacobian.reshape(-1, x.size).T @ r.ravel() + prior / np.asarray(problem.prior_sd)
    gain = float(gradient @ np.linalg.solve(information, gradient)) / unit
    values, vectors = np.linalg.eigh(information * np.outer(reach, reach))
    covariance = (vectors / np.maximum(values, 1.0 / WIDE**2)) @ vectors.T * np.outer(reach, reach)
    return _Local(r, unit, unit * covariance, gain)


def _verdict(moved: float, gain: float, outliers: int) -> _End:
    if not np.isfinite(gain):
        return _End(False, "the model cannot be computed at the point reached", outliers)
    if moved > 10.0 * _SETTLED:
        return _End(False, f"the last round still moved a parameter by {moved:.2g} standard errors", outliers)
    return _End(True, f"gradient zero to {gain:.1e} of chi2, last round moved {moved:.2g} standard errors", outliers)


def _searched(
    bench: Bench, x: np.ndarray, problem: Problem, local: _Local, outliers: int, report: Report
) -> tuple[Bench, Problem, np.ndarray, _End]:
    """Go on without a gradient from where it leads no further."""
    report("the gradient does not vanish: searching without it", 0.9)
    x, gain = settle(bench.layout, bench.tape.circuits, x, problem, local.covariance, local.unit)
    if gain > _ROUGH:
        text = f"points about the end still lower chi2, by {gain:.2g} of its own size per sample"
    else:
        text = f"chi2 is too rough for its gradient; no point drawn within a standard error lowers it by {_ROUGH}"
    return bench, problem, x, _End(gain <= _ROUGH, text, outliers)


def _result(
    rig: Rig,
    readings: Readings,
    bench: Bench,
    held_out: tuple[Trace, ...],
    problem: Problem,
    x: np.ndarray,
    starts: tuple[StartSummary, ...],
    end: _End,
    notes: tuple[str, ...],
) -> FitResult:
    r, _, jacobian = bench.linearise(x, problem)
    pieces = _pieces(bench, r, jacobian)
    certain = analyse(bench.layout, x, _information(problem.prior_sd, jacobian)).covariance
    covariance, factor, count = widen(certain, pieces)
    verdict = _verdict_on_parameters(bench, x, problem, pieces)
    values = {s: float(v) for s, v in bench.layout.values(x, bench.unknowns.held).items()}
    holdout = Bench.of(rig.config, bench.unknowns, held_out).refined(x).released(x) if held_out else None
    predicted, score_holdout = {}, ()
    for part in filter(None, (bench, holdout)):
        model, _ = part.free_run(x)
        predicted |= {t.measurement.file: y for t, y in zip(part.tape.traces, model, strict=True)}
    if holdout is not None:
        score_holdout = rows(held_out, [predicted[t.measurement.file] for t in held_out])
    score_fit = rows(bench.tape.traces, [predicted[t.measurement.file] for t in bench.tape.traces])
    whitened = _in_sigma(bench, predicted) if end.far else tuple(columns(bench.tape, r))
    samples = sum(row.n for row in score_fit)
    chi2 = sum(float(np.nansum(part**2)) for part in whitened) / max(1.0, samples - x.size)
    return FitResult(
        rig=rig,
        unknowns=bench.unknowns,
        x=x,
        values=values,
        covariance=covariance,
        identifiability=verdict,
        readings=readings,
        bench=bench,
        holdout=holdout,
        problem=problem,
        whitened=whitened,
        predicted=predicted,
        score_fit=score_fit,
        score_holdout=score_holdout,
        chi2_per_dof=chi2,
        converged=end.converged,
        reason=end.reason,
        starts=starts,
        widening=dict(zip(bench.layout.free, map(float, factor), strict=True)),
        warnings=(*rig.warnings, *notes, *_words(end, count, len(score_fit), chi2, factor)),
    )


def _in_sigma(bench: Bench, predicted: Mapping[str, np.ndarray]) -> tuple[np.ndarray, ...]:
    """Free-running error over each sample's own noise, for a model too far from the data to whiten."""
    return tuple((t.data - predicted[t.measurement.file]) / t.sigma for t in bench.tape.traces)


def _verdict_on_parameters(
    bench: Bench, x: np.ndarray, problem: Problem, pieces: list[tuple[np.ndarray, np.ndarray]]
) -> Identifiability:
    """What the data can tell, each channel counting for no more than its residual's size and independence allow.

    It is judged off the bounds: a parameter that lies on one would seem known, and so would what it hides behind.
    """
    inside = bench.layout.off_bounds(x)
    if not np.array_equal(inside, x):
        r, _, jacobian = bench.linearise(inside, problem)
        pieces = [(j, own) for (j, _), (_, own) in zip(_pieces(bench, r, jacobian), pieces, strict=True)]
    information = np.diag(1.0 / np.asarray(problem.prior_sd) ** 2)
    for jacobian, own in pieces:
        information = information + jacobian.T @ jacobian / inflation(own)
    return analyse(bench.layout, inside, information)


def _pieces(bench: Bench, r: np.ndarray, jacobian: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Jacobian and residual of each channel of each trace, where it was logged."""
    out = []
    for trace, part, (lane, _, marks) in zip(bench.tape.traces, columns(bench.tape, r), bench.tape.places, strict=True):
        for m in range(len(trace.channels)):
            seen = np.isfinite(trace.data[:, m])
            out.append((jacobian[marks[seen], lane, m], part[seen, m]))
    return out


def _words(end: _End, correlated: int, pieces: int, chi2: float, factor: np.ndarray) -> list[str]:
    out = []
    if end.far:
        out.append(
            f"The model is far from the data (chi2/dof {chi2:.3g}): it lacks an effect. It was fitted free-running, each "
            "channel weighed by the error left in it; parameters are a compromise, not measurements."
        )
    if correlated:
        out.append(
            f"{correlated} of {pieces} residuals are larger than their noise or not independent: the model lacks "
            f"something there. Intervals are widened for it (up to {float(np.max(factor)):.1f} times), but widening "
            "does not remove a bias; look at the residual pictures."
        )
    if end.outliers:
        out.append(f"{end.outliers} samples lie far outside their trace's residuals and were weighed down.")
    if not end.converged:
        out.append(f"NOT CONVERGED: {end.reason}")
    return out
