"""How far two parts of the data disagree, each with parameters of its own.

    T = z^T cov(z)^-1 z,    z_i = b_i^T F (x_own - x_others)

in the directions b_i that both sides determine, see `statement`. Each side's noise is what its own residual shows once
it need not agree with the other (`inflation`), so that no test is named where the model fits neither. T is compared
with Hotelling's T^2 of the smaller side's independent samples.

Source: Hausman 1978, Econometrica 46(6). Differs from source: the estimates compared are those of two disjoint parts of
the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from .pieces import Piece
from .settings import WhitenessSettings
from .statement import Split, Statement, inflations_of, statement
from .subsets import Subset

_LEAST = 1e-4  # share of the information of a direction below which a side has no say in it
_SURE = 3.0  # standard deviations by which noise alone may exceed its mean


@dataclass(frozen=True, eq=False)
class Parted:
    """One test and the others, each with its own parameters.

    Args:
        split: the two sides.
        misfit: sum of squared residuals of both sides together, over the noise itself.
        samples: of both.
    """

    split: Split
    misfit: float
    samples: int

    def share(self, together: float) -> float:
        """Of the misfit, what is gone once they need not agree; what noise alone leaves counts as none.

        Args:
            together: sum of squared residuals where they must.
        """
        gain = max(0.0, together - self.misfit)
        left = max(0.0, self.misfit - self.samples - _SURE * (2.0 * self.samples) ** 0.5)
        return gain / (gain + left) if gain > 0.0 else 0.0


def disagreement(split: Split, understated: float = 1.0) -> float:
    """log p of T; 0 where no direction is determined by both sides, or a side has too few independent samples.

    Args:
        split: the two sides.
        understated: times that their errors may exceed the standard errors stated.
    """
    common = split.told_by_own & split.told_by_others & (split.share > _LEAST) & (split.others_share > _LEAST)
    count = int(common.sum())
    freedom = min(split.own.samples, split.others.samples) - count + 1.0
    if not count or freedom < 1.0:
        return 0.0
    b = split.directions[:, common]
    own, others = b / split.share[common], b / split.others_share[common]
    z = others.T @ split.others.score - own.T @ split.own.score
    spread = own.T @ split.own.spread @ own + others.T @ split.others.spread @ others
    t2 = float(z @ np.linalg.solve(spread, z)) / understated**2
    with np.errstate(divide="ignore"):  # log 0 where no double is small enough
        return float(np.log(fdtrc(count, freedom, max(t2, 0.0) * freedom / ((freedom + count - 1.0) * count))))


def parted(
    here: Subset,
    test: str,
    believed: Statement,
    reach: np.ndarray,
    unknown: float,
    whiteness: WhitenessSettings,
    alone: Subset | None = None,
) -> Parted:
    """One test against the others, linearised at the same point.

    Args:
        here: the others fitted, or all of them with the test among them.
        test: which.
        believed: the priors, at that point.
        reach, unknown: see `Split`.
        whiteness: see `inflation`.
        alone: the fit to this test alone, where its own optimum is more than one step away: linearised there.
    """
    own, others = sides_of(here, test)
    if alone is not None:
        away = here.x - alone.x
        own = [piece._replace(r=piece.moved(away)) for piece in alone.pieces if piece.test == test]
    first = Split(undisputed(own), undisputed(others) + believed, reach, unknown)
    steps = first.own_step, first.others_step
    sides = [
        statement(side, inflations_of(side, step, whiteness)) for side, step in zip((own, others), steps, strict=True)
    ]
    misfit = sum(piece.misfit(step) for side, step in zip((own, others), steps, strict=True) for piece in side)
    count = sum(piece.r.size for piece in (*own, *others))
    return Parted(Split(sides[0], sides[1] + believed, reach, unknown), misfit, count)


def sides_of(here: Subset, test: str) -> tuple[list[Piece], list[Piece]]:
    """The channels of a test, and those of the other tests that count."""
    own = [piece for piece in here.pieces if piece.test == test]
    return own, [piece for piece in here.pieces if piece.test in here.tests and piece.test != test]


def undisputed(pieces: Sequence[Piece]) -> Statement:
    """What channels say whose noise is as declared."""
    return statement(pieces, [1.0] * len(pieces))
