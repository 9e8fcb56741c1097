"""The joint fit of all traces: from the paper's reading, through several starts, to an optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import MeasurementError
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import FreeParameters, free_parameters
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace, follows_setpoint, prepare
from ..problem.weights import discounted, forgiving, free_running, outliers_weighed, timed
from ..rig.base import Measurement, Rig
from ..rig.paper_readings import Readings, read_graphs
from .global_search import evolve, settle
from .levenberg_marquardt import Local, descend, local, minimise
from .result import FitResult as FitResult
from .result import StartSummary as StartSummary
from .result import Termination, outcome

Report = Callable[[str, float], None]

_NEAR, _THERE = 1e-2, 3e-6  # relative change of chi2 and absolute one of stretched coordinates that end a descent
_ROUNDS = 10
_CLOCK_ROUNDS = 4  # of them in which the clock's jitter is estimated; the rest settle with it
_STARTS = 3  # besides the reading
_LATE = (0.064, 0.016, 0.004, 0.0)  # s by which instants may be off, one stage after the other
_SPREAD = 0.35  # of the other starts about the reading, in coordinates
_SETTLED = 0.05  # a round that moves no parameter by more standard errors is the last
_WANDERING = 10.0  # a last round that moves one by more is no end; one that moves less widens the intervals by it
_DECREMENT = 1e-2  # chi2 still to be gained, by the gradient, at a point called converged
MISFIT = 30.0  # chi2 per degree of freedom of the best start above which the model lacks something and may be trapped
_REWEIGHINGS = 3  # of the channels by what is left in them, where the model lacks something
_ROUGH = 0.1  # the same where the gradient is no guide and points drawn about the end are


def quiet(text: str, share: float) -> None:
    """A progress report that says nothing."""


def start_values(free_parameters: FreeParameters, readings: Readings) -> dict[str, float]:
    """Where the fit starts: the reading; where it is silent rig.toml; where that is silent a nominal value."""
    values = {p.symbol: p.nominal for p in free_parameters.layout.parameters}
    values |= free_parameters.start
    read = {s: v for s, v in readings.values.items() if s in values and np.isfinite(v)}
    return values | read


def _left_out(measurement: Measurement) -> str:
    """Why a trace is not fitted, and what would make it count."""
    why = f"{measurement.file}: no voltage, duty or torque was logged with it; it is not fitted"
    if not follows_setpoint(measurement):
        return why
    return f'{why}. A table [ecu] in rig.toml, with the ECU\'s gains or P, I, D = "free", puts the ECU into the model'


def ready(rig: Rig) -> tuple[tuple[Trace, ...], tuple[Trace, ...], tuple[str, ...]]:
    """Traces to fit, traces held out, and a word on those the model cannot predict.

    Raises:
        MeasurementError: nothing is left to fit.
    """
    fitted, held_out, notes = [], [], []
    for measurement in rig.measurements:
        trace = prepare(measurement, rig.config)
        if trace is None:
            notes.append(_left_out(measurement))
        else:
            (held_out if measurement.held_out else fitted).append(trace)
    if rig.config.ecu is not None and not any(trace.controlled for trace in (*fitted, *held_out)):
        notes.append("rig.toml: no trace needs [ecu], for each logs its drive, or no setpoint")
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
    known = free_parameters(rig.config)
    fitted, held_out, notes = ready(rig)
    report("reading the paper's graphs", 0.02)
    readings = read_graphs(rig)
    start = known.layout.off_bounds(known.layout.coordinates(start_values(known, readings)))
    report("choosing integration steps", 0.05)
    problem = EstimationProblem.of(rig.config, known, fitted).refined(start).with_integrator_states(start)
    x, starts, unit = _from_several_starts(problem, start, report)
    problem = problem.with_release_times(x).with_integrator_states(x)
    problem, weighted, x, state = _whitened(problem, x, report) if unit < MISFIT else _free_running(problem, x, report)
    return outcome(rig, readings, problem, held_out, weighted, x, starts, state, notes)


def resume(rig: Rig, x: np.ndarray, far: bool, report: Report = quiet) -> FitResult:
    """Take up a fit where it ended.

    Args:
        rig: its measurement folder.
        x: coordinates at its optimum, shape (P,).
        far: whether it was fitted free-running.
        report: called with what is going on and the share done.
    """
    known = free_parameters(rig.config)
    fitted, held_out, notes = ready(rig)
    readings = read_graphs(rig)
    report("taking up the fit", 0.1)
    problem = EstimationProblem.of(rig.config, known, fitted).refined(x).with_release_times(x).with_integrator_states(x)
    if not far:
        problem, weighted, x, end = _whitened(problem, x, report)
    else:
        problem = discounted(problem, x)
        weighted = problem.weighted(free_running(problem))
        end = Termination(True, "taken up from a fit that was searched for", far=True)
    return outcome(rig, readings, problem, held_out, weighted, x, (), end, notes)


def _from_several_starts(
    problem: EstimationProblem, start: np.ndarray, report: Report
) -> tuple[np.ndarray, tuple[StartSummary, ...], float]:
    """The reading first, then points scattered about it; the deepest end wins. Its chi2 per degree of freedom last."""
    rng = np.random.default_rng(20230701)
    reach = _SPREAD * problem.layout.reach(start)
    others = [start + reach * rng.standard_normal(start.size) for _ in range(_STARTS)]
    weighted = problem.weighted(forgiving(problem))
    best, lowest, summaries = start, np.inf, []
    freedom = max(1.0, weighted.samples - start.size)
    for k, first in enumerate([start, *others]):
        report(f"start {k + 1} of {_STARTS + 1}", 0.1 + 0.1 * k)
        near = lowest / freedom < MISFIT  # then another start is a check, and the plain way will do
        end, steps = descend(problem, first, weighted, _NEAR) if near else approach(problem, first, _NEAR)
        before, after = chi2_of(problem, np.stack((first, end)), weighted).tolist()
        summaries.append(StartSummary("reading" if k == 0 else f"scattered {k}", before, after, steps))
        if after < lowest:
            best, lowest = end, after
    return best, tuple(summaries), lowest / freedom


def approach(problem: EstimationProblem, x: np.ndarray, tolerance: float) -> tuple[np.ndarray, int]:
    """Descend with all instants forgiven coarsely, then ever finer; where it ends, and after how many steps.

    Where the simulated plate hits its stop a little early, all samples up to the true impact are wrong, by an amount
    that no small step of a parameter changes.
    """
    steps = 0
    for late in _LATE:
        x, more = descend(problem, x, problem.weighted(forgiving(problem, late)), tolerance)
        steps += more
    return x, steps


def _whitened(
    problem: EstimationProblem, x: np.ndarray, report: Report
) -> tuple[EstimationProblem, WeightedData, np.ndarray, Termination]:
    """The rounds, and a search from where they end short of an optimum."""
    problem, weighted, x, end = rounds(problem, x, report, _SETTLED, _ROUNDS)
    if end.gain > _DECREMENT:
        return _searched(problem, x, weighted, local(problem, x, weighted), end.outliers, report)
    return problem, weighted, x, end


def rounds(
    problem: EstimationProblem, x: np.ndarray, report: Report, still: float, most: int
) -> tuple[EstimationProblem, WeightedData, np.ndarray, Termination]:
    """Renew the whitening, the releases and the outliers at each optimum until nothing moves any more.

    Args:
        problem, x: traces and coordinates near an optimum.
        report: progress.
        still: what counts as not moving, standard errors.
        most: rounds.
    """
    moved, outliers, about = np.inf, 0, x
    for k in range(most):
        report(f"whitening {k + 1}: moved {moved:.2g} standard errors", 0.5 + 0.4 * k / most)
        weighted = problem.weighted(problem.kalman(about))
        x, _ = (descend if k < 2 else minimise)(problem, x, weighted, _THERE)
        here = local(problem, x, weighted)
        moved = float(np.max(np.abs(x - about) / np.sqrt(np.diag(here.covariance))))
        if (moved < still and k > 0) or k == most - 1:
            break
        # later rounds go half way: an impact or a slip that falls on either side of a sample makes two ends alternate
        early = k < _CLOCK_ROUNDS
        about = x if early else 0.5 * (about + x)
        whitened = columns(problem.batch, here.r)
        problem = timed(problem, x, here.r) if early else problem
        problem = problem.with_release_times(about).with_integrator_states(about)
        problem, outliers = outliers_weighed(problem, whitened)
    return problem, weighted, x, replace(_verdict(moved, here.gain, outliers), wander=x - about, gain=here.gain)


def _free_running(
    problem: EstimationProblem, x: np.ndarray, report: Report
) -> tuple[EstimationProblem, WeightedData, np.ndarray, Termination]:
    """Least squares of the free-running simulation, for a model far from the data.

    What such a model lacks is larger than all that the whitening knows of, so the whitening would only let it follow
    the data; and there a fit may be trapped, so it is searched for as well as descended to. Each channel of each trace
    is weighed by the error that is left in it: what the model cannot explain must not spoil what it can.
    """
    for k in range(_REWEIGHINGS):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        problem, weighted, x = freed(problem, x, _SPREAD / 2.0**k)
    problem, weighted, x, end = _searched(problem, x, weighted, local(problem, x, weighted), 0, report)
    return problem, weighted, x, replace(end, far=True)


def freed(
    problem: EstimationProblem, x: np.ndarray, spread: float
) -> tuple[EstimationProblem, WeightedData, np.ndarray]:
    """The best free run about x: weighed by what is left in it, searched for, descended to.

    Args:
        problem, x: traces and coordinates.
        spread: of the points searched, in units of each coordinate's reach.
    """
    problem = discounted(problem, x)
    weighted = problem.weighted(free_running(problem))
    x = evolve(problem, x, weighted, spread * problem.layout.reach(x))
    x, _ = minimise(problem, x, weighted, _THERE)
    return problem, weighted, x


def _verdict(moved: float, gain: float, outliers: int) -> Termination:
    if not np.isfinite(gain):
        return Termination(False, "the model cannot be computed at the point reached", outliers)
    if moved > _WANDERING:
        return Termination(False, f"the last round still moved a parameter by {moved:.2g} standard errors", outliers)
    still = f"gradient zero to {gain:.1e} of chi2"
    if moved > 1.0:
        alternates = f"the rounds alternate by {moved:.2g} standard errors, which the intervals include"
        return Termination(True, f"{still}; {alternates}", outliers)
    return Termination(True, f"{still}, last round moved {moved:.2g} standard errors", outliers)


def _searched(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, here: Local, outliers: int, report: Report
) -> tuple[EstimationProblem, WeightedData, np.ndarray, Termination]:
    """Go on without a gradient from where it leads no further."""
    report("the gradient does not vanish: searching without it", 0.9)
    x, gain = settle(problem, x, weighted, here.covariance, here.unit)
    if gain > _ROUGH:
        text = f"points about the end still lower chi2, by {gain:.2g} of its own size per sample"
    else:
        text = f"chi2 is too rough for its gradient; no point drawn within a standard error lowers it by {_ROUGH}"
    return problem, weighted, x, Termination(gain <= _ROUGH, text, outliers)
