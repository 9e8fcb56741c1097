"""What standard deviations between units are estimated from: all symbols together, or each for itself.

Together they are told best: a unit's errors are correlated, and so are the units. But of P symbols P (P - 1) / 2
correlations are to be told besides. Few units tell none, and a prior that keeps them off +-1 draws the standard
deviations with it: where units are fewer than so many a symbol (`PopulationSettings.enough`) each symbol is taken for
itself, with its marginal errors. Where they are more, one unit's worth of prior will do, and draws by a unit's share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from .scaled import Scaled
from .settings import PopulationSettings
from .spread import Spread


class View(NamedTuple):
    """How standard deviations are estimated.

    Args:
        data: units as they are looked at.
        start: where the search starts.
        held: entries of (d, a) that it leaves alone.
        prior: of the correlations, units' worth.
    """

    data: Scaled
    start: Spread
    held: Bool[np.ndarray, " K"]
    prior: float


def spread_view(data: Scaled, start: Spread, settings: PopulationSettings) -> View:
    """How to look at these units.

    Args:
        data: units.
        start: a spread.
        settings: `enough`, and the prior of the correlations.
    """
    correlations = np.arange(len(start.vector)) >= len(start.d)
    if len(data.x) >= settings.enough * len(start.d) or np.any(data.tells.sum(axis=0) < 2):
        return View(data, start, np.zeros_like(correlations), settings.uncorrelated)
    return View(data.marginal, start.uncorrelated, correlations, 0.0)
