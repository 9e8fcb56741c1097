"""One picture of all parameters: how well each is known, how far off graph reading is, what another rig has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from ..estimation.intervals import Interval
from . import style
from .numbers import Digits, is_share

_LINEAR = 0.1  # per cent of the fitted value about zero, beyond which the axis is logarithmic
_EDGE = 100.0  # per cent
_TICKS = (-100.0, -10.0, -1.0, -0.1, 0.0, 0.1, 1.0, 10.0, 100.0)


@dataclass(frozen=True)
class _Mark:
    """How a value that is not the fit's is drawn; fields are matplotlib's."""

    label: str
    marker: str
    color: str
    markerfacecolor: str
    markersize: float


_READING = _Mark("graph reading", "o", style.READING, style.READING, 8.0)
# larger than a reading, so that an arrow shows behind another
_TABLE_2 = _Mark("the paper's Table 2: another rig", "s", style.MEASURED, "white", 9.5)

_INTERVAL: dict[str, Any] = {"color": style.SIMULATED, "label": "fit, 95 % interval"}
_RANGE: dict[str, Any] = {
    "color": style.SIMULATED,
    "alpha": 0.35,
    "label": "compromise: range that subsets of the data give",
}


@dataclass(frozen=True, eq=False)
class ParameterPicture:
    """What the picture of the parameters shows.

    Args:
        rig: its name.
        model: in words.
        intervals: by symbol.
        units: SI, by symbol.
        readings: SI, by symbol, where there is one.
        table_2: what the paper's table has, of another rig: no truth and no measurement of this one; SI, by symbol.
        synthetic: the data were made up.
    """

    rig: str
    model: str
    intervals: Mapping[str, Interval]
    units: Mapping[str, str]
    readings: Mapping[str, float]
    table_2: Mapping[str, float]
    synthetic: bool


def draw(picture: ParameterPicture) -> Figure:
    """A row a parameter that was free: its 95 % interval, and how far reading and Table 2 lie from the fitted value.

    Shares that a rig test has of its own, such as a place between two samples, are left out: a per cent of one near 0
    is no measure.
    """
    free = {s: i for s, i in picture.intervals.items() if i.status in ("estimated", "not identifiable", "compromise")}
    shown = {s: i for s, i in free.items() if not is_share(s, picture.units[s])}
    title = style.wrapped(f"{picture.rig}  ·  parameters of {picture.model}", 11.0, 13)
    head = 0.75 + 0.24 * title.count("\n")
    tall = 0.75 + head + 0.42 * max(1, len(shown))
    fig = style.figure(11.0, tall, picture.synthetic)
    panel = fig.subplots(1, 1)
    fig.subplots_adjust(left=0.2, right=0.64, top=1.0 - head / tall, bottom=0.62 / tall)
    panel.axvline(0.0, color="black", lw=0.8)
    others = [(picture.table_2, _TABLE_2), (picture.readings, _READING)]
    for row, (symbol, interval) in enumerate(shown.items()):
        _row(panel, row, interval)
        for values, mark in others:
            _mark(panel, row, interval, values.get(symbol), mark)
        text = _words(interval, picture.units[symbol])
        panel.text(1.02, row, text, transform=panel.get_yaxis_transform(), va="center", fontsize=10)
    _axes(panel, list(shown))
    fig.suptitle(title, x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    known = {symbol for symbol, interval in shown.items() if interval.low is not None}
    for values, mark in reversed(others):
        if values.keys() & known:
            panel.plot([], [], ls="none", **vars(mark))
    style.legend(fig, [panel], 0.2, 1.0 - (head - 0.37) / tall, "upper left")
    return fig


def _row(panel: Axes, row: int, interval: Interval) -> None:
    if interval.low is None or interval.high is None or interval.value == 0.0:
        panel.axhspan(row - 0.4, row + 0.4, color=style.BAND, lw=0)
        return
    low, high = (_relative(end, interval.value) for end in (interval.low, interval.high))
    look = _RANGE if interval.status == "compromise" else _INTERVAL
    panel.plot([low, high], [row, row], lw=5, solid_capstyle="butt", **look)


def _mark(panel: Axes, row: int, interval: Interval, value: float | None, mark: _Mark) -> None:
    """Another value of the parameter; one beyond the edge is an arrow there, which the legend need not show."""
    if value is None or interval.low is None or interval.value == 0.0:
        return
    distance = _relative(value, interval.value)
    marker = mark.marker if abs(distance) < _EDGE else ("<" if distance < 0 else ">")
    look = replace(mark, marker=marker, label="")
    panel.plot(np.clip(distance, -_EDGE, _EDGE), row, ls="none", clip_on=False, **vars(look))


def _relative(value: float, fitted: float) -> float:
    return 100.0 * (value - fitted) / abs(fitted)


def _words(interval: Interval, unit: str) -> str:
    if interval.status == "not identifiable":
        return "not identifiable"
    digits = Digits.of(interval.value, interval.spread)
    spread = "" if interval.stderr is None else f" ± {digits(interval.stderr)}"
    remarks = [interval.remark] if interval.remark else []
    remarks += ["compromise"] if interval.status == "compromise" else []
    return ", ".join([f"{digits(interval.value)}{spread} {unit}", *remarks])


def _axes(panel: Axes, symbols: list[str]) -> None:
    panel.set_xscale("symlog", linthresh=_LINEAR, linscale=0.6)
    panel.set_xlim(-_EDGE, _EDGE)
    panel.xaxis.set_major_locator(FixedLocator(_TICKS))
    panel.xaxis.set_minor_locator(FixedLocator([]))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panel.set_yticks(range(len(symbols)), symbols)
    panel.set_ylim(len(symbols) - 0.4, -0.6)
    panel.set_xlabel("distance from the fitted value [%]")
