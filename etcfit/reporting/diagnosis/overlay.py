"""One picture per trace: measured, the first and the final model, the errors of both below each, and what drove it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...diagnosis.findings import Diagnosis
from ...estimation.identifiability import listed
from ...problem.prediction_error import PredictionError, rows
from ...problem.trace import Trace
from .. import style
from ..numbers import counted, short
from ..pictures import briefly
from ..table import role
from ..traces import drive
from .ledger import Shown, in_degrees, scales

_CHANNELS = ("position", "current", "emf", "motor_speed")  # in the order of interest; two at most are drawn
_ZOOM = 0.08  # of the trace, beside the whole of it
_BODIES = ("throttle body of the other traces", "another throttle body")
_ROOM = 36  # letters
_SAMPLES = 60  # that a zoom shows at least


@dataclass(frozen=True, eq=False)
class Overlay:
    """What the picture shows.

    Args:
        before, after: free-run simulations of the first and of the final model, SI, shape (n, M) each.
        rows_before, rows_after: their scores, a channel each.
        synthetic: the data were made up.
        models: what the two are called.
        role: of the trace.
    """

    trace: Trace
    before: np.ndarray
    after: np.ndarray
    rows_before: tuple[PredictionError, ...]
    rows_after: tuple[PredictionError, ...]
    synthetic: bool
    models: tuple[str, str] = ("before", "after")
    role: str = "fitted"

    @classmethod
    def of_trace(cls, d: Diagnosis, trace: Trace) -> Overlay:
        """A trace under the first and the final model; one of another rig under the others' body and its own."""
        file, synthetic = trace.measurement.file, d.after.rig.config.synthetic
        for each in d.aside:
            if each.trace.measurement.file == file:
                was, now = (_rows(d, rows([trace], [model])) for model in (each.others, each.own))
                return cls(trace, each.others, each.own, was, now, synthetic, _BODIES, "of another rig")
        before, after = (np.asarray(result.predicted[file]) for result in (d.before, d.after))
        was, now = (
            _rows(d, [row for row in (*result.score_fit, *result.score_holdout) if row.file == file])
            for result in (d.before, d.after)
        )
        models = f"before: {briefly(d.before)}", _after(d)
        return cls(trace, before, after, was, now, synthetic, models, role(trace.measurement.held_out))

    @property
    def channels(self) -> tuple[int, ...]:
        """Columns that are drawn."""
        ranked = sorted(self.trace.channels, key=lambda c: _CHANNELS.index(c) if c in _CHANNELS else len(_CHANNELS))
        return tuple(self.trace.channels.index(name) for name in ranked[:2])


def _after(d: Diagnosis) -> str:
    """Of the final model what it has beyond the first, as far as a legend has room for it."""
    if not d.added:
        return "after"
    names = listed(d.added)
    return f"after: + {names if len(names) <= _ROOM else counted(len(d.added), 'effect')}"


def _rows(d: Diagnosis, errors: Sequence[PredictionError]) -> tuple[PredictionError, ...]:
    return in_degrees(errors, scales(d.before))


