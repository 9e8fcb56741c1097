"""A transfer function and PID gains for a notebook."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import Reduction
from ..control.loop_figures import FIGURES, TRACKING
from ..control.pid import Gains
from ..control.request import DesignRequest
from ..control.safety import Safety
from ..files import plain
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
from ..run_folder.folder import RunFolder
from ..run_folder.pid import PID
from ..run_folder.plant import reduction_json
from .fit import Fit
from .progress import Report, silent
from .views import Card, View, frame

if TYPE_CHECKING:
    from rich.console import RenderableType

    import control

    from .fleet import Fleet
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

    def printed(self, pade_order: int = 0) -> RenderableType:
        fitted = self.fit.result.fitted()
        sines = None if self.response is None else sine_table(fitted, self.response)
        return stacked(reduction_table(fitted, self.reduction, pade_order), sines)

    def save(self, run: str | Path | RunFolder, pade_order: int = 0, report: Report = silent) -> Path:
        """Write transfer_function.json, the Bode plot and the measured frequency response to a run folder.

        Args:
            pade_order: Pade order of the delay in `with_delay_and_lag` of the file; 0 leaves that out.
        Raises:
            UsageError: RUN holds another model.
        """
        from .work import keep_reduction

        folder = RunFolder.named(run)
        folder.refuse_other_model(self.fit.result)
        keep_reduction(folder, self.fit.result, self.reduction, self.response, pade_order, report)
        return folder.path

    def _card(self) -> Card:
        result, shown = self.fit.result, coefficients_table(self._plant)
        formula, *words = shown.notes
        known = ", ".join(f"{name.text} {value.text} ± {spread.text}" for name, value, spread in shown.cells)
        return Card(result.rig.config, f"transfer function, {self.unit}", tables=plant_tables(self._plant),
                    lines=(formula, known, *words), alarm=" ".join(result.state.cautions))  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Designed(View):
    """Gains for a rig, or for a fleet: `etcfit.design(fit)`.

    Args:
        fit: the model, or the fleet.
        request: rule, ECU and limits for which the gains were designed.
    """

    fit: Fit | Fleet
    design: Design
    request: DesignRequest = field(default_factory=DesignRequest)

    @property
    def gains(self) -> Gains:
        """The proposed gains, Kp (V/rad), Ki (V/(rad s)), Kd (V s/rad)."""
        return self.design.proposed

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

    def printed(self) -> RenderableType:
        return design_table(self.design)

    def save(self, run: str | Path | RunFolder, report: Report = silent) -> Path:
        """Write pid.json and the responses to a run folder.

        Raises:
            UsageError: RUN holds another model, or another fleet.
        """
        return self.fit.keep_design(RunFolder.named(run), self.design, self.request.recorded(), report)

    @property
    def _verdict(self) -> str:
        """The proposed gains, whether they meet the requirements, and which limits bind if they do not."""
        binds = f" What binds: {'; '.join(self.limits)}." if self.limits else ""
        return sentence(plain(self._written)) + binds

    def _card(self) -> Card:
        met = [name for name, t in self.design.tuned.items() if t.meets_all]
        on_the_model = f"every requirement is met on the nominal model by: {', '.join(met) or 'none'}; see .rules"
        doubted = doubt(self.design.fitted.state)
        return Card(
            self.design.fitted.config,
            f"PID gains, {len(self.design.tuned)} rules tried",
            () if doubted else (self._verdict,),
            (rules_table(self._written), figures_table(self._written)),
            ("see .rules" if doubted else on_the_model,),
            {"No gains": refused(self._written).texts},
            self._verdict if doubted else "",
        )
