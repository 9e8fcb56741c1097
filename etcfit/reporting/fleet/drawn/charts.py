"""A control chart: every unit in order with the chart's limits; below, the cumulative sums with their decision line.

Source: Montgomery, Introduction to Statistical Quality Control, 7th ed. 2012, ch. 6 and 9.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ... import style
from ..words import Content
from .frame import LIMIT, ODD, UNITS, formatter, frame, power_of, unit_of

_FEW = 300  # units up to which each has its interval


def draw(content: Content, symbol: str) -> Figure:
    """Of one symbol; a change point found in it is a line through both panels."""
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
    value, stderr = _column(chart, "value"), _column(chart, "stderr")
    at, power = np.arange(1, value.size + 1), power_of(value)
    if value.size <= _FEW:
        panel.vlines(at, value - 1.96 * stderr, value + 1.96 * stderr, color="#b9cadb", lw=1)
    panel.plot(at, value, ".", ms=5 if value.size <= _FEW else 2, color=UNITS, label="unit")
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
    high, low = _column(chart, "cusum_high"), _column(chart, "cusum_low")
    at = np.arange(1, high.size + 1)
    panel.plot(at, high, color=UNITS, label="sum above")
    panel.plot(at, low, color=UNITS, ls=":", label="sum below")
    if chart["decision"] is not None:
        panel.axhline(chart["decision"], color=LIMIT, ls="--", lw=1.2, label="decision")
    panel.set_ylabel("CUSUM [sd]")
    panel.margins(x=0.01)


def _column(chart: dict[str, Any], key: str) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in chart[key]], dtype=float)
