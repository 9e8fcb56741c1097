"""One picture of every rule: setpoint and response on the linear model and over draws of the nonlinear one."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...control.design import Design
from ...control.judged import PAPERS_SETPOINT, Tuned
from ...control.parts_verdict import OnParts
from .. import style
from ..numbers import short
from .fleet import of_models

_COLUMNS = 2


def draw(design: Design) -> Figure:
    """A panel a rule; the proposed one says so."""
    shown = [tuned for tuned in design.tuned.values() if tuned.gains is not None]
    rows = -(-len(shown) // _COLUMNS)
    tall = 1.35 + 2.25 * rows
    fig = style.figure(12.0, tall, design.fitted.config.synthetic)
    grid = fig.subplots(rows, _COLUMNS, sharex=True, sharey=True, squeeze=False)
    fig.subplots_adjust(left=0.07, right=0.985, top=1.0 - 0.95 / tall, bottom=0.55 / tall, hspace=0.3, wspace=0.06)
    panels = list(grid.flat)
    for panel, tuned in zip(panels, shown, strict=False):
        _panel(panel, design, tuned)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    _axes(panels[: len(shown)])
    own = design.fitted.config.notation
    unit = "Kp / Ki / Kd in V, rad, s" if own is None else f"P / I / D in {own.title}"
    title = f"{design.fitted.config.name}  ·  every rule on the paper's trapezoid  ·  {unit}"
    fig.suptitle(title, x=0.07, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    style.legend(fig, panels[:1], 0.07, 1.0 - 0.4 / tall, "upper left")
    style.caution(fig, design.fitted.state.cautions, 1.0 - 0.3 / tall)
    return fig


def _panel(panel: Axes, design: Design, tuned: Tuned) -> None:
    assert tuned.band is not None, "a rule with gains has been tried"
    assert tuned.linear_path is not None, "a rule with gains has been tried"
    time = PAPERS_SETPOINT.instants(design.task.ecu.period)  # the first of the scenarios
    panel.plot(time, 100.0 * PAPERS_SETPOINT.at(time), color=style.MEASURED, lw=1.2, label="setpoint")
    panel.plot(time, 100.0 * _bounded(tuned.linear_path), color=style.READING, lw=1.1, ls="--",
               label="linear model")  # fmt: skip
    draw_band(panel, time, tuned.band[:, : time.size], of_models(design))
    panel.set_title(_title(design, tuned), loc="left", fontsize=10)
    if design.parts is not None:
        panel.text(0.99, 0.95, _on_parts(design.parts.rules[tuned.rule]), transform=panel.transAxes, ha="right",
                   va="top", fontsize=9)  # fmt: skip


def _on_parts(each: OnParts) -> str:
    measured, drawn = each.measured.share, each.drawn.share
    return f"met by {100.0 * drawn.value:.1f} % of drawn parts, {measured.met} of {measured.of} measured"


def draw_band(panel: Axes, time: np.ndarray, band: np.ndarray, models: str) -> None:
    """What the draws of the nonlinear model do, or the units of a fleet: quantiles of `Tuned.band`.

    Args:
        panel: to draw in.
        time: s, shape (K,).
        band: at these instants, shape (3, K).
        models: "draws" or "units".
    """
    low, middle, high = 100.0 * band
    panel.fill_between(time, low, high, color=style.SIMULATED, alpha=0.35, lw=0, label=f"95 % of the {models}")
    panel.plot(time, middle, color=style.SIMULATED, label="nonlinear model, median")


def _bounded(path: np.ndarray) -> np.ndarray:
    """A path up to where an unstable loop has left the travel; it would only fill the panel."""
    gone = np.maximum.accumulate(~(np.abs(path - 0.5) < 1.0))
    return np.where(gone, np.nan, path)


def _title(design: Design, tuned: Tuned) -> str:
    assert tuned.gains is not None, "a rule that refused is not drawn"
    assert tuned.nonlinear is not None, "a rule with gains has been tried"
    own = design.fitted.config.notation
    gains = " / ".join(short(g) for g in (tuned.gains if own is None else design.written(tuned.gains, own)))
    name = tuned.rule.replace("_", " ") + (" (proposed)" if tuned is design.chosen else "")
    return f"{name}:  {gains}   RMSE {short(tuned.nonlinear.rmse_pct)} %, {_verdict(design, tuned)}"


def _verdict(design: Design, tuned: Tuned) -> str:
    if not tuned.stable:
        return "UNSTABLE"
    assert tuned.probability_met is not None, "a rule with gains has been tried"
    if design.origin == "fleet":
        every = design.fleet if tuned is design.chosen else None  # only the proposed gains are tried on all units
        return f"met by {100.0 * (tuned.probability_met if every is None else every.share.value):.1f} %"
    return f"{'meets all' if tuned.meets_all else 'misses'}, P = {tuned.probability_met:.2f}"


def _axes(panels: list[Axes]) -> None:
    shares = 100.0 * np.array(PAPERS_SETPOINT.shares)
    span = float(np.ptp(shares))
    panels[0].set_ylim(shares.min() - 0.3 * span, shares.max() + 0.5 * span)
    panels[0].set_xlim(PAPERS_SETPOINT.judged_from - 0.1, PAPERS_SETPOINT.duration)
    for k, panel in enumerate(panels):
        if k % _COLUMNS == 0:
            panel.set_ylabel("position [% travel]")
        if k >= len(panels) - _COLUMNS:
            panel.set_xlabel("time [s]")
            panel.tick_params(labelbottom=True)  # also where the panel below it is left out
