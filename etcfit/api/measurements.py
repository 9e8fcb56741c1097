"""Results about measurements without a fit, for a notebook: check, advice, next tests, logs from the car."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..car_log import record_next
from ..car_log.steps import Step
from ..car_log.study import verdict
from ..errors import UsageError
from ..reporting.car_log import compared_table, drive_table, foretold_table, logs_table
from ..reporting.check_table import advice_table, check_table, options_table, traces_table
from . import views
from .progress import Report, silent
from .views import Card, View, frame, indexed, with_nan

if TYPE_CHECKING:  # a check needs neither campaigns nor logs of a car
    import numpy as np
    import pandas as pd
    from rich.console import RenderableType

    from ..car_log import Study
    from ..experiment.advice import Advice
    from ..experiment.campaign import Campaign
    from ..experiment.check import CheckResult
    from ..reporting.car_log import Held
    from ..rig.base import RigConfig


@dataclass(frozen=True, eq=False, repr=False)
class Checked(View):
    """The contents of a measurement folder, and the parameters that it identifies: `etcfit.check(rig)`."""

    result: CheckResult

    @property
    def traces(self) -> pd.DataFrame:
        """Indexed by file: test, held_out, samples, duration (s), rate (Hz), gaps, channels."""
        keys = ("test", "held_out", "samples", "duration", "rate", "gaps", "channels")
        return frame(traces_table(self.result.traces).rows, "file", keys)

    @property
    def findings(self) -> pd.DataFrame:
        """Mistakes and habits of the rig itself, indexed by kind: test, file, channel ("" if no particular one), size,
        unit, chance, found, mend, and sure: such data are physically impossible, and `fit` refuses them.
        """
        rows = [
            {key: "" if each is None else each for key, each in asdict(f).items()} for f in self.result.rig.findings
        ]
        return frame(rows, "kind", ("test", "file", "channel", "size", "unit", "chance", "found", "mend", "sure"))

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """Symbols that these data cannot determine; () if nothing can be fitted, see `why_not`."""
        return () if self.result.identifiability is None else self.result.identifiability.lost

    @property
    def directions(self) -> tuple[str, ...]:
        """What these data cannot determine, or hardly, and which test would: one sentence each."""
        return self.result.directions

    @property
    def why_not(self) -> str:
        """Why nothing can be fitted, or ""."""
        return self.result.why_not

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the folder, one sentence each."""
        return self.result.warnings

    def printed(self) -> RenderableType:
        return check_table(self.result)

    def _card(self) -> Card:
        tests, findings = ", ".join(dict.fromkeys(t.test for t in self.result.traces)), self.result.rig.findings
        lost = f"not identifiable: {', '.join(self.not_identifiable) or 'none'}"
        return Card(
            self.result.rig.config,
            f"what {len(self.result.traces)} traces ({tests}) identify",
            () if self.why_not else (lost,),
            (traces_table(self.result.traces),),
            (views.count_of(self.warnings), *self.directions),
            {
                "Mistakes and habits of the rig": [str(f) for f in findings],
                "What these data cannot determine, or hardly": self.directions,
                "Warnings": [w for w in self.warnings if w not in map(str, findings)],
            },
            f"NOTHING CAN BE FITTED: {self.why_not}" if self.why_not else "",
        )


