"""pid.json."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..control.design import Design
from ..control.judged import Tuned
from ..control.loop_figures import FIGURES, MARGINS, LoopFigures
from ..control.on_units import FleetVerdict, OneByOne, PartsVerdict, Share
from ..control.own_numbers import said, shares
from ..control.pid import Gains, Task
from ..control.pid.ecu import UNIT
from ..control.pid.feedforward import Bias, Sliding
from ..control.pid.optimal import FrontPoint
from ..control.safety import Envelope, Holding, JamCheck, Return, Runaway, Sag
from ..control.setpoint import Setpoint
from ..control.supply_table import NEAR, AtSupply, OverPosition, SupplyTable
from ..files import plain, write_json
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import GENERIC, NOT_DIVIDED, RUSEFI, BiasTable, EcuProfile, Scheduling, differences
from ..model.feed_forward import Term, listed
from .fit import versions
from .manifest import replacing


def save_design(
    run: Path,
    design: Design,
    exit: int,
    settings: Mapping[str, Any],
    beside: Callable[[Path], None],
    outside: Sequence[Path] = (),
) -> None:
    """RUN/pid.json; `beside` draws into a folder that stands for RUN until all is there. `outside`: files besides RUN's
    that it was made from."""
    with replacing(run, "design", exit, settings, outside=outside) as draft:
        write_json(draft / "pid.json", "pid", design_json(design))
        beside(draft)


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


def ahead_json(design: Design) -> dict[str, Any]:
    """Terms with which the gains were found; the numbers of those that follow the setpoint's rate, asked for or not."""
    sliding = design.sliding
    return {
        "terms": listed(design.terms),
        "friction": {
            "opening_V": sliding.opening,
            "closing_V": sliding.closing,
            "full_from_rad_per_s": sliding.full,
        },
        "rate": {"V_s_per_rad": sliding.slope},
        "rate_filter_s": design.task.ecu.filter,
    }


def code(design: Design) -> list[str]:
    """Lines of C that a user runs at each tick behind the PID, all in % of duty and of the travel; none without terms.

    `target` and `output` are the setpoint and what the PID made of it; `rate` begins at 0 and `before` at the target;
    `constrain(x, low, high)` is Arduino's, and `table` the bias table.
    """
    sliding, ecu, body = design.task.loop.sliding, design.task.ecu, design.task.loop.body
    if sliding is None:
        return []
    travel = body.upper - body.lower
    spring = "table(target) + " if Term.SPRING in design.terms else ""
    most = 100.0 * ecu.duty
    return [
        f"rate = ({ecu.filter:g} * rate + target - before) / {ecu.filter + ecu.period:g};",
        "before = target;",
        f"ahead = {spring}{_formula(sliding, ecu.supply, travel)};",
        f"duty = constrain(output + ahead, {-most:g}, {most:g});",
    ]


def _formula(sliding: Sliding, supply: float, travel: float) -> str:
    """See `Sliding`; its terms that are 0 are left out."""
    volts, per_second = 100.0 / supply, 100.0 / travel
    full = f"{per_second * sliding.full:.6g}"
    parts = []
    if sliding.opening or sliding.closing:
        parts += [f"{volts * sliding.opening:.6g} * constrain(rate / {full}, 0, 1)",
                  f"{-volts * sliding.closing:.6g} * constrain(-rate / {full}, 0, 1)"]  # fmt: skip
    if sliding.slope:
        parts.append(f"{volts * sliding.slope / per_second:.6g} * rate")
    return " + ".join(parts)


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


def supply_table_json(task: Task, gains: Gains, table: SupplyTable) -> dict[str, Any]:
    """Gains at each supply, what they are worth at the ends of a car's supply, and what is said of other tables.

    Args:
        task: what they were found for.
        gains: of the ECU's own supply.
        table: made of them.
    """
    profile, body = task.profile, task.loop.body
    notation = (profile or GENERIC).notation
    if notation is None:
        over = (1.0 if task.ecu.compensated else task.ecu.supply / supply for supply in table.supplies)
        rows = tuple(Terms(each, each, each) for each in over)
        unit, form = f"share of the gain at {task.ecu.supply:g} V", "whatever its unit"
    else:
        rows = table.written(gains, notation, task.ecu, body.upper - body.lower)
        unit, form = notation.unit, notation.form
    return {
        "ecu_has": None if profile is None else profile.scheduling.name.lower(),
        "designed_at_V": task.ecu.supply,
        "supply_V": table.supplies,
        "gains": {name: [getattr(row, name) for row in rows] for name in Terms._fields},
        "unit": unit,
        "form": form,
        "worst": [_end(end) for end in table.ends],
        "position": _position(table.position),
        "says": list(_said(profile, table, task.ecu)),
    }


def _end(end: AtSupply) -> dict[str, Any]:
    return {"supply_V": end.supply, "fixed": end.fixed.known(), "table": end.table.known(), "helps": end.helps}


def _position(over: OverPosition) -> dict[str, Any]:
    return {"crossover_Hz": over.frequency, "within_pct": 100.0 * NEAR, "share_of_travel_within": over.alike,
            "least_ratio": over.ratio.min(), "largest_ratio": over.ratio.max()}  # fmt: skip


def _said(profile: EcuProfile | None, table: SupplyTable, ecu: Ecu) -> Iterator[str]:
    """Who has such a table, what it is worth, and where another one is worth nothing."""
    if ecu.compensated:
        yield "the ECU divides by the battery voltage: its gains mean the same at every supply, no table is needed"
    elif profile is not None:
        yield f"{profile.title} has {profile.scheduling.value}" + _so(profile.scheduling)
    yield from map(_of_end, table.ends)
    yield _of_position(table.position)
    yield ("over the error: the linear plant does not know it, so that nothing here gives such a table; what a small "
           "error meets is dry friction, and no table has been tried")  # fmt: skip


def _so(scheduling: Scheduling) -> str:
    """What follows for the table."""
    return {
        Scheduling.TABLE: "",
        Scheduling.CODE: "",
        Scheduling.NONE: ": fixed gains it must be",
        Scheduling.UNKNOWN: ": look for one before you plan with it",
    }[scheduling]


def _of_end(end: AtSupply) -> str:
    """Tracking with and without the table."""
    fixed, table = end.fixed, end.table
    return (f"at {end.supply:g} V, worst of winding and friction: RMSE {fixed.rmse_pct:.3g} % with fixed gains, "
            f"{table.rmse_pct:.3g} % with the table; overshoot {fixed.overshoot_pct:.3g} and "
            f"{table.overshoot_pct:.3g} %: it {'helps' if end.helps else 'does not help'} tracking there")  # fmt: skip


def _of_position(over: OverPosition) -> str:
    """Whether a table over the position had anything to compensate."""
    known = (f"over the position: at the crossover of {over.frequency:.3g} Hz the plant's gain is within "
             f"{100.0 * NEAR:g} % of that at a quarter of the travel over {100.0 * over.alike:.0f} % "
             "of it")  # fmt: skip
    if over.alike == 1.0:
        return f"{known}: a table would be flat"
    return (f"{known}, and {over.ratio.min():.2g} to {over.ratio.max():.2g} times it at the extremes: springs, "
            "which feed-forward and integral carry")  # fmt: skip
