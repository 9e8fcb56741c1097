"""Pictures of a trace and of a rig test: panels one above the other on one time axis; the paper's graphs.

The fitted model's line in a graph comes from simulated traces with the same reading, so that a new rig test gets its
overlay automatically, and errors of the reading affect both lines equally.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import blended_transform_factory

from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from ..rig.base import AbstractRigTest, Channel, Graph, Measurement, RigConfig
from . import style
from .numbers import short
from .table import role

_LEFT, _RIGHT = 0.105, 0.985  # edges of the panels, shares of the width


def stack(heights: Sequence[float], synthetic: bool) -> tuple[Figure, list[Axes]]:
    """An empty figure, and its panels of these relative heights from the top."""
    tall = min(9.0, 1.1 + 0.95 * sum(heights))
    fig = style.figure(10.0, tall, synthetic)
    grid = fig.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights}, squeeze=False)
    fig.subplots_adjust(left=_LEFT, right=_RIGHT, top=1.0 - 0.72 / tall, bottom=0.55 / tall, hspace=0.16)
    return fig, list(grid[:, 0])


def headed(fig: Figure, panels: Sequence[Axes], title: str, line: str) -> Figure:
    """The figure with its time axis, a title, a line of figures below it, and the legend."""
    tall = float(fig.get_figheight())
    for panel in panels[:-1]:
        style.quiet_axis(panel)
    panels[-1].set_xlabel("time [s]")
    _align_labels(fig, panels)
    style.title(fig, title, _LEFT)
    fig.text(_LEFT, 1.0 - 0.4 / tall, line, ha="left", va="top", fontsize=10.5)
    style.legend(fig, panels, _RIGHT, 1.0 - 0.4 / tall)
    return fig


def _align_labels(fig: Figure, panels: Sequence[Axes]) -> None:
    """Align the labels of the panels, left of the widest numbers.

    `Figure.align_ylabels` computes the numbers of every panel again for each panel, a sixth of all drawing time.
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
    return f"{trace.measurement.file}  ·  {role(trace.measurement.held_out)}"


def source(trace: Trace, name: str) -> Channel:
    """The logged column of a channel of the model; with open terminals the voltage is the EMF."""
    return trace.measurement.channels[name if name in trace.measurement.channels else "voltage"]


def drive(panel: Axes, trace: Trace, span: slice = slice(None)) -> None:
    """The input of a trace at these of its instants: torque, or the voltage at the motor, from a duty if that was
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
    """The measured channel and, by `label`, those of models, SI, shape (n,); drawn in the logger's unit."""
    name, t = trace.channels[m], trace.instants
    channel = source(trace, name)
    panel.plot(*style.thin(t, channel.logged(trace.data[:, m])), ".", ms=2.5, color=style.MEASURED, label="measured")
    panel.plot(*style.thin(t, channel.logged(model)), color=style.SIMULATED, label=label)
    panel.set_ylabel(style.channel_label(name, channel.unit))


_FLOOR = 4.0  # sigma; least range of a residual panel
_SHOWN = 0.998  # share of the residuals inside the panel; the others are counted at its edge


@dataclass(frozen=True, eq=False)
class TracePicture:
    """Contents of a trace's picture."""

    trace: Trace
    predicted: np.ndarray  # free-run simulation, SI, shape (n, M)
    residual: np.ndarray  # residual in sigma, shape (n, M)
    residual_label: str  # label of the residual
    rows: tuple[PredictionError, ...]  # score of each channel
    synthetic: bool  # whether the data are synthetic
    model: str = "the model"  # the simulated model, in words


def draw_trace(picture: TracePicture) -> Figure:
    """The picture, panels one above the other on one time axis."""
    trace = picture.trace
    heights = [h for _ in trace.channels for h in (2.1, 1.0)] + ([1.1] if trace.input is not None else [])
    fig, panels = stack(heights, picture.synthetic)
    for m, name in enumerate(trace.channels):
        signal(panels[2 * m], trace, m, picture.predicted[:, m], "simulated")
        if name == "position" and "setpoint" in trace.measurement.channels:
            channel, setpoint = source(trace, name), trace.measurement.channels["setpoint"]
            panels[2 * m].plot(*style.thin(setpoint.time, channel.logged(setpoint.value)), color=style.READING, lw=1.0,
                               ls="--", label="setpoint")  # fmt: skip
        _residual(panels[2 * m + 1], picture, m)
    if trace.input is not None:
        drive(panels[-1], trace)
    each = [f"{row.channel.replace('_', ' ')} {short(row.rms)} {row.unit} ({short(row.rms / row.sigma, 2)} σ)"
            for row in picture.rows]  # fmt: skip
    begin, end = trace.instants[[0, -1]]
    panels[-1].set_xlim(begin - 0.01 * (end - begin), end + 0.01 * (end - begin))
    return headed(fig, panels, f"{name_of(trace)}  ·  {picture.model}", "rms error: " + ", ".join(each))


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


_MOST_GRAPHS = 6
_MOST_TRACES = 12
_POINTS = 2000  # of a scatter plot