@dataclass(frozen=True, eq=False, repr=False)
class Advised(View):
    """The information of one more trace of each rig test: `etcfit.advise(rig)`."""

    advice: Advice

    @property
    def options(self) -> pd.DataFrame:
        """One further trace per row, best first, indexed by rig test: how it is made, again (it repeats an existing
        trace), mean (geometric, of the widths), separates (the pair of parameters that it separates best, or ""),
        remark (what was assumed)."""
        return frame(options_table(self.advice).rows, "test", ("how", "again", "mean", "separates", "remark"))

    @property
    def widths(self) -> pd.DataFrame:
        """Width of each parameter's interval after the further trace, over the present width; rows as in `options`."""
        every = self.advice.options
        columns = {
            symbol: with_nan(float(option.shrinks[k]) for option in every)
            for k, symbol in enumerate(self.advice.symbols)
        }
        return indexed(columns, [option.test for option in every], "test")

    @property
    def stderr(self) -> pd.Series:
        """Present relative standard errors by symbol; of the logarithm if the parameter is positive."""
        import pandas as pd

        return pd.Series(self.advice.sd, index=pd.Index(self.advice.symbols, name="symbol"), name="stderr")

    @property
    def not_judged(self) -> dict[str, str]:
        """Rig tests of which no trace can be simulated, with the reason."""
        return dict(self.advice.not_judged)

    def printed(self) -> RenderableType:
        return advice_table(self.advice)

    def save(self, run: str | Path) -> Path:
        """Write advice.json."""
        from ..run_folder.plan import save_advice

        save_advice(Path(run), self.advice)
        return Path(run)

    def _card(self) -> Card:
        lines = [f"{option.test}, {option.says}: {option.mean:.2f}" for option in self.advice.options]
        not_judged = [f"{test}: {why}." for test, why in self.advice.not_judged]
        return Card(
            self.advice.rig.config,
            "what one more trace would add",
            tables=(options_table(self.advice),),
            lines=("Best first, with the mean width of an interval after it:", *lines),
            lists={"Not judged": not_judged},
        )


@dataclass(frozen=True, eq=False, repr=False)
class Planned(View):
    """The next tests, as files to play: `etcfit.plan(fit)`."""

    campaign: Campaign

    @property
    def tests(self) -> pd.DataFrame:
        """In the order in which they are made, indexed by file: test, how, seconds, current (largest, A), temperature
        (of the winding, highest, degC), pause (s, after it), remark (what was assumed)."""
        from ..reporting.plan_sheet import tests_table

        keys = ("test", "how", "seconds", "current", "temperature", "pause", "remark")
        return frame(tests_table(self.campaign).rows, "file", keys)

    @property
    def stderr(self) -> pd.DataFrame:
        """Relative standard errors by symbol: now, expected (after all tests)."""
        columns = {"now": self.campaign.now, "expected": self.campaign.expected}
        return indexed(columns, list(self.campaign.symbols), "symbol")

    def printed(self) -> RenderableType:
        from ..reporting.plan_sheet import plan_table

        return plan_table(self.campaign)

    def save(self, plan: str | Path) -> Path:
        """Write plan.json, the files to play, the procedure sheet and the folder for the records, all or none.

        Args:
            plan: the folder; it must not exist, or be empty.
        Raises:
            UsageError: the folder is not empty.
        """
        from ..datasets.base import whole_folder, write_files
        from ..files import write_json
        from ..reporting.plan_sheet import write_sheet
        from ..run_folder.plan import PLAN, play_files, waiting_folder

        to = Path(plan)
        with whole_folder(to) as draft:
            write_files(draft, play_files(self.campaign) | waiting_folder(self.campaign))
            write_json(draft / "plan.json", "plan", PLAN.json(self.campaign))
            write_sheet(draft, self.campaign)
        return to

    def _card(self) -> Card:
        from ..reporting.plan_sheet import tests_table

        lines = [f"{test.file}: {test.candidate.plan.says}" for test in self.campaign.tests]
        return Card(self.campaign.rig.config, "the next tests", tables=(tests_table(self.campaign),), lines=lines)


