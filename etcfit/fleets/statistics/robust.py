"""Covariances that hold although the model is not exact, told from each unit and from all together.

    information_u = S_u^-1 F_u S_u^-1,   S_u = diag(min(max(w_us, m_s), most m_s)),   m_s = median of w_us over units

w_us is by how much the unit's own fit widens the standard error of symbol s, where residuals are correlated or where
traces disagree by more than their noise. What the model lacks it lacks in every unit of a design, and m_s says by how
much; no unit is surer than that. Of a handful of traces, on the other hand, nobody can tell by how much they disagree:
sound units are widened up to a hundred times, and would count for nothing. So no unit is widened by more than `most`
times what the others are. One that is worse than that is not uncertain but odd, and is to be found as such.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..unit import UnitEstimate, UnitResult


def robust(units: Sequence[UnitResult], most: float) -> list[UnitEstimate]:
    """Each unit's own estimate, with an information that is robust.

    Args:
        units: fitted.
        most: by how much a standard error is widened at most, times that of the middle unit.
    """
    symbols = {symbol for unit in units for symbol in unit.own.symbols}
    middle = {s: float(np.median([u.widening.get(s, 1.0) for u in units if s in u.own.symbols])) for s in symbols}
    return [_widened(unit, middle, most) for unit in units]


def _widened(unit: UnitResult, middle: dict[str, float], most: float) -> UnitEstimate:
    by = np.array([np.clip(unit.widening.get(s, 1.0), middle[s], most * middle[s]) for s in unit.own.symbols])
    return replace(unit.own, information=unit.own.information / np.outer(by, by))