@dataclass(frozen=True, eq=False)
class TestPicture:
    """Contents of a rig test's picture."""

    test: AbstractRigTest  # the rig test
    graphs: tuple[Graph, ...]  # graphs of the measured traces
    model: tuple[Graph, ...]  # graphs of the simulated traces, in any order
    traces: tuple[Trace, ...]  # all traces of the test
    predicted: Mapping[str, np.ndarray]  # their simulations by file, SI, shape (n, M) each
    lines: tuple[str, ...]  # reading and fitted value, one line per parameter
    synthetic: bool  # whether the data are synthetic
    model_words: str = "the model"  # the fitted model, in words


def simulated(trace: Trace, predicted: np.ndarray) -> Measurement:
    """The trace that a noise-free measurement of the fitted model would give."""
    channels = dict(trace.measurement.channels)
    for m, name in enumerate(trace.channels):
        logged = name if name in channels else "voltage"
        seen = np.isfinite(trace.data[:, m])
        channels[logged] = replace(channels[logged], value=predicted[seen, m])
    if trace.input is not None and not trace.torque_driven and "voltage" in channels:
        voltage = channels["voltage"]
        channels["voltage"] = replace(voltage, value=np.interp(voltage.time, trace.instants, trace.input.value))
    return replace(trace.measurement, channels=channels)


def read_model(
    test: AbstractRigTest,
    traces: Sequence[Trace],
    predicted: Mapping[str, np.ndarray],
    config: RigConfig,
    known: Mapping[str, float],
) -> tuple[Graph, ...]:
    """The test's graphs of the fitted model; none if it could not be simulated.

    Args:
        known: parameters known to the readings of the measured traces, so that both use the same scales.
    """
    used = [trace for trace in traces if not trace.measurement.held_out]
    if not used or not all(np.isfinite(predicted[t.measurement.file]).all() for t in used):
        return ()
    return test.reading([simulated(t, predicted[t.measurement.file]) for t in used], config, known).graphs


def draw_test(picture: TestPicture) -> Figure:
    """The graphs or, for a test without graphs, its measured and simulated traces."""
    graphs, traces = picture.graphs[:_MOST_GRAPHS], picture.traces[:_MOST_TRACES]
    count = len(graphs) or len(traces)
    columns = min(count, 3 if count > 4 else 2)
    rows = -(-count // columns)
    head = 0.8 + 0.2 * len(picture.lines)
    tall = head + 3.1 * rows if columns > 1 else head + 4.6
    fig = style.figure(11.0 if columns > 1 else 8.5, tall, picture.synthetic)
    fig.set_layout_engine("constrained", rect=(0.0, 0.0, 1.0, 1.0 - head / tall), h_pad=0.08, w_pad=0.08)
    panels: list[Axes] = list(fig.subplots(rows, columns, squeeze=False).ravel())
    if graphs:
        _graphs(panels, graphs, picture.model)
    else:
        _traces(panels, traces, picture.predicted)
    for panel in panels[count:]:
        panel.set_axis_off()
    there = len(picture.graphs) or len(picture.traces)
    shown = f"  ·  {count} of {there} shown" if count < there else ""
    style.title(fig, f"{picture.test.title}  ·  {picture.model_words}{shown}")
    fig.text(0.015, 1.0 - 0.42 / tall, "\n".join(picture.lines), ha="left", va="top", fontsize=10, linespacing=1.35)
    style.legend(fig, panels, 0.01, 1.0 - (0.47 + 0.2 * len(picture.lines)) / tall, "upper left")
    return fig


def _graphs(panels: Sequence[Axes], graphs: Sequence[Graph], model: Sequence[Graph]) -> None:
    waiting: dict[str, list[Graph]] = {}
    for graph in model:
        waiting.setdefault(graph.title, []).append(graph)
    for panel, graph in zip(panels, graphs, strict=False):
        stride = max(1, graph.x.size // _POINTS)
        panel.plot(graph.x[::stride], graph.y[::stride], ".", ms=4 if graph.x.size > 30 else 9, color=style.MEASURED,
                   label="measured")  # fmt: skip
        panel.plot(*style.broken(graph.line_x, graph.line_y), color=style.READING, label="graph reading")
        if twins := waiting.get(graph.title):
            twin = twins.pop(0)
            panel.plot(*style.broken(twin.line_x, twin.line_y), "--", color=style.SIMULATED,
                       label="fitted model, read the same way")  # fmt: skip
        panel.set(xlabel=graph.x_label, ylabel=graph.y_label)
        of = graph.title.rpartition(", ")
        panel.set_title(f"{of[2]}\n{graph.says}" if of[1] else graph.says, fontsize=9.5, loc="left")


def _traces(panels: Sequence[Axes], traces: Sequence[Trace], predicted: Mapping[str, np.ndarray]) -> None:
    for panel, trace in zip(panels, traces, strict=False):
        m = trace.channels.index("position") if "position" in trace.channels else 0
        signal(panel, trace, m, predicted[trace.measurement.file][:, m], "simulated")
        panel.set_xlabel("time [s]")
        role = ", held out" if trace.measurement.held_out else ""
        panel.set_title(trace.measurement.file.partition("/")[2] + role, fontsize=9.5, loc="left")
