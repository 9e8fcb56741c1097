"""One picture per trace: measured and simulated, the residual in sigma below each, and what drove it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from . import style
from .numbers import short
from .stack import drive, headed, name_of, signal, source, stack

_FLOOR = 4.0  # sigma; a residual panel shows at least so much
_SHOWN = 0.998  # of the residuals lie inside the panel; the few beyond are counted on its edge


@dataclass(frozen=True, eq=False)
class TracePicture:
    """What a trace's picture shows.

    Args:
        trace: as measured.
        predicted: free-run simulation, SI, shape (n, M).
        residual: in sigma, shape (n, M).
        residual_label: what the residual is.
        rows: score of each channel.
        synthetic: the data were made up.
        model: that simulates, in words.
    """

    trace: Trace
    predicted: np.ndarray
    residual: np.ndarray
    residual_label: str
    rows: tuple[PredictionError, ...]
    synthetic: bool
    model: str = "the model"


def draw(picture: TracePicture) -> Figure:
    """The picture, panels one above the other on one time axis."""
    trace = picture.trace
    heights = [h for _ in trace.channels for h in (2.1, 1.0)] + ([1.1] if trace.input is not None else [])
    fig, panels = stack(heights, picture.synthetic)
    for m in range(len(trace.channels)):
        _channel(panels[2 * m], picture, m)
        _residual(panels[2 * m + 1], picture, m)
    if trace.input is not None:
        drive(panels[-1], trace)
    begin, end = trace.instants[[0, -1]]
    panels[-1].set_xlim(begin - 0.01 * (end - begin), end + 0.01 * (end - begin))
    return headed(fig, panels, f"{name_of(trace)}  ·  {picture.model}", _errors(picture.rows))


def _errors(rows: tuple[PredictionError, ...]) -> str:
    each = [f"{row.channel.replace('_', ' ')} {short(row.rms)} {row.unit} ({short(row.rms / row.sigma, 2)} σ)"
            for row in rows]  # fmt: skip
    return "rms error: " + ", ".join(each)


def _channel(panel: Axes, picture: TracePicture, m: int) -> None:
    trace, name = picture.trace, picture.trace.channels[m]
    signal(panel, trace, m, picture.predicted[:, m], "simulated")
    if name == "position" and "setpoint" in trace.measurement.channels:
        channel, setpoint = source(trace, name), trace.measurement.channels["setpoint"]
        panel.plot(*style.thin(setpoint.time, channel.logged(setpoint.value)), color=style.READING, lw=1.0,
                   ls="--", label="setpoint")  # fmt: skip


def _residual(panel: Axes, picture: TracePicture, m: int) -> None:
    trace = picture.trace
    up = np.sign(source(trace, trace.channels[m]).scale)  # a sensor that falls as the plate opens turns the sign
    t, r = trace.instants, np.where(np.isfinite(trace.data[:, m]), up * picture.residual[:, m], np.nan)
    size = np.abs(r[np.isfinite(r)])
    limit = max(_FLOOR, 1.15 * float(np.quantile(size, _SHOWN, method="lower"))) if size.size else _FLOOR
    panel.axhspan(-2.0, 2.0, color=style.BAND, lw=0)
    panel.plot(*style.thin(t, np.clip(r, -limit, limit)), ".", ms=2.0, color=style.MEASURED)
    panel.axhline(0.0, color=style.SIMULATED, lw=1.0)
    panel.set_ylim(-limit, limit)
    panel.yaxis.set_major_locator(MaxNLocator(4, integer=True, symmetric=True))
    panel.set_ylabel(picture.residual_label)
    beyond = int(np.sum(size > limit))
    if beyond:
        text = f"{beyond} beyond, to {short(float(size.max()), 2)} σ"
        panel.text(0.995, 0.94, text, transform=panel.transAxes, ha="right", va="top", fontsize=9,
                   bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.8})  # fmt: skip
