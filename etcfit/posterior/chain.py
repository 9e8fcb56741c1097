"""Several ensembles that know nothing of each other, the file that keeps them between blocks, and when they suffice.

The file is written whole after each block. It holds the random state too: a chain taken up again goes on exactly as if
it had never been interrupted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import emcee
import numpy as np

from ..estimation.joint_fit import Report
from ..files import put_aside, whole
from .ensemble import Ensemble, LogProbability, approximate, in_step
from .settings import SamplingSettings

BLOCK = 50  # steps between two writings of the chain to its file
BURN = 5.0  # tau that are thrown away first
EARLIER = 0.8  # share of the chain with whose tau that of the whole is compared
FEWEST = 100  # steps before which nothing is said of tau
MARGIN = 1.1  # factor on the steps that are said to be still needed: tau grows with the chain it is estimated from
_SAME = 1e-6  # by which a log-probability may differ when it is computed again, absolute and relative


@dataclass(frozen=True, eq=False)
class Chain:
    """All that was sampled of a target so far."""

    symbols: tuple[str, ...]  # of the coordinates
    centre: np.ndarray  # x = centre + root u, coordinates, shape (P,): mean of a normal density near the one sampled
    root: np.ndarray  # square root of its covariance, shape (P, P)
    ensembles: tuple[Ensemble, ...]  # equally long

    @classmethod
    def begin(
        cls,
        target: LogProbability,
        symbols: tuple[str, ...],
        start: np.ndarray,
        covariance: np.ndarray,
        settings: SamplingSettings = SamplingSettings(),
    ) -> Chain:
        """One ensemble a seed, about the density's own mean as far as it is found.

        Args:
            target: log-probability of coordinates, shape (K, P) -> (K,).
            symbols: of the coordinates, P.
            start, covariance: first guess of the mean, coordinates, and of the covariance, shapes (P,) and (P, P).
            settings: seeds, walkers, and how the mean is sought.
        """
        bare = cls(symbols, *approximate(target, start, covariance, settings), ())
        standard = bare.standard(target)
        begun = (Ensemble.begin(standard, start.size, seed, settings) for seed in settings.seeds)
        return replace(bare, ensembles=tuple(begun))

    def standard(self, target: LogProbability) -> LogProbability:
        """The density over standard coordinates u, x = centre + root u; it differs by a constant factor."""
        return lambda u: target(self.centre + u @ self.root.T)

    def advanced(self, target: LogProbability, steps: int) -> Chain:
        """The chain after some more steps. Points of all ensembles are computed in one call, so that the processor's
        vectors are full."""
        later = in_step(lambda e, standard: e.advanced(standard, steps), self.ensembles, self.standard(target))
        return replace(self, ensembles=tuple(later))

    def coordinates(self, burn: int) -> np.ndarray:
        """What was sampled after `burn` steps, shape (E, N, W, P)."""
        kept = np.stack([e.points[burn:] for e in self.ensembles])
        return self.centre + kept @ self.root.T

    def belongs_to(self, target: LogProbability, symbols: tuple[str, ...]) -> bool:
        """False where the data, the model or its fit have changed since the chain was begun."""
        if symbols != self.symbols:
            return False
        e = self.ensembles[0]
        again = self.standard(target)(e.points[-1])
        return bool(np.allclose(again, e.log_probability[-1], rtol=_SAME, atol=_SAME))


def save(path: Path, chain: Chain) -> None:
    """Write a chain whole or not at all."""
    arrays: dict[str, Any] = {"symbols": np.array(chain.symbols, dtype=str), "mode": chain.centre, "root": chain.root}
    for k, e in enumerate(chain.ensembles):
        _, keys, position, has_gauss, gauss = e.random
        arrays |= {f"points{k}": e.points, f"log_probability{k}": e.log_probability, f"accepted{k}": e.accepted,
                   f"keys{k}": keys, f"random{k}": np.array([position, has_gauss, gauss])}  # fmt: skip
    with whole(path) as draft:
        np.savez(draft, **arrays)


class Damaged(ValueError):
    """A file that holds no whole chain."""


def load(path: Path) -> Chain | None:
    """The chain that was kept there; None where there is no file.

    Raises:
        Damaged: it is not whole, or something else.
        OSError: it cannot be opened.
    """
    if not path.exists():
        return None
    with path.open("rb") as file:
        try:
            with np.load(file, allow_pickle=False) as kept:
                return _chain(kept)
        except Exception as error:  # whatever a file of any bytes makes zipfile and NumPy say
            raise Damaged(str(error) or type(error).__name__) from error


def _chain(kept: Any) -> Chain:
    ensembles = []
    for k in range(sum(name.startswith("points") for name in kept.files)):
        position, has_gauss, gauss = kept[f"random{k}"].tolist()
        random = ("MT19937", kept[f"keys{k}"], int(position), int(has_gauss), gauss)
        ensembles.append(Ensemble(kept[f"points{k}"], kept[f"log_probability{k}"], kept[f"accepted{k}"], random))
    chain = Chain(tuple(map(str, kept["symbols"])), kept["mode"], kept["root"], tuple(ensembles))
    size, one = len(chain.symbols), ensembles[0].points.shape
    whole_one = chain.centre.shape == (size,) and chain.root.shape == (size, size) and one[2:] == (size,)
    if not whole_one or not all(e.points.shape == one and e.log_probability.shape == one[:2] for e in ensembles):
        raise ValueError("its arrays do not fit together")
    return chain


@dataclass(frozen=True, eq=False)
class Convergence:
    """Whether a chain is long enough to be called a posterior, and if not, how much longer it must be.

    tau is the integrated autocorrelation time of an ensemble (Goodman and Weare 2010; Sokal's window, as in emcee): N
    steps of W walkers hold N W / tau independent draws. It is itself only known from a chain of many tau, hence
    N > 50 tau.
    """

    steps: int  # of each ensemble
    burn: int  # steps thrown away
    tau: np.ndarray  # of each coordinate, the longest of the ensembles, steps, shape (P,)
    earlier: np.ndarray  # tau of the first part of the chain (four fifths), steps, shape (P,)
    rhat: np.ndarray  # of each coordinate, shape (P,)
    acceptance: float  # share of moves accepted
    effective: float  # independent draws of the coordinate that has fewest
    settings: SamplingSettings = SamplingSettings()  # what it is judged by

    @classmethod
    def judge(cls, ensembles: Sequence[Ensemble], settings: SamplingSettings = SamplingSettings()) -> Convergence:
        """That of ensembles that are equally long."""
        steps, size = ensembles[0].steps, ensembles[0].points.shape[2]
        acceptance = float(np.mean([e.acceptance for e in ensembles]))
        if steps < FEWEST:
            unknown = np.full(size, np.nan)
            return cls(steps, steps // 2, unknown, unknown, unknown, acceptance, 0.0, settings)
        rough = _longest([e.points for e in ensembles])
        burn = int(min(BURN * np.max(rough), steps // 2)) + 1
        kept = [e.points[burn:] for e in ensembles]
        tau = _longest(kept)
        earlier = _longest([points[: int(EARLIER * len(points))] for points in kept])
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
            return 2 * FEWEST
        lacking = self.settings.length * self.longest * MARGIN + self.burn
        return max(int(lacking), int(1.25 * self.steps)) if self.faults else self.steps

    @property
    def faults(self) -> tuple[str, ...]:
        """What keeps the chain from being a posterior; none where it is one."""
        if not np.isfinite(self.longest):
            return (f"{self.steps} steps are too few to say anything",)
        allowed, length, out = self.settings, (self.steps - self.burn) / self.longest, []
        if length <= allowed.length:
            tau = f"tau {self.longest:.0f} steps"
            out.append(f"the chain is {length:.0f} tau long where {allowed.length:.0f} are needed ({tau})")
        drift = abs(self.longest / float(np.max(self.earlier)) - 1.0)
        if drift > allowed.still:
            out.append(f"tau still changes, by {100.0 * drift:.0f} % over the last fifth of the chain")
        if np.max(self.rhat) > allowed.alike:
            out.append(f"the ensembles disagree (R-hat {float(np.max(self.rhat)):.3f}, {allowed.alike} allowed)")
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
    cuts = [(points, len(points) // 2) for points in chains]
    equal = [half for points, middle in cuts for half in (points[:middle], points[middle : 2 * middle])]
    halves = [half.reshape(-1, half.shape[2]) for half in equal]
    n = len(halves[0])
    within = np.mean([np.var(half, axis=0, ddof=1) for half in halves], axis=0)
    between = np.var([np.mean(half, axis=0) for half in halves], axis=0, ddof=1)
    return np.sqrt((n - 1) / n + between / np.where(within > 0.0, within, 1.0))


def run(
    target: LogProbability,
    symbols: tuple[str, ...],
    begin: Callable[[], Chain],
    path: Path,
    most: int,
    report: Report,
    settings: SamplingSettings = SamplingSettings(),
    remark: Callable[[str], None] = lambda said: None,
) -> tuple[Chain, Convergence]:
    """Sample in blocks of steps, each kept on disk and judged, until the chain has converged or the budget is spent.

    It goes on from what is kept in `path` if that belongs to the target. Else what is kept is hours of work all the
    same, and is put aside.

    Args:
        target: log-probability of coordinates, shape (K, P) -> (K,).
        symbols: of the coordinates, P.
        begin: a chain of no steps.
        path: file of the chain.
        most: steps after which to stop whether the chain has converged or not.
        report: called after each block with acceptance, tau, effective samples and time left, and the share done.
        settings: when a chain has converged.
        remark: told that a chain was put aside, and why.
    Returns:
        the whole chain, and the verdict on it.
    """
    chain = _taken_up(path, target, symbols, begin, remark)
    here = Convergence.judge(chain.ensembles, settings)
    began, first = time.monotonic(), here.steps
    while not here.converged and here.steps < most:
        chain = chain.advanced(target, min(BLOCK, most - here.steps))
        save(path, chain)
        here = Convergence.judge(chain.ensembles, settings)
        pace = (time.monotonic() - began) / (here.steps - first)
        report(_words(here, most, pace), here.steps / max(here.steps, min(here.needed, most)))
    return chain, here


def _taken_up(
    path: Path,
    target: LogProbability,
    symbols: tuple[str, ...],
    begin: Callable[[], Chain],
    remark: Callable[[str], None],
) -> Chain:
    """The chain that is kept, where it is whole and the target's, else the new one."""
    try:
        kept = load(path)
        why = "belongs to another model or other data"
    except Damaged as error:
        kept, why = None, f"cannot be read ({error})"
    if kept is not None and kept.belongs_to(target, symbols):
        return kept
    if path.exists():
        remark(f"{path} {why}: it was moved to {put_aside(path)}, and a new chain begun.")
    return begin()


def _words(here: Convergence, most: int, pace: float) -> str:
    """Acceptance, tau, effective samples and time left; `pace` in seconds a step."""
    text = f"step {here.steps}: {100.0 * here.acceptance:.0f} % accepted"
    if here.longest != here.longest:
        return f"{text}, {pace:.2g} s a step"
    left = pace * (min(here.needed, most) - here.steps)
    duration = f"{left:.0f} s" if left < 90.0 else f"{left / 60.0:.1f} min"
    return f"{text}, tau {here.longest:.0f}, {here.effective:.0f} effective samples, about {duration} left"
