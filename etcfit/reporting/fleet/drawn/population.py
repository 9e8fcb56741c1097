"""The population: of each symbol every unit's interval, sorted, beside their histogram and the population's curve.

p(x) = N(x; mean, sd^2)
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ... import style
from ...numbers import Digits
from ..columns import Columns, SymbolColumns
from ..content import limits_of
from ..words import Content
from .frame import LIMIT, ODD, UNITS, formatter, frame, power_of, unit_of

_MOST = 12  # symbols in the picture; the page has them all
_FAR = 5.0  # quartile ranges: a normal distribution reaches this far once in 10^13
_FEW = 400  # units of which each one's interval is drawn; of more, so many spread evenly over them


def shown(content: Content, columns: Columns) -> list[str]:
    """Symbols with a population and with units, in the population's order."""
    return [name for name in content.get("population") or {} if name in columns.symbols][:_MOST]


def draw(content: Content, columns: Columns) -> Figure:
    """Two panels a symbol, side by side."""
    names = shown(content, columns)
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
    if known.get("sd") and not known.get("shared"):
        _curve(right, known["mean"], known["sd"], low, high)
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
    """All units and limits; those units stand at the edge that would flatten all others."""
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


def _curve(panel: Axes, mean: float, sd: float, low: float, high: float) -> None:
    x = np.linspace(low, high, 300)
    density = np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * np.sqrt(2.0 * np.pi))
    panel.plot(density, x, color="black", label="population")


def _words(known: dict[str, float]) -> str:
    if known["mean"] is None:
        return ""
    of = Digits.of(known["mean"], known["sd"] or None)
    if known.get("shared"):
        return f"one for all: {Digits.of(known['mean'], None)(known['mean'])}"
    cpk = f", Cpk {known['cpk']:.2f}" if known.get("cpk") is not None else ""
    return f"{of(known['mean'])} ± {of(known['sd'])}{cpk}"