@dataclass(frozen=True, eq=False, repr=False)
class Driven(View):
    """Operating range, spectrum, tracking and verdict of logs from the car: `etcfit.drive(folder)`.

    Args:
        config: configuration of the rig, or its substitute if there is no rig.toml with the logs.
        foretold: the log compared with the prediction of `etcfit tune`: `says`, `found.as_foretold`,
            `found.figures`; None if this was not requested.
        compared: whether the two logs are compared, before and after.
    """

    config: RigConfig
    studies: tuple[Study, ...]
    foretold: Held | None = None
    compared: bool = False

    @property
    def table(self) -> pd.DataFrame:
        """Indexed by log: seconds, share_between (of the time, 0 to 1), dominant_hz, half_hz, rmse_pct, rmse_stderr,
        lag_s, lag_stderr, demand_pct_s; NaN if the log does not determine a figure.
        """
        keys = ("seconds", "share_between", "dominant_hz", "half_hz", "rmse_pct", "rmse_stderr", "lag_s", "lag_stderr",
                "demand_pct_s")  # fmt: skip
        return frame(logs_table(self.studies).rows, "log", keys)

    @cached_property
    def verdict(self) -> str:
        """What changed from the first log to the second; "" if there is only one."""
        return verdict(*self.studies) if len(self.studies) == 2 else ""

    @property
    def good_enough(self) -> dict[str, str]:
        """For each log, whether the control is good enough, and why not."""
        return {each.log.name: each.verdict.says for each in self.studies}

    @property
    def judgements(self) -> pd.DataFrame:
        """One row per threshold, indexed by log and name: value, limit, unit, word ("good", "not good", "cannot be
        said"), where, source (of the threshold), at_least.
        """
        import pandas as pd

        rows = [{"log": s.log.name} | asdict(j) for s in self.studies for j in s.verdict.judgements]
        return pd.DataFrame(rows).set_index(["log", "name"])

    @property
    def steps(self) -> pd.DataFrame:
        """Every step of the setpoint, indexed by log: begin, held (s), before, after, overshoot (% of the step),
        settling, lag (s), error, rms, band (% of travel); see `car_log.steps.Step`.
        """
        import pandas as pd

        rows = [{"log": s.log.name} | asdict(step) for s in self.studies for step in s.steps]
        names = ["log", *(field.name for field in fields(Step))]
        return pd.DataFrame(rows, columns=names).set_index("log")

    @property
    def sensors(self) -> pd.DataFrame:
        """Settings of an ECU for both sensors, indexed by log: ecu, name, value, unit."""
        import pandas as pd

        pairs = [(s.log.name, s.sensors) for s in self.studies if s.sensors is not None]
        rows = [{"log": name} | asdict(setting) for name, pair in pairs for setting in pair.table]
        return pd.DataFrame(rows, columns=["log", "ecu", "name", "value", "unit"]).set_index("log")

    @property
    def record_next(self) -> pd.DataFrame:
        """What to record next, indexed by the missing moves: found, needed, unit, record (what to do), why."""
        import pandas as pd

        every = record_next([study.log for study in self.studies])
        return pd.DataFrame([asdict(lack) for lack in every]).set_index("name")

    def plot(self, name: str) -> np.ndarray:
        """Operating range, spectrum and the busiest seconds of one log; Axes, shape (3,).

        Args:
            name: name of the log, as in `table`.
        Raises:
            UsageError: there is no such log.
        """
        from ..reporting.car_log.writing import draw
        from .plots import panels_of

        known = {study.log.name: study for study in self.studies}
        if name not in known:
            raise UsageError(f"no log is called {name!r}. There are: {', '.join(known)}.")
        return panels_of(lambda: draw(known[name], self.config.synthetic))

    def printed(self) -> RenderableType:
        if self.foretold is not None:
            return foretold_table(self.foretold)
        if self.compared:
            return compared_table(self.config, *self.studies)
        return drive_table(self.config, self.studies)

    def save(self, run: str | Path, report: Report = silent) -> Path:
        """Write drive.json, drive.html and the pictures of the logs to a folder."""
        from ..reporting.car_log.writing import write_drive

        write_drive(Path(run), self.config, self.studies, report, self.foretold)
        return Path(run)

    def _card(self) -> Card:
        table = logs_table(self.studies)
        lines = [f"{c['log']}: {c['length']}, RMSE {c['RMSE %']} %, lag {c['lag ms']} ms. {c['verdict']}"
                 for c in table.texts]  # fmt: skip
        return Card(self.config, "logs from the car", (self.verdict,), (table,), lines)
