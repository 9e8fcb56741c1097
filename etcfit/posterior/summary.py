"""What a chain says of each parameter, beside what the fit said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from ..estimation.intervals import LUMPS, Interval
from ..model.parameters import Parameter
from ..problem.free_parameters import FreeParameters
from .convergence import autocorrelation_time, split_rhat
from .settings import SamplingSettings

APART = SamplingSettings().apart


@dataclass(frozen=True)
class Marginal:
    """The posterior of one parameter, SI.

    Args:
        mean, sd, median: of its draws.
        low, high: its 95 % interval, between the 2.5 and 97.5 % quantiles.
        ess: independent draws, W N / tau of this parameter.
        r_hat: over the ensembles.
        status: "estimated", "fixed", "tied" or "not identifiable", as in the fit.
        laplace: the fit's standard error, or None.
    """

    mean: float
    sd: float
    median: float
    low: float
    high: float
    ess: float
    r_hat: float
    status: str
    laplace: float | None


def apart(*spreads: float | None, allowed: float = APART) -> bool:
    """Whether standard deviations found in different ways, where they were found, differ by more than is allowed.

    Args:
        spreads: in one unit; None where one was not found.
        allowed: relative difference of the largest and the smallest.
    """
    known = [s for s in spreads if s]
    return bool(known) and max(known) > (1.0 + allowed) * min(known)


def values(
    free_parameters: FreeParameters, gear_ratio: float, electric: bool, points: np.ndarray
) -> dict[str, np.ndarray]:
    """Parameters and their combinations at coordinates of shape (..., P), SI by symbol, shape (...).

    Args:
        electric: False where the rig has no electrical side, and no combination that needs one.
    """
    layout = free_parameters.layout
    pick, flat = layout.pick(free_parameters.held), points.reshape(-1, points.shape[-1])
    every = jax.jit(jax.vmap(lambda x: layout.form.values(x, pick)))(layout.padded(flat))
    every = {p.symbol: np.asarray(every[p.symbol]).reshape(points.shape[:-1]) for p in layout.parameters}
    return every | {s: np.asarray(lump.of(every, gear_ratio))
                    for s, lump in LUMPS.items() if electric or not lump.electric}  # fmt: skip


def marginal(draws: np.ndarray, fitted: Interval) -> Marginal:
    """The posterior of one parameter from its draws, SI, shape (E, N, W), beside the fit's own interval."""
    chains = [e[:, :, None] for e in draws]
    tau = max(float(autocorrelation_time(e)[0]) for e in chains)
    low, median, high = np.quantile(draws, (0.025, 0.5, 0.975)).tolist()
    return Marginal(float(draws.mean()), float(draws.std(ddof=1)), median, low, high, draws.size / tau,
                    float(split_rhat(chains)[0]), fitted.status, fitted.stderr)  # fmt: skip


def marginals(draws: Mapping[str, np.ndarray], fitted: Mapping[str, Interval]) -> dict[str, Marginal]:
    """Of every parameter and combination whose draws differ, by symbol."""
    return {s: marginal(d, fitted[s]) for s, d in draws.items() if np.ptp(d) > 0.0}


def described(parameters: Mapping[str, Parameter]) -> dict[str, tuple[str, str]]:
    """Unit and meaning by symbol, combinations among them."""
    own: dict[str, Any] = {s: (p.unit, p.meaning) for s, p in parameters.items()}
    return own | {s: (lump.unit, lump.meaning) for s, lump in LUMPS.items()}
