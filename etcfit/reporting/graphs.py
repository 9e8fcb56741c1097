"""One picture per rig test: the paper's graphs as read, and the fitted model read in the very same way.

The fitted model's line comes from simulated traces put through the same reading, so that a new rig test gets its
overlay without a word here, and what the reading itself distorts distorts both lines alike.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..problem.trace import Trace
from ..rig.base import AbstractRigTest, Channel, Graph, Measurement, RigConfig
from . import style
from .stack import source

_MOST_GRAPHS = 6
_MOST_TRACES = 12
_POINTS = 2000  # of a scatter plot


@dataclass(frozen=True, eq=False)
class TestPicture:
    """What a rig test's picture shows.

    Args:
        test: the rig test.
        graphs: as read from the measured traces.
        model: as read from the simulated ones, in any order.
        traces: all traces of the test.
        predicted: their simulations by file, SI, shape (n, M) each.
        lines: what was read and what was fitted, a line a parameter.
        synthetic: the data were made up.
        model_words: the fitted model, in words.
    """

    test: AbstractRigTest
    graphs: tuple[Graph, ...]
    model: tuple[Graph, ...]
    traces: tuple[Trace, ...]
    predicted: Mapping[str, np.ndarray]
    lines: tuple[str, ...]
    synthetic: bool
    model_words: str = "the model"


def simulated(trace: Trace, predicted: np.ndarray) -> Measurement:
    """The trace as it would have been logged had the fitted model been measured, without noise."""
    channels = dict(trace.measurement.channels)
    for m, name in enumerate(trace.channels):
        logged = name if name in channels else "voltage"
        seen = np.isfinite(trace.data[:, m])
        channels[logged] = replace(channels[logged], value=predicted[seen, m])
    if trace.input is not None and not trace.torque_driven and "voltage" in channels:
        channels["voltage"] = _without_noise(channels["voltage"], trace)
    return replace(trace.measurement, channels=channels)


def _without_noise(voltage: Channel, trace: Trace) -> Channel:
    assert trace.input is not None
    return replace(voltage, value=np.interp(voltage.time, trace.instants, trace.input.value))


def read_model(
    test: AbstractRigTest,
    traces: Sequence[Trace],
    predicted: Mapping[str, np.ndarray],
    config: RigConfig,
    known: Mapping[str, float],
) -> tuple[Graph, ...]:
    """The test's graphs of the fitted model; none where it could not be simulated.

    Args:
        known: what the readings of the measured traces knew, so that both use the same scales.
    """
    used = [trace for trace in traces if not trace.measurement.held_out]
    if not used or not all(np.isfinite(predicted[t.measurement.file]).all() for t in used):
        return ()
    return test.reading([simulated(t, predicted[t.measurement.file]) for t in used], config, known).graphs


def draw(picture: TestPicture) -> Figure:
    """The graphs; where a test has none, its traces, measured and simulated."""
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
    _head(fig, panels, picture, tall)
    return fig


def _head(fig: Figure, panels: Sequence[Axes], picture: TestPicture, tall: float) -> None:
    shown, there = sum(panel.axison for panel in panels), len(picture.graphs) or len(picture.traces)
    count = f"  ·  {shown} of {there} shown" if shown < there else ""
    fig.suptitle(
        f"{picture.test.title}  ·  {picture.model_words}{count}",
        x=0.015,
        y=1.0 - 0.1 / tall,
        ha="left",
        va="top",
        fontsize=13,
    )
    fig.text(0.015, 1.0 - 0.42 / tall, "\n".join(picture.lines), ha="left", va="top", fontsize=10, linespacing=1.35)
    style.legend(fig, panels, 0.01, 1.0 - (0.47 + 0.2 * len(picture.lines)) / tall, "upper left")


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
        name, channel = trace.channels[m], source(trace, trace.channels[m])
        t, model = trace.instants, predicted[trace.measurement.file][:, m]
        panel.plot(*style.thin(t, channel.logged(trace.data[:, m])), ".", ms=2, color=style.MEASURED, label="measured")
        panel.plot(*style.thin(t, channel.logged(model)), color=style.SIMULATED, label="simulated")
        panel.set(xlabel="time [s]", ylabel=style.channel_label(name, channel.unit))
        role = ", held out" if trace.measurement.held_out else ""
        panel.set_title(trace.measurement.file.partition("/")[2] + role, fontsize=9.5, loc="left")
