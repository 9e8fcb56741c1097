"""The formulas of the effects found are conventions: what that leaves unexplained, and what it does to parameters.

A formula that is off by phi adds phi xi(t) c(t) to the residual, c what the effect does there and xi of size 1. Part of
it looks like another effect (`blur`); the rest is taken for other values of the parameters (`spread`):

    p_b = phi J^+ c_b,    C' = C + sum_b p_b p_b^T

with c_b = c in one stretch of one trace and 0 elsewhere: xi is taken to be constant over a stretch and independent from
one stretch to the next. Far from the data both are 0: samples are weighed there by what is left in them.

Source: Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63(3) (model discrepancy). Differs from source: xi is constant
by stretches rather than a Gaussian process, and its size is `inexact` of the effect, not fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..estimation.levenberg_marquardt import local
from ..estimation.remedies import listed
from ..estimation.result import FitResult
from ..model.effects import EFFECT_BY_NAME
from .composition import Effect
from .trial import CandidateModel

_CLEAR = 0.04  # share of the noise's own chi2 above which what is left is never put down to a formula
_STRETCHES = 6  # of a trace over which a formula is off by as much


def inexact(s: CandidateModel) -> float:
    """Relative error of the least exact formula among the effects added."""
    return max((effect.inexact for effect in s.added), default=0.0)


def percent_off(effects: Sequence[str]) -> str:
    """How far off the formulas of these effects may be, in words."""
    return listed(dict.fromkeys(f"{100.0 * EFFECT_BY_NAME[name].inexact:.0f} %" for name in effects))


def blur(first: FitResult, s: CandidateModel) -> float:
    """Chi2 that the effects added may leave: all of them together explained what the first fit left above the noise."""
    n = s.weighted.samples
    return 0.0 if s.far else left_by(inexact(s), n * max(0.0, first.chi2_per_dof - 1.0), n)


def left_by(phi: float, explained: float, n: float) -> float:
    """Chi2 that an effect whose formula is phi off may leave of what it explained: min(phi^2 chi2, 0.04 n)."""
    return min(phi**2 * explained, _CLEAR * n)


def spread(s: CandidateModel) -> np.ndarray:
    """What inexact formulas add to the covariance of the coordinates, shape (P, P)."""
    out = np.zeros((s.x.size, s.x.size))
    if s.far or not s.added:
        return out
    s = s.lean()
    here = local(s.problem, s.x, s.weighted)
    inverse = here.covariance / here.unit
    for effect in s.added:
        for moved in _stretches(s, here.jacobian, here.jacobian @ _worth(s, effect)):
            p = effect.inexact * (inverse @ moved)
            out += np.outer(p, p)
    return out


def _worth(s: CandidateModel, effect: Effect) -> np.ndarray:
    """A step of the coordinates that does once more what the effect does: its amplitudes doubled, to first order."""
    layout, out = s.problem.layout, np.zeros(s.x.size)
    value, slope = layout.numbers(s.x)
    for symbol, off in (effect.off or {}).items():
        k = layout.free.index(symbol)
        out[k] = (value[k] - off) / slope[k]
    return out


def _stretches(s: CandidateModel, jacobian: np.ndarray, share: np.ndarray) -> Iterator[np.ndarray]:
    """J^T c of every stretch of every trace, shape (P,) each."""
    for lane, _, marks in s.problem.batch.places:
        for stretch in np.array_split(marks, _STRETCHES):
            yield np.einsum("tmp,tm->p", jacobian[stretch, lane], share[stretch, lane])
