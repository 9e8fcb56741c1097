"""Advice on the next measurement as a notebook holds it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from ..experiment.advice import Advice, Option
from . import words
from .frames import indexed, numbers
from .frames import words as texts

_HEAD = ("test", "how", "mean", "separates")


@dataclass(frozen=True, eq=False, repr=False)
class Advised:
    """What one more trace of each rig test would tell: `etcfit.advise(rig)`.

    Args:
        advice: in full.
    """

    advice: Advice

    @property
    def options(self) -> pd.DataFrame:
        """One more trace each, best first, indexed by rig test: how it is made, again (it repeats a trace that is
        there), mean (geometric, of the widths), separates (the pair that it tells apart best, or ""), remark (what was
        assumed)."""
        every = self.advice.options
        columns = {
            "how": texts(option.says for option in every),
            "again": np.array([option.again for option in every], dtype=bool),
            "mean": numbers(option.mean for option in every),
            "separates": texts(_pair(option) for option in every),
            "remark": texts(option.remark for option in every),
        }
        return indexed(columns, [option.test for option in every], "test")

    @property
    def widths(self) -> pd.DataFrame:
        """Width of each parameter's interval after it, as a share of what it is now; rows as in `options`."""
        every = self.advice.options
        columns = {
            symbol: numbers(float(option.shrinks[k]) for option in every)
            for k, symbol in enumerate(self.advice.symbols)
        }
        return indexed(columns, [option.test for option in every], "test")

    @property
    def stderr(self) -> pd.Series:
        """Standard errors now, relative: of a factor, where a parameter is positive; by symbol."""
        return pd.Series(self.advice.sd, index=pd.Index(self.advice.symbols, name="symbol"), name="stderr")

    @property
    def not_judged(self) -> dict[str, str]:
        """Rig tests that no trace can be simulated of, with the reason."""
        return dict(self.advice.not_judged)

    def summary(self, width: int = 140) -> str:
        """What `etcfit check --advise` prints, for `print`."""
        from ..reporting.blocks import render
        from ..reporting.check_table import advice_table

        return render(advice_table(self.advice), width)

    def save(self, run: str | Path) -> Path:
        """Write advice.json.

        Args:
            run: the folder; made if absent.
        """
        from ..run_folder import save_advice

        save_advice(Path(run), self.advice)
        return Path(run)

    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [(o.test, o.says, f"{o.mean:.2f}", _pair(o)) for o in self.advice.options]

    def __repr__(self) -> str:
        lines = [f"{test}, {how}: {mean}" for test, how, mean, _ in self._rows()]
        name = words.name_of(self.advice.rig.config)
        return words.block(f"One more trace for {name}, best first; mean width of an interval after it", *lines)

    def _repr_html_(self) -> str:
        return words.card(
            self.advice.rig.config,
            "what one more trace would tell; mean: width of an interval after it, as a share of now",
            words.table(_HEAD, self._rows()),
            words.folded("Not judged", [f"{test}: {why}." for test, why in self.advice.not_judged]),
        )


def _pair(option: Option) -> str:
    return "" if option.separates is None else " and ".join(option.separates.symbols)
