"""What sine traces say, where the rig has them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .table import Table
from .typeset import number

_HEAD = ("trace", "Hz", "cycles", "loop, dB", "phase, °", "outside the sine, %", "plant, dB re 1 rad/V", "phase, °",
         "fitted model, dB", "phase, °", "linear model, dB", "phase, °")  # fmt: skip

_OF = {"closed_loop": "Loop", "plant": "Plant"}


def sines_table(response: Mapping[str, Any]) -> Table | None:
    """A row a trace: the loop and the plant in it as measured, and the plant of both models."""
    points = response.get("points") or ()
    if not points:
        return None
    rows = [
        (
            point["file"],
            number(point["frequency_Hz"]),
            point["cycles"],
            *_response(point["measured"]["closed_loop"]),
            number(100.0 * point["outside_fundamental"]["position"], 2),
            *_response(point["measured"]["plant"]),
            *_response(point["modelled"]["nonlinear_plant"]),
            *_response(point["modelled"]["linear_plant"]),
        )
        for point in points
    ]
    return Table("Response to sines; ± 95 %", _HEAD, rows)


def orders(response: Mapping[str, Any]) -> list[str]:
    """What is said of the order of lag, of the loop and of the plant."""
    said = response.get("order") or {}
    return [f"{name}: {said[key]['says']}" for key, name in _OF.items() if said.get(key)]


def _response(value: Mapping[str, Any] | None) -> tuple[str, str]:
    """Magnitude in dB and phase in degrees, with their margins where they were measured."""
    if value is None:
        return "–", "–"
    decibels, degrees = 20.0 * math.log10(value["magnitude"]), math.degrees(value["phase_rad"])
    if "magnitude_ci95" not in value:
        return _fixed(decibels, 2), _fixed(degrees, 1)
    high, late = value["magnitude_ci95"][1], value["phase_ci95_rad"][1]
    more, margin = 20.0 * math.log10(high) - decibels, math.degrees(late) - degrees
    return f"{_fixed(decibels, 2)} ± {number(more, 2)}", f"{_fixed(degrees, 1)} ± {number(margin, 2)}"


def _fixed(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".replace("-", "−")
