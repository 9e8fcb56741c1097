"""The joint fit of all traces: from the paper's reading, through several starts, to an optimum."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, overload

import numpy as np

from ..errors import MeasurementError
from ..problem import weights
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import FreeParameters, free_parameters
from ..problem.problem import EstimationProblem
from ..problem.program import concurrently
from ..problem.residual import WeightedData
from ..problem.trace import Trace, follows_setpoint, prepare
from ..rig.base import Measurement, Rig
from ..rig.checks import refuse
from ..rig.paper_readings import Readings, read_graphs
from .accuracy import with_accuracy
from .approach import approach, with_lag_of
from .edges_in_step import with_edges_in_step
from .edges_on_samples import with_edges_on_samples
from .global_search import evolve
from .guide import let_go
from .levenberg_marquardt import compile_ahead, descend, minimise
from .neighbouring_optima import likeliest_nearby
from .result import FitResult as FitResult
from .result import Optimum, Termination, outcome
from .result import StartSummary as StartSummary
from .rig_places import refuse_wrong_places
from .rounds import Reached, rounds, searched, whitened
from .rounds import Report as Report
from .rounds import quiet as quiet
from .settings import FitSettings

_NOISE = 1.0  # chi2 per degree of freedom of noise alone
_HOPELESS = 3.0  # times the misfit of a model that is far: a descent stopped early may be that far above its end
_SPARE = 1.06  # room for held-out traces over what they need at the start: at other values they need a few steps more
MISFIT = FitSettings().misfit  # see there; the default, for whoever judges a fit by its JSON file alone


def start_values(free_parameters: FreeParameters, readings: Readings) -> dict[str, float]:
    """Where the fit starts: the reading; where it is silent rig.toml; where that is silent a nominal value."""
    values = {p.symbol: p.nominal for p in free_parameters.layout.parameters}
    values |= free_parameters.start
    read = {s: v for s, v in readings.values.items() if s in values and np.isfinite(v)}
    if "T_PL" not in read and {"K_s", "K_m", "R_a"} <= read.keys():
        # nominal in volts: the scale of torque is the reading's
        read["T_PL"] = values["T_PL"] * (read["K_m"] / read["R_a"]) / (values["K_m"] / values["R_a"])
    return values | read


def _left_out(measurement: Measurement) -> str:
    """Why a trace is not fitted, and what would make it count."""
    why = f"{measurement.file}: no voltage, duty or torque was logged with it; it is not fitted"
    if not follows_setpoint(measurement):
        return why
    return f'{why}. A table [ecu] in rig.toml, with the ECU\'s gains or P, I, D = "free", puts the ECU into the model'


class Prepared(NamedTuple):
    """The traces of a rig, ready for the model.

    Args:
        fitted: to be fitted; at least one.
        held_out: to be predicted only.
        notes: a sentence on each trace that the model cannot predict, and why.
    """

    fitted: tuple[Trace, ...]
    held_out: tuple[Trace, ...]
    notes: tuple[str, ...]


def ready(rig: Rig) -> Prepared:
    """Sort the traces of a rig into those to fit and those held out.

    Raises:
        MeasurementError: nothing is left to fit, or physics rules the data out.
    """
    refuse(rig.folder, rig.findings)
    fitted, held_out, notes = [], [], []
    traces = [prepare(measurement, rig.config) for measurement in rig.measurements]
    refuse_wrong_places(rig, [trace for trace in traces if trace is not None])
    for measurement, trace in zip(rig.measurements, traces, strict=True):
        if rig.config.sets_aside(measurement):
            notes.append(f"{measurement.file}: set aside as of another rig; it is neither fitted nor predicted")
        elif trace is None:
            notes.append(_left_out(measurement))
        else:
            (held_out if measurement.held_out else fitted).append(trace)
    if rig.config.ecu is not None and not any(trace.controlled for trace in (*fitted, *held_out)):
        notes.append("rig.toml: no trace needs [ecu], for each logs its drive, or no setpoint")
    if not fitted:
        found = "has no trace that can be fitted."
        required = "At least one trace must log what drove it and what came of it, and not be held out."
        raise MeasurementError(rig.folder, found, required, "Add one, or take it out of [holdout].")
    return Prepared(tuple(fitted), tuple(held_out), tuple(notes))


def fit(
    rig: Rig, report: Report = quiet, settings: FitSettings = FitSettings(), about: Mapping[str, float] | None = None
) -> FitResult:
    """Fit Eqs. 1-2 (and the effects that rig.toml names) jointly to all traces that are not held out.

    Several starts are descended from; from the deepest end the whitening filter and the least squares are renewed in
    turn until neither moves. A model that is far from the data is fitted free-running instead.

    Args:
        rig: a measurement folder.
        report: called with what is going on and the share done.
        settings: every threshold, budget and seed; written into the result.
        about: values of a like body, SI by symbol, to start from in place of the reading. No other start is tried where
            that one ends near the data; where it does not, the reading and all starts are, as without it.
    Raises:
        MeasurementError: nothing to fit, or rig.toml names what does not exist.
    """
    return finished(_end(rig, report, settings, about))


def fit_near(
    rig: Rig, report: Report = quiet, settings: FitSettings = FitSettings(), about: Mapping[str, float] | None = None
) -> Optimum | None:
    """Where `fit` ends, and nothing that is computed of that end (`finished`); None where it ends far from the data:
    for whoever asks only whether a model comes near, the free run is not gone into. Arguments as of `fit`."""
    return _end(rig, report, settings, about, only_near=True)


def finished(optimum: Optimum) -> FitResult:
    """What a fit leaves behind, its stated accuracy included."""
    return with_accuracy(outcome(optimum))


@overload
def _end(rig: Rig, report: Report, settings: FitSettings, about: Mapping[str, float] | None) -> Optimum: ...
@overload
def _end(
    rig: Rig, report: Report, settings: FitSettings, about: Mapping[str, float] | None, only_near: bool
) -> Optimum | None: ...
def _end(
    rig: Rig, report: Report, settings: FitSettings, about: Mapping[str, float] | None, only_near: bool = False
) -> Optimum | None:
    known = free_parameters(rig.config)
    fitted, held_out, notes = ready(rig)
    report("reading the paper's graphs", 0.02)
    readings = read_graphs(rig)
    start = known.layout.off_bounds(known.layout.coordinates(start_values(known, readings)))
    report("choosing integration steps", 0.05)
    problem = EstimationProblem.of(rig.config, known, fitted).refined(start).with_room_for(held_out, start, _SPARE)
    problem = problem.with_integrator_states(start)
    problem.compile_ahead(start)
    compile_ahead(start.size)
    near = None if about is None else _from_a_like_body(problem, start, about, settings)
    x, starts, misfit = near or _from_several_starts(problem, start, report, settings, only_near)
    x = with_lag_of(start, problem, x)
    problem = problem.with_instants(x)
    reached = _reached(problem, x, start, misfit, report, settings)
    if reached is None:
        if only_near:
            return None
        reached = fitted_free_running(problem, x, report, settings)
    trusted = not reached.end.far
    clocked = with_edges_in_step(rig, reached.problem, held_out, reached.x, settings.edges) if trusted else None
    if clocked is not None:  # instants of edges that were taken as independent share a phase
        report("edges in step with the samples: fitting their phase", 0.9)
        rig, (fitted, held_out, _) = clocked.rig, ready(clocked.rig)
        reached = _fitted_again(rig, fitted, reached, settings)
        decided = with_edges_on_samples(rig, reached, clocked.places, settings.edges)
        if decided is not None:  # a phase at the end of its interval is no free parameter
            rig, (fitted, held_out, _) = decided.rig, ready(decided.rig)
            reached = _fitted_again(rig, fitted, reached._replace(x=decided.x), settings)
    if trusted and reached.problem.controlled:
        reached = likeliest_nearby(reached, start, report, settings)
    problem, weighted, x, end = reached
    return Optimum(rig, readings, problem, held_out, weighted, x, end, starts, notes, settings)


class Descent(NamedTuple):
    """One descent from a starting point.

    Args:
        end: coordinates where it ended, shape (P,).
        before, after: chi2 at its start and its end.
        steps: Levenberg-Marquardt steps.
    """

    end: np.ndarray
    before: float
    after: float
    steps: int


class Deepest(NamedTuple):
    """The lowest end of all descents.

    Args:
        x: coordinates there, shape (P,).
        starts: every descent, in the order of the starting points.
        misfit: chi2 per degree of freedom there.
    """

    x: np.ndarray
    starts: tuple[StartSummary, ...]
    misfit: float


def deepest(
    points: Sequence[np.ndarray],
    descend_from: Callable[[int, np.ndarray, bool], Descent],
    freedom: float,
    settings: FitSettings = FitSettings(),
    checks: int | None = None,
) -> Deepest:
    """Descend from every starting point and keep the lowest end; of equal ones the first.

    Args:
        points: where to start, shape (P,) each; the first is the reading of the paper's graphs.
        descend_from: descends from the k-th point. Its last argument is True where the first end is near the data: then
            every other start is only a check, and a plain descent will do. From the second on they go side by side.
        freedom: degrees of freedom, samples less parameters.
        settings: `misfit` says what is near.
        checks: other starts where the first end leaves no more than noise; None: all. None can end much lower, but by
            half a standard error one does.
    """
    reading = descend_from(0, points[0], False)
    misfit = reading.after / freedom
    near, more = misfit < settings.misfit, len(points) - 1
    if checks is not None and misfit < _NOISE:
        more = min(more, checks)
    others = concurrently(lambda k: descend_from(k, points[k], near), range(1, 1 + more))
    best, lowest, summaries = points[0], np.inf, []
    for k, (end, before, after, steps) in enumerate([reading, *others]):
        summaries.append(StartSummary("reading" if k == 0 else f"scattered {k}", before, after, steps))
        if after < lowest:
            best, lowest = end, after
    return Deepest(best, tuple(summaries), lowest / freedom)


def _from_several_starts(
    problem: EstimationProblem, start: np.ndarray, report: Report, settings: FitSettings, only_near: bool
) -> Deepest:
    """From the reading first, then from points scattered about it.

    Args:
        only_near: an end far from the data is of no use: then no descent goes on to it.
    """
    rng = np.random.default_rng(settings.seed)
    reach = settings.spread * problem.layout.reach(start)
    others = [start + reach * rng.standard_normal(start.size) for _ in range(settings.starts)]
    weighted = problem.weighted(weights.forgiving(problem))
    tolerance, count = settings.rough_tolerance, settings.starts + 1
    freedom = max(1.0, weighted.samples - start.size)
    # an ECU in the model may bring a far end near in the rounds
    hopeless = _HOPELESS * settings.misfit * freedom if only_near and not problem.controlled else np.inf

    def descend_from(k: int, first: np.ndarray, near: bool) -> Descent:
        if k < 2:  # from there on they go side by side
            report("start 1, the reading" if k == 0 else f"starts 2 to {count}", 0.1 + 0.4 * k / count)
        if near:
            end, steps = descend(problem, first, weighted, tolerance, settings.steps)
        else:
            end, steps = approach(problem.with_integrator_states(first), first, tolerance, settings, hopeless)
        before, after = (_forgiven(problem, x) for x in (first, end))
        return Descent(end, before, after, steps)

    return deepest([start, *others], descend_from, freedom, settings, checks=0 if only_near else None)


def _from_a_like_body(
    problem: EstimationProblem, start: np.ndarray, about: Mapping[str, float], settings: FitSettings
) -> Deepest | None:
    """From the values of a like body, where it names them; None where that ends far from the data."""
    layout = problem.layout
    values = {**layout.values(start, problem.free_parameters.held), **about}
    first = layout.off_bounds(layout.coordinates(values))
    weighted = problem.weighted(weights.forgiving(problem))
    end, steps = descend(problem, first, weighted, settings.rough_tolerance, settings.steps)
    before, after = (_forgiven(problem, x) for x in (first, end))
    misfit = after / max(1.0, weighted.samples - start.size)
    if misfit >= settings.misfit:
        return None
    return Deepest(end, (StartSummary("a like body", before, after, steps),), misfit)


def _forgiven(problem: EstimationProblem, x: np.ndarray) -> float:
    """chi2 at x, shape (P,), instants forgiven, each ECU's integral begun as fits best there."""
    problem = problem.with_integrator_states(x)
    return float(chi2_of(problem, x[None], problem.weighted(weights.forgiving(problem)))[0])


