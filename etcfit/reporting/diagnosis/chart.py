"""The ledger at a glance: one dumbbell a test and channel, in sigma, before and after."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .. import style
from ..numbers import short
from .ledger import Entry

_ROW = 0.36  # inch


def draw(entries: Sequence[Entry], headline: str, synthetic: bool) -> Figure:
    """Held-out traces above, fitted ones below; what the errors are in the units logged stands beside them."""
    shown = [entry for entry in entries if entry.known()]
    heads = len({entry.held_out for entry in shown})
    title = style.wrapped(headline, 11.0, 13)
    tall = 1.45 + 0.24 * title.count("\n") + _ROW * (len(shown) + heads)
    fig = style.figure(11.0, tall, synthetic)
    panel = fig.subplots(1, 1)
    top = 0.72 + 0.24 * title.count("\n")
    fig.subplots_adjust(left=0.2, right=0.74, top=1.0 - top / tall, bottom=0.6 / tall)
    panel.axvline(1.0, color=style.MEASURED, lw=1.2, ls=":", label="noise of one sample")
    rows = _rows(panel, shown)
    _axes(panel, rows, shown)
    fig.suptitle(title, x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13, fontweight="bold")
    style.legend(fig, [panel], 0.2, 1.0 - (top - 0.27) / tall, "upper left")
    return fig


def _rows(panel: Axes, shown: Sequence[Entry]) -> dict[int, str]:
    """Draw them; the label of each place."""
    labels: dict[int, str] = {}
    place, last = 0, None
    for entry in shown:
        if entry.held_out != last:
            labels[place] = "HELD OUT, never fitted" if entry.held_out else "FITTED"
            place, last = place + 1, entry.held_out
        labels[place] = entry.name
        _dumbbell(panel, place, entry)
        place += 1
    return labels


def _dumbbell(panel: Axes, place: int, entry: Entry) -> None:
    if entry.held_out:
        panel.axhspan(place - 0.5, place + 0.5, color="#f3f3f3", lw=0, zorder=0)
    before, after = entry.before.ratio, entry.after.ratio
    panel.plot([before, after], [place, place], color="#b5b5b5", lw=4, solid_capstyle="butt", zorder=2)
    panel.plot(before, place, "o", ms=11, color=style.BEFORE, ls="none", label="before", zorder=3)
    panel.plot(after, place, "o", ms=8, color=style.AFTER, ls="none", label="after", zorder=4)
    text = entry.change()
    if entry.unknown is not None and np.isfinite(entry.unknown.ratio):
        panel.plot(entry.unknown.ratio, place, "D", ms=7, color=style.UNKNOWN, ls="none",
                   label="with what no effect explains", zorder=3)  # fmt: skip
        text += f" ({short(entry.unknown.rms)})"
    panel.text(1.015, place, text, transform=panel.get_yaxis_transform(), va="center", fontsize=10.5,
               fontweight="bold" if entry.held_out else "normal")  # fmt: skip


def _axes(panel: Axes, labels: dict[int, str], shown: Sequence[Entry]) -> None:
    panel.set_xscale("log")
    ends = [pool.ratio for e in shown for pool in (e.before, e.after, e.unknown) if pool and pool.ratio > 0.0]
    panel.set_xlim(min(0.7, 0.8 * min(ends)), max(3.0, 1.35 * max(ends)))
    style.log_ticks(panel.xaxis, panel.get_xlim())
    panel.set_yticks(list(labels), list(labels.values()))
    for tick in panel.get_yticklabels():
        if tick.get_text().isupper() or tick.get_text().startswith("HELD OUT"):
            tick.set_fontweight("bold")
    panel.tick_params(axis="y", length=0)
    panel.grid(visible=False, axis="y")
    panel.set_ylim(max(labels) + 0.6, -0.6)
    panel.set_xlabel("free-running error [σ of one sample]")
    head = "rms: before → after" + (" (with unexplained)" if any(entry.unknown for entry in shown) else "")
    panel.text(1.015, 0, head, transform=panel.get_yaxis_transform(), fontsize=10, va="center", color=style.MEASURED)
