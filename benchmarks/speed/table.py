"""The table: figures of both versions by row, as medians, in Markdown."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ..page import Between
from .rows import Aim, Figures, Lines, Row

PLACE = Between.named("speed")
HEAD = ("| row | what | | old | new | old / new | aim | |", "|---|---|---|---|---|---|---|---|")


@dataclass
class Outcome:
    """What was measured of a row and a version: every repeat, and why there are no more."""

    repeats: list[Lines] = field(default_factory=list)
    failure: str = ""

    def medians(self) -> Lines:
        """Of each figure."""
        first = self.repeats[0] if self.repeats else {}
        return {
            line: {unit: statistics.median(r[line][unit] for r in self.repeats) for unit in first[line]}
            for line in first
        }

    def cell(self, line: str) -> str:
        """The figures of a line, or why there are none, or fewer than wanted."""
        found = self.medians()
        words = [text(found[line])] if line in found else []
        return "; ".join((*words, self.failure) if self.failure else words)


def text(figures: Figures) -> str:
    """Values and units."""
    return ", ".join(f"{number(value)} {unit}" for unit, value in figures.items())


def number(value: float) -> str:
    """Three digits, and never an exponent."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def table(rows: Iterable[tuple[str, Row, Outcome, Outcome]]) -> str:
    """A line for each line of each row measured."""
    return "\n".join([*HEAD, *(line for each in rows for line in _lines(*each))])


def _lines(name: str, row: Row, old: Outcome, new: Outcome) -> list[str]:
    was, now = old.medians(), new.medians()
    out = []
    for line in dict.fromkeys((*was, *now, *row.aims)) or ("",):
        ratio = _ratio(was[line], now[line]) if line in was and line in now else ""
        aims = row.aims.get(line, ())
        cells = (name, row.what, line, old.cell(line), new.cell(line), ratio, _wanted(aims), _met(aims, now.get(line)))
        out.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return out


def _ratio(was: Figures, now: Figures) -> str:
    unit = next(iter(was))
    return f"{number(was[unit] / now[unit])}" if now.get(unit) else ""


def _wanted(aims: Sequence[Aim]) -> str:
    return ", ".join(map(str, aims))


def _met(aims: Sequence[Aim], figures: Figures | None) -> str:
    if not aims:
        return ""
    if figures is None:
        return "not measured"
    return "met" if all(aim.met(figures) for aim in aims) else "**missed**"
