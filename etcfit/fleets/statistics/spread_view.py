"""What standard deviations between units are estimated from: all symbols together, or each for itself.

Together they are told best: a unit's errors are correlated, and so are the units. But of P symbols P (P - 1) / 2
correlations are to be told besides. Few units tell none, and a prior that keeps them off +-1 draws the standard
deviations with it: where units are fewer than four a symbol each symbol is taken for itself, with its
marginal errors. Where they are more, one unit's worth of prior is enough, and draws by a unit's share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from .scaled import Scaled
from .settings import PopulationSettings
from .spread import Spread

ENOUGH = 4  # units a symbol from which on correlations are estimated beside


class Moving(NamedTuple):
    """Where a search for standard deviations starts, and which entries of (d, a) it leaves alone."""

    start: Spread
    held: Bool[np.ndarray, " K"]


class View(NamedTuple):
    """How standard deviations are estimated.

    Args:
        data: units as they are looked at.
        moving: see `Moving`.
        prior: of the correlations, units' worth.
    """

    data: Scaled
    moving: Moving
    prior: float


def spread_view(data: Scaled, start: Spread, settings: PopulationSettings) -> View:
    """How to look at these units.

    Args:
        data: units.
        start: a spread.
        settings: the prior of the correlations.
    """
    correlations = np.arange(len(start.vector)) >= len(start.d)
    if len(data.x) >= ENOUGH * len(start.d) or np.any(data.tells.sum(axis=0) < 2):
        return View(data, Moving(start, np.zeros_like(correlations)), settings.uncorrelated)
    return View(data.marginal, Moving(start.uncorrelated, correlations), 0.0)
