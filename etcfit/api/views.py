"""How results are shown: a few lines of text, a small table for a notebook in which all is escaped, DataFrames."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..estimation.intervals import Interval
from ..estimation.result import FitResult
from ..problem.prediction_error import PredictionError
from ..reporting.numbers import Digits
from ..rig.base import RigConfig

_WIDTH, _LINES = 110, 12  # of a repr
_NAME = 60  # letters of a rig's name that a repr shows
_RED, _PURPLE = "#c00000", "#c000c0"
_DOUBTFUL = ("not identifiable", "compromise")


class Cell(NamedTuple):
    """One cell of a table.

    Args:
        text: unescaped.
        alarm: shown in red.
    """

    text: str
    alarm: bool = False


def name_of(config: RigConfig) -> str:
    """The rig's name, shortened where it is long, and that its data were made up where they were."""
    name = textwrap.shorten(config.name, _NAME, placeholder="...") if config.name.strip() else "a rig"
    return name + (", SYNTHETIC DATA" if config.synthetic else "")


def block(*parts: str) -> str:
    """Paragraphs wrapped to a dozen lines at most; the last ones are cut where there are more."""
    lines = [line for part in parts if part for line in textwrap.wrap(part, _WIDTH, subsequent_indent="    ")]
    return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "    ..."])


def count_of(warnings: Sequence[str]) -> str:
    """How many there are to be read; "" without any."""
    many = len(warnings)
    return f"{many} warning{'s' * (many > 1)}, see .warnings" if many else ""


def value_text(interval: Interval) -> str:
    """ "1.637", with as many digits as are known; "-" where the data do not tell."""
    return "-" if interval.status == "not identifiable" else Digits.of(interval.value, interval.spread)(interval.value)


def known_text(symbol: str, interval: Interval, unit: str) -> str:
    """ "R_a 1.637 ± 0.002 ohm"."""
    spread = "" if interval.stderr is None else f" ± {Digits.of(interval.value, interval.spread)(interval.stderr)}"
    return f"{symbol} {value_text(interval)}{spread} {unit}"


def interval_row(symbol: str, i: Interval, unit: str) -> list[Cell]:
    """Symbol, value, standard error, 95 % interval, unit, status."""
    digits = Digits.of(i.value, i.spread)
    status = f"{i.status} ({i.remark})" if i.remark else i.status
    spread = "-" if i.stderr is None else digits(i.stderr)
    row = (symbol, value_text(i), spread, digits.span(i.low, i.high), unit, status)
    return [Cell(text, i.status in _DOUBTFUL) for text in row]


INTERVAL_HEAD = ("", "value", "std. error", "95 % interval", "unit", "status")


def card(config: RigConfig, title: str, *parts: str, alarm: str = "") -> str:
    """A heading, and parts made by `paragraph`, `table` and `folded` below it.

    Args:
        config: of the rig; names it, and its data as made up where they were.
        title: what this is.
        parts: HTML.
        alarm: what a reader must know before all else, as "NOT CONVERGED: ...".
    """
    tag = f' <b style="color:{_PURPLE}">SYNTHETIC DATA</b>' if config.synthetic else ""
    shout = f'<div style="color:{_RED}"><b>{escape(alarm)}</b></div>' if alarm else ""
    return f"<div><b>{escape(config.name)}</b>: {escape(title)}{tag}{shout}{''.join(parts)}</div>"


def paragraph(text: str) -> str:
    return f"<div>{escape(text)}</div>" if text else ""


def table(head: Sequence[str], rows: Iterable[Sequence[Cell | str]]) -> str:
    """Looks as Jupyter shows a DataFrame, but columns of words begin on the left."""
    cells = [[each if isinstance(each, Cell) else Cell(each) for each in row] for row in rows]
    left = [any(row[k].text[:1].isalpha() for row in cells) for k in range(len(head))]
    top = "".join(_cell("th", Cell(name), side) for name, side in zip(head, left, strict=True))
    kinds = ("th", *["td"] * (len(head) - 1))
    body = "".join(f"<tr>{''.join(map(_cell, kinds, row, left))}</tr>" for row in cells)
    return f'<table class="dataframe"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'


def _cell(kind: str, cell: Cell, left: bool) -> str:
    colour = f"; color: {_RED}" if cell.alarm else ""
    return f'<{kind} style="text-align: {"left" if left else "right"}{colour}">{escape(cell.text)}</{kind}>'


def folded(title: str, sentences: Sequence[str]) -> str:
    """Sentences behind a heading that opens at a click; nothing where there are none."""
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in sentences)
    return f"<details><summary>{escape(title)} ({len(sentences)})</summary><ul>{items}</ul></details>"


def numbers(values: Iterable[float | None]) -> np.ndarray:
    """float64, NaN for None, shape (n,)."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def texts(values: Iterable[str]) -> pd.Series:
    """Of dtype str, also where there are none."""
    return pd.Series(list(values), dtype="str")


def interval_frame(known: Mapping[str, Interval], units: Mapping[str, str]) -> pd.DataFrame:
    """A row a symbol: value, stderr, low, high (SI, 95 %), unit, status; NaN where there is no interval."""
    rows = known.values()
    named = {"unit": texts(units[s] for s in known), "status": texts(row.status for row in rows)}
    return indexed(attributes(rows, "value", "stderr", "low", "high") | named, list(known))


def indexed(columns: Mapping[str, Any], names: Sequence[str], index: str = "symbol") -> pd.DataFrame:
    """Columns under names for their rows."""
    frame = pd.DataFrame(dict(columns))
    frame.index = pd.Index(list(names), dtype="str", name=index)
    return frame


def attributes(rows: Iterable[Any], *names: str) -> dict[str, np.ndarray]:
    """A column of numbers for each of these attributes."""
    every = list(rows)
    return {name: numbers(getattr(row, name) for row in every) for name in names}


def score_frame(result: FitResult, rows: Sequence[PredictionError], columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Columns under file and channel, behind test, held_out, unit and n (samples); fitted traces come first."""
    where = {
        "test": texts(row.test for row in rows),
        "held_out": np.arange(len(rows)) >= len(result.score_fit),
        "unit": texts(row.unit or "1" for row in rows),
        "n": np.array([row.n for row in rows], dtype=np.int64),
    }
    frame = pd.DataFrame(where | dict(columns))
    places = [texts(row.file for row in rows), texts(row.channel for row in rows)]
    frame.index = pd.MultiIndex.from_arrays(places, names=["file", "channel"])
    return frame
