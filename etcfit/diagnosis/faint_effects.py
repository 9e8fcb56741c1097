"""Effects too faint to be named, and how much wider they make the intervals.

An effect that the data hardly show is not named, but it may have moved the parameters: a friction that depends on the
load looks much like more dry friction. So each effect of the throttle that is not in the final model is compared with
the hypothesis "nothing", by the linearised model and with every size up to the usual one:

    r = e + J dx + C a,    a = 0, or a ~ N(0, s^2 1) for one effect, one of its variants and one of `SIZES` s
    weight = prior |1 + s^2 G|^-1/2 exp(h^T M h / 2) prod 2 Phi(m_k / sqrt(M_kk)),    G = C'^T C',    h = C'^T r
    a | r ~ N(m, M),    M = (G + 1/s^2)^-1,    m = -M h;        dx = B a,    B = -(J^T J + P_0)^-1 J^T C

with C' the part of C that no parameter can imitate, and the product over amplitudes that cannot be negative. The
amplitude of a variant whose amplitude is scanned is fixed. The weights, with weight 1 for "nothing", are scaled so that
their sum is 1. A coordinate then follows a mixture: it is as fitted, or moved by B a. Its interval is that of the
mixture,

    sum_e p_e P(|x| > q | e) + p_0 P(|x| > q | nothing) = 0.05,    factor = q / (1.96 sd)

so an effect with a probability of a few per cent hardly widens the interval, however far it would move a parameter. The
estimate itself does not change.

Source: Hoeting et al. 1999, Statistical Science 14(4) (model averaging); Kass and Raftery 1995 (Laplace evidence).
Differs from source: the mixture is about the estimate of the model without the effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import log_ndtr, ndtr

from ..estimation.identifiability import listed
from ..estimation.intervals import Z_95
from ..estimation.joint_fit import Report
from ..estimation.levenberg_marquardt import linearise_at
from ..estimation.result import FitResult
from ..model.parameters import Parameter
from .candidate_model import CandidateModel
from .screen import IMITATED, Background, lowest
from .tangents import Variant, fitted_samples, tangents_inside, variants
from .unexplained import grown

SIZES = (1.0, 0.3, 0.1, 0.03)  # s over the scale of the amplitudes, equally probable: small effects are common
PRIOR = 0.1  # prior weight of an effect, over that of "nothing"
WORTH_SAYING = 1.05  # factor of an interval from which on the effects behind it are listed
_LISTED = 3  # effects listed at most
_NEGLIGIBLE = 1e-6  # share of all weights below which a part of the mixture is left out
_TAIL = 2.0 * float(ndtr(-Z_95))


@dataclass(frozen=True, eq=False)
class Part:
    """One effect, variant and size of the mixture."""

    effect: str  # name
    log_weight: float  # ln of its weight; the weight of "nothing" is 1
    moved: np.ndarray  # mean square by which it moved each coordinate, shape (P,)


@dataclass(frozen=True, eq=False)
class FaintEffects:
    """How much effects that are not named may widen the intervals."""

    factor: np.ndarray  # factor by which each coordinate's standard error grows, shape (P,)
    behind: tuple[str, ...]  # names of the effects that make it grow, the one that counts most first


def allowing_for_faint_effects(after: FitResult, s: CandidateModel, report: Report) -> FitResult:
    """The final fit with intervals that allow for effects too faint to be named; the fit unchanged where the model is
    far from the data."""
    if s.far or after.far:
        return after
    report("widening intervals for effects too faint to be named", 0.98)
    sd = np.sqrt(np.diag(after.covariance))
    found = mixed(sd, faint_parts(s))
    added = after.covariance * (np.outer(found.factor, found.factor) - 1.0)
    if not found.behind:
        return after
    words = f"Intervals allow for {listed(found.behind)}: each is too faint to be named and may be there or not."
    return grown(after, added, words)


def faint_parts(s: CandidateModel) -> list[Part]:
    """Every effect of the throttle that is not in the model, each variant at each size."""
    every = [variant for e in s.composition.inside if not s.at_work(e) for variant in variants(e)]
    parameters = {p.symbol: p for p in s.composition.whole.layout.parameters}
    lean = s.lean()
    here = linearise_at(lean.problem, lean.x, lean.weighted)
    background = Background.spanned(*fitted_samples(lean.problem, lean.x, lean.weighted))

    def one(variant: Variant, columns: np.ndarray) -> list[Part]:
        columns = np.where(np.isfinite(columns), columns, 0.0)
        own = background.free_of(background.basis, columns)
        gram = own.T @ own
        ways = own_ways(gram, np.sum(columns**2, axis=0))
        mine = [parameters[symbol] for symbol in variant.amplitudes]
        across = own.T @ background.r / here.unit
        bends = -here.covariance @ (background.jacobian.T @ columns) / here.unit
        return parts_of(variant, mine, Linear(gram / here.unit, across, bends), ways)

    return [part for parts in tangents_inside(lean, every, one) for part in parts]


def own_ways(gram: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Directions of the amplitudes, of length 1, that parameters do not imitate, shape (k, m).

    A direction that they do imitate is equivalent to a change of the parameters.

    Args:
        gram: C'^T C', shape (k, k).
        power: |C|^2 of each column, shape (k,).
    """
    size = 1.0 / np.sqrt(np.maximum(power, 1e-300))
    shares, turned = np.linalg.eigh(gram * np.outer(size, size))
    if (shares > IMITATED).all():
        return np.eye(power.size)
    ways = size[:, None] * turned[:, shares > IMITATED]
    return ways / np.linalg.norm(ways, axis=0)


