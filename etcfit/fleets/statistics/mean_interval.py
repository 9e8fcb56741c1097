"""Intervals of the population's mean that hold with a dozen units, and where the units' covariances are not exact.

    g_u = G (I - T_u)^-1/2 G^T r_u,   T_u = G^T W_u G,   G G^T = C = (sum W)^-1,   r_u = W_u (x_u - mu)
    stderr_j^2 = sum_u g_uj^2,   degrees of freedom by Satterthwaite

C itself takes the spread for known. The scatter of the units about the mean says the same without a model, and right
even if all stated covariances are too small. (I - T)^-1/2 undoes that each unit pulled the mean towards itself: the
sum is then exactly unbiased where the model does hold. A shared symbol has its interval by the same formula.

Source: Bell and McCaffrey 2002 (CR2); Tipton 2015 (Psychological Methods 20) for few clusters. Differs from source: in
information form, with the rank of T_u in place of a unit's design.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import stats

from .likelihood import Weighed

ALONE = 1e-8  # 1 - T below: the direction is told by this unit alone, its scatter is not seen


def mean_intervals(
    at: Weighed, level: float
) -> tuple[Float[np.ndarray, " P"], Float[np.ndarray, " P"], Float[np.ndarray, "P 2"]]:
    """Standard errors (P,), degrees of freedom (P,) and intervals (P, 2); NaN where no scatter is seen.

    Args:
        at: units under the covariance found.
        level: coverage.
    """
    g = np.linalg.cholesky(at.mean_covariance)
    t = g.T @ at.weight @ g
    value, vector = np.linalg.eigh(0.5 * (t + np.swapaxes(t, 1, 2)))
    left = 1.0 - value
    wider = np.where(left > ALONE, 1.0 / np.sqrt(np.maximum(left, ALONE)), 0.0)
    half = (vector * wider[:, None, :]) @ np.swapaxes(vector, 1, 2)  # (I - T)^-1/2
    moves = np.einsum("ij,ujk,uk->ui", g, half, at.pull @ g)
    variance = np.sum(moves**2, axis=0)
    degrees = _degrees(g, t, half)
    with np.errstate(invalid="ignore"):
        seen = (degrees > 0.0) & (variance > 0.0)
        stderr = np.where(seen, np.sqrt(variance), np.nan)
        reach = stats.t.ppf(0.5 + 0.5 * level, np.where(seen, degrees, 1.0)) * stderr
    return stderr, np.where(seen, degrees, 0.0), np.stack([at.mean - reach, at.mean + reach], axis=1)


def _degrees(g: np.ndarray, t: np.ndarray, half: np.ndarray) -> np.ndarray:
    """(sum_u v_uu)^2 / sum_uw v_uw^2 of the covariances v of g_uj and g_wj, for each symbol j."""
    k = np.einsum("uij,pj->upi", half, g)
    m = np.einsum("uij,upj->upi", t, k)
    own = np.einsum("upi,upi->up", k, m)
    cross = np.einsum("upi,upi->up", m, m)
    alone = own - cross  # v_uu; v_uw = -m_u m_w
    outer = np.einsum("upi,upj->pij", m, m)
    between = np.einsum("pij,pij->p", outer, outer) - np.sum(cross**2, axis=0)
    spread = np.sum(alone**2, axis=0) + np.maximum(between, 0.0)
    return np.where(spread > 0.0, np.sum(alone, axis=0) ** 2 / np.where(spread > 0.0, spread, 1.0), 0.0)
