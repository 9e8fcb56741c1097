"""What no effect explains, as a curve with its uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...diagnose.findings import Unexplained
from .. import style
from ..numbers import short

_DEGREES = 180.0 / np.pi
_SYMBOL = {"torque": "torque", "friction": "dry friction", "voltage": "voltage", "position": "position"}
_AXIS = {"angle": "plate angle", "speed": "plate speed", "load": "torque through the gear", "current": "current",
         "time": "time"}  # fmt: skip


def draw(unknown: Unexplained, synthetic: bool) -> Figure:
    """The curve and two standard deviations about it, over the range that was measured."""
    stretch, axis_unit = _shown(unknown.axis_unit)
    factor, unit = _shown(unknown.unit)
    x, y, sd = stretch * unknown.axis, factor * unknown.curve, factor * unknown.sd
    title = style.wrapped(unknown.sentence, 92)
    tall = 5.2 + 0.24 * title.count("\n")
    fig = style.figure(11.0, tall, synthetic)
    panel = fig.subplots(1, 1)
    head = 0.95 + 0.24 * title.count("\n")
    fig.subplots_adjust(left=0.1, right=0.985, top=1.0 - head / tall, bottom=0.6 / tall)
    panel.axhline(0.0, color="black", lw=0.8)
    panel.fill_between(x, y - 2.0 * sd, y + 2.0 * sd, color=style.UNKNOWN, alpha=0.3, lw=0,
                       label="± 2 standard deviations")  # fmt: skip
    panel.plot(x, y, color="#8a2c6b", lw=2.4, label=f"unexplained, {short(factor * unknown.size)} {unit} rms in motion")
    panel.set_xlabel(style.unit_label(_AXIS.get(unknown.depends_on, unknown.depends_on), axis_unit))
    panel.set_ylabel(style.unit_label(f"unexplained {_SYMBOL.get(unknown.enters, unknown.enters)}", unit))
    panel.set_xlim(float(np.min(x)), float(np.max(x)))
    fig.suptitle(title, x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13, fontweight="bold")
    style.legend(fig, [panel], 0.1, 1.0 - (head - 0.3) / tall, "upper left")
    return fig


def _shown(unit: str) -> tuple[float, str]:
    """Angles in degrees, all else as it is: the factor and the unit."""
    return (_DEGREES, "deg") if unit == "rad" else (1.0, unit.replace("*", " "))
