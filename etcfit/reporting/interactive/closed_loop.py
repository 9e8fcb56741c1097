"""The ECU and its setpoint as the page simulates them, from pid.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...control.linearise import stops
from ...control.setpoint import trapezoid
from ...control.settings import LoopSettings
from ...estimation.result import FitResult
from ...model.ecu import Ecu

_FACTOR = 8.0  # a slider goes from an eighth of a gain to eight times it
# fields of `Ecu` and their names in pid.json; null there is 0
_ECU = {"period": "period_s", "supply": "supply_V", "filter": "derivative_filter_s", "delay": "delay_s", "pwm": "pwm_V",
        "resolution": "resolution_rad", "duty": "duty_limit", "integral": "integral_limit", "lag": "input_filter_s",
        "slew": "slew_V_per_s", "dead_band": "dead_band_rad", "setpoint_weight": "setpoint_weight",
        "derivative_weight": "derivative_weight"}  # fmt: skip


def loop_json(result: FitResult, pid: Mapping[str, Any]) -> dict[str, Any] | None:
    """Gains, ECU, setpoint and levels; None where no gains were sought, or an older file lacks what they ran with.

    Args:
        result: the final model.
        pid: pid.json; empty where there is none.
    """
    needed = {"gains", "ecu", "setpoint", *(("bias_curve",) if pid.get("feed_forward") else ())}
    if not needed <= pid.keys():
        return None
    config, first = result.rig.config, trapezoid()
    lower, upper = stops(result.fitted())
    body = {"gear_ratio": float(config.gear_ratio), "lower": float(lower), "upper": float(upper)}
    return {
        "rule": pid["rule"],
        "gains": {name: _slider(float(pid["gains"][name])) for name in ("Kp", "Ki", "Kd")},
        "unit": pid["gains"]["unit"],
        "ecu": ecu_json(pid["ecu"]),
        "body": body,
        "longest_step": LoopSettings().longest_step,
        "setpoint": {"times": pid["setpoint"]["times_s"], "shares": pid["setpoint"]["shares_of_travel"]},
        "first": first.duration,
        "levels": [
            {"begins": each.begins, "ends": each.ends, "before": each.before, "after": each.after}
            for each in first.levels
        ],
        "requirements": pid["requirements"],
        "bias": _bias(pid["bias_curve"]) if pid.get("feed_forward") else None,
        "sliding": _sliding(pid.get("feed_forward_terms") or {}),
        "noise": float(pid["ecu"].get("noise_rad") or 0.0),
    }


def ecu_json(written: Mapping[str, Any]) -> dict[str, float]:
    """Fields of `Ecu` from the object `ecu` of pid.json; those of older files that are absent at their defaults."""
    default = Ecu()._asdict()
    return {
        field: float(written[name] or 0.0) if name in written else float(default[field]) for field, name in _ECU.items()
    }


def _sliding(ahead: Mapping[str, Any]) -> dict[str, float] | None:
    """What is put ahead by the setpoint's rate, as `Sliding` has it; None where the gains were found without."""
    terms = {term: term in ahead.get("terms", ()) for term in ("friction", "rate")}
    if not any(terms.values()):
        return None
    friction = ahead["friction"]
    return {
        "opening": friction["opening_V"] if terms["friction"] else 0.0,
        "closing": friction["closing_V"] if terms["friction"] else 0.0,
        "full": friction["full_from_rad_per_s"],
        "slope": ahead["rate"]["V_s_per_rad"] if terms["rate"] else 0.0,
    }


def _slider(value: float) -> dict[str, Any]:
    return {"value": value, "low": value / _FACTOR, "high": value * _FACTOR or 1.0, "geometric": value > 0.0}


def _bias(curve: Mapping[str, Any]) -> dict[str, list[float]]:
    """The curve that the gains were found with."""
    return {"angles": curve["angles_rad"], "volts": curve["hold_V"]}
