"""PID gains as a notebook holds them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..control.design import Design
from ..control.pid import Gains
from ..control.pid.figures import FIGURES, TRACKING
from ..control.safety import Safety
from ..model.feed_forward import as_asked
from ..reporting.control.sentence import doubt
from ..reporting.control.verdicts import answer
from ..reporting.numbers import short
from . import words
from .fit import Fit
from .fleet import Fleet
from .frames import indexed, numbers

if TYPE_CHECKING:
    from .plots import DesignPlots

_HEAD = ("rule", *Gains._fields, *(f"{FIGURES[k].heading} {FIGURES[k].unit}" for k in TRACKING), "meets all", "P(met)")


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
        return words.block(
            f"PID gains of {words.name_of(self.design.fitted.config)}: {len(self.design.tuned)} rules tried",
            self._verdict,
            "see .rules" if self._doubt else on_the_model,
        )

    def _repr_html_(self) -> str:
        rows = [_row(each, self._doubt) for each in self.rules.reset_index().to_dict("records")]
        alarm, said = (self._verdict, "") if self._doubt else ("", self._verdict)
        return words.card(
            self.design.fitted.config, "PID gains", words.paragraph(said), words.table(_HEAD, rows), alarm=alarm
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
