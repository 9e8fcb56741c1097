"""What no effect explains, as a curve with its uncertainty."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...diagnosis.findings import Unexplained
from .. import style
from ..numbers import short
from .shown import DEGREES, prefixed

_SYMBOL = {"torque": "torque", "friction": "dry friction", "voltage": "voltage", "position": "position"}
_AXIS = {"angle": "plate angle", "speed": "plate speed", "load": "torque through the gear", "current": "current",
         "time": "time"}  # fmt: skip


def draw(unknown: Unexplained, travel: tuple[float, float], synthetic: bool) -> Figure:
    """The curve and two standard deviations about it, over the range that was measured.

    Args:
        unknown: the curve.
        travel: end stops, rad; infinite where there is none.
        synthetic: the data were made up.
    """
    x, axis_unit = _along(unknown, travel)
    factor, unit = prefixed(float(np.max(np.abs(unknown.curve))), unknown.unit)
    y, sd = factor * unknown.curve, factor * unknown.sd
    title = style.wrapped(unknown.sentence, 11.0, 13)
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
    panel.set_ylim(*_limits(y, sd))
    fig.suptitle(title, x=0.015, y=1.0 - 0.1 / tall, ha="left", va="top", fontsize=13, fontweight="bold")
    style.legend(fig, [panel], 0.1, 1.0 - (head - 0.3) / tall, "upper left")
    return fig


def _along(unknown: Unexplained, travel: tuple[float, float]) -> tuple[np.ndarray, str]:
    """The axis as shown; an angle given as a share of the travel (a missing stop is half a turn away) in degrees."""
    if unknown.depends_on == "angle" and unknown.axis_unit in ("1", ""):
        lower, upper = (stop if np.isfinite(stop) else side for stop, side in zip(travel, (-np.pi, np.pi), strict=True))
        return DEGREES * (lower + (upper - lower) * unknown.axis), "deg"
    factor, unit = prefixed(np.inf, unknown.axis_unit)
    return factor * unknown.axis, unit


def _limits(y: np.ndarray, sd: np.ndarray) -> tuple[float, float]:
    """Room for the curve, and for its band as far as that is not many times as wide."""
    size = float(np.max(np.abs(y)))
    reach = 2.0 * np.minimum(sd, 1.5 * size)
    low, high = min(0.0, float(np.min(y - reach))), max(0.0, float(np.max(y + reach)))
    room = 0.06 * max(high - low, 1e-12)
    return low - room, high + room
