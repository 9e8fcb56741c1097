"""All pictures of a diagnosis: paths in RUN/pictures/diagnosis and drawing functions.

Pictures of its final model are `..pictures.jobs`, as for any fit. A picture of a trace has the measured channel, the
first and the final model, the errors of both below each, and the input.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...diagnosis.findings import Candidate, Diagnosis, RoundReport, Unexplained
from ...estimation.identifiability import listed
from ...problem.prediction_error import PredictionError, rows
from ...problem.trace import Trace
from .. import style
from ..drawing import Job
from ..numbers import counted, short
from ..pictures import all_traces, briefly, errors_of, file_name
from ..table import role
from ..tables import Pool
from ..traces import drive
from . import missing
from .ledger import DEGREES, QUANTITIES, Entry, Shown, headline, in_degrees, ledger, prefixed, scales

_CHANNELS = ("position", "current", "emf", "motor_speed")  # in the order of interest; at most two are drawn
_ZOOM = 0.08  # share of the trace in the zoom
_BODIES = ("throttle body of the other traces", "another throttle body")
_ROOM = 36  # letters in a legend
_SAMPLES = 60  # least number of samples in a zoom


@dataclass(frozen=True, eq=False)
class Overlay:
    """Contents of the picture."""

    trace: Trace
    # before, after: free-run simulations of the first and of the final model, SI, shape (n, M) each
    before: np.ndarray
    after: np.ndarray
    # rows_before, rows_after: their scores, one per channel
    rows_before: tuple[PredictionError, ...]
    rows_after: tuple[PredictionError, ...]
    synthetic: bool  # whether the data are synthetic
    models: tuple[str, str] = ("before", "after")  # names of the two models
    role: str = "fitted"  # role of the trace

    @classmethod
    def of_trace(cls, d: Diagnosis, trace: Trace) -> Overlay:
        """A trace with the first and the final model; a trace of another rig with the others' body and its own."""
        file, synthetic = trace.measurement.file, d.after.rig.config.synthetic
        for each in d.aside:
            if each.trace.measurement.file == file:
                was, now = (_rows_of(d, rows([trace], [model])) for model in (each.others, each.own))
                return cls(trace, each.others, each.own, was, now, synthetic, _BODIES, "of another rig")
        before, after = (np.asarray(result.predicted[file]) for result in (d.before, d.after))
        was, now = (_rows_of(d, errors_of(result, file)) for result in (d.before, d.after))
        # the final model's further effects, as far as a legend has space
        names = listed(d.added) if d.added else ""
        after_words = names if len(names) <= _ROOM else counted(len(d.added), "effect")
        models = f"before: {briefly(d.before)}", f"after: + {after_words}" if d.added else "after"
        return cls(trace, before, after, was, now, synthetic, models, role(trace.measurement.held_out))

    @property
    def channels(self) -> tuple[int, ...]:
        """Columns that are drawn."""
        ranked = sorted(self.trace.channels, key=lambda c: _CHANNELS.index(c) if c in _CHANNELS else len(_CHANNELS))
        return tuple(self.trace.channels.index(name) for name in ranked[:2])


def _rows_of(d: Diagnosis, errors: Sequence[PredictionError]) -> tuple[PredictionError, ...]:
    return in_degrees(errors, scales(d.before))


def draw_overlay(picture: Overlay) -> Figure:
    """The whole trace on the left, the worst stretch of the first model on the right."""
    heights = [h for _ in picture.channels for h in (2.1, 1.2)] + ([1.0] if picture.trace.input is not None else [])
    title = style.wrapped(_overlay_title(picture), 12.0, 13)
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
        for panel in grid[:, 0]:  # mark the zoom in the whole trace
            panel.axvspan(*picture.trace.instants[span][[0, -1]], color="#fff3c4", lw=0, zorder=0)
    _label(grid, picture)
    style.title(fig, title, bold=True)
    style.legend(fig, list(grid.ravel()), 0.085, 1.0 - (head - 0.36) / tall, "upper left")
    return fig


