"""A transfer function and PID gains as a notebook holds them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..control.design import Design
from ..control.frequency import FrequencyResponse
from ..control.linearise import SYMBOLS, UNITS, Reduction
from ..control.loop_figures import FIGURES, TRACKING
from ..control.pid import Gains
from ..control.safety import Safety
from ..model.feed_forward import as_asked
from ..reporting.control.sentence import doubt
from ..reporting.control.verdicts import answer
from ..reporting.numbers import Digits, short
from . import views
from .fit import Fit
from .fleet import Fleet
from .views import indexed, numbers

if TYPE_CHECKING:
    import control

    from .plots import DesignPlots, ReductionPlots

_NAMES = ("b0", "a2", "a1", "a0")


@dataclass(frozen=True, eq=False, repr=False)
class Reduced:
    """The linear plant about an operating point: `etcfit.reduce(fit)`.

        G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0)

    Args:
        fit: the model.
        reduction: of it.
        response: what the rig's sine traces say; None where it has none.
    """

    fit: Fit
    reduction: Reduction
    response: FrequencyResponse | None = None

    @property
    def transfer_function(self) -> control.TransferFunction:
        """For python-control, without delay and sensor lag; see `to_control`."""
        return self.reduction.to_control()

    def to_control(self, pade_order: int = 0) -> control.TransferFunction:
        """For python-control; with delay and sensor lag where the order of a Pade approximation is given."""
        return self.reduction.to_control(pade_order)

    @property
    def coefficients(self) -> pd.DataFrame:
        """b0, a2, a1, a0: value and stderr."""
        plant = self.reduction.plant
        values = np.array([*plant.num, *plant.den[1:]], dtype=float)
        return indexed({"value": values, "stderr": np.array(self.reduction.stderr, dtype=float)}, _NAMES, "coefficient")

    @property
    def feedforward(self) -> pd.DataFrame:
        """kS, kV and kA of v = kS sgn(w) + kV w + kA dw/dt: value, stderr and unit."""
        found = self.reduction.constants
        assert found is not None, "`etcfit.reduce` asks for them"
        columns = {"value": found.values, "stderr": found.stderr, "unit": np.array(UNITS)}
        return indexed(columns, SYMBOLS, "constant")

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
        """Of the gain: output over input."""
        return f"{self.reduction.output_unit}/{self.reduction.input_unit}"

    @property
    def plot(self) -> ReductionPlots:
        """Pictures: `plot.bode()`, `plot.sines()`."""
        from .plots import ReductionPlots

        return ReductionPlots(self.fit.result.fitted(), self.reduction, self.response)

    def summary(self, width: int = 140) -> str:
        """What `etcfit reduce` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.control.tables import reduction_table, sine_table

        text = render(reduction_table(self.fit.result.fitted(), self.reduction, 0), width)
        return text if self.response is None else text + render(sine_table(self.response), width)

    def save(self, run: str | Path, pade_order: int = 0) -> Path:
        """Write transfer_function.json and the Bode plot to a run folder, and what the sine traces say.

        Args:
            run: made if absent.
            pade_order: of the delay in `with_delay_and_lag` of the file; 0 leaves that out.
        Raises:
            UsageError: another model lies in RUN.
        """
        from ..run_folder.folder import RunFolder
        from .work import keep_reduction

        folder = RunFolder(run)
        folder.refuse_other_model(self.fit.result)
        keep_reduction(folder, self.fit.result, self.reduction, self.response, pade_order)
        return Path(run)

    @property
    def _where(self) -> str:
        gain = f"static gain {short(self.reduction.plant.dc_gain, 4)} {self.unit}"
        return f"about {100.0 * self.reduction.share:.0f} % of the travel; {gain}"

    @property
    def _poles(self) -> str:
        return "poles, 1/s: " + ", ".join(_pole(complex(pole)) for pole in self.poles)

    def _rows(self) -> list[tuple[str, str, str]]:
        """Coefficient, value and standard error."""
        plant = self.reduction.plant
        every = zip(_NAMES, (*plant.num, *plant.den[1:]), self.reduction.stderr.tolist(), strict=True)
        return [(name, Digits.of(value, spread)(value), Digits.of(value, spread)(spread))
                for name, value, spread in every]  # fmt: skip

    def __repr__(self) -> str:
        return views.block(
            f"Transfer function of {views.name_of(self.fit.result.rig.config)}: "
            f"b0 / (s^3 + a2 s^2 + a1 s + a0), {self.unit}",
            self._alarm,
            ", ".join(f"{name} {value} ± {spread}" for name, value, spread in self._rows()),
            self._where,
            self._poles,
        )

    @property
    def _alarm(self) -> str:
        return " ".join(self.fit.result.state.cautions)

    def _repr_html_(self) -> str:
        return views.card(
            self.fit.result.rig.config,
            f"b0 / (s³ + a2 s² + a1 s + a0), {self.unit}",
            views.table(("", "value", "std. error"), self._rows()),
            views.paragraph(self._where),
            views.paragraph(self._poles),
            alarm=self._alarm,
        )


def _pole(pole: complex) -> str:
    """ "-81" or "-16.3 + 5.2j"."""
    if not pole.imag:
        return short(pole.real, 4)
    return f"{short(pole.real, 4)} {'+' if pole.imag > 0.0 else '-'} {short(abs(pole.imag), 4)}j"


