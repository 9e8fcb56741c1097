"""What was asked of gains, and how the proposed ones fare, for stdout."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.loop_figures import FIGURES, MARGINS, OF_THE_PAPER, REQUIRED, TRACKING, LoopFigures, Requirements
from ...run_folder.design import design_json
from ..blocks import headed, plain_table
from ..numbers import short
from .fleet import of_models
from .sentence import sentence


def what_is_asked(asked: Requirements) -> str:
    """Every limit that there is."""
    limits = ((FIGURES[symbol], limit) for symbol, limit in asked.finite().items() if symbol in REQUIRED)
    return ", ".join(f"{of.name} < {limit:g} {of.unit}" for of, limit in limits)


def scenario_table(design: Design) -> RenderableType:
    """The proposed gains, scenario by scenario."""
    table = plain_table("scenario", *(f"{FIGURES[symbol].heading} {FIGURES[symbol].unit}" for symbol in TRACKING))
    for name, figures in design.chosen.scenarios.items():
        table.add_row(name, *(short(getattr(figures, symbol)) for symbol in TRACKING))
    metrics = design.chosen.nonlinear
    assert metrics is not None, "the proposed rule has gains"
    heading = f"{design.chosen.rule} in every scenario (nonlinear model)"
    return headed(heading, Group(table, Text(_cost(design, metrics))))


def _cost(design: Design, metrics: LoopFigures) -> str:
    """The figures that have no column of their own."""
    rest = {symbol: of for symbol, of in FIGURES.items() if not of.heading}
    said = (f"{of.name} {short(getattr(metrics, symbol))} {of.unit}" for symbol, of in rest.items())
    return f"{', '.join(said)}; the bridge has {design.settings.loop.bridge_ohm:g} ohm"


def outside_the_bench(design: Design) -> list[str]:
    """How the proposed gains fare where the car is not the bench."""
    robust, asked = design.robust, design.settings.conditions
    figures = [(FIGURES[symbol], float(getattr(robust.worst, symbol))) for symbol in (*OF_THE_PAPER, *MARGINS)]
    worst = ", ".join(f"{of.name} {short(value)} {of.unit}" if np.isfinite(value) else f"{of.name} never"
                      for of, value in figures)  # fmt: skip
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