def _overlay_title(picture: Overlay) -> str:
    names = [picture.trace.channels[m] for m in picture.channels]
    was, now = ({row.channel: row for row in rows} for rows in (picture.rows_before, picture.rows_after))
    each = [f"{name.replace('_', ' ')} {short(was[name].rms)} → {short(now[name].rms)} {now[name].unit or '1'}"
            for name in names if name in was and name in now]  # fmt: skip
    return f"{picture.trace.measurement.file}, {picture.role}: rms error {', '.join(each)}"


def _spans(picture: Overlay) -> tuple[slice, ...]:
    """The whole trace, and, if that is much longer, the stretch with the largest error of the first model in the first
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


_ROW = 0.36  # inch


def draw_ledger(entries: Sequence[Entry], headline: str, synthetic: bool) -> Figure:
    """Held-out traces above, fitted ones below; the errors in logged units are printed beside them."""
    shown = [entry for entry in entries if entry.known()]
    heads = len({entry.held_out for entry in shown})
    fig, panel = style.titled(headline, 1.55 + _ROW * (len(shown) + heads), (0.2, 0.74), synthetic, bold=True)
    panel.axvline(1.0, color=style.MEASURED, lw=1.2, ls=":", label="noise of one sample")
    rows = _rows(panel, shown)
    _ledger_axes(panel, rows, shown)
    style.legend_above(fig, panel)
    return fig


def _rows(panel: Axes, shown: Sequence[Entry]) -> dict[int, str]:
    """Draw the errors; return the label of each row."""
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


def _ledger_axes(panel: Axes, labels: dict[int, str], shown: Sequence[Entry]) -> None:
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


_NAMED = 3  # largest number of named rejected candidates per round
_APART = 1.35  # ratio of errors above which two names do not overlap


@dataclass(frozen=True)
class RoundPoint:
    """One round of the loop."""

    label: str  # the added effect
    # fit, holdout: free-running error after it, sigma; the latter None without held-out traces
    fit: float
    holdout: float | None
    others: tuple[tuple[str, float], ...] = ()  # refitted candidates that were not added, with their errors


def steps(diagnosis: Diagnosis) -> list[RoundPoint]:
    """Errors from the first fit to the final one; between them those of the trials, before the full refit."""
    before, after = diagnosis.before, diagnosis.after
    out = [RoundPoint("start", Pool.of_rows(before.score_fit).ratio, _ratio(before.score_holdout))]
    if diagnosis.aside:
        files = "\n".join(each.trace.measurement.file for each in diagnosis.aside)
        first = diagnosis.rounds[0]
        out.append(RoundPoint(f"without\n{files}", first.fit_rms, first.holdout_rms))
    for each in diagnosis.rounds:
        others = tuple((c.effect, e) for c in each.candidates if (e := _left(c, each)) and c.effect != each.added)
        taken = next((c for c in each.candidates if c.effect == each.added), None)
        fit, holdout = each.fit_rms, each.holdout_rms
        if taken is not None:
            fit *= taken.fit_rms_ratio or 1.0
            holdout = None if holdout is None else holdout * (taken.holdout_rms_ratio or 1.0)
        out.append(RoundPoint(f"+ {each.added}" if each.added else "nothing more", fit, holdout, others))
    end = RoundPoint("final fit", Pool.of_rows(after.score_fit).ratio, _ratio(after.score_holdout))
    if out[-1].label == "nothing more":  # the last round and the final fit share one place
        end = replace(end, label="nothing more:\nfinal fit", others=out.pop().others)
    return [*out, end]


def _ratio(rows: tuple) -> float | None:
    return Pool.of_rows(rows).ratio if rows else None


def _left(candidate: Candidate, each: RoundReport) -> float | None:
    """The error of a candidate: held out, or fitted if nothing is held out."""
    if each.holdout_rms is None:
        return None if candidate.fit_rms_ratio is None else each.fit_rms * candidate.fit_rms_ratio
    return None if candidate.holdout_rms_ratio is None else each.holdout_rms * candidate.holdout_rms_ratio


def draw_rounds(every: list[RoundPoint], added: tuple[str, ...], synthetic: bool) -> Figure:
    """Error over rounds."""
    fig, panel = style.titled(_title(every, added), 5.6, (0.09, 0.97), synthetic, bold=True)
    place = np.arange(len(every))
    panel.axhline(1.0, color=style.MEASURED, lw=1.2, ls=":", label="noise of one sample")
    panel.plot(place, [s.fit for s in every], "o--", color=style.BEFORE, ms=7, label="fitted traces")
    held_out = [s.holdout if s.holdout is not None else np.nan for s in every]
    if np.isfinite(held_out).any():
        panel.plot(place, held_out, "o-", color=style.AFTER, ms=9, lw=2.2, label="held-out traces")
    led = held_out if np.isfinite(held_out).any() else [s.fit for s in every]
    for k, value in enumerate(led):
        panel.annotate(f"{short(value)} σ", (k, value), xytext=(-9, -6), textcoords="offset points", fontsize=11,
                       va="top", ha="right", fontweight="bold")  # fmt: skip
    _others(panel, every)
    _round_axes(panel, every)
    style.legend_above(fig, panel)
    return fig


def _title(every: list[RoundPoint], added: tuple[str, ...]) -> str:
    first, last = every[0], every[-1]
    which = "Held-out" if last.holdout is not None else "Fitted"
    was, now = (first.holdout, last.holdout) if last.holdout is not None else (first.fit, last.fit)
    if not added:
        return f"{which} error {short(now)} σ: nothing was added"
    return f"{which} error {short(was)} → {short(now)} σ with {listed(added)}"


def _others(panel: Axes, every: list[RoundPoint]) -> None:
    for k, step in enumerate(every):
        others = sorted(step.others, key=lambda other: other[1])
        for n, (_, error) in enumerate(others):
            panel.plot(k, error, "D", ms=6, mfc="white", color="#8c8c8c", ls="none",
                       label="refitted, not taken" if n == 0 else "_")  # fmt: skip
        for error, names in labels(others[:_NAMED]):
            last = k == len(every) - 1  # the picture ends to its right
            panel.annotate(", ".join(names), (k, error), xytext=(-7 if last else 7, 5), textcoords="offset points",
                           va="bottom", ha="right" if last else "left", fontsize=9, color="#6b6b6b")  # fmt: skip


def labels(others: list[tuple[str, float]]) -> list[tuple[float, list[str]]]:
    """Names by their errors, ascending; names that would overlap share a line."""
    lines: list[tuple[float, list[str]]] = []
    for name, error in others:
        if lines and error < _APART * lines[-1][0]:
            lines[-1][1].append(name)
        else:
            lines.append((error, [name]))
    return lines


def _round_axes(panel: Axes, every: list[RoundPoint]) -> None:
    panel.set_yscale("log")
    panel.set_xticks(range(len(every)), [step.label for step in every])
    panel.set_xlim(-0.4, len(every) - 0.3)
    low, high = panel.get_ylim()
    panel.set_ylim(min(0.7, 0.8 * low), max(2.5, 1.2 * high))
    style.log_ticks(panel.yaxis, panel.get_ylim())
    panel.set_ylabel("free-running error, rms [σ of one sample]")


def draw_unexplained(unknown: Unexplained, travel: tuple[float, float], synthetic: bool) -> Figure:
    """The curve and two standard deviations about it, over the measured range; a missing stop is infinite."""
    x, axis_unit = _along(unknown, travel)
    factor, unit = prefixed(float(np.max(np.abs(unknown.curve))), unknown.unit)
    y, sd = factor * unknown.curve, factor * unknown.sd
    fig, panel = style.titled(unknown.sentence, 5.2, (0.1, 0.985), synthetic, bold=True)
    panel.axhline(0.0, color="black", lw=0.8)
    panel.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=style.UNKNOWN, alpha=0.3, lw=0,
                       label="± 2 standard deviations")  # fmt: skip
    panel.plot(x, y, color="#8a2c6b", lw=2.4, label=f"unexplained, {short(factor * unknown.size)} {unit} rms in motion")
    axis = QUANTITIES[unknown.depends_on][0] if unknown.depends_on in QUANTITIES else unknown.depends_on
    panel.set_xlabel(style.unit_label(axis, axis_unit))
    what = "dry friction" if unknown.enters == "friction" else unknown.enters
    panel.set_ylabel(style.unit_label(f"unexplained {what}", unit))
    panel.set_xlim(float(np.min(x)), float(np.max(x)))
    panel.set_ylim(*_limits(y, sd))
    style.legend_above(fig, panel)
    return fig


def _along(unknown: Unexplained, travel: tuple[float, float]) -> tuple[np.ndarray, str]:
    """The axis in output units; an angle as a share of the travel (a missing stop is half a turn away) in degrees."""
    if unknown.depends_on == "angle" and unknown.axis_unit in ("1", ""):
        lower, upper = (stop if np.isfinite(stop) else side for stop, side in zip(travel, (-np.pi, np.pi), strict=True))
        return DEGREES * (lower + (upper - lower) * unknown.axis), "deg"
    factor, unit = prefixed(np.inf, unknown.axis_unit)
    return factor * unknown.axis, unit


def _limits(y: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """Limits for the curve, and for its band unless that is many times wider."""
    size = float(np.max(np.abs(y)))
    reach = 2.0 * np.minimum(sd, 1.5 * size)
    low, high = min(0.0, float(np.min(y - reach))), max(0.0, float(np.max(y + reach)))
    room = 0.06 * max(high - low, 1e-12)
    return low - room, high + room


_FITTED = 3  # number of drawn fitted traces in addition to the held-out ones


def jobs(diagnosis: Diagnosis) -> list[Job]:
    """Every picture: path below RUN/pictures/diagnosis, and the call that draws it."""
    return [*summary(diagnosis), *_details(diagnosis), *_overlays(diagnosis)]


def summary(d: Diagnosis) -> list[Job]:
    """The summary picture of a diagnosis, from `jobs`; none if no error is known."""
    entries = ledger(d)
    if not any(entry.known() for entry in entries):
        return []
    return [(Path("ledger.png"), partial(draw_ledger, entries, headline(d), d.after.rig.config.synthetic))]


def _details(d: Diagnosis) -> Iterator[Job]:
    synthetic = d.after.rig.config.synthetic
    for enters in ("torque", "voltage"):
        picture = missing.MissingPicture.of_diagnosis(d, enters)
        if picture is not None:
            yield Path(f"missing_{enters}.png"), partial(missing.draw, picture)
    if d.unexplained is not None:
        yield (Path("unexplained.png"), partial(draw_unexplained, d.unexplained, d.after.rig.config.travel, synthetic))
    every = steps(d)
    if d.added or any(step.others for step in every):
        yield Path("rounds.png"), partial(draw_rounds, every, d.added, synthetic)


def _overlays(d: Diagnosis) -> Iterator[Job]:
    """Traces of another rig, held-out traces, then the driven fitted traces with the largest errors of the first
    model."""
    every = all_traces(d.after)
    shown = [*(each.trace for each in d.aside), *(t for t in every if t.measurement.held_out)]
    driven = [t for t in every if not t.measurement.held_out and t.input and not t.test.boundary.plate_held]
    worst: dict[str, float] = {}
    for row in d.before.score_fit:
        worst[row.file] = max(worst.get(row.file, 0.0), row.rms / row.sigma)
    driven.sort(key=lambda trace: -worst.get(trace.measurement.file, 0.0))
    for trace in (*shown, *driven[:_FITTED]):
        yield Path("traces") / file_name(trace), partial(draw_overlay, Overlay.of_trace(d, trace))
