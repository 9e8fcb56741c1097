"""The model as the page simulates it: effects by name, values, and what each slider may be set to."""

from __future__ import annotations

from typing import Any

from ...estimation.result import FitResult
from ...model.effects import EFFECT_BY_NAME
from ...model.parameters import NonNegative, Parameter, Positive, parameters_of
from ...run_folder import effects_of

_FACTOR = 4.0  # a slider goes from a fourth of a positive value to four times it
_SPAN = 2.0  # or as many times the larger of value and typical size away from it


def plant_json(result: FitResult) -> dict[str, Any]:
    """Names of effects, values in SI by symbol, ties, and the sliders.

    Effects of the rig are left out: they stand between throttle and log (`excitation`).
    """
    layout = result.free_parameters.layout
    inside = [t for t in layout.types if t.name in EFFECT_BY_NAME]
    shown = dict.fromkeys(p.symbol for t in inside for p in parameters_of(t))
    ties = {symbol: other for symbol, other in layout.ties if symbol in shown}
    others = [name for name in effects_of(result) if name not in EFFECT_BY_NAME]
    return {
        "effects": [t.name for t in inside],
        "others": others,
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
