"""A model that holds another is also started from where that one ended, and ends no higher.

Far from the data the sum of squares has many valleys, and the reading of a rig with more effects may lead into a worse
one. So where the fit of a model with named effects stays far, the fit goes up a chain: without those effects; then with
one after the other, each time the one that lowers the free run's error most where a guide leads it from the optimum of
the model before (`let_go`). Each model of the chain ends in the lower of its own end and of that which begins there.
The chain of a smaller model is the beginning of a larger one's, as long as what is added explains less.

Source: forward selection (Miller 2002, Subset Selection in Regression, ch. 3). Differs from source: the set is given;
the order in which it is built only gives starts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..model.effects import PAPER, AbstractEffect
from ..model.parameters import parameters_of
from ..problem import weights
from ..problem.free_parameters import effect_named
from ..problem.problem import EstimationProblem
from ..rig.base import Rig, Tied
from .approach import approach
from .free_run import fitted_free_running
from .guide import let_go, unlikely
from .rounds import Reached, Report, quiet, whitened
from .settings import FitSettings


class Model(NamedTuple):
    """A model beside its data, nothing fitted yet.

    Args:
        problem: the traces.
        start: coordinates of the reading, shape (P,).
    """

    problem: EstimationProblem
    start: np.ndarray


Begin = Callable[[Rig], Model]
EndOf = Callable[[Model], Reached]  # where a model ends from its own starts


def comes_near(reached: Reached, settings: FitSettings) -> bool:
    """Whether a fit came near its data and stayed there through the whitening."""
    return not reached.end.far and reached.misfit < settings.misfit


def growing(rig: Rig) -> tuple[str, ...]:
    """Names of the effects of rig.toml that can be taken out of the model, in the order in which they stand there:
    those with off values, to whose parameters no other is tied."""
    every = {name: effect_named(name) for name in rig.config.effects}
    needed = {to.to for to in rig.config.parameters.values() if isinstance(to, Tied)}

    def can_go(effect: type[AbstractEffect]) -> bool:
        own = {p.symbol for p in parameters_of(effect)}
        return effect not in PAPER and bool(effect.off) and not effect.commands and not own & needed

    return tuple(name for name, effect in every.items() if can_go(effect))


def with_only(rig: Rig, effects: tuple[str, ...]) -> Rig:
    """The rig with some of the effects that its rig.toml names, and without what it says of the others' parameters."""
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
    """The end of a model that stayed far from its data, or the lower one to which smaller models inside it lead.

    Args:
        rig: whose rig.toml names the effects.
        model: with all of them.
        own: where it ended from its own starts.
        begin: the model of another rig.
        end_of: fits a model from its own starts.
        report: progress.
        settings: budgets of guide, search and descent.
    """
    names = growing(rig)
    base = tuple(name for name in rig.config.effects if name not in names)
    report("no start comes near the data: beginning with smaller models", 0.6)
    smaller = begin(with_only(rig, base))
    end = _free(smaller, end_of(smaller), settings)
    here: tuple[str, ...] = ()
    while rest := [name for name in names if name not in here]:
        last = len(rest) == 1
        larger = {name: model if last else begin(with_only(rig, (*base, *here, name))) for name in rest}
        best, point = lowest(smaller.problem, end.x, larger, settings)
        report(f"starting from a smaller model, with {best} in it", 0.6 + 0.3 * len(here) / len(names))
        here, smaller = (*here, best), larger[best]
        end = lower(smaller, own if last else end_of(smaller), point, settings)
    return end


def lowest(
    smaller: EstimationProblem, x: np.ndarray, larger: Mapping[str, Model], settings: FitSettings
) -> tuple[str, np.ndarray]:
    """Of several effects the one whose model is led lowest from a smaller model's optimum, and where to: `led_from`."""
    points = {name: led_from(smaller, x, name, each, settings) for name, each in larger.items()}
    best = min(points, key=lambda name: unlikely(larger[name].problem, points[name]))
    return best, points[best]


def led_from(smaller: EstimationProblem, x: np.ndarray, name: str, larger: Model, settings: FitSettings) -> np.ndarray:
    """The optimum of a smaller model in a larger one, or where a guide leads from there if that is likelier.

    Args:
        smaller: the model that ended there.
        x: coordinates of its end, shape (P,).
        name: of the effect that the larger one has besides.
        larger: where to start.
        settings: of the guide.
    Returns:
        coordinates in the larger model, shape (P + free parameters of the effect,).
    """
    layout, held = larger.problem.layout, larger.problem.free_parameters.held
    off = effect_named(name).off or {}
    values = {**layout.values(larger.start, held), **off, **smaller.layout.values(x, smaller.free_parameters.held)}
    same = layout.coordinates(values)
    led = let_go(larger.problem, layout.off_bounds(same), settings)
    return min((same, led), key=lambda point: unlikely(larger.problem, point))


def lower(model: Model, own: Reached, x: np.ndarray, settings: FitSettings) -> Reached:
    """The end of a model from x, shape (P,), where it comes near the data or below the one from its own starts."""
    if comes_near(own, settings):
        return own
    near = _near(model.problem, x, settings)
    if near is not None:
        return near
    ends = _free(model, own, settings), fitted_free_running(model.problem, x, quiet, settings, led=True)
    return min(ends, key=lambda reached: unlikely(reached.problem, reached.x))


def _near(problem: EstimationProblem, x: np.ndarray, settings: FitSettings) -> Reached | None:
    """The whitened end from x; None where it does not come near the data."""
    x, _ = approach(problem, x, settings.rough_tolerance, settings)
    weighted = problem.weighted(weights.forgiving(problem))
    if problem.chi2(x, weighted) >= settings.misfit * max(1.0, weighted.samples - x.size):
        return None
    reached = whitened(problem, x, quiet, settings)
    return reached if comes_near(reached, settings) else None


def _free(model: Model, own: Reached, settings: FitSettings) -> Reached:
    """An end whose whitened residual is as large as that of a model far from its data, as an end of the free run."""
    if own.end.far or comes_near(own, settings):
        return own
    return fitted_free_running(model.problem, own.x, quiet, settings)
