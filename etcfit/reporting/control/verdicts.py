"""What was asked of gains, and how the proposed ones fare, for stdout."""

from __future__ import annotations

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from ...control.design import Design
from ...control.pid.requirements import Requirements
from ..blocks import headed, plain_table
from ..numbers import short
from .fleet import of_models


def what_is_asked(asked: Requirements) -> str:
    """Every limit that there is."""
    names = {
        "overshoot_pct": ("overshoot", "%"),
        "settling_s": ("settling", "s"),
        "steady_state_error_pct": ("steady-state error", "%"),
        "duty_activity_pct": ("duty", "%"),
        "current_rms_A": ("rms current", "A"),
        "winding_W": ("heat in the winding", "W"),
        "bridge_W": ("heat in the bridge", "W"),
    }
    limits = {symbol: getattr(asked, symbol) for symbol in names}
    return ", ".join(f"{name} < {limits[symbol]:g} {unit}" for symbol, (name, unit) in names.items()
                     if np.isfinite(limits[symbol]))  # fmt: skip


def scenario_table(design: Design) -> RenderableType:
    """The proposed gains, scenario by scenario."""
    table = plain_table("scenario", "overshoot %", "settling s", "error %", "RMSE %")
    for name, figures in design.chosen.scenarios.items():
        table.add_row(name, *(short(value) for value in figures))
    metrics = design.chosen.nonlinear
    assert metrics is not None, "the proposed rule has gains"
    heat = (f"rms current {short(metrics.current_rms_A)} A: {short(metrics.winding_W)} W in the winding, "
            f"{short(metrics.bridge_W)} W in a bridge of {design.settings.loop.bridge_ohm:g} ohm")  # fmt: skip
    return headed(f"{design.chosen.rule} in every scenario (nonlinear model)", Group(table, Text(heat)))


def outside_the_bench(design: Design) -> list[str]:
    """How the proposed gains fare where the car is not the bench."""
    robust, asked = design.robust, design.settings.conditions
    names = {"overshoot_pct": ("overshoot", "%"), "settling_s": ("settling", "s"),
             "steady_state_error_pct": ("error", "%"), "gain_margin_db": ("gain margin", "dB"),
             "phase_margin_deg": ("phase margin", "degrees")}  # fmt: skip
    figures = {key: float(getattr(robust.worst, key)) for key in names}
    worst = ", ".join(f"{name} {short(figures[key])} {unit}" if np.isfinite(figures[key]) else f"{name} never"
                      for key, (name, unit) in names.items())  # fmt: skip
    ranges = (f"supply {_range(asked.supply)} V, winding {_range(asked.winding)} degrees Celsius, dry friction "
              f"{_range(asked.friction)} times the bench's; a duty is a share of the supply that there is")  # fmt: skip
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
    calm = [point for point in points if point.meets]
    said = [f"proposed: RMSE {short(figures.rmse_pct)} % at a duty that moves {short(figures.duty_activity_pct, 2)} %"]
    if calm:
        said.append("within everything else that is asked for, on the nominal model: " + "; ".join(
            f"{short(point.rmse)} % at {short(point.activity, 2)} %" for point in calm))  # fmt: skip
    return said


def answer(design: Design) -> str:
    """The gains that are proposed and whether they meet what was asked, in one sentence."""
    gains, word = design.proposed, "meet" if design.chosen.meets_all else "do not meet"
    values = f"Kp {gains.Kp:.4g}, Ki {gains.Ki:.4g}, Kd {gains.Kd:.4g}"
    return f"Gains of {design.chosen.rule}: {values}; they {word} what was asked for."
