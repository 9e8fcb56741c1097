"""What `etcfit drive --foretold` shows: a log beside what `etcfit tune` foretold, in a table and in plain words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

from rich.console import RenderableType

from ...car_log.foretold import Comparison, Figure
from ..blocks import shown
from ..numbers import between, or_never, short
from ..table import Cell, of_texts


@dataclass(frozen=True)
class Held:
    """One log beside what was foretold for the gains that made it.

    Args:
        log: name of its file.
        run: of `etcfit tune`.
        made_with: name of the step in `told`.
        told: the object of tune.json.
        found: the comparison.
    """

    log: str
    run: Path
    made_with: str
    told: Mapping[str, Any]
    found: Comparison

    @property
    def says(self) -> str:
        """As foretold or not, and what that means."""
        gains = f"the {self.made_with.replace('_', '-')} gains"
        if self.found.as_foretold:
            meant = "the model can be trusted with the next step" if self.made_with != "proposed" else "keep them"
            return f"As foretold for {gains}: {', '.join(map(_found, self.found.figures))}. So {meant}."
        off = [f"{_found(each)}, foretold {between(each.low, each.high)}"
               for each in self.found.figures if not each.as_foretold]  # fmt: skip
        off += ["the plate tracks no better than with the gains before"] if self.found.better is False else []
        said = f"Not as foretold for {gains}: {'; '.join(off)}."
        if self.found.unchanged:
            said += " The error is that of the gains before."
        return said


def foretold_table(held: Held) -> RenderableType:
    """A row a figure: foretold, what still is as foretold, found."""
    levels = held.told["large_steps"]
    rows = [(f"{figure.name}, {figure.unit}", between(figure.low, figure.high), _allowed(figure),
             or_never(figure.found),
             "as foretold" if figure.as_foretold else Cell("NOT as foretold", "bad"))
            for figure in held.found.figures]  # fmt: skip
    gains = f"the {held.made_with.replace('_', '-')} gains"
    title = (f"{held.log}: {held.found.steps} steps from {levels['low_pct']:g} to {levels['high_pct']:g} % of the "
             f"travel and back, beside what {held.run} foretold for {gains}")  # fmt: skip
    heads = ("figure", "foretold", "as foretold", "in this log", "verdict")
    return shown(of_texts(title, heads, rows, 1, {"verdict": "word"}))


def _allowed(figure: Figure) -> str:
    if not isfinite(figure.most):
        return "any"
    return between(figure.least, figure.most) if isfinite(figure.least) else f"<= {short(figure.most)}"


def _found(figure: Figure) -> str:
    return f"{figure.name} {or_never(figure.found)}" + (f" {figure.unit}" if isfinite(figure.found) else "")
