"""Sampling, the posterior that it leaves, and what that says of each parameter and of each trace."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import jax
import numpy as np

from ..backend import compiled_quickly
from ..estimation.intervals import LUMPS, Z_95, intervals, lumped
from ..estimation.joint_fit import FitResult, Report, quiet
from ..files import held
from ..problem.trace import Trace
from .chain import Chain, Convergence, autocorrelation_time, run, split_rhat
from .settings import SamplingSettings
from .target import Target

CHAIN = "posterior_chain.npz"
APART = 0.2  # relative difference of standard deviations from fit, profile and posterior that is flagged
DRAWS_PER_TAU = 4  # of each walker kept in posterior.nc
PREDICTIVE_DRAWS = 32  # of the posterior that predictive bands are computed from


@dataclass(frozen=True)
class Marginal:
    """The posterior of one parameter, SI."""

    # mean, sd, median: of its draws
    mean: float
    sd: float
    median: float
    # low, high: its 95 % interval, between the 2.5 and 97.5 % quantiles
    low: float
    high: float
    ess: float  # independent draws, W N / tau of this parameter
    r_hat: float  # over the ensembles
    status: str  # "estimated", "fixed", "tied" or "not identifiable", as in the fit
    laplace: float | None  # the fit's standard error, or None


def apart(*spreads: float | None) -> bool:
    """Whether standard deviations found in different ways, where they were found, differ by more than is allowed."""
    known = [s for s in spreads if s]
    return bool(known) and max(known) > (1.0 + APART) * min(known)


@dataclass(frozen=True, eq=False)
class Posterior:
    """What was sampled."""

    fit: FitResult  # the fit it belongs to
    target: Target  # the density
    chain: Chain  # every step
    convergence: Convergence  # how far it came; where it is not `converged`, this is no posterior yet
    # effects whose formulas are taken as exact here, while the final model's own intervals are not
    exact: tuple[str, ...] = ()
    settings: SamplingSettings = SamplingSettings()  # what the sampling decided by
    remark: str = ""  # that a chain which was there could not be taken up, and where it lies now; or ""

    @cached_property
    def points(self) -> np.ndarray:
        """Coordinates after the burn-in, shape (E, N, W, P)."""
        return self.chain.coordinates(self.convergence.burn)

    @cached_property
    def draws(self) -> dict[str, np.ndarray]:
        """Parameters, and those of their combinations that the rig knows, SI by symbol, shape (E, N, W) each."""
        free, shape = self.fit.free_parameters, self.points.shape
        layout, pick = free.layout, free.layout.pick(free.held)
        compute = compiled_quickly(jax.vmap(lambda x: layout.form.values(x, pick)))
        found = compute(layout.padded(self.points.reshape(-1, shape[-1])))
        every = {p.symbol: np.asarray(found[p.symbol]).reshape(shape[:-1]) for p in layout.parameters}
        electric = any(trace.circuit for trace in self.fit.problem.batch.traces)
        lumps = {s: lump for s, lump in LUMPS.items() if electric or not lump.electric}
        return every | {s: np.asarray(lump.formula(every, self.fit.rig.config.gear_ratio)) for s, lump in lumps.items()}

    @cached_property
    def marginals(self) -> dict[str, Marginal]:
        """Posterior of every parameter and combination whose draws differ, by symbol."""
        out, fitted = {}, intervals(self.fit) | lumped(self.fit)
        for symbol, draws in self.draws.items():
            if np.ptp(draws) > 0.0:
                chains = [e[:, :, None] for e in draws]
                tau = max(float(autocorrelation_time(e)[0]) for e in chains)
                low, median, high = np.quantile(draws, (0.025, 0.5, 0.975)).tolist()
                out[symbol] = Marginal(
                    float(draws.mean()), float(draws.std(ddof=1)), median, low, high, draws.size / tau,
                    float(split_rhat(chains)[0]), fitted[symbol].status, fitted[symbol].stderr,
                )  # fmt: skip
        return out

    @property
    def described(self) -> dict[str, tuple[str, str]]:
        """Unit and meaning by symbol, combinations among them."""
        own = {p.symbol: (p.unit, p.meaning) for p in self.fit.free_parameters.layout.parameters}
        return own | {s: (lump.unit, lump.meaning) for s, lump in LUMPS.items()}

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
        run_dir: keeps the chain between blocks of steps.
        most: steps of each ensemble after which to stop whether it has converged or not; None: `settings.most_steps`.
        exact: effects whose formulas the intervals of the model allow to be off; the posterior does not.
    Raises:
        UsageError: another process writes into the folder.
    """
    settings = settings if most is None else replace(settings, most_steps=most)
    report("finding the mode", 0.0)
    target = Target.from_fit(result)

    def begin() -> Chain:
        report("finding where the walkers begin", 0.0)
        return Chain.begin(target.log_probability, target.symbols, *target.start(), settings)

    remarks: list[str] = []
    with held(Path(run_dir)):
        chain, convergence = run(target.log_probability, target.symbols, begin, Path(run_dir) / CHAIN,
                                 settings.most_steps, report, settings, remarks.append)  # fmt: skip
    return Posterior(result, target, chain, convergence, exact, settings, " ".join(remarks))


@dataclass(frozen=True, eq=False)
class Band:
    """The prediction of one trace, SI."""

    trace: Trace  # as measured
    # mean, sd: shape (n, M)
    mean: np.ndarray
    sd: np.ndarray

    @property
    def inside(self) -> tuple[float, ...]:
        """Share of each channel's samples inside its 95 % band."""
        error = np.abs(self.trace.data - self.mean)
        return tuple(float(np.mean(e[np.isfinite(e)] <= Z_95 * s[np.isfinite(e)]))
                     for e, s in zip(error.T, self.sd.T, strict=True))  # fmt: skip


def bands(posterior: Posterior, report: Report = quiet) -> tuple[Band, ...]:
    """Posterior predictive bands: what each trace ought to have shown, fitted ones first, then those held out.

        y_k ~ N(mean_k, var over draws of y_hat_k + C P_k C^T + sigma^2)

    y_hat is the free-running simulation at draws of the posterior, P what the noise of the logged input and instants
    that nobody logged add up to along it (`innovations.free_run_variance`), sigma the sensor's noise; of a fit that is
    `far` from the data, the error left in each fitted channel.
    """
    points = posterior.some(PREDICTIVE_DRAWS)
    problems = [problem for problem in (posterior.fit.problem, posterior.fit.holdout) if problem is not None]
    out: list[Band] = []
    for k, problem in enumerate(problems):
        report("predictive bands", k / len(problems))
        runs = [problem.free_run(x) for x in points]
        own = problem.free_run_variance(posterior.target.mode)
        drawn = [(np.mean(y, axis=0), np.var(y, axis=0)) for y in zip(*runs, strict=True)]
        out += [Band(trace, mean, np.sqrt(spread + noise))
                for trace, (mean, spread), noise in zip(problem.batch.traces, drawn, own, strict=True)]  # fmt: skip
    return tuple(out)
