"""Formula errors: what inexact formulas of the added effects leave in the residual, and how they move parameters.

A formula with the relative error phi adds phi xi(t) c(t) to the residual, c being the contribution of the effect and xi
of size 1. With xi constant over a stretch of a trace, and independent from one stretch to the next, the residual has
the covariance

    M = 1 + sum_b C_b C_b^T,    C_b = phi c in stretch b and 0 elsewhere, one column for each effect

in units of the noise. Models with one more effect are compared by r^T M^-1 r: a residual that looks like an added
effect which is a little larger in one stretch and a little smaller in the next is no evidence. The fit absorbs a part
of the formula errors by other values of the parameters,

    p_b = J^+ C_b,    C' = C + sum_b p_b p_b^T

Far from the data M = 1 and C' = C, because each sample is weighed by its own residual.

Source: Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63(3) (model discrepancy). Differs from source: xi is constant
by stretches rather than a Gaussian process, and its size is `inexact` of the effect, not fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..estimation.identifiability import listed
from ..estimation.levenberg_marquardt import linearise_at
from ..problem.free_parameters import effect_named
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel
from .composition import Effect
from .tangents import fitted_samples, stretch_of_samples

ERROR_STRETCHES = 20  # equal parts of a trace for M
FORMULA_STRETCHES = 6  # equal parts of a trace for C'
FORMULA_CEILING = 0.04  # chi2 that may be put down to an inexact formula: at most this share of the number of samples
_RANK = 1e-10  # smallest eigenvalue of J^T J over the largest that does not count as 0


def percent_off(effects: Sequence[str]) -> str:
    """Relative errors of the formulas of these effects, given by name, in words: "2 % and 10 %"."""
    return listed(dict.fromkeys(f"{100.0 * effect_named(name).inexact:.0f} %" for name in effects))


def chi2_left_by_formula(phi: float, explained: float, n: float) -> float:
    """min(phi^2 chi2, 0.04 n): chi2 that an effect whose formula is off may leave of what it explained.

    Args:
        phi: relative error of the formula.
        explained: chi2 that the effect explained.
        n: fitted samples; 0.04 is `FORMULA_CEILING`.
    """
    return min(phi**2 * explained, FORMULA_CEILING * n)


class Stretch(NamedTuple):
    """Formula errors in one stretch of one trace."""

    samples: np.ndarray  # indices of the fitted samples in the stretch, shape (m,)
    directions: np.ndarray  # U, orthonormal, shape (m, k)
    shrinkage: np.ndarray  # 1 - (1 + s^2)^-1/2 along each direction, s the singular values of C, shape (k,)

    @classmethod
    def of_columns(cls, samples: np.ndarray, columns: np.ndarray) -> Stretch:
        """The stretch with these columns C, shape (m, k)."""
        directions, sizes, _ = np.linalg.svd(columns, full_matrices=False)
        return cls(samples, directions, 1.0 - 1.0 / np.sqrt(1.0 + sizes**2))


@dataclass(frozen=True, eq=False)
class FormulaErrors:
    """Covariance M of the residual of the fitted samples, and of that of the held-out ones."""

    stretches: tuple[Stretch, ...] = ()  # all stretches of all traces; none where M = 1
    count: int = 0  # n, number of fitted samples
    free: tuple[str, ...] = ()  # symbols of the free parameters of the model
    held_out: FormulaErrors | None = None  # those of the held-out samples; None where M = 1 or nothing is held out

    def __bool__(self) -> bool:
        """Whether M differs from 1."""
        return bool(self.stretches)

    @classmethod
    def of_model(cls, s: CandidateModel) -> FormulaErrors:
        """The formula errors of the effects added to a model."""
        inexact = [effect for effect in s.added if effect.inexact]
        if s.far or not inexact:
            return EXACT
        steps = np.stack([effect.inexact * step_that_doubles(s, effect) for effect in inexact], axis=1)
        held_out = None if s.holdout is None else cls._of_samples(*s.holdout, s.x, steps)
        return replace(cls._of_samples(s.problem, s.weighted, s.x, steps), held_out=held_out)

    @classmethod
    def _of_samples(
        cls, problem: EstimationProblem, weighted: WeightedData, x: np.ndarray, steps: np.ndarray
    ) -> FormulaErrors:
        """Where formula errors move the coordinates by so much at their size, shape (P, k)."""
        columns = fitted_samples(problem, x, weighted)[1] @ steps
        columns = np.where(np.isfinite(columns), columns, 0.0)
        number = stretch_of_samples(problem, weighted, ERROR_STRETCHES)
        order = np.argsort(number, kind="stable")
        stretches = np.split(order, np.flatnonzero(np.diff(number[order])) + 1)
        found = tuple(Stretch.of_columns(samples, columns[samples]) for samples in stretches)
        return cls(found, len(columns), problem.layout.free)

    def whitened(self, columns: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """M^-1/2 times columns, shape (n,) or (n, k).

        Args:
            rows: indices of the samples in the columns, all samples of some traces; None: all of all traces.
        """
        if not self:
            return columns
        out = np.array(columns, dtype=float)
        place = None if rows is None else np.full(self.count, -1)
        if place is not None:
            place[rows] = np.arange(len(out))
        for samples, u, shrinkage in self.stretches:
            own = samples if place is None else place[samples]
            if own[0] >= 0:
                out[own] -= u @ (shrinkage * (u.T @ out[own]).T).T
        return out

    def chi2(self, r: np.ndarray, jacobian: np.ndarray) -> float:
        """min over d of |M^-1/2 (r + J d)|^2: chi2 at the optimum under M, linearised at the optimum under noise.

        Args:
            r: residual, shape (n,).
            jacobian: J, in the free parameters that all models compared share, shape (n, P).
        """
        r, jacobian = self.whitened(r), self.whitened(jacobian)
        jacobian = jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
        along = jacobian.T @ r
        inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=_RANK, hermitian=True)
        return float(r @ r - along @ inverse @ along)


EXACT = FormulaErrors()


def formula_covariance(s: CandidateModel) -> np.ndarray:
    """Covariance of the coordinates that inexact formulas of the added effects cause, shape (P, P), to be added."""
    out = np.zeros((s.x.size, s.x.size))
    if s.far or not s.added:
        return out
    here = linearise_at(s.problem, s.x, s.weighted)
    inverse, jacobian = here.covariance / here.unit, s.problem.linearise(s.x, s.weighted).jacobian
    for effect in (e for e in s.added if e.inexact):
        for moved in _stretches(s, jacobian, jacobian @ step_that_doubles(s, effect)):
            p = effect.inexact * (inverse @ moved)
            out += np.outer(p, p)
    return out


def step_that_doubles(s: CandidateModel, effect: Effect) -> np.ndarray:
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
        jacobian: of the residual, shape (T, L, M, P).
        effect: c, what the effect does to the residual, shape (T, L, M).
    """
    for lane, stretch in s.problem.batch.stretches(FORMULA_STRETCHES):
        yield np.einsum("tmp,tm->p", jacobian[stretch, lane], effect[stretch, lane])
