"""pid.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..control.design import Design
from ..control.judged import Tuned
from ..control.loop_figures import FIGURES, MARGINS, LoopFigures
from ..control.on_units import FleetVerdict, OneByOne, PartsVerdict, Share
from ..control.own_numbers import said, shares
from ..control.pid.ecu import UNIT, Gains
from ..control.pid.feedforward import Bias
from ..control.pid.optimal import FrontPoint
from ..control.setpoint import Setpoint
from ..files import plain
from ..model.ecu import Ecu, Notation
from ..model.ecus import NOT_DIVIDED, RUSEFI, BiasTable, differences
from .ahead import ahead_json, code
from .fit import versions
from .safety import safety_json
from .supply_table import supply_table_json


def design_json(design: Design) -> dict[str, Any]:
    """The object of pid.json (docs/formats.md), and what else a reader may want to know.

    `ecu` has the gains as an ECU that counts ticks: P = Kp, I = Ki T, D = Kd / T, all V/rad. `as_written` has them, and
    those of every rule, in unit and form of [ecu] of rig.toml; null where it names no unit. A settling time is null
    where the response does not settle, a margin where the loop has none.
    """
    chosen, asked = design.chosen, design.task.requirements
    assert chosen.gains is not None, "the proposed rule has gains"
    return plain({
        "rig": design.fitted.config.name,
        "synthetic": design.fitted.config.synthetic,
        "model": {"effects": [effect.name for effect in design.fitted.free_parameters.layout.types]},
        "fit": design.fitted.state,
        "anyway": design.anyway,
        "rule": chosen.rule,
        "gains": _gains(chosen.gains),
        "ecu": _native(design, chosen.gains),
        "as_written": _as_written(design, chosen.gains),
        "linear": loop_json(chosen.linear),
        "nonlinear": loop_json(chosen.nonlinear),
        "requirements": asked.limits(),
        "margins_asked": asked.limits(MARGINS),
        "met": chosen.met,
        "scenarios": {name: loop_json(figures) for name, figures in chosen.scenarios.items()},
        "conditions": _conditions(design),
        "supply_table": supply_table_json(design.task, chosen.gains, design.supply_table),
        "front": [_point(point) for point in design.front],
        "safety": safety_json(design),
        "stable": chosen.stable,
        "met_linear": chosen.met_linear,
        "limits": list(design.limits),
        "posterior": {
            "probability_met": chosen.probability_met,
            "probability_margins": chosen.probability_stable,
            "draws": design.draws,
            "origin": design.origin,
        },
        "setpoint": _setpoint(design.setpoint),
        "feed_forward": design.task.loop.bias is not None,
        "bias_curve": _curve(design.bias),
        "feed_forward_terms": ahead_json(design),
        "rules": {name: _rule(design, tuned) for name, tuned in design.tuned.items()},
        "rusefi": rusefi(design),
        "profile": written_for(design),
        "settings": design.settings,
        "versions": versions(),
    } | ({} if design.fleet is None else {"fleet": fleet_json(design.fleet)})
      | ({} if design.parts is None else {"parts": parts_json(design.parts)}))  # fmt: skip


def fleet_json(found: FleetVerdict) -> dict[str, Any]:
    """How the proposed gains fare unit by unit; a figure that is not finite, such as of an unstable loop, is null."""
    ahead = found.future
    return {
        "share_met": found.share.value,
        "share_ci95": [found.share.low, found.share.high],
        "share_asked": found.asked,
        "reached": found.reached,
        "units": found.share.of,
        "future": None if ahead is None else {
            "share_met": ahead.value, "share_ci95": [ahead.low, ahead.high], "draws": ahead.of,
        },
        "worst": [each._asdict() for each in found.worst],
        "fails": found.fails,
        "searches": found.searches,
        "says": found.says,
        "settings": found.settings,
    }  # fmt: skip


def parts_json(found: PartsVerdict) -> dict[str, Any]:
    """How the gains of every rule fare on the parts; a figure that is not finite is null."""
    return {
        "fleet": found.where,
        "name": found.name,
        "units": found.units,
        "left_out": found.left_out,
        "of_run": found.of_run,
        "rules": {
            name: {
                "measured": _on_units(each.measured),
                "drawn": _on_units(each.drawn),
                "worst": each.worst._asdict(),
                "fails": each.measured.fails,
            }
            for name, each in found.rules.items()
        },
        "conditions": {
            "corners": _share(found.share_at_corners),
            "hardest": found.corners.named(1)[0]._asdict(),
            "drawn": _on_units(found.anywhere),
        },
    }


def _on_units(found: OneByOne) -> dict[str, Any]:
    return {**_share(found.share), "worst_rmse_pct": float(found.figures.rmse_pct.max())}


def _share(share: Share) -> dict[str, Any]:
    return {"share_met": share.value, "share_ci95": [share.low, share.high], "of": share.of}


def _gains(gains: Gains) -> dict[str, Any]:
    return {**gains._asdict(), "unit": UNIT}


def _native(design: Design, gains: Gains) -> dict[str, Any]:
    ecu = design.task.ecu
    return {
        **design.written(gains, Notation(form="ticks"))._asdict(),
        "period_s": ecu.period, "unit": UNIT, "supply_V": ecu.supply,
        "noise_rad": ecu.noise, "input_filter_s": ecu.lag,
        "derivative_filter_s": ecu.filter, "delay_s": ecu.delay, "pwm_V": ecu.pwm, "resolution_rad": ecu.resolution,
        "duty_limit": ecu.duty, "integral_limit": ecu.integral or None,
        "slew_V_per_s": ecu.slew or None, "dead_band_rad": ecu.dead_band,
        "divides_by_battery": bool(ecu.compensated),
        "setpoint_weight": ecu.setpoint_weight, "derivative_weight": ecu.derivative_weight,
    }  # fmt: skip


def _as_written(design: Design, gains: Gains | None) -> dict[str, Any] | None:
    """In the user's own unit and form."""
    notation = design.fitted.config.notation
    if notation is None or gains is None:
        return None
    return {**design.written(gains, notation)._asdict(), "unit": notation.unit, "form": notation.form}


