"""RUN/pictures/fleet: the population, correlations, control charts, odd units; for a slide or a report.

p(x) = N(x; mean, sd^2)

Source of the charts: Montgomery, Introduction to Statistical Quality Control, 7th ed. 2012, ch. 6 and 9.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from .. import style
from ..drawing import draw_one
from ..numbers import SUPERSCRIPT, counted, with_error
from ..packed import with_nan
from . import Content, title
from .page import Columns, SymbolColumns, limits_of

if TYPE_CHECKING:
    import pandas as pd


ODD, LIMIT, UNITS = style.SIMULATED, "#b03a00", style.READING


def frame(content: Content, rest: str, size: tuple[float, float], grid: tuple[int, int]) -> tuple[Figure, list[Axes]]:
    """A figure, inches, with its title and these rows and columns of panels."""
    wide, tall = size
    fig = style.figure(wide, tall, bool(content.get("synthetic")))
    head = style.wrapped(f"{title(content)}  ·  {rest}", wide, 13)
    top = 0.55 + 0.24 * head.count("\n")
    fig.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - top / tall), h_pad=0.08, w_pad=0.08)
    style.title(fig, head)
    return fig, list(fig.subplots(*grid, squeeze=False).ravel())


def power_of(values: np.ndarray | Sequence[float]) -> int:
    """The power of a thousand that is split off, as a power of ten; 0 if numbers are readable without it."""
    finite = np.abs(np.asarray(values, dtype=float))
    size = float(np.max(finite[np.isfinite(finite)], initial=0.0))
    if size == 0.0 or 1e-2 <= size < 1e5:
        return 0
    return 3 * math.floor(math.log10(size) / 3.0 + 1e-9)


def unit_of(unit: str, power: int) -> str:
    """ "10⁻⁶ kg m²", for the brackets of an axis."""
    plain = "1" if unit in ("", "1") else unit.replace("**2", "²").replace("*", " ")
    return f"10{str(power).translate(SUPERSCRIPT)} {plain}" if power else plain


def formatter(power: int) -> FuncFormatter:
    """Ticks of numbers without that power of ten."""
    return FuncFormatter(lambda value, _: f"{value / 10.0**power:.6g}")


_FEW_IN_CHART = 300  # largest number of units with intervals in a chart


def draw_chart(content: Content, symbol: str) -> Figure:
    """Control chart and cumulative sums of one symbol; a change point is a line through both panels."""
    chart: dict[str, Any] = content["charts"][symbol]
    drift = [each for each in content.get("drift") or () if each["symbol"] == symbol]
    found = "; ".join(f"changed at {each['since']}" for each in drift) or "no change found"
    fig, (top, below) = frame(content, f"control chart of {symbol}: {found}", (11.0, 6.2), (2, 1))
    _values(top, symbol, chart, content)
    _sums(below, chart)
    for each in drift:
        if each["since"] in chart["order"]:
            for panel in (top, below):
                panel.axvline(chart["order"].index(each["since"]) + 0.5, color=LIMIT, lw=2, label="change")
    style.quiet_axis(top)
    below.set_xlabel("unit, in order")
    style.legend(fig, [top, below], 0.985, 1.0 - 0.42 / 6.2)
    return fig


def _values(panel: Axes, symbol: str, chart: dict[str, Any], content: Content) -> None:
    value, stderr = with_nan(chart["value"]), with_nan(chart["stderr"])
    at, power = np.arange(1, value.size + 1), power_of(value)
    if value.size <= _FEW_IN_CHART:
        panel.vlines(at, value - 1.96 * stderr, value + 1.96 * stderr, color="#b9cadb", lw=1)
    panel.plot(at, value, ".", ms=5 if value.size <= _FEW_IN_CHART else 2, color=UNITS, label="unit")
    odd = np.isin(chart["order"], [each["unit"] for each in content.get("odd") or ()])
    if odd.any():
        panel.plot(at[odd], value[odd], "D", ms=6, color=ODD, ls="none", label="odd unit")
    lines = ((("centre",), "black", "-", "centre"), (("lower", "upper"), "#8a5a00", "--", "control limit"))
    for keys, colour, dash, label in lines:
        for key in keys:
            if chart[key] is not None:
                panel.axhline(chart[key], color=colour, ls=dash, lw=1.2, label=label)
    panel.yaxis.set_major_formatter(formatter(power))
    panel.set_ylabel(f"{symbol} [{unit_of(chart['unit'], power)}]")
    panel.margins(x=0.01)


def _sums(panel: Axes, chart: dict[str, Any]) -> None:
    high, low = with_nan(chart["cusum_high"]), with_nan(chart["cusum_low"])
    at = np.arange(1, high.size + 1)
    panel.plot(at, high, color=UNITS, label="sum above")
    panel.plot(at, low, color=UNITS, ls=":", label="sum below")
    if chart["decision"] is not None:
        panel.axhline(chart["decision"], color=LIMIT, ls="--", lw=1.2, label="decision")
    panel.set_ylabel("CUSUM [sd]")
    panel.margins(x=0.01)


_WRITTEN = 16  # largest number of symbols for which the cells show numbers


def draw_correlation(content: Content) -> Figure:
    """Blue for positive, red for negative correlation; the cell of an unknown correlation is empty."""
    names = content["correlation"]["symbols"]
    matrix = np.array([with_nan(row) for row in content["correlation"]["matrix"]])
    side = max(4.2, 1.6 + 0.62 * len(names))
    fig, (panel,) = frame(content, "correlation between units", (max(6.5, side + 1.2), side + 0.4), (1, 1))
    image = panel.imshow(matrix, vmin=-1.0, vmax=1.0, cmap="RdBu")
    panel.set_xticks(range(len(names)), names, rotation=45 if len(names) > 10 else 0)
    panel.set_yticks(range(len(names)), names)
    panel.grid(visible=False)
    for spine in panel.spines.values():
        spine.set_visible(False)
    if len(names) <= _WRITTEN:
        for (row, column), r in np.ndenumerate(matrix):
            if np.isfinite(r):
                panel.text(column, row, f"{r:.2f}".replace("-0.00", "0.00"), ha="center", va="center", fontsize=10,
                           color="white" if abs(r) > 0.65 else "black")  # fmt: skip
    fig.colorbar(image, ax=panel, label="correlation", shrink=0.8)
    return fig


_MOST_ODD = 20
_WIDE = 68  # letters per line of a reason


def draw_odd(content: Content) -> Figure:
    """One bar per unit, with its reason beside it."""
    odd = content["odd"][:_MOST_ODD]
    count = len(content["odd"])
    words = counted(count, "odd unit") + (f", the {_MOST_ODD} oddest" if count > _MOST_ODD else "")
    fig, (panel,) = frame(content, words, (12.0, 1.5 + 0.52 * len(odd)), (1, 1))
    distance = np.array([each["distance"] for each in odd], dtype=float)
    most = float(distance.max())
    panel.barh(range(len(odd)), distance, height=0.55, color=ODD)
    for row, each in enumerate(odd):
        why = textwrap.shorten(each["why"], 2 * _WIDE, placeholder=" ...")
        panel.text(distance[row] + 0.02 * most, row, "\n".join(textwrap.wrap(why, _WIDE)), va="center", fontsize=9.5)
    panel.set_yticks(range(len(odd)), [each["unit"] for each in odd])
    panel.set_ylim(len(odd) - 0.4, -0.6)
    panel.set_xlim(0.0, 2.6 * most)
    panel.set_xticks([tick for tick in panel.get_xticks() if tick <= 1.05 * most])
    panel.set_xlabel("Mahalanobis distance from the population", loc="left")
    panel.grid(visible=False, axis="y")
    return fig


_MOST = 12  # largest number of symbols in the picture; the page has all
_FAR = 5.0  # quartile ranges: a normal distribution exceeds this once in 10^13
_FEW = 400  # largest number of drawn intervals; with more units, an even selection


def shown_symbols(content: Content, columns: Columns) -> list[str]:
    """Symbols with a population and with units, in the population's order."""
    return [name for name in content.get("population") or {} if name in columns.symbols][:_MOST]


