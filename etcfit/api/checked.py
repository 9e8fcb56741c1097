"""A check as a notebook holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..experiment.check import CheckResult
from ..reporting.numbers import short
from . import words
from .frames import indexed, numbers
from .frames import words as texts


@dataclass(frozen=True, eq=False, repr=False)
class Checked:
    """What is in a measurement folder, and what it can identify: `etcfit.check(rig)`.

    Args:
        result: in full.
    """

    result: CheckResult

    @property
    def traces(self) -> pd.DataFrame:
        """Indexed by file: test, held_out, samples, duration (s), rate (Hz), gaps, channels."""
        every = self.result.traces
        columns = {
            "test": texts(t.test for t in every),
            "held_out": np.array([t.held_out for t in every], dtype=bool),
            "samples": np.array([t.clock.samples for t in every], dtype=np.int64),
            "duration": numbers(t.clock.duration for t in every),
            "rate": numbers(t.clock.rate for t in every),
            "gaps": np.array([t.clock.gaps for t in every], dtype=np.int64),
            "channels": texts(", ".join(c.name for c in t.channels) for t in every),
        }
        return indexed(columns, [t.file for t in every], "file")

    @property
    def findings(self) -> pd.DataFrame:
        """Mistakes and habits of the rig itself, indexed by kind: test, file, channel ("" where it is none in
        particular), size, unit, chance, found, mend, and sure: physics rules the data out, and `fit` refuses them.
        """
        every = self.result.rig.findings
        columns = {key: texts(getattr(f, key) or "" for f in every) for key in ("test", "file", "channel")}
        columns |= {key: numbers(getattr(f, key) for f in every) for key in ("size", "chance")}
        columns |= {key: texts(getattr(f, key) for f in every) for key in ("unit", "found", "mend")}
        columns |= {"sure": np.array([f.sure for f in every], dtype=bool)}
        order = ("test", "file", "channel", "size", "unit", "chance", "found", "mend", "sure")
        return indexed({key: columns[key] for key in order}, [f.kind for f in every], "kind")

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """Symbols that these data cannot determine; () where nothing can be fitted, see `why_not`."""
        return () if self.result.identifiability is None else self.result.identifiability.lost

    @property
    def directions(self) -> tuple[str, ...]:
        """What these data cannot tell, or hardly, and what would: a sentence each."""
        return self.result.directions

    @property
    def why_not(self) -> str:
        """Why nothing can be fitted, or ""."""
        return self.result.why_not

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a reader must know."""
        return self.result.warnings

    def summary(self, width: int = 140) -> str:
        """What `etcfit check` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.check_table import check_table

        return render(check_table(self.result), width)

    @property
    def _verdict(self) -> str:
        return f"not identifiable: {', '.join(self.not_identifiable) or 'none'}"

    @property
    def _alarm(self) -> str:
        return f"NOTHING CAN BE FITTED: {self.why_not}" if self.why_not else ""

    def __repr__(self) -> str:
        tests = ", ".join(dict.fromkeys(t.test for t in self.result.traces))
        return words.block(
            f"Check of {words.name_of(self.result.rig.config)}: {len(self.result.traces)} traces ({tests})",
            self._alarm or self._verdict,
            words.count_of(self.warnings),
            *self.directions,
        )

    def _repr_html_(self) -> str:
        rows = [(t.file, str(t.clock.samples), short(t.clock.duration), short(t.clock.rate),
                 ", ".join(c.name for c in t.channels), "held out" if t.held_out else "")
                for t in self.result.traces]  # fmt: skip
        return words.card(
            self.result.rig.config,
            "what these traces can identify",
            "" if self._alarm else words.paragraph(self._verdict),
            words.table(("file", "samples", "duration s", "rate Hz", "channels", ""), rows),
            words.folded("Mistakes and habits of the rig", [str(f) for f in self.result.rig.findings]),
            words.folded("What these data cannot tell, or hardly", self.directions),
            words.folded("Warnings", [w for w in self.warnings if w not in map(str, self.result.rig.findings)]),
            alarm=self._alarm,
        )
