"""How results are shown: a few lines of text, a small table for a notebook in which all text is escaped, DataFrames.

Also a trace with its simulation.
"""

from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import starmap
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import UsageError
from ..estimation.result import FitResult
from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from ..reporting.packed import with_nan
from ..reporting.table import Cell, Table, role
from ..rig.base import Channel, RigConfig

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import RenderableType


_WIDTH, _LINES = 110, 12  # size of a repr
_NAME = 60  # letters of a rig's name that a repr shows
_RED, _PURPLE = "#c00000", "#c000c0"


class View(ABC):
    """A result for a notebook."""

    @abstractmethod
    def printed(self) -> RenderableType:
        """The output of the command of the same name."""

    @abstractmethod
    def _card(self) -> Card:
        """The result in a few lines."""

    def summary(self, width: int = 140) -> str:
        """The output of the command of the same name, as text."""
        from ..reporting.blocks import render

        return render(self.printed(), width)

    def __repr__(self) -> str:
        card = self._card()
        return block(f"{name_of(card.config)}: {card.title}", card.alarm, *card.says, *card.lines)

    def _repr_html_(self) -> str:
        card = self._card()
        parts = (*map(paragraph, card.says), *map(table, card.tables), *starmap(folded, card.lists.items()))
        return html_card(card.config, card.title, *parts, alarm=card.alarm)


@dataclass(frozen=True)
class Card:
    """A result in a few lines of text, or with its tables in a notebook."""

    config: RigConfig  # of the rig: its name, and whether its data are synthetic
    title: str  # what the result is
    says: Sequence[str] = ()  # sentences
    tables: Sequence[Table] = ()  # for a notebook
    lines: Sequence[str] = ()  # for the text, in place of the tables
    lists: Mapping[str, Sequence[str]] = field(default_factory=dict)  # for a notebook: sentences by heading
    alarm: str = ""  # the most important caution, as "NOT CONVERGED: ..."


def name_of(config: RigConfig) -> str:
    """The rig's name, shortened if it is long, with a remark if its data are synthetic."""
    name = textwrap.shorten(config.name, _NAME, placeholder="...") if config.name.strip() else "a rig"
    return name + (", SYNTHETIC DATA" if config.synthetic else "")


def block(*parts: str) -> str:
    """Paragraphs wrapped to at most a dozen lines; further lines are cut."""
    lines = [line for part in parts if part for line in textwrap.wrap(part, _WIDTH, subsequent_indent="    ")]
    return "\n".join(lines if len(lines) <= _LINES else [*lines[: _LINES - 1], "    ..."])


def count_of(warnings: Sequence[str]) -> str:
    """The number of warnings in words; "" if there are none."""
    many = len(warnings)
    return f"{many} warning{'s' * (many > 1)}, see .warnings" if many else ""


def html_card(config: RigConfig, title: str, *parts: str, alarm: str = "") -> str:
    """A heading, and parts made by `paragraph`, `table` and `folded` below it."""
    tag = f' <b style="color:{_PURPLE}">SYNTHETIC DATA</b>' if config.synthetic else ""
    shout = f'<div style="color:{_RED}"><b>{escape(alarm)}</b></div>' if alarm else ""
    return f"<div><b>{escape(config.name)}</b>: {escape(title)}{tag}{shout}{''.join(parts)}</div>"


def paragraph(text: str) -> str:
    return f"<div>{escape(text)}</div>" if text else ""


def table(it: Table) -> str:
    """A table in the style of a DataFrame in Jupyter; columns of words are left-aligned, a bad row is red."""
    top = "".join(_cell("th", Cell(column.head.replace("\n", " "), kind=column.kind)) for column in it.columns)
    body = "".join(f"<tr>{''.join(_row(row))}</tr>" for row in it.cells)
    notes = "".join(map(paragraph, it.notes))
    return f'<table class="dataframe"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>{notes}'


def _row(cells: Sequence[Cell]) -> Iterator[str]:
    bad = any(cell.tone == "bad" for cell in cells)
    yield from (_cell("td" if k else "th", cell, bad) for k, cell in enumerate(cells))


def _cell(kind: str, cell: Cell, bad: bool = False) -> str:
    colour = f"; color: {_RED}" if bad else ""
    side = "right" if cell.kind == "figure" else "left"
    return f'<{kind} style="text-align: {side}{colour}">{escape(cell.text)}</{kind}>'


def folded(title: str, sentences: Sequence[str]) -> str:
    """Sentences behind a heading that opens at a click; "" if there are none."""
    if not sentences:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in sentences)
    return f"<details><summary>{escape(title)} ({len(sentences)})</summary><ul>{items}</ul></details>"


def texts(values: Iterable[str]) -> pd.Series:
    """A series of dtype str, even if it is empty."""
    import pandas as pd

    return pd.Series(list(values), dtype="str")


