"""A fit for a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..estimation.explained import motion_explained
from ..estimation.result import FitResult
from ..model.effects import PAPER
from ..problem.prediction_error import pooled
from ..reporting.numbers import short
from ..reporting.tables import LOST, fit_table, parameter_rows, parameters_table
from ..run_folder.fit import FIT
from . import views
from .progress import Report, silent
from .views import Card, FittedTrace, View, attributes, frame, indexed, named, score_frame, texts, traces_of, with_nan

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import RenderableType

    from ..control.design import Design
    from ..run_folder.folder import RunFolder
    from .plots import FitPlots

_KEYS = ("value", "stderr", "low", "high", "unit", "status")


@dataclass(frozen=True, eq=False, repr=False)
class Fit(View):
    """The joint fit of a rig: `etcfit.fit(rig)`."""

    result: FitResult

    @cached_property
    def _parameters(self) -> dict[str, dict[str, Any]]:
        return FIT.json(self.result, "parameters")["parameters"]

    @property
    def parameters(self) -> pd.DataFrame:
        """Every parameter, indexed by symbol: value, stderr, low, high (SI, 95 %), unit, status.

        `stderr`, `low` and `high` are NaN where there is no interval: the value was given, or its status is "not
        identifiable", so that these data do not determine it and the number means nothing. A "compromise" has no
        `stderr`; its `low` and `high` are the range that subsets of the data give.
        """
        return frame(parameter_rows(self._parameters), "symbol", _KEYS)

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions for every result made from this fit, one sentence each; none if the fit is sound."""
        return self.result.state.cautions

    def keep_design(self, run: RunFolder, design: Design, options: Mapping[str, Any], report: Report = silent) -> Path:
        """Write pid.json, the responses, and their entry in the manifest.

        Raises:
            UsageError: RUN holds another model.
        """
        from .work import keep_design

        run.refuse_other_model(self.result)
        keep_design(run, self.result, design, options, report)
        return run.path

    @property
    def combinations(self) -> pd.DataFrame:
        """Combinations of parameters that act on the plate (J_eq, B_eq, ...): columns as in `parameters`."""
        return frame(parameter_rows(FIT.json(self.result, "lumped")["lumped"]), "symbol", _KEYS)

    @property
    def influence(self) -> pd.DataFrame:
        """How far leaving out each test, and each trace, would move the parameters: columns test, file, parameter,
        pull; largest first.

        `pull` is in standard errors of noise alone. A parameter that only one test determines has no row for that test.
        """
        import pandas as pd

        every = self.result.influence.pulls
        where = {"test": texts(p.test for p in every), "file": pd.Series([p.file for p in every], dtype="object")}
        return pd.DataFrame(where | {"parameter": texts(p.parameter for p in every)} | attributes(every, "pull"))

    @property
    def contradictions(self) -> pd.DataFrame:
        """Tests that the others contradict, worst first, indexed by test: parameter, pull, value, without, p, share."""
        every = self.result.contradictions
        columns = attributes(every, "pull", "value", "without", "p", "share")
        return indexed({"parameter": texts(c.parameter for c in every)} | columns, [c.test for c in every], "test")

    @property
    def score(self) -> pd.DataFrame:
        """Free-running error of the simulation, one row per file and channel: test, held_out, unit, n (samples), rms
        and sigma (in that unit), in_sigma (rms / sigma)."""
        rows = (*self.result.score_fit, *self.result.score_holdout)
        rms, sigma = with_nan(row.rms for row in rows), with_nan(row.sigma for row in rows)
        return score_frame(self.result, rows, {"rms": rms, "sigma": sigma, "in_sigma": rms / sigma})

    @property
    def converged(self) -> bool:
        """Whether the fit ended at an optimum; `reason` says why (not)."""
        return self.result.converged

    @property
    def reason(self) -> str:
        return self.result.reason

    @property
    def chi2_per_dof(self) -> float:
        """1 if the residual is noise."""
        return self.result.chi2_per_dof

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the fit, one sentence each."""
        return self.result.warnings

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects of the model beyond Eqs. 1-2."""
        return tuple(effect.name for effect in self.result.free_parameters.layout.types if effect not in PAPER)

    @property
    def traces(self) -> tuple[str, ...]:
        """Files of the traces, fitted ones first."""
        return tuple(self._traces)

    @cached_property
    def _traces(self) -> dict[str, FittedTrace]:
        return traces_of(self.result)

    def trace(self, file: str) -> FittedTrace:
        """One trace and its simulation.

        Raises:
            UsageError: there is no such trace.
        """
        return named(self._traces, file)

    @property
    def plot(self) -> FitPlots:
        """Pictures: `plot.trace(file)`, `plot.parameters()`, `plot.overview()`, `plot.test(name)`."""
        from .plots import FitPlots

        return FitPlots(self.result)

    def printed(self) -> RenderableType:
        return fit_table(self.result)

    def save(self, run: str | Path) -> Path:
        """Write the whole fit to a run folder; `etcfit.load` restores it bit for bit."""
        from ..run_folder.folder import RunFolder
        from .work import keep_fit

        keep_fit(RunFolder(run), self.result)
        return Path(run)

    def _card(self) -> Card:
        held_out, shown = sum(each.held_out for each in self._traces.values()), parameters_table(self._parameters, {})
        count = f"{len(self._traces) - held_out} traces fitted, {held_out} held out"
        lost = [row["symbol"] for row in shown.rows if row["status"] == LOST]
        known = "; ".join(f"{c['parameter']} {c['value']} ± {c['std. error']} {c['unit']}".replace(" ± -", "")
                          for c in shown.texts if c["95 % interval"] != "-")  # fmt: skip
        reason = textwrap.shorten(self.reason, 200, placeholder="...")
        lines = (
            f"converged: {reason}" if self.converged else "",
            f"not identifiable: {', '.join(lost)}" if lost else "",
            f"compromise: {self.result.compromise.why}" if self.result.compromise is not None else "",
            views.count_of(self.warnings),
            known,
        )
        return Card(
            self.result.rig.config,
            " + ".join(("fit of Eqs. 1-2", *self.effects)),
            (f"{count}; chi2/dof {short(self.chi2_per_dof, 4)}{_predicts(self.result)}",),
            (shown,),
            lines,
            {"Warnings": self.warnings},
            "" if self.converged else f"NOT CONVERGED: {reason}",
        )


def _predicts(result: FitResult) -> str:
    """Rms errors of the simulation, in sigma."""
    parts = {"fitted": result.score_fit, "held out": result.score_holdout}
    off = "".join(f"; {name} rms error {short(pooled(rows))} sigma" for name, rows in parts.items() if rows)
    said = motion_explained(result.score_fit, result.score_holdout, result.rig.measurements)
    return f"{off}. {said}" if said else off
