"""Each unit's posterior, the population being its prior: what a unit with few traces is worth.

    mean_u = (F_u + Omega^-1)^-1 (F_u estimate_u + Omega^-1 mu) = mu + Omega W_u (estimate_u - mu)
    covariance_u = (F_u + Omega^-1)^-1 = Omega - Omega W_u Omega,   W_u = H_u^T (I + H_u Omega H_u^T)^-1 H_u

The right-hand forms need no Omega^-1: a shared symbol, Omega = 0 there, takes the common value. That mu itself is
estimated adds A C A^T with A = I - Omega W_u, C the covariance of mu: all the uncertainty that a shared symbol has.

An odd unit is none of the population: its shrunk values are pulled to where it does not belong, and its own are
those to use.

Source: Efron and Morris 1973 (JASA 68), eq. 2.1; Lindley and Smith 1972 (JRSS B 34), eq. 12. Differs from source: no.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .likelihood import weights
from .population import Population
from .scaled import scaled
from .settings import DEFAULT, FleetSettings
from .stack import Stack


@dataclass(frozen=True, eq=False)
class Shrunk:
    """N units, P symbols of the population, SI.

    Args:
        units: their names.
        symbols: of the population.
        estimate: posterior means, shape (N, P).
        covariance: given the population, shape (N, P, P).
        stderr: that of the population's mean included, shape (N, P).
    """

    units: tuple[str, ...]
    symbols: tuple[str, ...]
    estimate: Float[np.ndarray, "N P"]
    covariance: Float[np.ndarray, "N P P"]
    stderr: Float[np.ndarray, "N P"]


def shrink(stack: Stack, of: Population, settings: FleetSettings = DEFAULT) -> Shrunk:
    """Every unit's posterior.

    Args:
        stack: units, which may be others than those of the population, too.
        of: the population.
        settings: what counts as no information.
    Raises:
        ValueError: the units lack a symbol of the population.
    """
    if missing := [s for s in of.symbols if s not in stack.symbols]:
        raise ValueError(f"the population has {', '.join(missing)}, which none of these units has.")
    data = scaled(stack.marginal(of.symbols), settings.population.null)
    s = data.scale
    omega, c = of.covariance / np.outer(s, s), of.mean_covariance / np.outer(s, s)
    _, solved = weights(data, omega)
    gain = omega @ np.swapaxes(data.root, 1, 2) @ solved  # Omega W
    mean = (of.mean - data.centre) / s
    estimate = mean + np.einsum("upq,uq->up", gain, data.x - mean)
    covariance = omega - gain @ omega
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    left = np.eye(len(s)) - gain
    whole = np.einsum("upp->up", covariance) + np.einsum("upq,qr,upr->up", left, c, left)
    return Shrunk(stack.units, of.symbols, data.centre + s * estimate, covariance * np.outer(s, s),
                  s * np.sqrt(np.maximum(whole, 0.0)))  # fmt: skip