def loop_json(figures: LoopFigures | None) -> dict[str, Any] | None:
    """Every figure of a loop, null where it is not known."""
    return None if figures is None else {symbol: getattr(figures, symbol) for symbol in FIGURES}


def _setpoint(setpoint: Setpoint) -> dict[str, Any]:
    return {"scenarios": setpoint.scenarios, "times_s": setpoint.times, "shares_of_travel": setpoint.shares}


def _conditions(design: Design) -> dict[str, Any]:
    """How the proposed gains fare where supply, winding and friction are not those of the bench."""
    robust, asked = design.robust, design.settings.conditions
    supply, winding, friction = robust.corner
    return {
        "supply_V": asked.supply,
        "winding_degC": asked.winding,
        "friction_over_bench": asked.friction,
        "worst": loop_json(robust.worst),
        "hardest": {"supply_V": supply, "winding_degC": winding, "friction_over_bench": friction},
        "met": robust.met,
        "stable": robust.stable,
        "probability_met": robust.probability_met,
    }


def _curve(bias: Bias) -> dict[str, Any]:
    return {"angles_rad": bias.angles, "hold_V": bias.hold, "closing_V": bias.closing, "opening_V": bias.opening}


def _point(point: FrontPoint) -> dict[str, Any]:
    return {
        "gains": _gains(point.gains),
        "duty_activity_limit_pct": point.limit,
        "duty_activity_pct": point.activity,
        "rmse_pct": point.rmse,
        "met": point.meets,
    }


