"""A diagnosis and a posterior for a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..problem.prediction_error import pooled
from ..reporting.numbers import Digits, short
from ..reporting.tables import LOST, errors_table
from ..run_folder.folder import RunFolder
from .fit import Fit
from .progress import Report, silent, working
from .views import Card, View, attributes, frame, score_frame, texts, with_nan

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import RenderableType

    from ..diagnosis.findings import Diagnosis
    from ..posterior.profile import Profile
    from ..posterior.sampling import Posterior
    from ..reporting.table import Table
    from .plots import DiagnosisPlots, PosteriorPlots


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosed(View):
    """The effects that a model lacked: `etcfit.diagnose(fit)`."""

    diagnosis: Diagnosis

    @cached_property
    def before(self) -> Fit:
        """The fit that was diagnosed."""
        return Fit(self.diagnosis.before)

    @cached_property
    def final(self) -> Fit:
        """The fit of the model with the effects that were found."""
        return Fit(self.diagnosis.after)

    @property
    def added(self) -> tuple[str, ...]:
        """Effects that were found, in the order in which they were added."""
        return self.diagnosis.added

    @property
    def verdict(self) -> str:
        """The result in a few sentences."""
        return " ".join(self.diagnosis.verdict)

    @property
    def ties(self) -> tuple[tuple[str, ...], ...]:
        """Effects that these data cannot tell apart."""
        return tuple(tie.effects for tie in self.diagnosis.ties)

    @property
    def unexplained(self) -> str | None:
        """The part of the residual that no effect explains, in a sentence."""
        return None if self.diagnosis.unexplained is None else self.diagnosis.unexplained.sentence

    @property
    def ledger(self) -> pd.DataFrame:
        """Free-running error before and after, one row per file and channel: test, held_out, unit, n (samples), sigma
        (noise of one sample), before and after (rms, in that unit), before_in_sigma and after_in_sigma."""
        was, now = self.diagnosis.before, self.diagnosis.after
        rows = (*was.score_fit, *was.score_holdout)
        later = {(row.file, row.channel): row.rms for row in (*now.score_fit, *now.score_holdout)}
        sigma, before = with_nan(row.sigma for row in rows), with_nan(row.rms for row in rows)
        after = with_nan(later.get((row.file, row.channel)) for row in rows)
        columns = {"sigma": sigma, "before": before, "after": after,
                   "before_in_sigma": before / sigma, "after_in_sigma": after / sigma}  # fmt: skip
        return score_frame(was, rows, columns)

    @property
    def candidates(self) -> pd.DataFrame:
        """Every effect that was tried, one row per round and effect: the predicted improvement and that of the
        refit."""
        every = [(k, each, c) for k, each in enumerate(self.diagnosis.rounds, start=1) for c in each.candidates]
        keys = ("screened", "fit_rms_ratio", "holdout_rms_ratio", "holdout_chi2_change", "bic_change")
        import pandas as pd

        frame = pd.DataFrame(attributes((c for _, _, c in every), *keys))
        frame.insert(0, "added", np.array([c.effect == each.added for _, each, c in every], dtype=bool))
        places = [np.array([k for k, _, _ in every], dtype=np.int64), texts(c.effect for _, _, c in every)]
        frame.index = pd.MultiIndex.from_arrays(places, names=["round", "effect"])
        return frame

    @property
    def plot(self) -> DiagnosisPlots:
        """Pictures: `plot.ledger()`, `plot.missing_torque()`, `plot.trace(file)`, ..."""
        from .plots import DiagnosisPlots

        return DiagnosisPlots(self.diagnosis)

    def printed(self) -> RenderableType:
        from ..reporting.diagnosis import diagnosis_table

        return diagnosis_table(self.diagnosis)

    def save(self, run: str | Path) -> Path:
        """Write the whole diagnosis, and the fit that it began from, to a run folder."""
        from ..run_folder.folder import RunFolder
        from .work import keep_diagnosis, keep_fit

        folder = RunFolder(run)
        keep_fit(folder, self.diagnosis.before)
        keep_diagnosis(folder, self.diagnosis)
        return Path(run)

    def _card(self) -> Card:
        from ..reporting.diagnosis.ledger import ledger

        was, now, count = self.diagnosis.before, self.diagnosis.after, len(self.diagnosis.rounds)
        pairs = {"fitted": (was.score_fit, now.score_fit), "held out": (was.score_holdout, now.score_holdout)}
        errors = [f"{name}: rms error {short(pooled(a))} -> {short(pooled(b))} sigma"
                  for name, (a, b) in pairs.items() if a and b]  # fmt: skip
        found = f"Eqs. 1-2 lack {', '.join(self.added)}" if self.added else "found nothing, no effect added"
        alarm = "" if now.converged else f"THE FINAL FIT DID NOT CONVERGE, NOT CONVERGED: {now.reason}"
        return Card(now.rig.config, f"diagnosis, {count} rounds: {found}", (self.verdict,),
                    (errors_table(ledger(self.diagnosis), True),), errors, {"Warnings": self.final.warnings},
                    alarm)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Sampled(View):
    """The posterior of a fit: `etcfit.sample(fit)`."""

    posterior: Posterior
    profiles: Mapping[str, Profile] = field(default_factory=dict)  # by symbol, of weakly determined parameters

    def profiled(self, report: Report = silent) -> Sampled:
        """The same with the profiles of its weakly determined parameters, which takes seconds."""
        from ..posterior.profile import profiles

        return replace(self, profiles=profiles(self.posterior, report))

    @cached_property
    def fit(self) -> Fit:
        """The fit that was sampled."""
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
        """Free parameters and combinations of them, indexed by symbol: mean, sd, median, low, high (SI, 95 %), unit,
        status, ess (independent draws), r_hat.

        NaN where the status is "not identifiable": there the draws show the prior, not the data.
        """
        rows = [{**row, **dict(zip(("low", "high"), row["ci95"] or (None, None), strict=True))}
                for row in self._shown.rows]  # fmt: skip
        return frame(rows, "symbol", ("mean", "sd", "median", "low", "high", "unit", "status", "ess", "r_hat"))

    @property
    def _shown(self) -> Table:
        from ..reporting.posterior import parameters_table
        from ..run_folder.posterior import parameters_json

        return parameters_table({"parameters": parameters_json(self.posterior, {})})

    @property
    def draws(self) -> pd.DataFrame:
        """Every draw after the burn-in, SI: one column per symbol, one row per ensemble, step and walker."""
        import pandas as pd

        draws = self.posterior.draws
        shape = next(iter(draws.values())).shape
        index = pd.MultiIndex.from_product([range(n) for n in shape], names=["ensemble", "step", "walker"])
        return pd.DataFrame({s: np.asarray(each).ravel() for s, each in draws.items()}, index=index)

    @property
    def plot(self) -> PosteriorPlots:
        """Pictures: `plot.corner()`, `plot.intervals()`."""
        from .plots import PosteriorPlots

        return PosteriorPlots(self.posterior)

    def printed(self) -> RenderableType:
        from ..reporting.blocks import cautioned
        from ..reporting.posterior import posterior_table

        return cautioned(posterior_table(self.posterior, self.profiles), self.posterior.fit.state)

    @property
    def remark(self) -> str:
        """Why an earlier chain could not be taken up, or ""."""
        return self.posterior.remark

    def save(self, run: str | Path | RunFolder, quiet: bool | Report = False) -> Path:
        """Write posterior.json, posterior.nc and the pictures to a run folder; this computes the profiles.

        Raises:
            UsageError: RUN holds another model.
        """
        from .work import keep_posterior

        folder = RunFolder.named(run)
        folder.refuse_other_model(self.posterior.fit)
        with working(quiet) as report:
            keep_posterior(folder, self.posterior, self.profiles or self.profiled(report).profiles, report)
        return folder.path

    def _card(self) -> Card:
        here, chain, shown = self.posterior.convergence, self.posterior.chain, self._shown
        size = (f"{len(chain.ensembles)} ensembles, {here.steps} steps, {here.burn} of them burn-in, "
                f"{short(here.effective)} effective samples")  # fmt: skip
        lost = [row["symbol"] for row in shown.rows if row["status"] == LOST]
        known = [(row, Digits.of_value(row["mean"], row["sd"])) for row in shown.rows if row["status"] != LOST]
        lines = (
            f"not identifiable: {', '.join(lost)}" if lost else "",
            "; ".join(f"{row['symbol']} {digits(row['mean'])} ± {digits(row['sd'])} {row['unit']}"
                      for row, digits in known),
        )  # fmt: skip
        alarm = "" if self.converged else f"NOT CONVERGED, no posterior yet: {self.reason}"
        return Card(self.posterior.fit.rig.config, "posterior", (size,), (shown,), lines, alarm=alarm)
