"""Do the parts of the data agree? What each pulls, how wide intervals must be, which test contradicts the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from operator import add

import numpy as np

from ..problem.cores import concurrently
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from . import clusters, compromise
from .compromise import Compromise
from .contradiction import Comparison, Contradicting, Contradiction, by_consequence, digits_apart, distance
from .disagreement import sides_of, undisputed
from .influence import Influence, influence, parts
from .levenberg_marquardt import believed
from .pieces import Piece
from .settings import FitSettings
from .statement import Split, Statement, inflations_of, prior, statement
from .subsets import Subset, belief, fitted_to, renewed, tests_of

_SEEN = 1.0  # standard errors by which a parameter must move to show a contradiction
_LOOK = (
    "Look for what differs in that test: series resistance, a sensor, wiring, temperature, or an effect that the model "
    "lacks."
)


@dataclass(frozen=True, eq=False)
class Agreement:
    """What the parts of the data say of each other.

    Args:
        influence: by how much each part moves each parameter.
        covariance: of the coordinates, wide enough for the scatter of traces and tests, shape (P, P).
        contradictions: tests that contradict the others, worst first.
        outweighed: tests that disagree with the others, and yet move nothing.
        compromise: what subsets of the data give, where the parameters are no estimates; else None.
    """

    influence: Influence
    covariance: np.ndarray
    contradictions: tuple[Contradiction, ...] = ()
    outweighed: tuple[Contradiction, ...] = ()
    compromise: Compromise | None = None

    def words(self, units: Callable[[str], str]) -> list[str]:
        """Warnings.

        Args:
            units: of a symbol, SI.
        """
        return [
            *(in_words(each, units(each.parameter)) for each in self.contradictions),
            *map(outweighed_in_words, self.outweighed),
        ]


@dataclass(frozen=True, eq=False)
class _Asked:
    """What is compared: the problem at its optimum; see `agreement`."""

    problem: EstimationProblem
    weighted: WeightedData
    x: np.ndarray
    pieces: tuple[Piece, ...]
    settings: FitSettings
    made: dict[tuple[str, ...], Subset] = field(default_factory=dict)  # what was refitted to, by its tests

    @property
    def reach(self) -> np.ndarray:
        return self.problem.layout.reach(self.x)

    @property
    def unknown(self) -> float:
        return self.settings.identifiability.unknown

    @property
    def everything(self) -> Subset:
        return Subset(tests_of(self.problem), self.x, self.pieces, belief(self.problem, self.weighted, self.x))

    def believed(self, here: Subset) -> Statement:
        """The priors: those given, and `WIDE` about wherever the fit went."""
        return prior(believed(self.problem.layout, self.x, self.weighted.prior_sd), here.belief)

    def refitted(self, x: np.ndarray, tests: tuple[str, ...]) -> Subset:
        """The fit made again to some tests, from x, shape (P,), where that was not yet done."""
        if tests not in self.made:
            self.made[tests] = fitted_to(self.problem, self.weighted, x, tests, self.settings)
        return self.made[tests]

    def freed(self, each: Contradicting) -> Contradicting:
        """A contradicting test, the others fitted with a whitening that it does not bend."""
        rest = renewed(self.problem, each.without, self.settings)
        self.made[rest.tests] = rest
        return replace(each, without=rest)

    def covariance(self, here: Subset) -> np.ndarray:
        """Of the coordinates as a subset knows them, widened for what its own residual shows, shape (P, P)."""
        counted = [piece for piece in here.pieces if piece.test in here.tests]
        said = statement(counted, inflations_of(counted, settings=self.settings.whiteness)) + self.believed(here)
        inverse = np.linalg.inv(said.information)
        return inverse @ said.spread @ inverse


def agreement(
    problem: EstimationProblem,
    weighted: WeightedData,
    x: np.ndarray,
    pieces: tuple[Piece, ...],
    covariance: np.ndarray,
    misfit: tuple[bool, float],
    settings: FitSettings,
) -> Agreement:
    """Compare every trace and every test of a fit with the others.

    Args:
        problem, weighted: the data as fitted.
        x: the optimum, shape (P,).
        pieces: every channel of every trace, linearised there.
        covariance: of the coordinates, widened channel by channel, shape (P, P).
        misfit: whether the model is far from the data, and chi2 per degree of freedom.
        settings: what decides.
    """
    if not all(np.isfinite(piece.jacobian).all() and np.isfinite(piece.r).all() for piece in pieces):
        return Agreement(Influence(), covariance)
    asked = _Asked(problem, weighted, x, pieces, settings)
    believed = asked.believed(asked.everything)
    traces = _by_trace(pieces, settings)
    found = influence(problem.layout.free, traces, believed, asked.reach, asked.unknown)
    tests = [said for (_, file), said in parts(traces).items() if file is None]
    every = (clusters.scatter(each, believed, asked.reach, asked.unknown) for each in ([*traces.values()], tests))
    wide = clusters.widened(covariance, every, settings.contradiction.scatter)
    # far from the data each channel is weighed by its own error: there, the test that errs hardly counts
    contradicting = () if misfit[0] else tuple(map(asked.freed, _comparison(asked).contradicting(asked.everything)))
    named = tuple(_named(asked, each) for each in contradicting)
    real, outweighed = by_consequence(named, settings.contradiction.moves)
    why = compromise.reason(*misfit, (each.test for each in real), settings)
    return Agreement(found, wide, real, outweighed, None if why is None else _compromise(asked, why))


def _by_trace(pieces: Sequence[Piece], settings: FitSettings) -> dict[tuple[str, str], Statement]:
    out: dict[tuple[str, str], Statement] = {}
    for piece, f in zip(pieces, inflations_of(pieces, settings=settings.whiteness), strict=True):
        said, key = statement((piece,), (f,)), (piece.test, piece.file)
        out[key] = out[key] + said if key in out else said
    return out


def _comparison(asked: _Asked) -> Comparison:
    decides = asked.settings.contradiction, asked.settings.whiteness
    return Comparison(asked.refitted, asked.believed, asked.reach, asked.unknown, *decides)


def _named(asked: _Asked, each: Contradicting) -> Contradiction:
    """The parameter that the test pulls most, of those that the others know."""
    layout = asked.problem.layout
    said = reduce(add, (statement((piece,), (1.0,)) for piece in asked.pieces), asked.believed(asked.everything))
    sd = np.sqrt(np.diag(np.linalg.inv(said.information)))
    known = np.sqrt(np.diag(asked.covariance(each.without))) < asked.unknown * asked.reach
    pulls = (each.without.x - each.together.x) / sd
    k = int(np.argmax(np.where(known, np.abs(pulls), -1.0)))
    with_it, without = (float(layout.numbers(here.x)[0][k]) for here in (each.together, each.without))
    moved = distance(each, asked.believed(each.together), asked.reach, asked.unknown)
    return Contradiction(each.test, layout.free[k], float(pulls[k]), with_it, without, each.p, each.share, moved)


def _compromise(asked: _Asked, why: str) -> Compromise:
    """The range that subsets give: the fit made again without each test, and one step to each test alone."""
    tests, size = tests_of(asked.problem), asked.x.size
    left_out = tests if len(tests) > 1 else ()
    rest = [tuple(each for each in tests if each != test) for test in left_out]
    without = concurrently(partial(asked.refitted, asked.x), rest)
    return Compromise(
        why,
        left_out,
        np.array([here.x for here in without]).reshape(-1, size),
        np.array([asked.covariance(here) for here in without]).reshape(-1, size, size),
        np.array([_alone(asked, test) for test in left_out]).reshape(-1, size),
    )


def _alone(asked: _Asked, test: str) -> np.ndarray:
    """Coordinates by one test alone, one step from the optimum, shape (P,); NaN where it does not know them, or lies so
    far off that one step does not lead there."""
    own, others = sides_of(asked.everything, test)
    split = Split(undisputed(own), undisputed(others) + asked.believed(asked.everything), asked.reach, asked.unknown)
    believed = asked.believed(asked.everything).information
    sd = np.sqrt(np.diag(np.linalg.inv(split.own.information + believed)))
    near = np.abs(split.own_step) < asked.unknown * asked.reach
    known = sd < asked.settings.identifiability.weak * asked.reach
    return np.where(known & near, asked.x + split.own_step, np.nan)


def in_words(each: Contradiction, unit: str) -> str:
    """The warning for a test that contradicts the others; unit: of the parameter it pulls, SI."""
    if abs(each.pull) < _SEEN:
        return (
            f"{each.test} contradicts the other tests: without it a combination of parameters moves by "
            f"{each.moved:.2g} standard errors of noise alone, though no single parameter moves by as much as "
            f"{_SEEN:g}. {_LOOK}"
        )
    digits = digits_apart(each.without, each.value)
    return (
        f"{each.test} contradicts the other tests: without it {each.parameter} is {each.without:.{digits}g} {unit} "
        f"instead of {each.value:.{digits}g} ({each.pull:+.2g} standard errors of noise alone). {_LOOK}"
    )


def outweighed_in_words(each: Contradiction) -> str:
    """The warning for a test that disagrees with the others and moves nothing."""
    return (
        f"{each.test} disagrees with the other tests by more than its noise, but the others outweigh it: without it no "
        f"parameter moves by more than {each.moved:.2g} standard errors. The parameters hold. {_LOOK}"
    )
