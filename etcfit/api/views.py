"""How results are shown: a few lines of text, a small table for a notebook in which all is escaped, DataFrames."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ..diagnosis.findings import Diagnosis
from ..estimation.intervals import LUMPS, Interval
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


def interval_rows(known: dict[str, Interval], units: dict[str, str]) -> list[list[Cell]]:
    """A row a parameter: symbol, value, standard error, 95 % interval, unit, status."""
    return [[Cell(text, row.status in _DOUBTFUL) for text in _row(symbol, row, units[symbol])]
            for symbol, row in known.items()]  # fmt: skip


def _row(symbol: str, i: Interval, unit: str) -> tuple[str, ...]:
    digits = Digits.of(i.value, i.spread)
    status = f"{i.status} ({i.remark})" if i.remark else i.status
    spread = "-" if i.stderr is None else digits(i.stderr)
    return symbol, value_text(i), spread, digits.span(i.low, i.high), unit, status


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
    body = "".join(f"<tr>{_row_of(row, left)}</tr>" for row in cells)
    return f'<table class="dataframe"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'


def _row_of(row: Sequence[Cell], left: Sequence[bool]) -> str:
    kinds = ("th", *["td"] * (len(row) - 1))
    return "".join(_cell(kind, cell, side) for kind, cell, side in zip(kinds, row, left, strict=True))


def _cell(kind: str, cell: Cell, left: bool) -> str:
    colour = f"; color: {_RED}" if cell.alarm else ""
    return f'<{kind} style="text-align: {"left" if left else "right"}{colour}">{escape(cell.text)}</{kind}>'


def folded(title: str, sentences: Sequence[str]) -> str:
    """Sentences behind a heading that opens at a click; nothing where there are none."""
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in sentences)
    return f"<details><summary>{escape(title)} ({len(sentences)})</summary><ul>{items}</ul></details>"


def units_of(result: FitResult) -> dict[str, str]:
    """SI unit of every parameter and combination, by symbol."""
    declared = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    return declared | {"N": "1"} | {symbol: lump.unit for symbol, lump in LUMPS.items()}


def numbers(values: Iterable[float | None]) -> np.ndarray:
    """float64, NaN for None, shape (n,)."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def texts(values: Iterable[str]) -> pd.Series:
    """Of dtype str, also where there are none."""
    return pd.Series(list(values), dtype="str")


def interval_frame(known: Mapping[str, Interval], units: Mapping[str, str]) -> pd.DataFrame:
    """A row a symbol: value, stderr, low, high (SI, 95 %), unit, status; NaN where there is no interval."""
    rows = list(known.values())
    columns = {key: numbers(getattr(row, key) for row in rows) for key in ("value", "stderr", "low", "high")}
    named = {"unit": [units[s] for s in known], "status": [row.status for row in rows]}
    return indexed(columns | {key: texts(text) for key, text in named.items()}, list(known))


def influence_frame(result: FitResult) -> pd.DataFrame:
    """A row a test and a trace left out, and a parameter: pull (standard errors of noise alone), the largest first.

    Columns: test, file (None where the whole test is left out), parameter, pull.
    """
    pulls = result.influence.pulls
    where = {"test": texts(p.test for p in pulls), "file": pd.Series([p.file for p in pulls], dtype="object")}
    return pd.DataFrame(
        where | {"parameter": texts(p.parameter for p in pulls), "pull": numbers(p.pull for p in pulls)}
    )


def contradiction_frame(result: FitResult) -> pd.DataFrame:
    """A row a test that the others contradict, worst first: parameter that it pulls most, pull, value, without (SI)."""
    every = result.contradictions
    figures = {key: numbers(getattr(c, key) for c in every) for key in ("pull", "value", "without", "p", "share")}
    return indexed({"parameter": texts(c.parameter for c in every)} | figures, [c.test for c in every], "test")


def indexed(columns: Mapping[str, Any], names: Sequence[str], index: str = "symbol") -> pd.DataFrame:
    """Columns under names for their rows."""
    frame = pd.DataFrame(dict(columns))
    frame.index = pd.Index(list(names), dtype="str", name=index)
    return frame


def _placed(columns: Mapping[str, Any], rows: Sequence[PredictionError]) -> pd.DataFrame:
    """Columns under file and channel."""
    frame = pd.DataFrame({key: np.asarray(value) if isinstance(value, list) else value
                          for key, value in columns.items()})  # fmt: skip
    frame.index = pd.MultiIndex.from_arrays(
        [texts(row.file for row in rows), texts(row.channel for row in rows)], names=["file", "channel"]
    )
    return frame


def score_frame(result: FitResult) -> pd.DataFrame:
    """Free-running error, one row a file and channel, fitted traces first.

    Columns: test, held_out, unit, n (samples), rms and sigma (in that unit), in_sigma (rms / sigma).
    """
    rows = (*result.score_fit, *result.score_holdout)
    rms, sigma = numbers(row.rms for row in rows), numbers(row.sigma for row in rows)
    return _placed(_where(result, rows) | {"rms": rms, "sigma": sigma, "in_sigma": rms / sigma}, rows)


def _where(result: FitResult, rows: Sequence[PredictionError]) -> dict[str, Any]:
    fitted = len(result.score_fit)
    return {
        "test": texts(row.test for row in rows),
        "held_out": np.arange(len(rows)) >= fitted,
        "unit": texts(row.unit or "1" for row in rows),
        "n": np.array([row.n for row in rows], dtype=np.int64),
    }


def ledger_frame(diagnosis: Diagnosis) -> pd.DataFrame:
    """Free-running error of the first and of the final model, one row a file and channel, fitted traces first.

    Columns: test, held_out, unit, n (samples), sigma (noise of one sample), before and after (rms, in that unit),
    before_in_sigma and after_in_sigma (over that noise).
    """
    was, now = diagnosis.before, diagnosis.after
    rows = (*was.score_fit, *was.score_holdout)
    later = {(row.file, row.channel): row.rms for row in (*now.score_fit, *now.score_holdout)}
    sigma, before = numbers(row.sigma for row in rows), numbers(row.rms for row in rows)
    after = numbers(later.get((row.file, row.channel)) for row in rows)
    columns = {"sigma": sigma, "before": before, "after": after,
               "before_in_sigma": before / sigma, "after_in_sigma": after / sigma}  # fmt: skip
    return _placed(_where(was, rows) | columns, rows)


def candidate_frame(diagnosis: Diagnosis) -> pd.DataFrame:
    """Every effect that was tried, one row a round and effect: what it promised, and what refitting with it came to."""
    every = [(k, each, c) for k, each in enumerate(diagnosis.rounds, start=1) for c in each.candidates]
    keys = ("screened", "fit_rms_ratio", "holdout_rms_ratio", "holdout_chi2_change", "bic_change")
    frame = pd.DataFrame({key: numbers(getattr(c, key) for _, _, c in every) for key in keys})
    frame.insert(0, "added", np.array([c.effect == each.added for _, each, c in every], dtype=bool))
    frame.index = pd.MultiIndex.from_arrays(
        [np.array([k for k, _, _ in every], dtype=np.int64), texts(c.effect for _, _, c in every)],
        names=["round", "effect"],
    )
    return frame
