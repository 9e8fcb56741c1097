"""Posterior predictive band of a trace: what was measured within it, and how much of that lies inside."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...intervals import Z_95
from ...posterior.predictive import Band
from .. import style
from ..traces import source

_BAND = "#f2c49b"
_SHOWN = 0.998  # of the errors lie inside their panel


def draw(band: Band, synthetic: bool) -> Figure:
    """Two panels a channel: the signal, and measured - predicted with the band about zero."""
    trace = band.trace
    heights = [h for _ in trace.channels for h in (1.7, 1.3)]
    tall = min(9.0, 1.1 + 0.95 * sum(heights))
    fig = style.figure(10.0, tall, synthetic)
    grid = fig.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}, squeeze=False)
    panels: list[Axes] = list(grid[:, 0])
    fig.subplots_adjust(left=0.105, right=0.985, top=1.0 - 0.72 / tall, bottom=0.55 / tall, hspace=0.16)
    for m, name in enumerate(trace.channels):
        _signal(panels[2 * m], band, m, name)
        _error(panels[2 * m + 1], band, m)
    for panel in panels[:-1]:
        style.quiet_axis(panel)
    panels[-1].set_xlabel("time [s]")
    fig.align_ylabels(panels)
    fig.suptitle(_title(band), x=0.105, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    fig.text(0.105, 1.0 - 0.4 / tall, _inside(band), ha="left", va="top", fontsize=10.5)
    style.legend(fig, panels, 0.985, 1.0 - 0.4 / tall)
    return fig


def _title(band: Band) -> str:
    role = "held out" if band.trace.measurement.held_out else "fitted"
    return f"{band.trace.measurement.file}  ·  {role}, posterior predictive"


def _inside(band: Band) -> str:
    each = (f"{name.replace('_', ' ')} {100.0 * share:.1f} %"
            for name, share in zip(band.trace.channels, band.inside, strict=True))  # fmt: skip
    return "inside the 95 % band: " + ", ".join(each)


def _signal(panel: Axes, band: Band, m: int, name: str) -> None:
    trace, channel = band.trace, source(band.trace, name)
    t = trace.instants
    panel.plot(*style.thin(t, channel.logged(trace.data[:, m])), ".", ms=2.5, color=style.MEASURED, label="measured")
    panel.plot(*style.thin(t, channel.logged(band.mean[:, m])), color=style.SIMULATED, label="posterior mean")
    panel.set_ylabel(style.unit_label(name, channel.unit))


def _error(panel: Axes, band: Band, m: int) -> None:
    trace, channel = band.trace, source(band.trace, band.trace.channels[m])
    t, half = trace.instants, Z_95 * band.sd[:, m] / abs(channel.scale)
    error = (trace.data[:, m] - band.mean[:, m]) / channel.scale
    size = np.abs(error[np.isfinite(error)])
    limit = 1.15 * max(float(np.quantile(size, _SHOWN)), float(np.quantile(half, _SHOWN)))
    panel.fill_between(t, -half, half, color=_BAND, lw=0, label="95 % band")
    panel.plot(*style.thin(t, np.clip(error, -limit, limit)), ".", ms=2.0, color=style.MEASURED)
    panel.axhline(0.0, color=style.SIMULATED, lw=1.0)
    panel.set_ylim(-limit, limit)
    panel.set_ylabel(f"error [{channel.unit or '1'}]")
