"""What was asked of gains, and how the proposed ones fare, for stdout."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.pid.requirements import OF_THE_PAPER, REQUIRED, Requirements
from ...run_folder import design_json
from ..blocks import headed, plain_table
from ..numbers import short
from .fleet import of_models
from .sentence import sentence
from .words import WORDS


def what_is_asked(asked: Requirements) -> str:
    """Every limit that there is."""
    limits = {symbol: getattr(asked, symbol) for symbol in REQUIRED}
    return ", ".join(f"{WORDS[symbol][0]} < {limit:g} {WORDS[symbol][1]}" for symbol, limit in limits.items()
                     if np.isfinite(limit))  # fmt: skip


def scenario_table(design: Design) -> RenderableType:
    """The proposed gains, scenario by scenario."""
    table = plain_table("scenario", "overshoot %", "settling s", "error %", "RMSE %")
    for name, figures in design.chosen.scenarios.items():
        table.add_row(name, *(short(value) for value in figures))
    metrics = design.chosen.nonlinear
    assert metrics is not None, "the proposed rule has gains"
    heat = (f"current {short(metrics.current_rms_A)} A, root mean square: {short(metrics.winding_W)} W in the "
            f"winding, {short(metrics.bridge_W)} W in a bridge of {design.settings.loop.bridge_ohm:g} ohm")  # fmt: skip
    return headed(f"{design.chosen.rule} in every scenario (nonlinear model)", Group(table, Text(heat)))


def outside_the_bench(design: Design) -> list[str]:
    """How the proposed gains fare where the car is not the bench."""
    robust, asked = design.robust, design.settings.conditions
    shown = (*OF_THE_PAPER, "gain_margin_db", "phase_margin_deg")
    figures = [(*WORDS[key], float(getattr(robust.worst, key))) for key in shown]
    worst = ", ".join(f"{name} {short(value)} {unit}" if np.isfinite(value) else f"{name} never"
                      for name, unit, value in figures)  # fmt: skip
    reckons = ("the ECU divides by the battery voltage" if design.task.ecu.compensated else
               "a duty is a share of the supply that there is")  # fmt: skip
    ranges = (f"supply {_range(asked.supply)} V, winding {_range(asked.winding)} degrees Celsius, dry friction "
              f"{_range(asked.friction)} times the bench's; {reckons}")  # fmt: skip
    met = "met at every corner" if robust.meets_all else "not met at every corner"
    share = f"{robust.probability_met:.2f} of the {of_models(design)}, each under conditions of its own, meet them"
    supply, winding, friction = robust.corner
    return [
        f"{ranges}: requirements {met}; {share}",
        f"worst of the corners: {worst}; hardest at {supply:g} V, {winding:g} degrees Celsius, friction {friction:g}",
    ]


def _range(ends: tuple[float, ...]) -> str:
    return f"{ends[0]:g} to {ends[1]:g}"


def against_effort(design: Design) -> list[str]:
    """What a calmer duty would cost, and what gains without any reserve would win."""
    figures, points = design.chosen.nonlinear, design.front
    assert figures is not None, "the proposed rule has gains"
    calm = dict.fromkeys((short(point.rmse), short(point.activity, 2)) for point in points if point.meets)
    said = [f"proposed: RMSE {short(figures.rmse_pct)} % at a duty that moves {short(figures.duty_activity_pct, 2)} %"]
    if calm:
        said.append("within everything else that is required, on the nominal model: " + "; ".join(
            f"{rmse} % at {activity} %" for rmse, activity in calm))  # fmt: skip
    return said


def answer(design: Design) -> str:
    """The verdict on the proposed gains in one sentence, see `sentence`."""
    return sentence(design_json(design))