class Linear(NamedTuple):
    """What k amplitudes do to the residual and to the coordinates, linearised."""

    gram: np.ndarray  # G, in units of the noise, shape (k, k)
    across: np.ndarray  # h, in units of the noise, shape (k,)
    bends: np.ndarray  # B, shape (P, k)

    def along(self, ways: np.ndarray) -> Linear:
        """The same for amplitudes along some directions (columns), shape (k, m)."""
        return Linear(ways.T @ self.gram @ ways, ways.T @ self.across, self.bends @ ways)


def parts_of(variant: Variant, amplitudes: Sequence[Parameter], linear: Linear, ways: np.ndarray) -> list[Part]:
    """The parts of one variant at every size, or at the scanned one where its amplitudes are scanned; empty where no
    direction remains.

    Args:
        amplitudes: k parameters.
        linear: their effect.
        ways: directions of the amplitudes that no parameter imitates, shape (k, m).
    """
    name = variant.effect.name
    prior = float(np.log(PRIOR / len(variants(variant.effect))))
    if not ways.size:
        return []
    if any(p.symbol in variant.shape for p in amplitudes):
        a = np.array([variant.shape.get(p.symbol, 0.0) / p.domain.scale for p in amplitudes])
        return [Part(name, float(prior - linear.across @ a - 0.5 * a @ linear.gram @ a), (linear.bends @ a) ** 2)]
    gram, across, bends = linear.along(ways)
    one_sided = np.isfinite(lowest([p.domain for p in amplitudes])) & (ways.shape[0] == ways.shape[1])
    out = []
    for size in SIZES:
        spread = np.linalg.inv(gram + np.eye(across.size) / size**2)
        mean = -spread @ across
        occam = 0.5 * float(np.linalg.slogdet(spread / size**2)[1])
        bound = 0.0
        if one_sided.any():
            bound = float(np.sum((log_ndtr(mean / np.sqrt(np.diag(spread))) + np.log(2.0))[one_sided]))
        evidence = occam + 0.5 * float(across @ spread @ across) + bound
        moved = np.einsum("pk,kl,pl->p", bends, spread + np.outer(mean, mean), bends)
        out.append(Part(name, prior - float(np.log(len(SIZES))) + evidence, moved))
    return out


def mixed(sd: np.ndarray, parts: Sequence[Part]) -> FaintEffects:
    """The mixture of all parts and nothing.

    Args:
        sd: standard errors as fitted, shape (P,).
    """
    logs = np.array([0.0, *(part.log_weight for part in parts)])
    shares = np.exp(logs - logs.max())
    shares /= shares.sum()
    kept = [(share, part) for share, part in zip(shares[1:].tolist(), parts, strict=True) if share > _NEGLIGIBLE]
    weights = np.array([share for share, _ in kept])
    spread = np.sqrt(sd**2 + np.array([part.moved for _, part in kept]).reshape(len(kept), sd.size))
    factor = np.array([widening(own, weights, spread[:, k]) for k, own in enumerate(sd)])
    counts: dict[str, float] = {}
    for (share, part), wide in zip(kept, spread / sd, strict=True):
        beyond = share * float(np.max(2.0 * ndtr(-Z_95 / wide[factor > WORTH_SAYING]) - _TAIL, initial=0.0))
        counts[part.effect] = counts.get(part.effect, 0.0) + beyond
    most = max(counts.values(), default=0.0)
    behind = sorted((e for e, count in counts.items() if count > 0.1 * most > 0.0), key=lambda e: -counts[e])
    return FaintEffects(factor, tuple(behind[:_LISTED]))


def widening(sd: float, weights: np.ndarray, spread: np.ndarray) -> float:
    """q / (1.96 sd) of a mixture of normal distributions about one mean, at least 1.

    Args:
        sd: standard deviation of the part that has the rest of the weight, above 0.
        weights: of the other parts, shape (n,); their sum is below 1.
        spread: their standard deviations, each at least sd, shape (n,).
    """
    rest = 1.0 - float(weights.sum())

    def beyond(q: float) -> float:
        return 2.0 * (rest * float(ndtr(-q / sd)) + float(weights @ ndtr(-q / spread))) - _TAIL

    low, high = Z_95 * sd, 1.01 * Z_95 * float(np.max(spread, initial=sd))
    return float(root_scalar(beyond, bracket=(low, high), rtol=1e-6).root) / low if beyond(low) > 0.0 else 1.0
