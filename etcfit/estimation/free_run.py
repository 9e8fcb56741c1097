"""The fit of a model that is far from its data: led by a guide, fitted in the free run, grown from smaller models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..model.effects import PAPER, AbstractEffect
from ..model.parameters import parameters_of
from ..problem import weights
from ..problem.chi2 import chi2_of
from ..problem.free_parameters import effect_named
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from ..rig.base import Rig, Tied
from .levenberg_marquardt import ROUGH_TOLERANCE, descend_in_stages, minimise
from .result import Termination
from .rounds import Reached, Report, evolve_population, quiet, searched, whitened
from .settings import FitSettings

# ---- A guide at the terminals pulls the simulated plate towards the measured angle; relaxed step by step, it leads to
# the best free run.
#
#     V_guide = stiffness (theta_measured - theta)
#
# Far from the data a free run leaves the measured path at the first stick or impact that it misses, and its chi2 has
# many valleys. With a stiff guide it cannot leave the path, and chi2 has one valley; with each weaker guide the valley
# is at nearly the same place, and a little deeper.
#
# Source: Abarbanel et al. 2009 (synchronisation by a coupling); Vyasarayani, Uchida and McPhee 2012, Phys. Rev. E 85
# (single shooting with a coupling that is removed step by step). Differs from source: the coupling acts at the
# terminals, each channel is reweighted by its residual, and the coupling's first stiffness is physical.


GIVE = 0.01  # deflection of the guide under a torque as large as dry friction, over the measured travel
BANDWIDTH = 15.0  # bandwidth that gives the least stiffness, Hz
BANDWIDTH_OF_RATE = 0.1  # largest value of this bandwidth, over the sample rate
LEAST = 0.003  # least stiffness over J w^2, w the bandwidth: for plates with hardly any dry friction
STABLE = 0.3  # largest stiffness, over that at which guide and coil would oscillate
SHARES = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003)
"""Factors of the stiffness, in turn, with which a model far from its data is led into its free run."""


class Guided(NamedTuple):
    """The measured angle along which a plate is guided."""

    span: float  # largest travel within a trace, rad
    rate: float  # sample rate, Hz
    torque_driven: bool  # the guide acts as a torque, not as a voltage


def guide_stiffness_of(problem: EstimationProblem, x: np.ndarray) -> float:
    """Stiffness of the guide for these traces; 0 if no angle was logged. Arguments and units: `guide_stiffness`."""
    guided = [t for t in problem.batch.traces if "position" in t.channels]
    if not guided:
        return 0.0
    angles = [t.data[:, t.channels.index("position")] for t in guided]
    record = Guided(
        span=max(float(np.nanmax(a) - np.nanmin(a)) for a in angles),
        rate=1.0 / float(np.median(np.concatenate([np.diff(t.instants) for t in guided]))),
        torque_driven=all(t.torque_driven for t in guided),
    )
    values = problem.layout.values(x, problem.free_parameters.held)
    return guide_stiffness(values, problem.config.gear_ratio, record)


def guide_stiffness(values: Mapping[str, Any], gear: float, record: Guided) -> float:
    """Stiffness with which a guide pulls the plate along its measured angle.

        torque = max(T_f / (0.01 span), 0.003 J w^2),    w = 2 pi min(15 Hz, rate / 10),    J = N^2 J_m + J_L
        volts  = min(torque R_a / (N K_m), 0.3 N K_b R_a / L_a)

    Above the last bound guide and coil would oscillate. The numbers are `GIVE`, `LEAST`, `BANDWIDTH`,
    `BANDWIDTH_OF_RATE` and `STABLE`.

    Args:
        values: parameters, SI by symbol.
        gear: N.
        record: the measured angle.
    Returns:
        V/rad, or N m/rad if a torque is the input.
    """
    inertia = gear**2 * float(values["J_m"]) + float(values["J_L"])
    hertz = min(BANDWIDTH, BANDWIDTH_OF_RATE * record.rate)
    stiff = inertia * (2.0 * np.pi * hertz) ** 2
    torque = max(float(values["T_f"]) / max(GIVE * record.span, 1e-9), LEAST * stiff)
    if record.torque_driven:
        return torque
    R_a = float(values["R_a"])
    fastest = gear * float(values["K_b"]) * R_a / float(values["L_a"])  # V/rad
    return min(torque * R_a / (gear * float(values["K_m"])), STABLE * fastest)


def relax_guide(problem: EstimationProblem, x: np.ndarray, settings: FitSettings = FitSettings()) -> np.ndarray:
    """The end of the relaxed guide if its free run is likelier than that of x; else x itself."""
    if guide_stiffness_of(problem, x) == 0.0:
        return x
    here, _ = led_by_guide(problem, x, settings.tolerance, settings)
    return here if free_run_cost(problem, here) < free_run_cost(problem, x) else x


def led_by_guide(
    problem: EstimationProblem, x: np.ndarray, tolerance: float, settings: FitSettings
) -> tuple[np.ndarray, int]:
    """The end of the guide, relaxed step by step from x, and the number of Levenberg-Marquardt steps.

    Args:
        tolerance: relative change of chi2 that ends each descent.
    """
    stiffness, steps = guide_stiffness_of(problem, x), 0
    for share in (*SHARES, 0.0):
        guided = weights.discounted(problem.guided(share * stiffness), x)
        weighted = guided.weighted(weights.free_running(guided))
        x, more = minimise(guided, x, weighted, tolerance, settings.steps)
        steps += more
    return x, steps


def free_run_cost(problem: EstimationProblem, x: np.ndarray) -> float:
    """-log likelihood of the free run, each channel of each trace with its residual as the noise.

    sum of (y - y_hat)^2 / 2 sigma^2 + log sigma,    sigma as of `weights.discounted`
    """
    free = weights.discounted(problem.guided(0.0), x)
    chi2 = free.chi2(x, free.weighted(weights.free_running(free)))
    slots = problem.batch.slots
    return 0.5 * chi2 + float(np.sum(np.log(free.sigma / slots.sigma)[slots.weight > 0.0]))


# ---- The fit of a model that is far from its data: least squares of the free run, by a search and by a guide

REWEIGHINGS = 3  # times that the weight of each channel is renewed from its residual


def fitted_free_running(
    problem: EstimationProblem, x: np.ndarray, report: Report, settings: FitSettings, led: bool = False
) -> Reached:
    """Least squares of the free-running simulation, for a model far from the data.

    The error of such a model is larger than all noise that the whitening models, so the whitening would only make it
    follow the data. The descent may end in a local optimum, so there is a search too. Each channel of each trace is
    weighted by its residual, so that channels that the model cannot explain do not distort the others.

    Args:
        led: whether a guide led to x already, so that none is tried again.
    """
    for k in range(REWEIGHINGS):
        report("no start comes near the data: searching about the best", 0.5 + 0.1 * k)
        problem, weighted, x, now = freed(problem, x, settings.spread / 2.0**k, settings, guided=not led)
        led = led or now  # from its own valley the guide leads back to it
    reached = searched(Reached(problem, weighted, x, Termination(False, "")), report, settings)
    return reached._replace(end=replace(reached.end, far=True))


class FreeRun(NamedTuple):
    """The best free-running simulation that was found."""

    problem: EstimationProblem  # the data, each channel of each trace weighted by its residual
    weighted: WeightedData  # the weighted data of the minimised residual
    x: np.ndarray  # coordinates, shape (P,)
    led: bool  # whether a guide led there


def freed(
    problem: EstimationProblem, x: np.ndarray, spread: float, settings: FitSettings = FitSettings(), guided: bool = True
) -> FreeRun:
    """The best free run about x, weighted by the residual of each channel: by a search, a descent, and the end of a
    guide from there if that is likelier.

    Args:
        spread: spread of the search's points, in units of each coordinate's reach.
        guided: whether a guide is tried.
    """
    problem = weights.discounted(problem, x)
    weighted = problem.weighted(weights.free_running(problem))
    reach = spread * problem.layout.reach(x)
    x = evolve_population(lambda points: chi2_of(problem, points, weighted), x, reach, settings.search)
    x, _ = minimise(problem, x, weighted, settings.tolerance, settings.steps)
    end = relax_guide(problem, x, settings) if guided else x
    if end is x:
        return FreeRun(problem, weighted, x, led=False)
    problem = weights.discounted(problem, end)
    return FreeRun(problem, problem.weighted(weights.free_running(problem)), end, led=True)


# ---- A model that contains another is also started from the end of the other, and ends no higher
#
# Far from the data the sum of squares has many valleys, and the reading of a rig with more effects may lead into a
# worse one. So if the fit of a model with named effects stays far, the fit goes up a chain of models: first without
# those effects; then it adds one after the other, each time the effect that lowers the free run's error most when a
# guide leads from the optimum of the model before (`relax_guide`). Each model of the chain takes the lower of two ends:
# that from its own starts and that from the model before. The chain of a smaller model is the beginning of a larger
# one's, as long as the further effects explain less.
#
# Source: forward selection (Miller 2002, Subset Selection in Regression, ch. 3). Differs from source: the set is given;
# the order only gives starts.


class Model(NamedTuple):
    """A model and its data, before any fit."""

    problem: EstimationProblem  # the traces
    start: np.ndarray  # coordinates of the reading, shape (P,)


Begin = Callable[[Rig], Model]
EndOf = Callable[[Model], Reached]  # fits a model from its own starts


def comes_near(reached: Reached, settings: FitSettings) -> bool:
    """Whether a fit came near its data and stayed near under the whitening."""
    return not reached.end.far and reached.misfit < settings.misfit


def removable_effects(rig: Rig) -> tuple[str, ...]:
    """Names of the effects of rig.toml that can be removed from the model, in their order there: effects with off
    values to whose parameters no other is tied."""
    every = {name: effect_named(name) for name in rig.config.effects}
    needed = {to.to for to in rig.config.parameters.values() if isinstance(to, Tied)}

    def can_go(effect: type[AbstractEffect]) -> bool:
        own = {p.symbol for p in parameters_of(effect)}
        return effect not in PAPER and bool(effect.off) and not effect.commands and not own & needed

    return tuple(name for name, effect in every.items() if can_go(effect))


def with_only(rig: Rig, effects: tuple[str, ...]) -> Rig:
    """The rig with some of the effects that its rig.toml names, without the settings of the other effects'
    parameters."""
    gone = {p.symbol for name in rig.config.effects if name not in effects for p in parameters_of(effect_named(name))}
    known = {symbol: value for symbol, value in rig.config.parameters.items() if symbol not in gone}
    return replace(rig, config=replace(rig.config, effects=effects, parameters=known))


def no_higher_than_smaller(
    rig: Rig,
    model: Model,
    own: Reached,
    begin: Begin,
    end_of: EndOf,
    report: Report = quiet,
    settings: FitSettings = FitSettings(),
) -> Reached:
    """The end of a model that stayed far from its data, or the lower one that smaller models inside it lead to.

    Args:
        model: the model with all effects.
        own: its end from its own starts.
        begin: makes the model of another rig.
        end_of: fits a model from its own starts.
    """
    names = removable_effects(rig)
    base = tuple(name for name in rig.config.effects if name not in names)
    report("no start comes near the data: beginning with smaller models", 0.6)
    smaller = begin(with_only(rig, base))
    end = _free(smaller, end_of(smaller), settings)
    here: tuple[str, ...] = ()
    while rest := [name for name in names if name not in here]:
        last = len(rest) == 1
        larger = {name: model if last else begin(with_only(rig, (*base, *here, name))) for name in rest}
        best, point = likeliest_addition(smaller.problem, end.x, larger, settings)
        report(f"starting from a smaller model, with {best} in it", 0.6 + 0.3 * len(here) / len(names))
        here, smaller = (*here, best), larger[best]
        end = lower_end(smaller, own if last else end_of(smaller), point, settings)
    return end


def likeliest_addition(
    smaller: EstimationProblem, x: np.ndarray, larger: Mapping[str, Model], settings: FitSettings
) -> tuple[str, np.ndarray]:
    """The effect whose guided start from a smaller model's optimum is lowest, and that start, see `guided_start`."""
    points = {name: guided_start(smaller, x, name, each, settings) for name, each in larger.items()}
    best = min(points, key=lambda name: free_run_cost(larger[name].problem, points[name]))
    return best, points[best]


