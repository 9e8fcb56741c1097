"""A transfer function and PID gains for a notebook."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import Reduction
from ..control.loop_figures import FIGURES, TRACKING
from ..control.pid import Gains
from ..control.safety import Safety
from ..files import plain
from ..model.feed_forward import as_recorded
from ..reporting.blocks import stacked
from ..reporting.control.gains import (
    GAINS,
    design_table,
    figures_table,
    refused,
    rule_rows,
    rules_table,
    scenario_table,
)
from ..reporting.control.plant import coefficients_table, constants_table, plant_tables, reduction_table, sine_table
from ..reporting.control.sentence import doubt, sentence
from ..run_folder.pid import PID
from ..run_folder.plant import reduction_json
from . import views
from .fit import Fit
from .fleet import Fleet
from .views import View, frame

if TYPE_CHECKING:
    from rich.console import RenderableType

    import control

    from .plots import DesignPlots, ReductionPlots


@dataclass(frozen=True, eq=False, repr=False)
class Reduced(View):
    """The linear plant about an operating point: `etcfit.reduce(fit)`.

        G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0)

    Args:
        response: frequency response measured by the rig's sine traces; None if it has none.
    """

    fit: Fit
    reduction: Reduction
    response: FrequencyResponse | None = None

    @property
    def transfer_function(self) -> control.TransferFunction:
        """For python-control, without delay and sensor lag; see `to_control`."""
        return self.reduction.to_control()

    def to_control(self, pade_order: int = 0) -> control.TransferFunction:
        """For python-control; with delay and sensor lag if the order of a Pade approximation is given."""
        return self.reduction.to_control(pade_order)

    @cached_property
    def _plant(self) -> dict[str, Any]:
        return reduction_json(self.fit.result.fitted(), self.reduction, 0)

    @property
    def coefficients(self) -> pd.DataFrame:
        """b0, a2, a1, a0: value and stderr."""
        return frame(coefficients_table(self._plant).rows, "coefficient")

    @property
    def feedforward(self) -> pd.DataFrame:
        """kS, kV and kA of v = kS sgn(w) + kV w + kA dw/dt: value, stderr and unit."""
        found = constants_table(self._plant)
        assert found is not None, "`etcfit.reduce` requests them"
        return frame(found.rows, "constant")

    @property
    def stderr(self) -> pd.Series:
        """Standard errors of b0, a2, a1, a0."""
        return pd.Series(self.coefficients["stderr"])

    @property
    def poles(self) -> Any:
        """Slowest first, 1/s, complex, shape (3,)."""
        return self.reduction.plant.poles

    @property
    def unit(self) -> str:
        """Unit of the gain: output over input."""
        return f"{self.reduction.output_unit}/{self.reduction.input_unit}"

    @property
    def plot(self) -> ReductionPlots:
        """Pictures: `plot.bode()`, `plot.sines()`."""
        from .plots import ReductionPlots

        return ReductionPlots(self.fit.result.fitted(), self.reduction, self.response)

    def _printed(self) -> RenderableType:
        fitted = self.fit.result.fitted()
        sines = None if self.response is None else sine_table(fitted, self.response)
        return stacked(reduction_table(fitted, self.reduction, 0), sines)

    def save(self, run: str | Path, pade_order: int = 0) -> Path:
        """Write transfer_function.json, the Bode plot and the measured frequency response to a run folder.

        Args:
            pade_order: Pade order of the delay in `with_delay_and_lag` of the file; 0 leaves that out.
        Raises:
            UsageError: RUN holds another model.
        """
        from ..run_folder.folder import RunFolder
        from .work import keep_reduction

        folder = RunFolder(run)
        folder.refuse_other_model(self.fit.result)
        keep_reduction(folder, self.fit.result, self.reduction, self.response, pade_order)
        return Path(run)

    def __repr__(self) -> str:
        shown = coefficients_table(self._plant)
        formula, *words = shown.notes
        return views.block(
            f"Transfer function of {views.name_of(self.fit.result.rig.config)}: {formula}, {self.unit}",
            self._alarm,
            ", ".join(f"{name.text} {value.text} ± {spread.text}" for name, value, spread in shown.cells),
            *words,
        )

    @property
    def _alarm(self) -> str:
        return " ".join(self.fit.result.state.cautions)

    def _repr_html_(self) -> str:
        parts = map(views.table, plant_tables(self._plant))
        return views.card(self.fit.result.rig.config, f"transfer function, {self.unit}", *parts, alarm=self._alarm)


@dataclass(frozen=True, eq=False, repr=False)
class Designed(View):
    """Gains for a rig, or for a fleet: `etcfit.design(fit)`.

    Args:
        fit: the model, or the fleet.
        log: file of the log among the scenarios, or None.
    """

    fit: Fit | Fleet
    design: Design
    log: str | None = None

    @property
    def gains(self) -> Gains:
        """The proposed gains, Kp (V/rad), Ki (V/(rad s)), Kd (V s/rad)."""
        gains = self.design.chosen.gains
        assert gains is not None, "the proposed rule has gains"
        return gains

    @property
    def rule(self) -> str:
        """The rule whose gains are proposed."""
        return self.design.chosen.rule

    @property
    def meets_all(self) -> bool:
        """Whether the nominal nonlinear model meets every requirement with the proposed gains."""
        return self.design.chosen.meets_all

    @cached_property
    def _written(self) -> dict[str, Any]:
        """The object of pid.json, infinities kept."""
        return PID.written(self.design)

    @property
    def rules(self) -> pd.DataFrame:
        """Every rule, indexed by name: its gains, figures of the nonlinear model, whether it meets every requirement
        (`met`), the share of the draws that do (`probability_met`), and why a rule that refused has none (`why`).

        `settling_s` is infinite where the response does not settle. NaN where a rule refused.
        """
        return frame(rule_rows(self._written), "rule", (*GAINS, *FIGURES, "met", "probability_met", "why"))

    @property
    def scenarios(self) -> pd.DataFrame:
        """The proposed gains on each scenario of the nominal nonlinear model, indexed by its name."""
        return frame(scenario_table(self._written).rows, "scenario", TRACKING)

    @property
    def front(self) -> pd.DataFrame:
        """Tracking against effort on the nominal model: the best gains within each limit of the duty's activity."""
        rows = [point | point["gains"] for point in self._written["front"]]
        return frame(rows, None, (*GAINS, "duty_activity_pct", "rmse_pct", "met"))

    @property
    def safety(self) -> Safety:
        """The loop with the proposed gains under failures: jam check, sensor, supply, spring return, holding."""
        return self.design.safety

    @property
    def limits(self) -> tuple[str, ...]:
        """For each requirement that the proposed gains miss, what prevents any gains from meeting it."""
        return self.design.limits

    @property
    def plot(self) -> DesignPlots:
        """Pictures: `plot.responses()`, `plot.scenarios()`, `plot.front()`, `plot.safety()`."""
        from .plots import DesignPlots

        return DesignPlots(self.design)

    def _printed(self) -> RenderableType:
        return design_table(self.design)

    def save(self, run: str | Path) -> Path:
        """Write pid.json and the responses to a run folder.

        Raises:
            UsageError: RUN holds another model, or another fleet.
        """
        self.fit.keep_design(Path(run), self.design, self._options)
        return Path(run)

    @property
    def _options(self) -> dict[str, Any]:
        """The options with which `etcfit run` would design these gains again."""
        task = self.design.task
        return {
            "rule": self.rule,
            "feed_forward": as_recorded(task.terms),
            "limits": task.requirements.finite(),
            "ecu": task.ecu._asdict(),
            "profile": None if task.profile is None else task.profile.name,
            "log": self.log,
            "parts": None if self.design.parts is None else self.design.parts.where,
            "anyway": self.design.anyway,
        }

    @property
    def _verdict(self) -> str:
        """The proposed gains, whether they meet the requirements, and which limits bind if they do not."""
        binds = f" What binds: {'; '.join(self.limits)}." if self.limits else ""
        return sentence(plain(self._written)) + binds

    def __repr__(self) -> str:
        met = [name for name, t in self.design.tuned.items() if t.meets_all]
        on_the_model = f"every requirement is met on the nominal model by: {', '.join(met) or 'none'}; see .rules"
        return views.block(
            f"PID gains of {views.name_of(self.design.fitted.config)}: {len(self.design.tuned)} rules tried",
            self._verdict,
            "see .rules" if self._doubt else on_the_model,
        )

    def _repr_html_(self) -> str:
        alarm, said = (self._verdict, "") if self._doubt else ("", self._verdict)
        tables = (rules_table(self._written), figures_table(self._written))
        return views.card(self.design.fitted.config, "PID gains", views.paragraph(said), *map(views.table, tables),
                          views.folded("No gains", refused(self._written).texts), alarm=alarm)  # fmt: skip

    @property
    def _doubt(self) -> str:
        return doubt(self.design.fitted.state)