def frame(rows: Iterable[Mapping[str, Any]], index: str | None, keys: Sequence[str] = ()) -> pd.DataFrame:
    """The rows of a table, SI, NaN for None.

    Args:
        index: key that names the rows; None: rows are numbered.
        keys: keys that are shown; all but the index if none is named.
    """
    import pandas as pd

    every = list(rows)
    shown = keys or [key for key in (every[0] if every else ()) if key != index]
    columns = {key: _column([row.get(key) for row in every]) for key in shown}
    return pd.DataFrame(columns) if index is None else indexed(columns, [row[index] for row in every], index)


def _column(values: Sequence[Any]) -> Any:
    if values and all(isinstance(value, str) for value in values):
        return texts(values)
    kinds = {bool: bool, np.bool_: bool, int: np.int64}
    same = {kinds.get(type(value)) for value in values}
    if len(same) == 1 and None not in same:
        return np.array(values, dtype=same.pop())
    if not any(isinstance(value, str | list | tuple) for value in values):
        return with_nan(values)
    import pandas as pd

    return pd.Series(values, dtype="object")


def indexed(columns: Mapping[str, Any], names: Sequence[str], index: str = "symbol") -> pd.DataFrame:
    """A DataFrame of these columns; `names` name the rows."""
    import pandas as pd

    frame = pd.DataFrame(dict(columns))
    frame.index = pd.Index(list(names), dtype="str", name=index)
    return frame


def attributes(rows: Iterable[Any], *names: str) -> dict[str, np.ndarray]:
    """One column of numbers for each of these attributes."""
    every = list(rows)
    return {name: with_nan(getattr(row, name) for row in every) for name in names}


def score_frame(result: FitResult, rows: Sequence[PredictionError], columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Columns indexed by file and channel, after test, held_out, unit and n (samples); fitted traces come first."""
    import pandas as pd

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


@dataclass(frozen=True, eq=False, repr=False)
class FittedTrace:
    """One measured trace and its simulation.

    Args:
        predicted: free-running simulation, SI, shape (n, M).
        whitened: residual that the fit minimised, in sigma, independent from sample to sample if the model is right,
            shape (n, M); None if the trace was held out.
    """

    trace: Trace
    predicted: np.ndarray
    whitened: np.ndarray | None

    @property
    def file(self) -> str:
        return self.trace.measurement.file

    @property
    def held_out(self) -> bool:
        """Whether the trace was only predicted, never fitted."""
        return self.trace.measurement.held_out

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that the model predicts."""
        return self.trace.channels

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column of `to_frame`."""
        out = {"time": "s"}
        for name in self.channels:
            unit = self._logged(name).unit or "1"
            out |= {self._column(name, "measured"): unit, self._column(name, "simulated"): unit}
            out[self._column(name, "residual")] = "sigma"
        return out

    def to_frame(self) -> pd.DataFrame:
        """One row per instant: time (s), measured and simulated (in the unit that was logged), residual (in sigma).

        The residual is (measured - simulated) over the noise of one sample. If a trace has several channels, each
        has columns of its own, `position_measured` and so on. NaN where nothing was logged. `frame.attrs["units"]`
        names the units.
        """
        import pandas as pd

        columns = {"time": np.array(self.trace.instants)}
        for m, name in enumerate(self.channels):
            logged = self._logged(name)
            measured, simulated = (logged.logged(y[:, m]) for y in (self.trace.data, self.predicted))
            columns[self._column(name, "measured")] = measured
            columns[self._column(name, "simulated")] = simulated
            sigma = float(self.trace.sigma[m]) / abs(logged.scale)
            columns[self._column(name, "residual")] = (measured - simulated) / sigma
        frame = pd.DataFrame(columns)
        frame.attrs = {"file": self.file, "units": self.units}
        return frame

    def _logged(self, name: str) -> Channel:
        """The logged column of a channel; with open terminals the EMF was logged as a voltage."""
        channels = self.trace.measurement.channels
        return channels[name if name in channels else "voltage"]

    def _column(self, name: str, what: str) -> str:
        return what if len(self.channels) == 1 else f"{name}_{what}"

    def __repr__(self) -> str:
        what = f"{role(self.held_out)}, {', '.join(self.channels)}, {self.trace.instants.size} samples"
        return f"FittedTrace({self.file!r}, {what})"


def traces_of(result: FitResult) -> dict[str, FittedTrace]:
    """Every trace of a fit by its file, fitted ones first."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    fitted = zip(result.problem.batch.traces, result.whitened, strict=True)
    every = (*fitted, *((trace, None) for trace in held_out))
    return {t.measurement.file: FittedTrace(t, result.predicted[t.measurement.file], r) for t, r in every}


def named(traces: Mapping[str, FittedTrace], file: str) -> FittedTrace:
    """The trace of a file."""
    if file not in traces:
        raise UsageError(f"no trace is called {str(file)!r}. There are: {', '.join(traces)}.")
    return traces[file]
