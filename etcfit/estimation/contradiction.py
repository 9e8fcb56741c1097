"""Which rig test contradicts the others: it is left out, the fit is made again, and the two sides are compared.

The level is shared out over the tests (Holm's first step). Of those that contradict, the one is named that explains
most of the misfit if it may differ; then the others are asked again without it, so that what disagreed with it alone is
not named beside it.

Source: Holm 1979, Scand. J. Statist. 6. Differs from source: of all that could be rejected only the worst is, and the
rest tested anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .disagreement import disagreement, parted, sides_of, undisputed
from .settings import ContradictionSettings, WhitenessSettings
from .statement import Split, Statement
from .subsets import Subset


@dataclass(frozen=True)
class Contradiction:
    """A rig test that the others contradict.

    Args:
        test: which.
        parameter: the one that it pulls most, symbol.
        pull: by how much leaving it out moves that, standard errors of noise alone.
        value, without: of that parameter, with the test and without it, SI.
        p: probability of so large a disagreement, or a larger one, where there is none and errors are as much larger
            than stated as they may be (`ContradictionSettings.understated`).
        share: of the misfit that is gone if this test may differ from the others.
        moved: by how much leaving it out moves the combination of parameters that moves most, standard errors of noise
            alone; see `distance`.
    """

    test: str
    parameter: str
    pull: float
    value: float
    without: float
    p: float
    share: float
    moved: float = math.inf


def digits_apart(one: float, other: float, least: int = 3, most: int = 8) -> int:
    """Significant digits with which two numbers differ by more than their last one.

    Args:
        one, other: in one unit.
        least, most: the digits are no fewer and no more.
    """
    gap, size = abs(one - other), max(abs(one), abs(other))
    if not (math.isfinite(gap) and gap > 0.0):
        return least
    return min(max(least, 1 + math.ceil(math.log10(size / gap))), most)


@dataclass(frozen=True, eq=False)
class Contradicting:
    """A test that contradicts the others.

    Args:
        test: which.
        together, without: the fit with it and the one to the others.
        p, share: see `Contradiction`.
        gain: sum of squared residuals, over the noise itself, that is gone if the test may differ.
    """

    test: str
    together: Subset
    without: Subset
    p: float
    share: float
    gain: float


def distance(each: Contradicting, believed: Statement, reach: np.ndarray, unknown: float) -> float:
    """By how much leaving a test out moves the fit, along whatever combination of parameters moves most.

        sqrt(sum_i (b_i^T F (x_without - x_together))^2)    over the directions b_i that the others determine

    in standard errors of noise alone: 1 along b_i is one standard error of all the data together. No parameter, and no
    combination of parameters, moves by more.

    Args:
        each: the test.
        believed: the priors, at the fit with it.
        reach, unknown: see `Split`.
    """
    own, others = sides_of(each.together, each.test)
    split = Split(undisputed(own), undisputed(others) + believed, reach, unknown)
    information = split.own.information + split.others.information
    along = split.directions[:, split.told_by_others].T @ information @ (each.without.x - each.together.x)
    return float(np.linalg.norm(along))


def by_consequence(
    found: Sequence[Contradiction], least: float
) -> tuple[tuple[Contradiction, ...], tuple[Contradiction, ...]]:
    """Tests that contradict the others, and those that the others outweigh.

    Args:
        found: tests that disagree with the others.
        least: standard errors by which a contradiction moves something; see `ContradictionSettings.moves`.
    """
    return tuple(each for each in found if each.moved >= least), tuple(each for each in found if each.moved < least)


@dataclass(frozen=True)
class Comparison:
    """How tests are compared.

    Args:
        refitted: the fit made again to some tests, from coordinates of shape (P,).
        believed: the priors, at a subset's coordinates.
        reach: of each coordinate, shape (P,).
        unknown: standard deviation above which a parameter is not known, reaches.
        settings: what decides.
        whiteness: see `inflation`.
    """

    refitted: Callable[[np.ndarray, tuple[str, ...]], Subset]
    believed: Callable[[Subset], Statement]
    reach: np.ndarray
    unknown: float
    settings: ContradictionSettings
    whiteness: WhitenessSettings

    def contradicting(self, everything: Subset) -> tuple[Contradicting, ...]:
        """The tests that contradict the others, worst first.

        Args:
            everything: the fit to all tests.
        """
        here, found = everything, []
        while len(here.tests) > 1 and len(found) < self.settings.named:
            worst = self._worst(here)
            if worst is None:
                break
            found.append(worst)
            here = worst.without
        return tuple(found)

    def _worst(self, here: Subset) -> Contradicting | None:
        bound = self._bound(here)
        together = sum(piece.misfit() for piece in here.pieces if piece.test in here.tests)
        likely = [test for test in here.tests if self._screened(here, test) < bound]
        tried = (self._tried(here, test, together) for test in likely)
        proven = [each for each in tried if np.log(max(each.p, 1e-300)) < bound and each.share >= self.settings.share]
        return max(proven, key=lambda each: each.gain, default=None)

    def _bound(self, here: Subset) -> float:
        """log p below which one of so many tests contradicts the others."""
        return float(np.log(self.settings.level / len(here.tests)))

    def _screened(self, here: Subset, test: str) -> float:
        """log p to first order, as if noise were as declared: cheap, and never too lenient."""
        own, others = sides_of(here, test)
        return self._unlikely(
            Split(undisputed(own), undisputed(others) + self.believed(here), self.reach, self.unknown)
        )

    def _unlikely(self, split: Split) -> float:
        return disagreement(split, self.settings.understated)

    def _tried(self, here: Subset, test: str, together: float) -> Contradicting:
        without = self.refitted(here.x, tuple(each for each in here.tests if each != test))
        asked = without, test, self.believed(without), self.reach, self.unknown, self.whiteness
        two = parted(*asked)
        if two.share(together) >= self.settings.share and self._unlikely(two.split) > self._bound(here):
            two = parted(*asked, self.refitted(without.x, (test,)))  # its own optimum may be more than a step away
        p = float(np.exp(self._unlikely(two.split)))
        return Contradicting(test, here, without, p, two.share(together), together - two.misfit)