def draw(picture: Overlay) -> Figure:
    """Left the whole trace, right where the first model was worst."""
    heights = [h for _ in picture.channels for h in (2.1, 1.2)] + ([1.0] if picture.trace.input is not None else [])
    title = style.wrapped(_title(picture), 12.0, 13)
    head = 0.95 + 0.24 * title.count("\n")
    tall = head + 0.55 + 1.02 * sum(heights)
    fig = style.figure(12.0, tall, picture.synthetic)
    spans = _spans(picture)
    ratios = {"height_ratios": heights, "width_ratios": (1.7, 1.0)[: len(spans)]}
    grid = fig.subplots(len(heights), len(spans), sharex="col", squeeze=False, gridspec_kw=ratios)
    fig.subplots_adjust(left=0.085, right=0.985, top=1.0 - head / tall, bottom=0.55 / tall, hspace=0.14, wspace=0.13)
    for column, span in enumerate(spans):
        for row, m in enumerate(picture.channels):
            _model(grid[2 * row, column], picture, m, span)
            _error(grid[2 * row + 1, column], picture, m, span)
        if picture.trace.input is not None:
            drive(grid[-1, column], picture.trace, span)
            grid[-1, column].set_ylabel("" if column else grid[-1, column].get_ylabel())
        grid[-1, column].tick_params(labelbottom=True)
        grid[-1, column].set_xlabel("time [s]" if column == 0 else "time [s], where the first model was worst")
    for span in spans[1:]:
        for panel in grid[:, 0]:  # where the zoom lies in the whole
            panel.axvspan(*picture.trace.instants[span][[0, -1]], color="#fff3c4", lw=0, zorder=0)
    _label(grid, picture)
    style.title(fig, title, bold=True)
    style.legend(fig, list(grid.ravel()), 0.085, 1.0 - (head - 0.36) / tall, "upper left")
    return fig


def _title(picture: Overlay) -> str:
    names = [picture.trace.channels[m] for m in picture.channels]
    was, now = ({row.channel: row for row in rows} for rows in (picture.rows_before, picture.rows_after))
    each = [f"{name.replace('_', ' ')} {short(was[name].rms)} → {short(now[name].rms)} {now[name].unit or '1'}"
            for name in names if name in was and name in now]  # fmt: skip
    return f"{picture.trace.measurement.file}, {picture.role}: rms error {', '.join(each)}"


def _spans(picture: Overlay) -> tuple[slice, ...]:
    """The whole trace, and, where that is much longer, the stretch in which the first model errs most in the first
    channel."""
    n, m = picture.trace.instants.size, picture.channels[0]
    width = min(n, max(_SAMPLES, round(_ZOOM * n)))
    error = np.nan_to_num(picture.trace.data[:, m] - picture.before[:, m])
    power = np.convolve(error**2, np.ones(width), mode="valid")
    first = int(np.argmax(power))
    zoom = slice(first, first + width)
    return (slice(0, n), zoom) if 3 * width < n else (slice(0, n),)


def _model(panel: Axes, picture: Overlay, m: int, span: slice) -> None:
    trace, shown = picture.trace, Shown.of_channel(picture.trace, picture.trace.channels[m])
    t = trace.instants[span]
    panel.plot(*style.thin(t, shown(trace.data[span, m])), ".", ms=5, mew=0, color="#8c8c8c", label="measured")
    first, final = picture.models
    panel.plot(*style.thin(t, shown(picture.before[span, m])), color=style.BEFORE, lw=1.8, label=first)
    panel.plot(*style.thin(t, shown(picture.after[span, m])), color=style.AFTER, lw=1.2, label=final)
    style.quiet_axis(panel)


def _error(panel: Axes, picture: Overlay, m: int, span: slice) -> None:
    trace, shown = picture.trace, Shown.of_channel(picture.trace, picture.trace.channels[m])
    sigma = 2.0 * float(trace.sigma[m]) / abs(shown.size)
    panel.axhspan(-sigma, sigma, color=style.BAND, lw=0, label="± 2 σ of the noise")
    for model, color in ((picture.before, style.BEFORE), (picture.after, style.AFTER)):
        error = (trace.data[span, m] - model[span, m]) / shown.size
        panel.plot(*style.thin(trace.instants[span], error), ".", ms=2.5, color=color)
    panel.axhline(0.0, color="black", lw=0.8)
    style.quiet_axis(panel)


def _label(grid: np.ndarray, picture: Overlay) -> None:
    for row, m in enumerate(picture.channels):
        name = picture.trace.channels[m]
        unit = Shown.of_channel(picture.trace, name).unit
        grid[2 * row, 0].set_ylabel(style.unit_label(name, unit))
        grid[2 * row + 1, 0].set_ylabel(style.unit_label("error", unit))
    grid[0, 0].figure.align_ylabels(grid[:, 0])
    for panel in grid[0]:
        panel.margins(x=0.01)
