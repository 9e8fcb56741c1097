"""Panels one above the other on one time axis: what pictures of a trace have in common."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.transforms import blended_transform_factory

from ..problem.trace import Trace
from ..rig.base import Channel
from . import style

_LEFT, _RIGHT = 0.105, 0.985  # edges of the panels, shares of the width


def stack(heights: Sequence[float], synthetic: bool) -> tuple[Figure, list[Axes]]:
    """An empty figure, and its panels of these relative heights from the top."""
    tall = min(9.0, 1.1 + 0.95 * sum(heights))
    fig = style.figure(10.0, tall, synthetic)
    grid = fig.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}, squeeze=False)
    fig.subplots_adjust(left=_LEFT, right=_RIGHT, top=1.0 - 0.72 / tall, bottom=0.55 / tall, hspace=0.16)
    return fig, list(grid[:, 0])


def headed(fig: Figure, panels: Sequence[Axes], title: str, line: str) -> Figure:
    """The same with its time axis, a title, a line of figures below it, and the legend."""
    tall = float(fig.get_figheight())
    for panel in panels[:-1]:
        style.quiet_axis(panel)
    panels[-1].set_xlabel("time [s]")
    _align_labels(fig, panels)
    fig.suptitle(title, x=_LEFT, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    fig.text(_LEFT, 1.0 - 0.4 / tall, line, ha="left", va="top", fontsize=10.5)
    style.legend(fig, panels, _RIGHT, 1.0 - 0.4 / tall)
    return fig


def _align_labels(fig: Figure, panels: Sequence[Axes]) -> None:
    """Labels of the panels one above the other, left of the widest numbers.

    `Figure.align_ylabels` works out the numbers of every panel anew for each of them, a sixth of all drawing.
    """
    renderer = FigureCanvasAgg(fig).get_renderer()
    for panel in panels:
        panel.yaxis.label.set_visible(False)
    boxes = [box for panel in panels if (box := panel.yaxis.get_tightbbox(renderer)) is not None]
    left = min([box.x0 for box in boxes], default=panels[0].bbox.x0) / fig.bbox.width
    for panel in panels:
        pad = panel.yaxis.labelpad / 72.0 / fig.get_figwidth()
        panel.yaxis.label.set_visible(True)
        panel.yaxis.set_label_coords(left - pad, 0.5, blended_transform_factory(fig.transFigure, panel.transAxes))


def name_of(trace: Trace) -> str:
    """Its file, and whether it was fitted."""
    role = "held out" if trace.measurement.held_out else "fitted"
    return f"{trace.measurement.file}  ·  {role}"


def source(trace: Trace, name: str) -> Channel:
    """The logged column that a channel of the model came from; with open terminals the voltage is the EMF."""
    return trace.measurement.channels[name if name in trace.measurement.channels else "voltage"]


def drive(panel: Axes, trace: Trace, span: slice = slice(None)) -> None:
    """What drove a trace, over these of its instants: torque, or the voltage at the motor, from a duty where that was
    logged."""
    driving = trace.input
    assert driving is not None
    name, unit = ("torque", "N m") if trace.torque_driven else ("voltage", "V")
    logged, t = trace.measurement.channels.get(name), trace.instants[span]
    if logged is not None:
        seen = (logged.time >= t[0]) & (logged.time <= t[-1])
        panel.plot(*style.thin(logged.time[seen], logged.value[seen]), ".", ms=2.0, color=style.MEASURED)
    steps = "steps-post" if driving.held else "default"
    panel.plot(*style.thin(t, driving.value[span]), color=style.DRIVE, drawstyle=steps)
    panel.set_ylabel(style.unit_label("duty × supply" if logged is None else name, unit))


def signal(panel: Axes, trace: Trace, m: int, model: np.ndarray, label: str) -> None:
    """A channel as it was measured and, by `label`, as a model has it, SI, shape (n,); in the logger's unit."""
    name, t = trace.channels[m], trace.instants
    channel = source(trace, name)
    panel.plot(*style.thin(t, channel.logged(trace.data[:, m])), ".", ms=2.5, color=style.MEASURED, label="measured")
    panel.plot(*style.thin(t, channel.logged(model)), color=style.SIMULATED, label=label)
    panel.set_ylabel(style.channel_label(name, channel.unit))
