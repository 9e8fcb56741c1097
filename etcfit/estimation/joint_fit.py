"""The joint fit of all traces: from the paper's reading, through several starts, to an optimum."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ..problem import weights
from ..problem.chi2 import chi2_of
from ..problem.cores import concurrently, in_background
from ..problem.free_parameters import free_parameters
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..problem.trace import Trace
from ..rig.base import Rig
from ..rig.paper_readings import Readings, read_graphs
from .edges import phases_hold, with_edges_in_step, with_edges_on_samples
from .free_run import Model, comes_near, fitted_free_running, led_by_guide, no_higher_than_smaller, removable_effects
from .intervals import with_accuracy
from .levenberg_marquardt import ROUGH_TOLERANCE, descend, descend_in_stages, with_lag_of_start
from .ready import ready, start_values
from .result import FitResult as FitResult
from .result import Optimum, outcome
from .result import StartSummary as StartSummary
from .rounds import FIRST_ROUNDS, SETTLED, Reached, likeliest_nearby, rounds, whitened
from .rounds import Report as Report
from .rounds import quiet as quiet
from .settings import FitSettings

_NOISE = 1.0  # chi2 per degree of freedom of noise alone
_HOPELESS = 3.0  # times the misfit of a far model: a descent stopped early may be so far above its end
_SPARE = 1.06  # factor on the integration steps of held-out traces at the start: other values need a few steps more
MISFIT = FitSettings().misfit  # the default, to judge a fit from its JSON file alone


def _compile_step(size: int) -> None:
    from .damped_step import compile_step

    compile_step(size)


def fit(
    rig: Rig, report: Report = quiet, settings: FitSettings = FitSettings(), about: Mapping[str, float] | None = None
) -> FitResult:
    """Fit Eqs. 1-2 (and the effects that rig.toml names) jointly to all traces that are not held out.

    It descends from several starts. From the deepest end it renews the whitening filter and the least squares in turn
    until neither changes. A model that is far from the data is fitted free-running instead.

    Args:
        rig: a measurement folder.
        report: called with the current step and the share done.
        settings: thresholds, budgets and seeds; written into the result.
        about: values of a similar body, SI by symbol, as a start in place of the reading. If that start ends near the
            data, no other is tried; else the reading and all other starts are tried, as without it.
    Raises:
        MeasurementError: nothing to fit, or rig.toml names something that does not exist.
    """
    optimum = _end(rig, report, settings, about)
    assert optimum is not None, "None is possible only if an end near the data is required"
    return finished(optimum)


def fit_near(
    rig: Rig, report: Report = quiet, settings: FitSettings = FitSettings(), about: Mapping[str, float] | None = None
) -> Optimum | None:
    """The end of `fit`, without the results computed there (`finished`); None if it is far from the data. It only shows
    whether a model comes near, so it makes no fit of the free run. Arguments as of `fit`."""
    return _end(rig, report, settings, about, only_near=True)


def finished(optimum: Optimum) -> FitResult:
    """The result of a fit, with the stated accuracy of the instruments."""
    return with_accuracy(outcome(optimum))


def _end(
    rig: Rig, report: Report, settings: FitSettings, about: Mapping[str, float] | None, only_near: bool = False
) -> Optimum | None:
    begun = _begun(rig, report)
    start, held_out = begun.model.start, begun.held_out
    ended = _ended(begun.model, report, settings, about, only_near)
    if ended is None:
        return None
    reached, starts = ended
    if not (only_near or begun.model.problem.controlled or comes_near(reached, settings)) and removable_effects(rig):

        def end_of(smaller: Model) -> Reached:
            return from_own_starts(smaller, settings)

        reached = no_higher_than_smaller(rig, begun.model, reached, model_of, end_of, report, settings)
    trusted = not reached.end.far
    clocked = with_edges_in_step(rig, reached.problem, held_out, reached.x) if trusted else None
    if clocked is not None:  # the instants of edges, taken as independent before, share a phase
        report("edges in step with the samples: fitting their phase", 0.9)
        prepared = ready(clocked.rig)
        phased = _fitted_again(clocked.rig, prepared.fitted, reached, settings)
        if phases_hold(phased.problem, phased.x):
            rig, (traces, held_out, _), reached = clocked.rig, prepared, phased
            decided = with_edges_on_samples(rig, reached, clocked.places)
            if decided is not None:  # a phase at the end of its interval is no free parameter
                rig, (traces, held_out, _) = decided.rig, ready(decided.rig)
                reached = _fitted_again(rig, traces, reached._replace(x=decided.x), settings)
    if trusted and reached.problem.controlled:
        reached = likeliest_nearby(reached, start, report, settings)
    problem, weighted, x, end = reached
    return Optimum(rig, begun.readings, problem, held_out, weighted, x, end, starts, begun.notes, settings)


class _Begun(NamedTuple):
    """A rig ready to be fitted."""

    model: Model  # the model and its traces
    readings: Readings  # the readings of the paper's graphs
    # held_out, notes: as `Prepared` has them
    held_out: tuple[Trace, ...]
    notes: tuple[str, ...]


def _begun(rig: Rig, report: Report) -> _Begun:
    known = free_parameters(rig.config)
    fitted, held_out, notes = ready(rig)
    report("reading the paper's graphs", 0.02)
    readings = read_graphs(rig)
    start = known.layout.off_bounds(known.layout.coordinates(start_values(known, readings)))
    report("choosing integration steps", 0.05)
    problem = (
        EstimationProblem.of_traces(rig.config, known, fitted).refined(start).with_room_for(held_out, start, _SPARE)
    )
    return _Begun(Model(problem.with_integrator_states(start), start), readings, held_out, notes)


def model_of(rig: Rig) -> Model:
    """The model of a rig and its traces, ready to be fitted."""
    return _begun(rig, quiet).model


def from_own_starts(model: Model, settings: FitSettings = FitSettings()) -> Reached:
    """The end of a model from the reading and from the points scattered about it."""
    ended = _ended(model, quiet, settings)
    assert ended is not None, "None is possible only if an end near the data is required"
    return ended[0]


def _ended(
    model: Model,
    report: Report,
    settings: FitSettings,
    about: Mapping[str, float] | None = None,
    only_near: bool = False,
) -> tuple[Reached, tuple[StartSummary, ...]] | None:
    """The end of a model from its own starts, and its descents; None if an end near the data is required and there is
    none."""
    problem, start = model
    problem.compile_ahead()
    in_background(partial(_compile_step, start.size))
    near = None if about is None else _from_a_like_body(problem, start, about, settings)
    if near is None and _angles_alone(problem):
        report("start 1, the reading, led along the measured angle", 0.1)
        # from the end of a guide that starts at the reading; None if that ends far from the data
        led, steps = led_by_guide(problem, start, ROUGH_TOLERANCE, settings)
        near = _from_one_start("reading, led along the measured angle", problem, start, led, steps, settings)
    x, starts, misfit = near or _from_several_starts(problem, start, report, settings, only_near)
    x = with_lag_of_start(start, problem, x)
    problem = problem.with_instants(x)
    reached = _reached(problem, x, start, misfit, report, settings)
    if reached is None and not only_near:
        reached = fitted_free_running(problem, x, report, settings)
    return None if reached is None else (reached, starts)


class Descent(NamedTuple):
    """One descent from a starting point."""

    end: np.ndarray  # coordinates of its end, shape (P,)
    # before, after: chi2 at its start and its end
    before: float
    after: float
    steps: int  # Levenberg-Marquardt steps


class Deepest(NamedTuple):
    """The lowest end of all descents."""

    x: np.ndarray  # its coordinates, shape (P,)
    starts: tuple[StartSummary, ...]  # every descent, in the order of the starting points
    misfit: float  # its chi2 per degree of freedom


def deepest(
    points: Sequence[np.ndarray],
    descend_from: Callable[[int, np.ndarray, bool], Descent],
    freedom: float,
    settings: FitSettings = FitSettings(),
    checks: int | None = None,
) -> Deepest:
    """Descend from every starting point and keep the lowest end; of equal ones the first.

    Args:
        points: starting points, shape (P,) each; the first is the reading of the paper's graphs.
        descend_from: descends from the k-th point. Its last argument is True if the first end is near the data: then
            the other starts are only checks, and a plain descent is enough. From the second on they run in parallel.
        freedom: degrees of freedom, samples minus parameters.
        settings: `misfit` defines near.
        checks: number of other starts if the residual of the first end is noise; None: all. No other start can end much
            lower then, but one may end lower by half a standard error.
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
        only_near: an end far from the data is not needed: no descent to one is continued.
    """
    rng = np.random.default_rng(settings.seed)
    reach = settings.spread * problem.layout.reach(start)
    others = [start + reach * rng.standard_normal(start.size) for _ in range(settings.starts)]
    weighted = problem.weighted(weights.forgiving(problem))
    tolerance, count = ROUGH_TOLERANCE, settings.starts + 1
    freedom = max(1.0, weighted.samples - start.size)
    # an ECU in the model may bring a far end near in the rounds
    hopeless = _HOPELESS * settings.misfit * freedom if only_near and not problem.controlled else np.inf

    def descend_from(k: int, first: np.ndarray, near: bool) -> Descent:
        if k < 2:  # from there on they run in parallel
            report("start 1, the reading" if k == 0 else f"starts 2 to {count}", 0.1 + 0.4 * k / count)
        if near:
            end, steps = descend(problem, first, weighted, tolerance, settings.steps)
        else:
            end, steps = descend_in_stages(problem.with_integrator_states(first), first, tolerance, settings, hopeless)
        before, after = (_forgiven(problem, x, weighted) for x in (first, end))
        return Descent(end, before, after, steps)

    return deepest([start, *others], descend_from, freedom, settings, checks=0 if only_near else None)


def _from_a_like_body(
    problem: EstimationProblem, start: np.ndarray, about: Mapping[str, float], settings: FitSettings
) -> Deepest | None:
    """From the values of a similar body, where given; None if that ends far from the data."""
    layout = problem.layout
    values = {**layout.values(start, problem.free_parameters.held), **about}
    first = layout.off_bounds(layout.coordinates(values))
    return _from_one_start("a like body", problem, first, first, 0, settings)


def _angles_alone(problem: EstimationProblem) -> bool:
    """Whether every trace logs only the plate's angle, with a known voltage. Without a current the paper's reading
    determines little, and a guide along the angle leads to the valley of the data sooner than many starts do."""
    return not problem.controlled and all(set(trace.channels) == {"position"} for trace in problem.batch.traces)


def _from_one_start(
    name: str, problem: EstimationProblem, start: np.ndarray, first: np.ndarray, led: int, settings: FitSettings
) -> Deepest | None:
    """One descent in place of all starts; None if it ends far from the data.

    Args:
        start: the first point, whose chi2 is in the summary, shape (P,).
        first: the start of the descent, shape (P,): the same point, or the end of a guide from there.
        led: number of steps of that guide.
    """
    weighted = problem.weighted(weights.forgiving(problem))
    end, steps = descend(problem, first, weighted, ROUGH_TOLERANCE, settings.steps)
    before, after = (_forgiven(problem, x, weighted) for x in (start, end))
    misfit = after / max(1.0, weighted.samples - start.size)
    if misfit >= settings.misfit:
        return None
    return Deepest(end, (StartSummary(name, before, after, led + steps),), misfit)


def _forgiven(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> float:
    """chi2 at x, shape (P,), with errors of timing allowed and each ECU's integral at its best initial value."""
    there = problem.with_integrator_states(x)
    forgiven = weighted if there is problem else there.weighted(weights.forgiving(there))
    return float(chi2_of(there, x[None], forgiven)[0])


def _fitted_again(rig: Rig, fitted: tuple[Trace, ...], reached: Reached, settings: FitSettings) -> Reached:
    """The rounds again, from their end, for a rig with further known properties."""
    known, before = free_parameters(rig.config), reached.problem
    found = before.layout.values(reached.x, before.free_parameters.held)
    x = known.layout.coordinates({**known.start, **found})
    problem = EstimationProblem.of_traces(rig.config, known, fitted).refined(x)
    return whitened(problem.with_instants(x), x, quiet, settings)


def _reached(
    problem: EstimationProblem, x: np.ndarray, start: np.ndarray, misfit: float, report: Report, settings: FitSettings
) -> Reached | None:
    """The whitened end of the fit from the deepest descent; None if that did not come near the data.

    With an ECU in the model it is possible that no descent comes near although the model is right: then others are
    tried before the model is called far.
    """
    if misfit < settings.misfit:
        return whitened(problem, x, report, settings)
    if problem.controlled:
        far = rounds(problem, x, quiet, SETTLED, FIRST_ROUNDS, settings)
        reached = likeliest_nearby(far, start, report, settings)
        if reached.misfit < settings.misfit:
            return reached
    return None
