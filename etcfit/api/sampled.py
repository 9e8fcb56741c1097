"""A posterior as a notebook holds it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from ..posterior.sampling import Posterior
from ..posterior.summary import Marginal
from ..reporting.numbers import Digits, short
from . import words
from .fit import Fit
from .frames import indexed, numbers

if TYPE_CHECKING:
    from .plots import PosteriorPlots

_HEAD = ("", "mean", "sd", "95 % interval", "unit", "status", "ESS", "R-hat")


@dataclass(frozen=True, eq=False, repr=False)
class Sampled:
    """How sure: `etcfit.sample(fit)`.

    Args:
        posterior: every step of the chain.
    """

    posterior: Posterior

    @cached_property
    def fit(self) -> Fit:
        """The fit it belongs to."""
        return Fit(self.posterior.fit)

    @property
    def converged(self) -> bool:
        """Whether the chain is long enough to be called a posterior; `reason` says why (not)."""
        return self.posterior.convergence.converged

    @property
    def reason(self) -> str:
        return self.posterior.convergence.reason

    @property
    def parameters(self) -> pd.DataFrame:
        """What moves, combinations among it, indexed by symbol: mean, sd, median, low, high (SI, 95 %), unit, status,
        ess (independent draws), r_hat.

        NaN where the status is "not identifiable": those draws show what was believed, not what was seen.
        """
        rows = self.posterior.marginals
        keys = ("mean", "sd", "median", "low", "high")
        figures = {key: numbers(None if _lost(m) else getattr(m, key) for m in rows.values()) for key in keys}
        units = pd.Series([self.posterior.described[s][0] for s in rows], dtype="str")
        status = pd.Series([m.status for m in rows.values()], dtype="str")
        chain = {key: numbers(getattr(m, key) for m in rows.values()) for key in ("ess", "r_hat")}
        return indexed(figures | {"unit": units, "status": status} | chain, list(rows))

    @property
    def draws(self) -> pd.DataFrame:
        """Every draw after the burn-in, SI: a column a symbol, a row for each ensemble, step and walker."""
        draws = self.posterior.draws
        shape = next(iter(draws.values())).shape
        index = pd.MultiIndex.from_product([range(n) for n in shape], names=["ensemble", "step", "walker"])
        return pd.DataFrame({s: np.asarray(each).ravel() for s, each in draws.items()}, index=index)

    @property
    def plot(self) -> PosteriorPlots:
        """Pictures: `plot.corner()`, `plot.intervals()`."""
        from .plots import PosteriorPlots

        return PosteriorPlots(self.posterior)

    def summary(self, width: int = 140) -> str:
        """What `etcfit sample` prints, for `print`; without the profiles."""
        from ..reporting.blocks import render
        from ..reporting.posterior.table import posterior_table

        return render(posterior_table(self.posterior, {}), width)

    def save(self, run: str | Path, quiet: bool = False) -> Path:
        """Write posterior.json, posterior.nc and the pictures to a run folder; profiles are computed for it.

        Args:
            run: made if absent.
            quiet: show no progress.
        Raises:
            UsageError: another model lies in RUN.
        """
        from ..posterior.profile import profiles
        from ..run_folder import RunFolder
        from .progress import working
        from .saving import keep_posterior

        folder = RunFolder(run)
        folder.refuse_other_model(self.posterior.fit)
        with working(quiet) as report:
            keep_posterior(folder, self.posterior, profiles(self.posterior, report), {}, report)
        return Path(run)

    @property
    def _alarm(self) -> str:
        return "" if self.converged else f"NOT CONVERGED, no posterior yet: {self.reason}"

    @property
    def _size(self) -> str:
        here, chain = self.posterior.convergence, self.posterior.chain
        return (f"{len(chain.ensembles)} ensembles, {here.steps} steps, {here.burn} of them burn-in, "
                f"{short(here.effective)} effective samples")  # fmt: skip

    def __repr__(self) -> str:
        unit = {s: u for s, (u, _) in self.posterior.described.items()}
        rows = self.posterior.marginals
        lost = [s for s, m in rows.items() if _lost(m)]
        return words.block(
            f"Posterior of {words.name_of(self.posterior.fit.rig.config)}: {self._size}",
            self._alarm,
            f"not identifiable: {', '.join(lost)}" if lost else "",
            "; ".join(f"{s} {_figures(m)[0]} ± {_figures(m)[1]} {unit[s]}" for s, m in rows.items() if not _lost(m)),
        )

    def _repr_html_(self) -> str:
        unit = {s: u for s, (u, _) in self.posterior.described.items()}
        rows = [[words.Cell(text, _lost(m)) for text in (s, *_figures(m), unit[s], m.status, short(m.ess),
                                                         f"{m.r_hat:.3f}")]
                for s, m in self.posterior.marginals.items()]  # fmt: skip
        return words.card(
            self.posterior.fit.rig.config,
            "posterior",
            words.paragraph(self._size),
            words.table(_HEAD, rows),
            alarm=self._alarm,
        )


def _lost(m: Marginal) -> bool:
    return m.status == "not identifiable"


def _figures(m: Marginal) -> tuple[str, str, str]:
    """Mean, sd and interval."""
    if _lost(m):
        return "-", "-", "-"
    digits = Digits.of(m.mean, m.sd)
    return digits(m.mean), digits(m.sd), digits.span(m.low, m.high)
