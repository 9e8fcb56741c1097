"""Whether a chain is long enough to be called a posterior, and if not, how much longer it must be.

tau is the integrated autocorrelation time of an ensemble (Goodman and Weare 2010; Sokal's window, as in emcee): N steps
of W walkers hold N W / tau independent draws. It is itself only known from a chain of many tau, hence N > 50 tau.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import emcee
import numpy as np

from .ensemble import Ensemble
from .settings import SamplingSettings

LENGTH = SamplingSettings().length


@dataclass(frozen=True, eq=False)
class Convergence:
    """How far a set of ensembles has come.

    Args:
        steps: of each ensemble.
        burn: steps thrown away.
        tau: of each coordinate, the longest of the ensembles, steps, shape (P,).
        earlier: tau of the first part of the chain (four fifths), steps, shape (P,).
        rhat: of each coordinate, shape (P,).
        acceptance: share of moves accepted.
        effective: independent draws of the coordinate that has fewest.
        settings: what it is judged by.
    """

    steps: int
    burn: int
    tau: np.ndarray
    earlier: np.ndarray
    rhat: np.ndarray
    acceptance: float
    effective: float
    settings: SamplingSettings = SamplingSettings()

    @classmethod
    def of(cls, ensembles: Sequence[Ensemble], settings: SamplingSettings = SamplingSettings()) -> Convergence:
        """Judge ensembles that are equally long."""
        steps, size = ensembles[0].steps, ensembles[0].points.shape[2]
        acceptance = float(np.mean([e.acceptance for e in ensembles]))
        if steps < settings.fewest:
            unknown = np.full(size, np.nan)
            return cls(steps, steps // 2, unknown, unknown, unknown, acceptance, 0.0, settings)
        rough = _longest([e.points for e in ensembles])
        burn = int(min(settings.burn * np.max(rough), steps // 2)) + 1
        kept = [e.points[burn:] for e in ensembles]
        tau = _longest(kept)
        earlier = _longest([points[: int(settings.earlier * len(points))] for points in kept])
        effective = sum(points.shape[0] * points.shape[1] for points in kept) / float(np.max(tau))
        return cls(steps, burn, tau, earlier, split_rhat(kept), acceptance, effective, settings)

    @property
    def longest(self) -> float:
        """tau of the slowest coordinate, steps; NaN where the chain is too short to say."""
        return float(np.max(self.tau))

    @property
    def needed(self) -> int:
        """Steps that each ensemble must have in all, as far as can be told now."""
        if not np.isfinite(self.longest):
            return 2 * self.settings.fewest
        lacking = self.settings.length * self.longest * self.settings.margin + self.burn
        return max(int(lacking), int(1.25 * self.steps)) if self.faults else self.steps

    @property
    def faults(self) -> tuple[str, ...]:
        """What keeps the chain from being a posterior; none where it is one."""
        if not np.isfinite(self.longest):
            return (f"{self.steps} steps are too few to say anything",)
        asked, length, out = self.settings, (self.steps - self.burn) / self.longest, []
        if length <= asked.length:
            tau = f"tau {self.longest:.0f} steps"
            out.append(f"the chain is {length:.0f} tau long where {asked.length:.0f} are needed ({tau})")
        drift = abs(self.longest / float(np.max(self.earlier)) - 1.0)
        if drift > asked.still:
            out.append(f"tau still changes, by {100.0 * drift:.0f} % over the last fifth of the chain")
        if np.max(self.rhat) > asked.alike:
            out.append(f"the ensembles disagree (R-hat {float(np.max(self.rhat)):.3f}, {asked.alike} allowed)")
        return tuple(out)

    @property
    def converged(self) -> bool:
        return not self.faults

    @property
    def reason(self) -> str:
        """The verdict in words."""
        if self.converged:
            length = (self.steps - self.burn) / self.longest
            return f"{length:.0f} tau long (tau {self.longest:.0f} steps), tau settled, the ensembles agree"
        return "; ".join(self.faults) + f". About {self.needed - self.steps} more steps are needed."


def autocorrelation_time(points: np.ndarray) -> np.ndarray:
    """tau of each column, steps, at least 1, of a chain of shape (N, W, P)."""
    return np.maximum(1.0, emcee.autocorr.integrated_time(points, tol=0, quiet=True))


def _longest(chains: Sequence[np.ndarray]) -> np.ndarray:
    """tau of each coordinate in the ensemble where it is longest, steps; chains of shape (N, W, P) -> (P,)."""
    return np.max([autocorrelation_time(points) for points in chains], axis=0)


def split_rhat(chains: Sequence[np.ndarray]) -> np.ndarray:
    """R-hat = sqrt(1 - 1/n + B / (n W)) over both halves of each ensemble (Gelman et al. 2013, sec. 11.4), shape (P,).

    Args:
        chains: shape (N, W, P) each; all draws of a half are one sequence of n.
    """
    halves = [half.reshape(-1, half.shape[2]) for points in chains for half in _halves(points)]
    n = len(halves[0])
    within = np.mean([np.var(half, axis=0, ddof=1) for half in halves], axis=0)
    between = np.var([np.mean(half, axis=0) for half in halves], axis=0, ddof=1)
    return np.sqrt((n - 1) / n + between / np.where(within > 0.0, within, 1.0))


def _halves(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second half of a chain, shape (N, W, P), equally long."""
    middle = len(points) // 2
    return points[:middle], points[middle : 2 * middle]
