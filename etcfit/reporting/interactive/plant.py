"""The model as the page simulates it: effects by name, values, and what each slider may be set to."""

from __future__ import annotations

from typing import Any

from ...estimation.result import FitResult
from ...model.parameters import NonNegative, Parameter, Positive, parameters_of
from .printed_model import Simulation

_FACTOR = 4.0  # a slider goes from a fourth of a positive value to four times it
_SPAN = 2.0  # or as many times the larger of value and typical size away from it


def plant_json(result: FitResult, simulated: Simulation) -> dict[str, Any]:
    """Names of effects, values in SI by symbol, ties, and the sliders.

    Args:
        result: the model.
        simulated: its throttle as the page simulates it; the others are effects of the rig, which stand between
            throttle and log (`excitation`), and an ECU in the model.
    """
    layout = result.free_parameters.layout
    shown = dict.fromkeys(p.symbol for t in simulated.effects for p in parameters_of(t))
    ties = {symbol: other for symbol, other in layout.ties if symbol in shown}
    inside = {*simulated.effects, *simulated.left_out}
    return {
        "effects": [t.name for t in simulated.effects],
        "left_out": [t.name for t in simulated.left_out],
        "others": [t.name for t in layout.types if t not in inside],
        "values": {symbol: float(result.values[symbol]) for symbol in shown},
        "ties": ties,
        "sliders": [
            _slider(layout.parameter(s), float(result.values[s]), layout.status(s)) for s in shown if s not in ties
        ],
    }


def _slider(parameter: Parameter, value: float, status: str) -> dict[str, Any]:
    domain = parameter.domain
    geometric = isinstance(domain, Positive) or (isinstance(domain, NonNegative) and value > 0.05 * domain.scale)
    reach = _SPAN * max(abs(value), 0.5 * domain.scale)
    low, high = (value / _FACTOR, value * _FACTOR) if geometric else (value - reach, value + reach)
    if isinstance(domain, NonNegative):
        low = max(low, 0.0)
    return {
        "symbol": parameter.symbol,
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "value": value,
        "low": low,
        "high": high,
        "geometric": geometric,
        "status": status,
    }