def draw_population(content: Content, columns: Columns) -> Figure:
    """Two panels per symbol, side by side."""
    names = shown_symbols(content, columns)
    rows = -(-len(names) // 2)
    tall = 1.2 + 2.35 * rows
    rest = f"{len(columns.units):,} units: each one's fit, and the population"
    fig, panels = frame(content, rest, (13.0, tall), (rows, 4))
    odd = np.isin(columns.units, [each["unit"] for each in content.get("odd") or ()])
    for k, name in enumerate(names):
        _symbol(content, name, columns.symbols[name], odd, (panels[2 * k], panels[2 * k + 1]))
    for panel in panels[2 * len(names) :]:
        panel.set_axis_off()
    style.legend(fig, panels, 0.985, 1.0 - 0.3 / tall)
    return fig


def _symbol(content: Content, name: str, each: SymbolColumns, odd: np.ndarray, panels: tuple[Axes, Axes]) -> None:
    left, right = panels
    known, value = content["population"][name], each["value"]
    power, lines = power_of(value), [limit for limit in limits_of(content, name) if limit is not None]
    low, high = _reach(value, lines)
    finite = np.clip(value[np.isfinite(value)], low, high)
    _sorted(left, np.clip(value, low, high), each["low"], each["high"], odd)
    right.hist(
        finite, bins=np.linspace(low, high, 31).tolist(), orientation="horizontal", color="#9ebbd4", density=True
    )
    if (sd := known.get("sd")) and not known.get("shared"):
        x = np.linspace(low, high, 300)
        density = np.exp(-0.5 * ((x - known["mean"]) / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
        right.plot(density, x, color="black", label="population")
    for panel in panels:
        for limit in lines:
            panel.axhline(limit, color=LIMIT, ls="--", label="specification limit")
        panel.set_ylim(low, high)
        panel.yaxis.set_major_formatter(formatter(power))
    left.set(ylabel=f"{name} [{unit_of(known['unit'], power)}]", xlabel="units, by value")
    right.set(xlabel="share of units", xticks=[])
    right.set_title(_words(known), fontsize=9.5, loc="left")
    right.tick_params(labelleft=False)


def _sorted(panel: Axes, value: np.ndarray, low: np.ndarray, high: np.ndarray, odd: np.ndarray) -> None:
    order = np.argsort(value)[: np.count_nonzero(np.isfinite(value))]
    few = np.unique(np.linspace(0, max(order.size - 1, 0), min(order.size, _FEW)).astype(int)) if order.size else order
    at = order[few]
    panel.vlines(few + 1, low[at], high[at], color="#b9cadb", lw=0.9, label="95 % interval")
    panel.plot(few + 1, value[at], ".", ms=3, color=UNITS, label="unit's own fit")
    places = np.flatnonzero(odd[order])
    panel.plot(places + 1, value[order[places]], "D", ms=5, color=ODD, label="odd unit", ls="none", clip_on=False)


def _reach(value: np.ndarray, lines: list[float]) -> tuple[float, float]:
    """Range of all units and limits; units that would compress the picture are drawn at the edge."""
    finite = value[np.isfinite(value)]
    if finite.size:
        quarter, last = np.quantile(finite, [0.25, 0.75])
        off = _FAR * (last - quarter) or np.inf
        finite = finite[(finite >= quarter - off) & (finite <= last + off)]
    ends = np.concatenate([finite, np.asarray(lines, dtype=float)])
    if not ends.size:
        return 0.0, 1.0
    low, high = float(ends.min()), float(ends.max())
    pad = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
    return low - pad, high + pad


def _words(known: dict[str, float]) -> str:
    if known["mean"] is None:
        return ""
    if known.get("shared"):
        return f"one for all: {with_error(known['mean'], None)}"
    cpk = f", Cpk {known['cpk']:.2f}" if known.get("cpk") is not None else ""
    return with_error(known["mean"], known["sd"]) + cpk


def draw_fleet(content: Content, units: pd.DataFrame, folder: Path) -> tuple[Path, ...]:
    """Draw every picture with data in fleet.json and units.parquet, the population first; delete older pictures."""
    for old in folder.glob("*.png"):
        old.unlink()
    written: list[Path] = []
    for name, draw in _jobs(content, Columns.of_units(content.get("units") or (), units)):
        draw_one(folder / name, draw)
        written.append(folder / name)
    return tuple(written)


def _jobs(content: Content, columns: Columns) -> Iterator[tuple[str, Callable[[], Figure]]]:
    if shown_symbols(content, columns):
        yield "population.png", partial(draw_population, content, columns)
    if (content.get("correlation") or {}).get("symbols"):
        yield "correlation.png", partial(draw_correlation, content)
    for symbol in content.get("charts") or {}:
        plain = "".join(c if c.isalnum() or c in "-_" else "_" for c in symbol)
        yield f"chart_{plain}.png", partial(draw_chart, content, symbol)
    if content.get("odd"):
        yield "odd.png", partial(draw_odd, content)