_RULES_HEAD = (
    "rule",
    *Gains._fields,
    *(f"{FIGURES[k].heading} {FIGURES[k].unit}" for k in TRACKING),
    "meets all",
    "P(met)",
)


@dataclass(frozen=True, eq=False, repr=False)
class Designed:
    """Gains for a rig, or for a fleet: `etcfit.design(fit)`.

    Args:
        fit: the model, or the fleet.
        design: in full.
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
        """Whose gains are proposed."""
        return self.design.chosen.rule

    @property
    def meets_all(self) -> bool:
        """Whether the nominal nonlinear model meets every requirement with them."""
        return self.design.chosen.meets_all

    @property
    def rules(self) -> pd.DataFrame:
        """Every rule, indexed by name: its gains, figures of the nonlinear model, whether it meets every requirement
        (`met`), the share of the draws that do (`probability_met`), and why a rule that refused has none (`why`).

        `settling_s` is infinite where the response does not settle. NaN where a rule refused.
        """
        every = self.design.tuned.values()
        gains = {k: numbers(None if t.gains is None else float(getattr(t.gains, k)) for t in every)
                 for k in Gains._fields}  # fmt: skip
        figures = {k: numbers(None if t.nonlinear is None else float(getattr(t.nonlinear, k)) for t in every)
                   for k in FIGURES}  # fmt: skip
        verdict = {
            "met": np.array([t.meets_all for t in every], dtype=bool),
            "probability_met": numbers(t.probability_met for t in every),
            "why": pd.Series([t.why for t in every], dtype="str"),
        }
        return indexed(gains | figures | verdict, list(self.design.tuned), "rule")

    @property
    def scenarios(self) -> pd.DataFrame:
        """The proposed gains on each scenario of the nominal nonlinear model, indexed by its name."""
        each = self.design.chosen.scenarios
        columns = {k: numbers(float(getattr(figures, k)) for figures in each.values()) for k in TRACKING}
        return indexed(columns, list(each), "scenario")

    @property
    def front(self) -> pd.DataFrame:
        """Tracking against effort on the nominal model: the best gains within each limit of the duty's activity."""
        points = self.design.front
        gains = {k: numbers(float(getattr(point.gains, k)) for point in points) for k in Gains._fields}
        figures = {"duty_activity_pct": numbers(point.activity for point in points),
                   "rmse_pct": numbers(point.rmse for point in points),
                   "met": np.array([point.meets for point in points], dtype=bool)}  # fmt: skip
        return pd.DataFrame(gains | figures)

    @property
    def safety(self) -> Safety:
        """What the proposed gains do where something fails: jam check, sensor, supply, spring return, holding."""
        return self.design.safety

    @property
    def limits(self) -> tuple[str, ...]:
        """Where the proposed gains miss a requirement, what keeps any gains from meeting it."""
        return self.design.limits

    @property
    def plot(self) -> DesignPlots:
        """Pictures: `plot.responses()`, `plot.scenarios()`, `plot.front()`, `plot.safety()`."""
        from .plots import DesignPlots

        return DesignPlots(self.design)

    def summary(self, width: int = 140) -> str:
        """What `etcfit design` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.control.tables import design_table

        return render(design_table(self.design), width)

    def save(self, run: str | Path) -> Path:
        """Write pid.json and the responses to a run folder.

        Args:
            run: made if absent.
        Raises:
            UsageError: another model, or another fleet, lies in RUN.
        """
        self.fit.keep_design(Path(run), self.design, self._options)
        return Path(run)

    @property
    def _options(self) -> dict[str, Any]:
        """With what `etcfit run` would make these gains anew."""
        task = self.design.task
        return {
            "rule": self.rule,
            "feed_forward": as_asked(task.terms),
            "limits": task.requirements.finite(),
            "ecu": task.ecu._asdict(),
            "profile": None if task.profile is None else task.profile.name,
            "log": self.log,
            "parts": None if self.design.parts is None else self.design.parts.where,
            "anyway": self.design.anyway,
        }

    @property
    def _verdict(self) -> str:
        """What is proposed and whether it does what is required; what binds where it does not."""
        binds = f" What binds: {'; '.join(self.limits)}." if self.limits else ""
        return answer(self.design) + binds

    def __repr__(self) -> str:
        met = [name for name, t in self.design.tuned.items() if t.meets_all]
        on_the_model = f"every requirement is met on the nominal model by: {', '.join(met) or 'none'}; see .rules"
        return views.block(
            f"PID gains of {views.name_of(self.design.fitted.config)}: {len(self.design.tuned)} rules tried",
            self._verdict,
            "see .rules" if self._doubt else on_the_model,
        )

    def _repr_html_(self) -> str:
        rows = [_row(each, self._doubt) for each in self.rules.reset_index().to_dict("records")]
        alarm, said = (self._verdict, "") if self._doubt else ("", self._verdict)
        return views.card(
            self.design.fitted.config, "PID gains", views.paragraph(said), views.table(_RULES_HEAD, rows), alarm=alarm
        )

    @property
    def _doubt(self) -> str:
        return doubt(self.design.fitted.state)


def _row(r: dict[Hashable, Any], doubted: str) -> tuple[str, ...]:
    if r["why"]:
        return (r["rule"], *["-"] * 7, r["why"], "-")
    keys = (*Gains._fields, *TRACKING)
    figures = (short(r[key]) for key in keys)
    verdict = (doubted, "-") if doubted else ("yes" if r["met"] else "no", short(r["probability_met"], 2))
    return (r["rule"], *figures, *verdict)