def guided_start(
    smaller: EstimationProblem, x: np.ndarray, name: str, larger: Model, settings: FitSettings
) -> np.ndarray:
    """The optimum of a smaller model in a larger one, or the end of a guide from there if that is likelier.

    Args:
        smaller: the end of the smaller model.
        name: name of the additional effect of the larger model.
    Returns:
        Coordinates in the larger model, shape (P + free parameters of the effect,).
    """
    layout, held = larger.problem.layout, larger.problem.free_parameters.held
    off = effect_named(name).off or {}
    values = {**layout.values(larger.start, held), **off, **smaller.layout.values(x, smaller.free_parameters.held)}
    same = layout.coordinates(values)
    led = relax_guide(larger.problem, layout.off_bounds(same), settings)
    return min((same, led), key=lambda point: free_run_cost(larger.problem, point))


def lower_end(model: Model, own: Reached, x: np.ndarray, settings: FitSettings) -> Reached:
    """The end of a model from x, shape (P,), if it comes near the data or below the end from its own starts; else
    that."""
    if comes_near(own, settings):
        return own
    near = _near(model.problem, x, settings)
    if near is not None:
        return near
    ends = _free(model, own, settings), fitted_free_running(model.problem, x, quiet, settings, led=True)
    return min(ends, key=lambda reached: free_run_cost(reached.problem, reached.x))


def _near(problem: EstimationProblem, x: np.ndarray, settings: FitSettings) -> Reached | None:
    """The whitened end from x; None if it does not come near the data."""
    x, _ = descend_in_stages(problem, x, ROUGH_TOLERANCE, settings)
    weighted = problem.weighted(weights.forgiving(problem))
    if problem.chi2(x, weighted) >= settings.misfit * max(1.0, weighted.samples - x.size):
        return None
    reached = whitened(problem, x, quiet, settings)
    return reached if comes_near(reached, settings) else None


def _free(model: Model, own: Reached, settings: FitSettings) -> Reached:
    """The end as an end of the free run, if its whitened residual is as large as that of a model far from its data."""
    if own.end.far or comes_near(own, settings):
        return own
    return fitted_free_running(model.problem, own.x, quiet, settings)
