"""The proposed gains in every scenario: setpoint, and response over draws of the nonlinear model."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...control.design import Design
from ...control.pid.figures import LoopFigures
from .. import style
from ..numbers import short
from .fleet import of_models
from .responses import draw_band

_COLUMNS = 2
_BEFORE = 0.05  # s shown ahead of the first change


def draw(design: Design) -> Figure:
    """A panel a scenario."""
    names = design.setpoint.scenarios
    rows = -(-len(names) // _COLUMNS)
    tall = 1.3 + 3.0 * rows
    fig = style.figure(12.0, tall, design.fitted.config.synthetic)
    panels = list(fig.subplots(rows, _COLUMNS, squeeze=False).flat)
    fig.subplots_adjust(left=0.07, right=0.985, top=1.0 - 1.2 / tall, bottom=0.6 / tall, hspace=0.55, wspace=0.16)
    for panel, name in zip(panels, names, strict=False):
        _panel(panel, design, name)
    for panel in panels[len(names) :]:
        panel.set_visible(False)
    title = f"{design.fitted.config.name}  ·  {design.chosen.rule.replace('_', ' ')} in every scenario"
    fig.suptitle(title, x=0.07, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13)
    style.legend(fig, panels[:1], 0.07, 1.0 - 0.42 / tall, "upper left")
    style.caution(fig, design.fitted.state.cautions, 1.0 - 0.3 / tall)
    return fig


def _panel(panel: Axes, design: Design, name: str) -> None:
    chosen, setpoint = design.chosen, design.setpoint
    assert chosen.band is not None, "the proposed rule has been tried"
    parts = [part for part in (*setpoint.levels, *setpoint.stretches) if part.scenario == name]
    begin, end = min(part.begins for part in parts) - _BEFORE, max(part.ends for part in parts)
    time = setpoint.instants(design.task.ecu.period)
    seen = (time >= begin) & (time < end - 0.5 * design.task.ecu.period)  # there the next scenario begins
    since = time[seen] - begin
    panel.plot(since, 100.0 * setpoint.at(time[seen]), color=style.MEASURED, lw=1.2, label="setpoint")
    draw_band(panel, since, chosen.band[:, seen], of_models(design))
    panel.set_title(f"{name}\n{_says(chosen.scenarios[name])}", loc="left", fontsize=10)
    panel.set(xlabel="time [s]", ylabel="position [% travel]", xlim=(0.0, end - begin))


def _says(figures: LoopFigures) -> str:
    if np.isnan(figures.overshoot_pct):
        return f"RMSE {short(figures.rmse_pct)} %"
    settled = f"settled in {short(figures.settling_s)} s" if np.isfinite(figures.settling_s) else "not settled"
    return (
        f"overshoot {short(figures.overshoot_pct, 2)} %, {settled}, error {short(figures.steady_state_error_pct, 2)} %"
    )