def _fitted_again(rig: Rig, fitted: tuple[Trace, ...], reached: Reached, settings: FitSettings) -> Reached:
    """The rounds once more, of a rig of which more is known and of its traces, from where they ended."""
    known, before = free_parameters(rig.config), reached.problem
    found = before.layout.values(reached.x, before.free_parameters.held)
    x = known.layout.coordinates({**known.start, **found})
    problem = EstimationProblem.of(rig.config, known, fitted).refined(x)
    return whitened(problem.with_instants(x), x, quiet, settings)


def _reached(
    problem: EstimationProblem, x: np.ndarray, start: np.ndarray, misfit: float, report: Report, settings: FitSettings
) -> Reached | None:
    """The whitened end of the fit from the deepest descent; None where that came not near the data.

    Under an ECU no descent may come near, though the model is right: then others are tried before it is called far.
    """
    if misfit < settings.misfit:
        return whitened(problem, x, report, settings)
    if problem.controlled:
        far = rounds(problem, x, quiet, settings.settled, settings.first_rounds, settings)
        reached = likeliest_nearby(far, start, report, settings)
        if reached.misfit < settings.misfit:
            return reached
    return None


def fitted_free_running(problem: EstimationProblem, x: np.ndarray, report: Report, settings: FitSettings) -> Reached:
    """Least squares of the free-running simulation, for a model far from the data.

    What such a model lacks is larger than all that the whitening knows of, so the whitening would only let it follow
    the data; and there a fit may be trapped, so it is searched for as well as descended to. Each channel of each trace
    is weighed by the error that is left in it: what the model cannot explain must not spoil what it can.
    """
    led = False
    for k in range(settings.reweighings):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        problem, weighted, x, now = freed(problem, x, settings.spread / 2.0**k, settings, guided=not led)
        led = led or now  # from its own valley the guide leads back to it
    reached = searched(Reached(problem, weighted, x, Termination(False, "")), report, settings)
    return reached._replace(end=replace(reached.end, far=True))


