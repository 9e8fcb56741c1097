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
from ..problem.free_parameters import effect_named
from .candidate_model import CandidateModel
from .composition import Effect
from .settings import DiagnosisSettings


def inexact(effects: Sequence[Effect]) -> float:
    """Relative error of the least exact formula among these effects; 0 for none."""
    return max((effect.inexact for effect in effects), default=0.0)


def percent_off(effects: Sequence[str]) -> str:
    """Relative errors of the formulas of these effects, by name, in words: "2 % and 10 %"."""
    return listed(dict.fromkeys(f"{100.0 * effect_named(name).inexact:.0f} %" for name in effects))


def blur(first_chi2_per_dof: float, s: CandidateModel) -> float:
    """Chi2 that inexact formulas of the effects added may leave; 0 far from the data.

    Args:
        first_chi2_per_dof: of the first fit; the effects added explained what it left above 1.
        s: the model with them.
    """
    n = s.weighted.samples
    explained = n * max(0.0, first_chi2_per_dof - 1.0)
    return 0.0 if s.far else left_by(inexact(s.added), explained, n, s.settings)


def left_by(phi: float, explained: float, n: float, settings: DiagnosisSettings) -> float:
    """min(phi^2 chi2, 0.04 n): chi2 that an effect whose formula is off may leave of what it explained.

    Args:
        phi: relative error of the formula.
        explained: chi2 that the effect explained.
        n: fitted samples; 0.04 is `formula_ceiling`.
        settings: what decides.
    """
    return min(phi**2 * explained, settings.formula_ceiling * n)


def spread(s: CandidateModel) -> np.ndarray:
    """What inexact formulas of the effects added do to the covariance of the coordinates, shape (P, P), to be added."""
    out = np.zeros((s.x.size, s.x.size))
    if s.far or not s.added:
        return out
    here = local(s.problem, s.x, s.weighted)
    inverse, jacobian = here.covariance / here.unit, s.problem.linearise(s.x, s.weighted).jacobian
    for effect in (e for e in s.added if e.inexact):
        for moved in _stretches(s, jacobian, jacobian @ _doubled(s, effect)):
            p = effect.inexact * (inverse @ moved)
            out += np.outer(p, p)
    return out


def _doubled(s: CandidateModel, effect: Effect) -> np.ndarray:
    """Step of the coordinates, shape (P,), that doubles the effect's amplitudes to first order."""
    layout, out = s.problem.layout, np.zeros(s.x.size)
    value, slope = layout.numbers(s.x)
    for symbol, off in (effect.off or {}).items():
        k = layout.free.index(symbol)
        out[k] = (value[k] - off) / slope[k]
    return out


def _stretches(s: CandidateModel, jacobian: np.ndarray, effect: np.ndarray) -> Iterator[np.ndarray]:
    """J^T c_b of every stretch of every trace, shape (P,) each.

    Args:
        s: the model.
        jacobian: of the residual, shape (T, L, M, P).
        effect: c, what the effect does to the residual, shape (T, L, M).
    """
    for lane, stretch in s.problem.batch.stretches(s.settings.formula_stretches):
        yield np.einsum("tmp,tm->p", jacobian[stretch, lane], effect[stretch, lane])
