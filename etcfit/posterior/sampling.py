"""Sampling, and the posterior that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ..estimation.intervals import intervals, lumped
from ..estimation.joint_fit import FitResult, Report, quiet
from ..files import held
from .chain import Chain
from .convergence import Convergence
from .run import run
from .settings import SamplingSettings
from .summary import Marginal, described, marginals, values
from .target import Target

CHAIN = "posterior_chain.npz"


@dataclass(frozen=True, eq=False)
class Posterior:
    """What was sampled.

    Args:
        fit: the fit it belongs to.
        target: the density.
        chain: every step.
        convergence: how far it came; where it is not `converged`, this is no posterior yet.
        exact: effects whose formulas are taken as exact here, while the final model's own intervals are not.
        settings: what the sampling decided by.
        remark: that a chain which was there could not be taken up, and where it lies now; or "".
    """

    fit: FitResult
    target: Target
    chain: Chain
    convergence: Convergence
    exact: tuple[str, ...] = ()
    settings: SamplingSettings = SamplingSettings()
    remark: str = ""

    @cached_property
    def points(self) -> np.ndarray:
        """Coordinates after the burn-in, shape (E, N, W, P)."""
        return self.chain.coordinates(self.convergence.burn)

    @cached_property
    def draws(self) -> dict[str, np.ndarray]:
        """Parameters and combinations, SI by symbol, shape (E, N, W) each."""
        electric = any(trace.circuit for trace in self.fit.problem.batch.traces)
        return values(self.fit.free_parameters, self.fit.rig.config.gear_ratio, electric, self.points)

    @cached_property
    def marginals(self) -> dict[str, Marginal]:
        """Posterior of every parameter and combination whose draws differ, by symbol."""
        return marginals(self.draws, intervals(self.fit) | lumped(self.fit))

    @property
    def described(self) -> dict[str, tuple[str, str]]:
        """Unit and meaning by symbol."""
        return described({p.symbol: p for p in self.fit.free_parameters.layout.parameters})

    def some(self, count: int) -> np.ndarray:
        """`count` points spread evenly over all that was sampled after the burn-in, coordinates, shape (count, P)."""
        flat = self.points.reshape(-1, self.points.shape[-1])
        return flat[np.linspace(0, len(flat) - 1, count).astype(int)]


def sample(
    result: FitResult,
    run_dir: Path | str,
    most: int | None = None,
    report: Report = quiet,
    exact: tuple[str, ...] = (),
    settings: SamplingSettings = SamplingSettings(),
) -> Posterior:
    """Sample the posterior of a fit; what was sampled before in the same folder is taken up.

    Args:
        result: a fit.
        run_dir: keeps the chain between blocks of steps.
        most: steps of each ensemble after which to stop whether it has converged or not; None: `settings.most_steps`.
        report: called with what is going on and the share done.
        exact: effects whose formulas the intervals of the model allow to be off; the posterior does not.
        settings: ensembles, budgets and thresholds; kept in what is returned.
    Raises:
        UsageError: another process writes into the folder.
    """
    settings = settings if most is None else replace(settings, most_steps=most)
    report("finding the mode", 0.0)
    target = Target.of(result, settings)

    def begin() -> Chain:
        report("finding where the walkers begin", 0.0)
        return Chain.begin(target.log_probability, target.symbols, *target.start(), settings)

    remarks: list[str] = []
    with held(Path(run_dir)):
        chain, convergence = run(target.log_probability, target.symbols, begin, Path(run_dir) / CHAIN,
                                 settings.most_steps, report, settings, remarks.append)  # fmt: skip
    return Posterior(result, target, chain, convergence, exact, settings, " ".join(remarks))