class FreeRun(NamedTuple):
    """The best free-running simulation that was found.

    Args:
        problem: the data, each channel of each trace weighed by the error left in it.
        weighted: what the residual was minimised over.
        x: coordinates, shape (P,).
        led: a guide led there.
    """

    problem: EstimationProblem
    weighted: WeightedData
    x: np.ndarray
    led: bool


def freed(
    problem: EstimationProblem,
    x: np.ndarray,
    spread: float,
    settings: FitSettings = FitSettings(),
    guided: bool = True,
) -> FreeRun:
    """The best free run about x: weighed by the error left in each channel, searched for, descended to, and the one
    to which a guide leads from there, where that is likelier.

    Args:
        problem: the traces.
        x: coordinates, shape (P,).
        spread: of the points searched, in units of each coordinate's reach.
        settings: budgets of search and descent.
        guided: whether a guide is tried.
    """
    problem = weights.discounted(problem, x)
    weighted = problem.weighted(weights.free_running(problem))
    x = evolve(problem, x, weighted, spread * problem.layout.reach(x), settings.search)
    x, _ = minimise(problem, x, weighted, settings.tolerance, settings.steps)
    end = let_go(problem, x, settings) if guided else x
    if end is x:
        return FreeRun(problem, weighted, x, led=False)
    problem = weights.discounted(problem, end)
    return FreeRun(problem, problem.weighted(weights.free_running(problem)), end, led=True)
