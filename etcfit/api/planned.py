"""The next tests as a notebook holds them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from ..experiment.campaign import Campaign
from . import words
from .frames import indexed, numbers
from .frames import words as texts


@dataclass(frozen=True, eq=False, repr=False)
class Planned:
    """The next tests, as files to play: `etcfit.plan(fit)`.

    Args:
        campaign: in full.
    """

    campaign: Campaign

    @property
    def tests(self) -> pd.DataFrame:
        """In the order in which they are made, indexed by file: test, how, seconds, current (largest, A), temperature
        (of the winding, highest, degC), pause (s, after it), remark (what was assumed)."""
        every, ambient = self.campaign.tests, self.campaign.settings.ambient
        columns = {
            "test": texts(t.candidate.plan.test for t in every),
            "how": texts(t.candidate.plan.says for t in every),
            "seconds": numbers(t.candidate.seconds for t in every),
            "current": numbers(float(np.abs(t.forecast.shown.get("current", np.zeros(1))).max()) for t in every),
            "temperature": numbers(ambient + float(t.forecast.warmth.max()) for t in every),
            "pause": numbers(t.pause for t in every),
            "remark": texts(self.campaign.remark(t) for t in every),
        }
        return indexed(columns, [t.file for t in every], "file")

    @property
    def stderr(self) -> pd.DataFrame:
        """Relative standard errors by symbol: now, expected (after all tests)."""
        columns = {"now": self.campaign.now, "expected": self.campaign.expected}
        return indexed(columns, list(self.campaign.symbols), "symbol")

    def summary(self, width: int = 140) -> str:
        """What `etcfit plan` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.plan_sheet import plan_table

        return render(plan_table(self.campaign), width)

    def save(self, plan: str | Path) -> Path:
        """Write plan.json, the files to play, the procedure sheet and the folder for the records, whole or not at all.

        Args:
            plan: the folder; must not exist, or be empty.
        Raises:
            UsageError: it holds something already.
        """
        from ..datasets.folder import whole_folder, write_files
        from ..files import write_json
        from ..reporting.plan_sheet import write_sheet
        from ..run_folder import plan_json, play_files, waiting_folder

        to = Path(plan)
        with whole_folder(to) as draft:
            write_files(draft, play_files(self.campaign) | waiting_folder(self.campaign))
            write_json(draft / "plan.json", "plan", plan_json(self.campaign))
            write_sheet(draft, self.campaign)
        return to

    def _rows(self) -> list[tuple[str, str]]:
        return [(test.file, test.candidate.plan.says) for test in self.campaign.tests]

    def __repr__(self) -> str:
        name = words.name_of(self.campaign.rig.config)
        return words.block(f"The next tests for {name}", *(f"{file}: {how}" for file, how in self._rows()))

    def _repr_html_(self) -> str:
        return words.card(self.campaign.rig.config, "the next tests", words.table(("record as", "how"), self._rows()))
