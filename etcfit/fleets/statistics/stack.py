"""The units of a fleet as arrays: one axis of units, one of symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..unit import UnitEstimate


@dataclass(frozen=True, eq=False)
class Stack:
    """Estimates of N units in the union of their symbols; what a unit does not have is without information.

    Args:
        units: their names.
        symbols: in the order in which the units bring them.
        estimate: SI, shape (N, P).
        information: 1/SI^2, shape (N, P, P).
    """

    units: tuple[str, ...]
    symbols: tuple[str, ...]
    estimate: Float[np.ndarray, "N P"]
    information: Float[np.ndarray, "N P P"]

    def only(self, kept: Bool[np.ndarray, " N"]) -> Stack:
        """Those units alone."""
        names = tuple(unit for unit, keep in zip(self.units, kept, strict=True) if keep)
        return Stack(names, self.symbols, self.estimate[kept], self.information[kept])

    def marginal(self, symbols: Sequence[str]) -> Stack:
        """F_kk - F_kd F_dd^+ F_dk: what the data tell of some symbols when nothing is known of the others."""
        keep = [self.symbols.index(s) for s in symbols]
        drop = [p for p in range(len(self.symbols)) if p not in keep]
        kk, estimate = self.information[:, keep][:, :, keep], self.estimate[:, keep]
        if not drop:
            return Stack(self.units, tuple(symbols), estimate, kk)
        kd, dd = self.information[:, keep][:, :, drop], self.information[:, drop][:, :, drop]
        s = 1.0 / np.sqrt(np.where((d := np.einsum("upp->up", dd)) > 0.0, d, 1.0))
        inverse = np.linalg.pinv(dd * s[:, :, None] * s[:, None, :], rcond=1e-12, hermitian=True)
        inverse = inverse * s[:, :, None] * s[:, None, :]
        left = kk - kd @ inverse @ np.swapaxes(kd, 1, 2)
        return Stack(self.units, tuple(symbols), estimate, 0.5 * (left + np.swapaxes(left, 1, 2)))


def stacked(estimates: Sequence[UnitEstimate]) -> Stack:
    """All units side by side.

    Raises:
        ValueError: no unit, a name twice, or an entry that is not finite.
    """
    if not estimates:
        raise ValueError("a fleet without a unit: at least one must have a result.")
    names = tuple(each.unit for each in estimates)
    if len(set(names)) < len(names):
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)}: a unit's name stands twice in the fleet.")
    symbols = tuple(dict.fromkeys(s for each in estimates for s in each.symbols))
    place = {s: p for p, s in enumerate(symbols)}
    x, f = np.zeros((len(names), len(symbols))), np.zeros((len(names), len(symbols), len(symbols)))
    for u, each in enumerate(estimates):
        if not (np.all(np.isfinite(each.estimate)) and np.all(np.isfinite(each.information))):
            raise ValueError(f"{each.unit}: estimate and information must be finite; what is not told has zero.")
        at = np.array([place[s] for s in each.symbols], dtype=int)
        x[u, at] = each.estimate
        f[u, at[:, None], at[None, :]] = 0.5 * (each.information + each.information.T)
    return Stack(names, symbols, x, f)
