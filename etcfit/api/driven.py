"""Logs from the car as a notebook holds them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from functools import cached_property

import numpy as np
import pandas as pd

from ..car_log import Study, record_next
from ..car_log.steps import Step
from ..car_log.study import verdict
from ..errors import UsageError
from ..reporting.numbers import short
from ..rig.base import RigConfig
from . import words
from .frames import indexed, numbers

_HEAD = ("log", "seconds", "share between", "dominant Hz", "RMSE %", "lag ms", "verdict")


@dataclass(frozen=True, eq=False, repr=False)
class Driven:
    """Operating range, spectrum, tracking and verdict of logs from the car: `etcfit.drive(folder)`.

    Args:
        config: of the rig, or what stands for it where no rig.toml lies beside the logs.
        studies: a log each.
    """

    config: RigConfig
    studies: tuple[Study, ...]

    @property
    def table(self) -> pd.DataFrame:
        """Indexed by log: seconds, share_between (of the time, 0 to 1), dominant_hz, half_hz, rmse_pct, rmse_stderr,
        lag_s, lag_stderr, demand_pct_s; NaN where a log does not tell.
        """
        every = self.studies
        columns = {
            "seconds": numbers(float(np.ptp(s.log.position.time)) for s in every),
            "share_between": numbers(s.usage.between for s in every),
            "dominant_hz": numbers(None if s.spectrum is None else s.spectrum.dominant for s in every),
            "half_hz": numbers(None if s.spectrum is None else s.spectrum.half for s in every),
            "rmse_pct": numbers(None if s.tracking is None else s.tracking.rmse for s in every),
            "rmse_stderr": numbers(None if s.tracking is None else s.tracking.stderr for s in every),
            "lag_s": numbers(None if s.tracking is None else s.tracking.lag for s in every),
            "lag_stderr": numbers(None if s.tracking is None else s.tracking.lag_stderr for s in every),
            "demand_pct_s": numbers(None if s.tracking is None else s.tracking.demand for s in every),
        }
        return indexed(columns, [s.log.name for s in every], "log")

    @cached_property
    def verdict(self) -> str:
        """What changed from the first log to the second, where there are two; else ""."""
        return verdict(*self.studies) if len(self.studies) == 2 else ""

    @property
    def good_enough(self) -> dict[str, str]:
        """For each log whether it is good enough, and why not."""
        return {each.log.name: each.verdict.says for each in self.studies}

    @property
    def judgements(self) -> pd.DataFrame:
        """A row a threshold, indexed by log and name: value, limit, unit, word ("good", "not good", "cannot be said"),
        where, source (of the threshold), at_least.
        """
        rows = [{"log": s.log.name} | asdict(j) for s in self.studies for j in s.verdict.judgements]
        return pd.DataFrame(rows).set_index(["log", "name"])

    @property
    def steps(self) -> pd.DataFrame:
        """Every step of the setpoint, indexed by log: begin, held (s), before, after, overshoot (% of the step),
        settling, lag (s), error, rms, band (% of travel); see `car_log.steps.Step`.
        """
        rows = [{"log": s.log.name} | asdict(step) for s in self.studies for step in s.steps]
        names = ["log", *(field.name for field in fields(Step))]
        return pd.DataFrame(rows, columns=names).set_index("log")

    @property
    def sensors(self) -> pd.DataFrame:
        """What to type into an ECU for both sensors, indexed by log: ecu, name, value, unit."""
        pairs = [(s.log.name, s.sensors) for s in self.studies if s.sensors is not None]
        rows = [{"log": name} | asdict(setting) for name, pair in pairs for setting in pair.table]
        return pd.DataFrame(rows, columns=["log", "ecu", "name", "value", "unit"]).set_index("log")

    @property
    def record_next(self) -> pd.DataFrame:
        """What to record next, indexed by the moves that lack: found, needed, unit, record (what to do), why."""
        every = record_next([study.log for study in self.studies])
        return pd.DataFrame([asdict(lack) for lack in every]).set_index("name")

    def plot(self, name: str) -> np.ndarray:
        """Operating range, spectrum and the busiest seconds of one log; Axes, shape (3,).

        Args:
            name: of the log, as in `table`.
        Raises:
            UsageError: there is no such log.
        """
        from .plots import log_panels

        known = {study.log.name: study for study in self.studies}
        if name not in known:
            raise UsageError(f"no log is called {name!r}. There are: {', '.join(known)}.")
        return log_panels(self.config, known[name])

    def summary(self, width: int = 140) -> str:
        """What `etcfit drive` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.car_log import drive_table

        return render(drive_table(self.config, self.studies), width)

    def __repr__(self) -> str:
        lines = [f"{r[0]}: {r[1]} s, RMSE {r[4]} %, lag {r[5]} ms. {r[6]}" for r in self._rows()]
        return words.block(f"Logs from the car, {words.name_of(self.config)}", self.verdict, *lines)

    def _rows(self) -> list[tuple[str, ...]]:
        from ..reporting.car_log.tables import in_a_word

        words_of = {each.log.name: in_a_word(each.verdict) for each in self.studies}
        return [(r["log"], f"{r['seconds']:.0f}", short(r["share_between"]), short(r["dominant_hz"]),
                 short(r["rmse_pct"]), short(1e3 * r["lag_s"]), words_of[r["log"]])
                for r in self.table.reset_index().to_dict("records")]  # fmt: skip

    def _repr_html_(self) -> str:
        return words.card(
            self.config, "logs from the car", words.table(_HEAD, self._rows()), words.paragraph(self.verdict)
        )
