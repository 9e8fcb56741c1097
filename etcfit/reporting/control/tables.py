"""Transfer function and gains for stdout: what every view says of them, and what only a terminal does."""

from __future__ import annotations

import numpy as np
from rich.console import RenderableType

from ...control.design import Design
from ...control.frequency import FrequencyResponse
from ...control.linearise import Reduction
from ...estimation.fitted_model import Fitted
from ...run_folder.pid import design_json
from ...run_folder.plant import frequency_json, reduction_json
from ..blocks import all_shown, cautioned, rig_title, stacked
from ..numbers import short
from ..table import Column, Table
from .gains import design_parts, gains_table
from .plant import plant_tables, sine_parts


def reduction_table(fitted: Fitted, reduction: Reduction, pade_order: int) -> RenderableType:
    """Coefficients with standard errors, poles, gain and operating point."""
    parts = plant_tables(reduction_json(fitted, reduction, pade_order))
    return cautioned(stacked(rig_title(fitted.config, "transfer function"), all_shown(*parts)), fitted.state)


def sine_table(fitted: Fitted, response: FrequencyResponse) -> RenderableType:
    """A row a sine trace: the loop as measured, then the plant and those of the models."""
    return all_shown(*sine_parts(frequency_json(fitted, response)))


def design_table(design: Design) -> RenderableType:
    """All rules, then the proposed gains as an ECU writes them, with the curve to type in, and how they fare.

    Of a model that is no estimate the caution stands first, and what an ECU would take is left out unless it is asked
    for all the same (`Design.withheld`).
    """
    pid = design_json(design)
    typed = gains_table(pid)
    parts = []
    for part in design_parts(pid):
        parts.append(part)
        if typed is not None and part.title == typed.title:
            parts.append(_curve(design))
    return cautioned(stacked(rig_title(design.fitted.config, "PID gains"), all_shown(*parts)), design.fitted.state)


def _curve(design: Design) -> Table:
    """Duty that holds the plate, and at which it begins to move."""
    bias, supply = design.bias, design.task.ecu.supply
    places = 100.0 * np.asarray(design.task.loop.share(bias.angles))
    rows = [(float(place), *(100.0 * float(volts) / supply for volts in each))
            for place, *each in zip(places, bias.hold, bias.opening, bias.closing, strict=True)]  # fmt: skip
    heads = ("position, % of travel", "holding duty %", "opening %", "closing %")
    return Table("Bias curve", [Column(head, k, digits=4) for k, head in enumerate(heads)], rows, [_moving(design)])


def _moving(design: Design) -> str:
    """What a moving plate takes beside the curve, and who can put it ahead."""
    sliding, profile = design.sliding, design.task.profile
    said = (f"a moving plate takes more: dry friction {short(sliding.opening)} V opening, {short(sliding.closing)} V "
            f"closing; back-EMF and drag {short(sliding.slope)} V s/rad of the setpoint's rate")  # fmt: skip
    if design.task.loop.sliding is not None:
        return said
    if profile is not None and not profile.code:
        return f"{said}; {profile.title} cannot put these ahead"
    return f"{said}; --feed-forward-terms friction,rate puts them ahead where you write the code"
