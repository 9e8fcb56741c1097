"""`safety` of pid.json: what the proposed gains do where something fails."""

from __future__ import annotations

import math
from typing import Any

from ..control.design import Design
from ..control.safety import Envelope, Holding, JamCheck, Return, Runaway, Sag


def safety_json(design: Design) -> dict[str, Any]:
    """Every figure of safety, positions and errors in % of the travel; null for never, or for what is not known."""
    found = design.safety
    return {
        "envelope": _envelope(found.envelope),
        "jam": None if found.jam is None else _jam(design, found.jam),
        "sensor": [_runaway(each) for each in found.sensors],
        "supply": [_sag(each) for each in found.sags],
        "unpowered": [_return(each) for each in found.returns],
        "holding": _holding(found.holding),
    }


def _envelope(found: Envelope) -> dict[str, Any]:
    return {
        "error_pct": 100.0 * found.errors,
        "longest_s": found.longest,
        "largest_pct": 100.0 * found.largest,
        "models": found.models,
    }


def _jam(design: Design, check: JamCheck) -> dict[str, Any]:
    return {
        "error_pct": 100.0 * check.error,
        "timeout_s": check.timeout,
        "longest_above_s": check.longest,
        "sustained_pct": 100.0 * check.sustained,
        "told_after_s": check.tells,
        "written": _written(design, check),
    }


def _written(design: Design, check: JamCheck) -> dict[str, float] | None:
    """As the ECU writes it, the error rounded up: a larger one is passed for a shorter time."""
    profile = design.task.profile
    if profile is None or profile.jam is None:
        return None
    error, timeout = profile.jam
    return {error: float(math.ceil(100.0 * check.error)), timeout: check.timeout}


def _runaway(each: Runaway) -> dict[str, Any]:
    return {
        "fault": each.fault,
        "asked_pct": 100.0 * each.asked,
        "opens_pct": 100.0 * each.opens,
        "jam_after_s": each.jam_after,
        "jam_opens_pct": 100.0 * each.jam_opens,
        "apart_after_s": each.apart_after,
        "apart_opens_pct": 100.0 * each.apart_opens,
    }


def _sag(each: Sag) -> dict[str, Any]:
    return {
        "name": each.name,
        "opening_pct": 100.0 * each.opening,
        "closes_pct": 100.0 * each.closes,
        "opens_pct": 100.0 * each.opens,
        "back_after_s": each.back_after,
        "integral_pct": 100.0 * each.wound,
        "false_trip": each.false_trip,
    }


def _return(each: Return) -> dict[str, Any]:
    return {
        "opening_pct": 100.0 * each.opening,
        "open_terminals_s": each.cut_s,
        "shorted_terminals_s": each.shorted_s,
        "rests_pct": [100.0 * share for share in each.rests],
    }


def _holding(found: Holding) -> dict[str, Any]:
    return {
        "position_pct": 100.0 * found.shares,
        "current_A": found.current,
        "closing_A": found.closing,
        "opening_A": found.opening,
        "winding_W": found.watts,
        "winding_rise_K": found.rise,
        "full_duty_A": found.stall_A,
        "full_duty_W": found.stall_W,
        "full_duty_s": None if found.longest is None or math.isinf(found.longest) else found.longest,
        "heating_known": found.rise is not None,
    }
