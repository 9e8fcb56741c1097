"""Posterior predictive band of a trace: what was measured within it, and how much of that lies inside."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...estimation.intervals import Z_95
from ...posterior.sampling import Band
from .. import style
from ..stack import headed, name_of, signal, source, stack

_BAND = "#f2c49b"
_SHOWN = 0.998  # of the errors lie inside their panel


def draw(band: Band, synthetic: bool) -> Figure:
    """Two panels a channel: the signal, and measured - predicted with the band about zero."""
    trace = band.trace
    heights = [h for _ in trace.channels for h in (1.7, 1.3)]
    fig, panels = stack(heights, synthetic)
    for m in range(len(trace.channels)):
        signal(panels[2 * m], trace, m, band.mean[:, m], "posterior mean")
        _error(panels[2 * m + 1], band, m)
    return headed(fig, panels, f"{name_of(trace)}, posterior predictive", _inside(band))


def _inside(band: Band) -> str:
    each = (f"{name.replace('_', ' ')} {100.0 * share:.1f} %"
            for name, share in zip(band.trace.channels, band.inside, strict=True))  # fmt: skip
    return "inside the 95 % band: " + ", ".join(each)


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