def _rule(design: Design, tuned: Tuned) -> dict[str, Any]:
    return {
        "gains": None if tuned.gains is None else _gains(tuned.gains),
        "as_written": _as_written(design, tuned.gains),
        "why_not": tuned.why or None,
        "linear": loop_json(tuned.linear),
        "nonlinear": loop_json(tuned.nonlinear),
        "met": tuned.met,
        "stable": tuned.stable,
        "probability_met": tuned.probability_met,
        "probability_margins": tuned.probability_stable,
    }


def rusefi(design: Design) -> dict[str, Any] | None:
    """The gains as rusEFI has them: % of duty over % of travel, per s and times s, and the bias curve of 8 points.

    None where they were sought for another controller than rusEFI's: there they would do something else.

    Source: rusEFI, electronic_throttle.cpp and efi_pid.cpp: iFactor and dFactor are of continuous time, and the bias
    table is added whatever the gains, so leave it at 0 where they were found without feed-forward.
    """
    if differences(design.task.ecu, RUSEFI.fixes):
        return None
    gains, ecu = design.chosen.gains, design.task.ecu
    assert gains is not None, "the proposed rule has gains"
    his = design.written(gains, Notation("%", "%"))
    bias = design.bias
    share = 100.0 * np.asarray(design.task.loop.share(bias.angles))
    return {
        "pFactor": his.P,
        "iFactor": his.I,
        "dFactor": his.D,
        "periodMs": 1e3 * ecu.period,
        "minValue": -100,
        "maxValue": 100,
        "etb_iTermMin": -100.0 * ecu.integral,
        "etb_iTermMax": 100.0 * ecu.integral,
        "etbBiasBins": np.round(share, 3),
        "etbBiasValues": _duty(bias.hold, ecu),
        "duty_closing": _duty(bias.closing, ecu),
        "duty_opening": _duty(bias.opening, ecu),
        "gains_found_with_bias": design.task.loop.bias is not None,
        "unit": "% duty, % travel",
    }


def written_for(design: Design) -> dict[str, Any] | None:
    """Gains and limits as the make of ECU writes them that they were sought for; None where none was named.

    Pasted whole they make that ECU the controller that was designed: a table of feed-forward that the gains were found
    without is all 0.
    """
    profile, ecu = design.task.profile, design.task.ecu
    if profile is None:
        return None
    gains, body = design.chosen.gains, design.task.loop.body
    assert gains is not None, "the proposed rule has gains"
    notation, own = profile.notation, shares(design.task, gains)
    if notation is None:
        typed = [each.known | dict(zip(("value", "unit"), each.shown, strict=True)) for each in own]
    else:
        typed = [{"value": value, "unit": unit}
                 for value, unit in zip(design.written(gains, notation), notation.of_each, strict=True)]  # fmt: skip
    return {
        "name": profile.name,
        "title": profile.title,
        "gains": dict(zip(profile.gains, typed, strict=True)),
        "says": [] if notation is not None else list(said(design.task, gains, profile.title)),
        "limits": {
            limit.name: {"value": limit.value(ecu, body.upper - body.lower), "unit": limit.unit}
            for limit in profile.limits
        },
        "bias": None if profile.bias is None else _bias(design, profile.bias),
        "code": code(design),
        "source": profile.source,
        "assumed": [each for each in profile.assumed if not (ecu.compensated and each == NOT_DIVIDED)],
    }


def _bias(design: Design, table: BiasTable) -> dict[str, list[float]]:
    share = 100.0 * np.asarray(design.task.loop.share(design.bias.angles))
    duty = _percent(design.bias.hold, design.task.ecu) if design.task.loop.bias is not None else np.zeros(share.shape)
    step = 100.0 / (table.positions - 1)
    return {
        table.bins: np.round(step * np.round(share / step), 6).tolist(),
        table.values: np.round(duty, table.decimals).tolist(),
    }


def _percent(volts: np.ndarray, ecu: Ecu) -> np.ndarray:
    return np.clip(100.0 * volts / ecu.supply, -100.0, 100.0)


def _duty(volts: np.ndarray, ecu: Ecu) -> np.ndarray:
    """%, to two places."""
    return np.round(_percent(volts, ecu), 2)
