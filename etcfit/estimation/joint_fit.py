"""The joint fit of all traces: from the paper's reading, through several starts, to an optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import MeasurementError
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import Unknowns, unknowns
from ..problem.prediction_error import columns
from ..problem.problem import Bench
from ..problem.residual import Problem
from ..problem.trace import Trace, follows_setpoint, prepare
from ..rig.base import Measurement, Rig
from ..rig.paper_readings import Readings, read_graphs
from .global_search import evolve, settle
from .levenberg_marquardt import Local, descend, go, local
from .result import End, outcome
from .result import FitResult as FitResult
from .result import StartSummary as StartSummary

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


def start_values(unknowns: Unknowns, readings: Readings) -> dict[str, float]:
    """Where the fit starts: the reading; where it is silent rig.toml; where that is silent a nominal value."""
    values = {p.symbol: p.nominal for p in unknowns.layout.parameters}
    values |= unknowns.start
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
    known = unknowns(rig.config)
    fitted, held_out, notes = ready(rig)
    report("reading the paper's graphs", 0.02)
    readings = read_graphs(rig)
    start = known.layout.off_bounds(known.layout.coordinates(start_values(known, readings)))
    report("choosing integration steps", 0.05)
    bench = Bench.of(rig.config, known, fitted).refined(start).poised(start)
    x, starts, unit = _from_several_starts(bench, start, report)
    bench = bench.released(x).poised(x)
    bench, problem, x, state = _whitened(bench, x, report) if unit < MISFIT else _free_running(bench, x, report)
    return outcome(rig, readings, bench, held_out, problem, x, starts, state, notes)


def resume(rig: Rig, x: np.ndarray, far: bool, report: Report = quiet) -> FitResult:
    """Take up a fit where it ended.

    Args:
        rig: its measurement folder.
        x: coordinates at its optimum, shape (P,).
        far: whether it was fitted free-running.
        report: called with what is going on and the share done.
    """
    known = unknowns(rig.config)
    fitted, held_out, notes = ready(rig)
    readings = read_graphs(rig)
    report("taking up the fit", 0.1)
    bench = Bench.of(rig.config, known, fitted).refined(x).released(x).poised(x)
    if not far:
        bench, problem, x, end = _whitened(bench, x, report)
    else:
        bench = bench.discounted(x)
        problem = bench.problem(bench.free_running())
        end = End(True, "taken up from a fit that was searched for", far=True)
    return outcome(rig, readings, bench, held_out, problem, x, (), end, notes)


def _from_several_starts(
    bench: Bench, start: np.ndarray, report: Report
) -> tuple[np.ndarray, tuple[StartSummary, ...], float]:
    """The reading first, then points scattered about it; the deepest end wins. Its chi2 per degree of freedom last."""
    rng = np.random.default_rng(20230701)
    reach = _SPREAD * bench.layout.reach(start)
    others = [start + reach * rng.standard_normal(start.size) for _ in range(_STARTS)]
    problem = bench.problem(bench.forgiving())
    best, lowest, summaries = start, np.inf, []
    freedom = max(1.0, problem.samples - start.size)
    for k, first in enumerate([start, *others]):
        report(f"start {k + 1} of {_STARTS + 1}", 0.1 + 0.1 * k)
        near = lowest / freedom < MISFIT  # then another start is a check, and the plain way will do
        end, steps = descend(bench, first, problem, _NEAR) if near else approach(bench, first, _NEAR)
        before, after = chi2_of(bench, np.stack((first, end)), problem).tolist()
        summaries.append(StartSummary("reading" if k == 0 else f"scattered {k}", before, after, steps))
        if after < lowest:
            best, lowest = end, after
    return best, tuple(summaries), lowest / freedom


def approach(bench: Bench, x: np.ndarray, tolerance: float) -> tuple[np.ndarray, int]:
    """Descend with all instants forgiven coarsely, then ever finer; where it ends, and after how many steps.

    Where the simulated plate hits its stop a little early, all samples up to the true impact are wrong, by an amount
    that no small step of a parameter changes.
    """
    steps = 0
    for late in _LATE:
        x, more = descend(bench, x, bench.problem(bench.forgiving(late)), tolerance)
        steps += more
    return x, steps


def _whitened(bench: Bench, x: np.ndarray, report: Report) -> tuple[Bench, Problem, np.ndarray, End]:
    """The rounds, and a search from where they end short of an optimum."""
    bench, problem, x, end = rounds(bench, x, report, _SETTLED, _ROUNDS)
    if end.gain > _DECREMENT:
        return _searched(bench, x, problem, local(bench, x, problem), end.outliers, report)
    return bench, problem, x, end


def rounds(
    bench: Bench, x: np.ndarray, report: Report, still: float, most: int
) -> tuple[Bench, Problem, np.ndarray, End]:
    """Renew the whitening, the releases and the outliers at each optimum until nothing moves any more.

    Args:
        bench, x: traces and coordinates near an optimum.
        report: progress.
        still: what counts as not moving, standard errors.
        most: rounds.
    """
    moved, outliers, about = np.inf, 0, x
    for k in range(most):
        report(f"whitening {k + 1}: moved {moved:.2g} standard errors", 0.5 + 0.4 * k / most)
        problem = bench.problem(bench.kalman(about))
        x, _ = (descend if k < 2 else go)(bench, x, problem, _THERE)
        here = local(bench, x, problem)
        moved = float(np.max(np.abs(x - about) / np.sqrt(np.diag(here.covariance))))
        if (moved < still and k > 0) or k == most - 1:
            break
        # later rounds go half way: an impact or a slip that falls on either side of a sample makes two ends alternate
        early = k < _CLOCK_ROUNDS
        about = x if early else 0.5 * (about + x)
        whitened = columns(bench.tape, here.r)
        bench = bench.timed(x, here.r) if early else bench
        bench, outliers = bench.released(about).poised(about).outliers_weighed(whitened)
    return bench, problem, x, replace(_verdict(moved, here.gain, outliers), wander=x - about, gain=here.gain)


def _free_running(bench: Bench, x: np.ndarray, report: Report) -> tuple[Bench, Problem, np.ndarray, End]:
    """Least squares of the free-running simulation, for a model far from the data.

    What such a model lacks is larger than all that the whitening knows of, so the whitening would only let it follow
    the data; and there a fit may be trapped, so it is searched for as well as descended to. Each channel of each trace
    is weighed by the error that is left in it: what the model cannot explain must not spoil what it can.
    """
    for k in range(_REWEIGHINGS):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        bench, problem, x = freed(bench, x, _SPREAD / 2.0**k)
    bench, problem, x, end = _searched(bench, x, problem, local(bench, x, problem), 0, report)
    return bench, problem, x, replace(end, far=True)


def freed(bench: Bench, x: np.ndarray, spread: float) -> tuple[Bench, Problem, np.ndarray]:
    """The best free run about x: weighed by what is left in it, searched for, descended to.

    Args:
        bench, x: traces and coordinates.
        spread: of the points searched, in units of each coordinate's reach.
    """
    bench = bench.discounted(x)
    problem = bench.problem(bench.free_running())
    x = evolve(bench, x, problem, spread * bench.layout.reach(x))
    x, _ = go(bench, x, problem, _THERE)
    return bench, problem, x


def _verdict(moved: float, gain: float, outliers: int) -> End:
    if not np.isfinite(gain):
        return End(False, "the model cannot be computed at the point reached", outliers)
    if moved > _WANDERING:
        return End(False, f"the last round still moved a parameter by {moved:.2g} standard errors", outliers)
    still = f"gradient zero to {gain:.1e} of chi2"
    if moved > 1.0:
        alternates = f"the rounds alternate by {moved:.2g} standard errors, which the intervals include"
        return End(True, f"{still}; {alternates}", outliers)
    return End(True, f"{still}, last round moved {moved:.2g} standard errors", outliers)


def _searched(
    bench: Bench, x: np.ndarray, problem: Problem, here: Local, outliers: int, report: Report
) -> tuple[Bench, Problem, np.ndarray, End]:
    """Go on without a gradient from where it leads no further."""
    report("the gradient does not vanish: searching without it", 0.9)
    x, gain = settle(bench, x, problem, here.covariance, here.unit)
    if gain > _ROUGH:
        text = f"points about the end still lower chi2, by {gain:.2g} of its own size per sample"
    else:
        text = f"chi2 is too rough for its gradient; no point drawn within a standard error lowers it by {_ROUGH}"
    return bench, problem, x, End(gain <= _ROUGH, text, outliers)
