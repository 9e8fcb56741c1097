"""pid.json, declared: every key, what it means and which figure of a design it is.

First stands what is worked out for it: gains as ECUs write them, lines of code, a table over the supply.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..control.design import Design
from ..control.judged import Robust
from ..control.loop_figures import MARGINS, REQUIRED, LoopFigures
from ..control.on_units import OddOne, Share
from ..control.own_numbers import sentences, shares
from ..control.pid import Gains, Task
from ..control.pid.feedforward import Bias, Sliding
from ..control.pid.optimal import FrontPoint
from ..control.safety.faults import Envelope, JamCheck, Runaway, Sag
from ..control.safety.unpowered import Holding, Return
from ..control.supply_table import NEAR, AtSupply, OverPosition, SupplyTable
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import GENERIC, NOT_DIVIDED, RUSEFI, BiasTable, EcuProfile, Scheduling, differences
from ..model.feed_forward import Term, listed
from ..model.pid import UNIT
from .declared import Record, by_name, figures, file_of, key, list_of, record_of

_FOLLOWS = {Scheduling.NONE: ": fixed gains it must be", Scheduling.UNKNOWN: ": look for one before you plan with it"}


def as_written(design: Design, gains: Gains | None) -> dict[str, Any] | None:
    """Gains in unit and form of [ecu] of rig.toml; None where it names no unit."""
    notation = design.fitted.config.notation
    if notation is None or gains is None:
        return None
    return {**design.written(gains, notation)._asdict(), "unit": notation.unit, "form": notation.form}


def jam_with_names(design: Design) -> dict[str, Any] | None:
    """The jam check, and as the ECU writes it, the error rounded up: a larger one is passed for a shorter time."""
    check, names = design.safety.jam, design.task.profile and design.task.profile.jam
    if check is None:
        return None
    written = names and {names[0]: float(math.ceil(100.0 * check.error)), names[1]: check.timeout}
    return {"check": check, "written": written}


def rusefi(design: Design) -> dict[str, Any] | None:
    """The gains as rusEFI has them: % of duty over % of travel, per s and times s, and the bias curve of 8 points.

    None where they were sought for another controller than rusEFI's: there they would do something else.

    Source: rusEFI, electronic_throttle.cpp and efi_pid.cpp: iFactor and dFactor are of continuous time, and the bias
    table is added whatever the gains, so leave it at 0 where they were found without feed-forward.
    """
    if differences(design.task.ecu, RUSEFI.fixes):
        return None
    ecu, bias = design.task.ecu, design.bias
    duty = {name: np.round(_percent(getattr(bias, name), ecu), 2) for name in ("hold", "closing", "opening")}
    return {"gains": design.written(design.proposed, Notation("%", "%")), "ecu": ecu, "loop": design.task.loop,
            "bins": np.round(100.0 * np.asarray(design.task.loop.share(bias.angles)), 3), "duty": duty}  # fmt: skip


def written_for(design: Design) -> dict[str, Any] | None:
    """Gains and limits as the make of ECU writes them that they were sought for; None where none was named.

    Pasted whole they make that ECU the controller that was designed: a table of feed-forward that the gains were found
    without is all 0.
    """
    profile, ecu = design.task.profile, design.task.ecu
    if profile is None:
        return None
    gains, body, notation = design.proposed, design.task.loop.body, profile.notation
    if notation is None:
        typed = [each.known | dict(zip(("value", "unit"), each.shown, strict=True))
                 for each in shares(design.task, gains)]  # fmt: skip
    else:
        typed = [{"value": value, "unit": unit}
                 for value, unit in zip(design.written(gains, notation), notation.of_each, strict=True)]  # fmt: skip
    return {
        "profile": profile,
        "gains": dict(zip(profile.gains, typed, strict=True)),
        "says": [] if notation is not None else list(sentences(design.task, gains, profile.title)),
        "limits": {
            limit.name: {"value": limit.value(ecu, body.upper - body.lower), "unit": limit.unit}
            for limit in profile.limits
        },
        "bias": None if profile.bias is None else _bias(design, profile.bias),
        "code": code(design),
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


def supply_table_json(task: Task, gains: Gains, table: SupplyTable) -> dict[str, Any]:
    """Gains at each supply, what they are worth at the ends of a car's supply, and what is said of other tables."""
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
        "worst": table.ends,
        "position": table.position,
        "says": list(_said(profile, table, task.ecu)),
    }


def _said(profile: EcuProfile | None, table: SupplyTable, ecu: Ecu) -> Iterator[str]:
    """Who has such a table, what it is worth, and where another one is worth nothing."""
    if ecu.compensated:
        yield "the ECU divides by the battery voltage: its gains mean the same at every supply, no table is needed"
    elif profile is not None:
        yield f"{profile.title} has {profile.scheduling.value}" + _FOLLOWS.get(profile.scheduling, "")
    yield from map(_of_end, table.ends)
    yield _of_position(table.position)
    yield ("over the error: the linear plant does not know it, so that nothing here gives such a table; what a small "
           "error meets is dry friction, and no table has been tried")  # fmt: skip


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


def _ends(share: Share) -> list[float]:
    return [share.low, share.high]


METRICS = figures(
    LoopFigures,
    "How well a loop follows its setpoint, and what that costs; null is infinite, absent, or not computed there.",
    ref="metrics",
)
GAINS = record_of(Gains, unit=key("text", "Of Kp.", lambda _: UNIT, const="V/rad"))
ECU_KEYS = {"period": "period_s", "supply": "supply_V", "filter": "derivative_filter_s", "delay": "delay_s",
            "pwm": "pwm_V", "resolution": "resolution_rad", "duty": "duty_limit", "integral": "integral_limit",
            "slew": "slew_V_per_s", "dead_band": "dead_band_rad", "noise": "noise_rad", "lag": "input_filter_s",
            "compensated": "divides_by_battery"}  # fmt: skip
"""Keys of the ECU by field, where they differ."""
ECU = record_of(
    Ecu,
    optional=("duty", "slew", "dead_band", "setpoint_weight", "derivative_weight", "noise", "lag"),
    called=ECU_KEYS,
    integral=key("number?", "Largest value of its integral, share of the supply; null where the integral stops at "
        "the output's limit instead.", lambda ecu: ecu["integral"] or None, optional=True),
    slew=key("number?", "Largest change of its output; null for none.", lambda ecu: ecu["slew"] or None, optional=True),
    compensated=key("flag", "Whether it divides its output by the battery voltage, so that the output means volts.",
        lambda ecu: bool(ecu["compensated"]), optional=True),
    P=key("number", "V/rad."),
    I=key("number", "V/rad for each tick."),
    D=key("number", "V/rad times ticks."),
    unit=key("text", "Of the three.", lambda _: UNIT),
)  # fmt: skip
_UNIT, _FORM = key("text", "Output over error, such as %/%."), key("text", "ticks or seconds.")
AS_WRITTEN = record_of(Terms, unit=_UNIT, form=_FORM)
CORNER = Record(
    supply_V=key("number", "There.", lambda corner: corner[0]),
    winding_degC=key("number", "There.", lambda corner: corner[1]),
    friction_over_bench=key("number", "There.", lambda corner: corner[2]),
)  # fmt: skip
CONDITIONS = Record(
    supply_V=key("[number]", "Least and largest.", "settings.conditions.supply"),
    winding_degC=key("[number]", "Coldest and hottest.", "settings.conditions.winding"),
    friction_over_bench=key("[number]", "Least and largest.", "settings.conditions.friction"),
    **record_of(
        Robust,
        worst=key(METRICS, "Of the fitted model at all corners of the conditions, each figure at its worst.", "worst"),
        called={"corner": "hardest"},
        corner=key(CORNER, "Corner at which most is missed, or least is left.", "corner"),
    ).within("robust"),
)
TABLE_GAINS = Record(**{name: key("[number]", each.meaning) for name, each in record_of(Terms).keys.items()})
TABLE_END = Record(
    "One supply.",
    supply_V=key("number", "Of the car.", "supply"),
    fixed=key(METRICS, "With the gains as they are.", lambda end: end.fixed.known()),
    table=key(METRICS, "With those of the table, feed-forward divided likewise.", lambda end: end.table.known()),
    helps=key("flag", "The table follows more closely."),
)  # fmt: skip
OVER_POSITION = Record(
    crossover_Hz=key("number", "Of the loop at a quarter of the travel.", "frequency"),
    within_pct=key("number", "Differences up to this count as none.", lambda _: 100.0 * NEAR),
    share_of_travel_within=key("number", "Where the plant's gain at the crossover differs by no more.", "alike"),
    least_ratio=key("number", "Of that gain to the one at a quarter of the travel, anywhere.",
        lambda over: over.ratio.min()),
    largest_ratio=key("number", "Likewise.", lambda over: over.ratio.max()),
)  # fmt: skip
SUPPLY_TABLE = Record(
    ecu_has=key("text?", "Whether the named make of ECU has one: table, code (yours sets the gains), none, or "
        "unknown; null where none was named.", enum=["table", "code", "none", "unknown", None]),
    designed_at_V=key("number", "Supply for which `gains` were found."),
    supply_V=key("[number]", "At each point of the table."),
    gains=key(TABLE_GAINS, "At each of these supplies, as the ECU writes them."),
    unit=_UNIT,
    form=_FORM,
    worst=key(list_of(TABLE_END), "At the ends of a car's supply, each figure at its worst of winding and friction "
        "there."),
    position=key(OVER_POSITION, "Whether a table over the position had anything to do."),
    says=key("[text]", "The same in words."),
)  # fmt: skip
FRONT_POINT = record_of(
    FrontPoint,
    null=("limit",),
    called={"limit": "duty_activity_limit_pct", "activity": "duty_activity_pct", "rmse": "rmse_pct", "meets": "met"},
    gains=key(GAINS, "v = Kp e + Ki integral of e + Kd de/dt, e in rad, v in V."),
)
ENVELOPE = record_of(Envelope, percent=("errors", "largest"), called={"errors": "error_pct", "longest": "longest_s"})
JAM = Record(
    **record_of(
        JamCheck,
        percent=("error", "sustained"),
        called={"timeout": "timeout_s", "longest": "longest_above_s", "detected_after": "told_after_s"},
    ).within("check"),
    written=key("{number}?", "As the named ECU writes it; null where its settings are not known."),
)
SENSOR_FAULT = record_of(
    Runaway,
    percent=("setpoint", "opens", "jam_opens", "apart_opens"),
    called={"setpoint": "asked_pct", "jam_after": "jam_after_s", "apart_after": "apart_after_s"},
)
SAG = record_of(
    Sag, percent=("opening", "closes", "opens", "wound"), called={"back_after": "back_after_s", "wound": "integral_pct"}
)
RETURN = record_of(
    Return, percent=("opening", "rests"), called={"cut_s": "open_terminals_s", "shorted_s": "shorted_terminals_s"}
)
HOLDING = record_of(
    Holding,
    null=("rise",),
    percent=("shares",),
    called={
        "shares": "position_pct", "current": "current_A", "closing": "closing_A", "opening": "opening_A",
        "watts": "winding_W", "rise": "winding_rise_K", "stall_A": "full_duty_A", "stall_W": "full_duty_W",
        "longest": "full_duty_s",
    },
    heating_known=key("flag", "The model has the winding's heating.", lambda holding: holding.rise is not None),
)  # fmt: skip
SAFETY = Record(
    envelope=key(ENVELOPE, "How far off a sound throttle is, in every scenario, over all draws under conditions drawn "
        "for them and the corners of the conditions.", "safety.envelope"),
    jam=key(JAM, "Jam check proposed: the least threshold whose timeout, with the reserve of the settings, is short "
        "enough; null where none is.", jam_with_names, null=True),
    sensor=key(list_of(SENSOR_FAULT), "Faults of the position sensor at a quarter of the travel, each figure the "
        "worst of the models.", "safety.sensors"),
    supply=key(list_of(SAG), "Sags of the supply while an opening is held, each figure the worst of the models.",
        "safety.sags"),
    unpowered=key(list_of(RETURN), "The plate without a current, each figure the worst of the models.",
        "safety.returns"),
    holding=key(HOLDING, "Holding the plate, fitted model at the bench's temperature.", "safety.holding"),
)  # fmt: skip
OVER_DRAWS = Record(
    probability_met=key("number?", "Share of draws that meet every requirement, by a stable loop.",
        "chosen.probability_met"),
    probability_margins=key("number?", "Share of draws that meet the required margins.", "chosen.probability_stable"),
    draws=key("whole", "How many."),
    origin=key("text", "posterior, or laplace where there is none; fleet where the draws are units of a fleet and the "
        "nominal model is their mean."),
)  # fmt: skip
SETPOINT = Record(
    times_s=key("[number]", "Corners.", "times"),
    shares_of_travel=key("[number]", "Corners, 0 to 1.", "shares"),
    scenarios=key("[text]", "Names, in their order.", optional=True),
)  # fmt: skip
BIAS_CURVE = record_of(
    Bias, called={"angles": "angles_rad", "hold": "hold_V", "closing": "closing_V", "opening": "opening_V"}
)
FRICTION_AHEAD = Record(
    opening_V=key("number", "Ahead while the setpoint rises.", "opening"),
    closing_V=key("number", "Taken off while it falls.", "closing"),
    full_from_rad_per_s=key("number", "Rate from which on it is all there.", "full"),
)  # fmt: skip
RATE_AHEAD = Record(
    V_s_per_rad=key("number", "N K_b + R_a (N^2 B_m + B_L) / (N K_m).", "slope"),
)  # fmt: skip
AHEAD = Record(
    terms=key("[text]", "With which the gains were found: spring (the bias curve), friction, rate.",
        lambda design: listed(design.terms), items={"type": "string", "enum": ["spring", "friction", "rate"]}),
    friction=key(FRICTION_AHEAD, "Of dry friction: by the sign of the setpoint's rate, straight where that is small.",
        "sliding"),
    rate=key(RATE_AHEAD, "Of back-EMF and viscous drag: in proportion to the setpoint's rate.", "sliding"),
    rate_filter_s=key("number", "Time constant of the filter of that rate; the derivative's.", "task.ecu.filter"),
)  # fmt: skip
RULE = Record(
    "One rule.",
    gains=key(GAINS, "v = Kp e + Ki integral of e + Kd de/dt, e in rad, v in V.", "tuned.gains", null=True),
    as_written=key(AS_WRITTEN, "The gains as the ECU of [ecu] in rig.toml writes them: numbers to type in; null where "
        "it names no unit.", null=True),
    why_not=key("text?", "Why it has no gains; null where it has.", lambda rule: rule["tuned"].why or None),
    linear=key(METRICS, "On the linear model; null without gains.", "tuned.linear", null=True),
    nonlinear=key(METRICS, "On the nonlinear model; null without gains.", "tuned.nonlinear", null=True),
    met=key("{flag}", "By requirement.", "tuned.met"),
    stable=key("flag", "As above; false without gains.", "tuned.stable", optional=True),
    probability_met=key("number?", "As above.", "tuned.probability_met"),
    probability_margins=key("number?", "As above.", "tuned.probability_stable"),
)  # fmt: skip
RUSEFI_GAINS = Record(
    pFactor=key("number", "Proportional.", "gains.P"),
    iFactor=key("number", "Per s.", "gains.I"),
    dFactor=key("number", "Times s.", "gains.D"),
    periodMs=key("number", "Clock; fixed there.", "ecu.period", 1e3),
    minValue=key("number", "Limit of what the PID asks for; the duty itself stays within 90 %.", lambda _: -100),
    maxValue=key("number", "Limit of what the PID asks for; the duty itself stays within 90 %.", lambda _: 100),
    etbBiasBins=key("[number]", "Position, % of travel.", "bins"),
    etbBiasValues=key("[number]", "Duty that holds it, %.", "duty.hold"),
    gains_found_with_bias=key("flag", "Leave the bias table at 0 where false.",
        lambda found: found["loop"].bias is not None),
    unit=key("text", "Of the gains.", lambda _: "% duty, % travel"),
    etb_iTermMin=key("number", "Least integral, % of duty.", "ecu.integral", -100.0, optional=True),
    etb_iTermMax=key("number", "Largest integral, % of duty.", "ecu.integral", 100.0, optional=True),
    duty_closing=key("[number]", "Duty at which the plate is about to close at these positions, %.", "duty.closing",
        optional=True),
    duty_opening=key("[number]", "Duty at which the plate is about to open at these positions, %.", "duty.opening",
        optional=True),
)  # fmt: skip
TYPED_GAIN = Record(
    value=key("number", "To type in; of an ECU whose unit is not published the most useful share that is known, see "
        "`unit`."),
    unit=key("text", "Of it, such as %/%, per s; of an ECU whose unit is not published what `value` is a share of."),
    of_present=key("number?", "Over the gain that the ECU has now, of an ECU whose unit is not published; null where "
        "that is not known.", optional=True),
    of_ultimate=key("number?", "Over the P at which P alone makes the plate oscillate; null for I and D.",
        optional=True),
    seconds=key("number?", "Of I the time P over I, of D the time D over P, s; null of P.", optional=True),
)  # fmt: skip
TYPED_LIMIT = Record(
    value=key("number", "To type in."),
    unit=key("text", "Of it."),
)  # fmt: skip
PROFILE = Record(
    name=key("text", "Of `--ecu`.", "profile.name"),
    title=key("text", "Of the make.", "profile.title"),
    gains=key(by_name(TYPED_GAIN), "Proportional, integral and derivative gain, by the names that the ECU gives them."),
    limits=key(by_name(TYPED_LIMIT), "Its other settings, by name, that make it the controller that was designed."),
    bias=key("{[number]}?", "Its table of feed-forward, by the names of its two rows: target position (% of the "
        "travel) and duty (%), as finely as the table can name them; all 0 where the gains were found without "
        "feed-forward; null where it has none."),
    source=key("text", "What is known of this ECU is taken from.", "profile.source"),
    assumed=key("[text]", "What is taken of it without a source, one sentence each."),
    code=key("[text]", "Lines that a user adds behind the PID in code of his own, at each tick, in %; empty where "
        "nothing but the table is fed forward.", optional=True),
    says=key("[text]", "What the gains mean, of an ECU whose unit is not published, one sentence each.", optional=True),
)  # fmt: skip
FUTURE = Record(
    share_met=key("number", "Share of them that meet every requirement.", "value"),
    share_ci95=key("[number]", "95 % interval of that share for the number of draws alone.",
        _ends, minItems=2, maxItems=2),
    draws=key("whole", "How many were drawn.", "of"),
)  # fmt: skip
UNIT_VERDICT = record_of(OddOne, null=("figure",))
FLEET = Record(
    share_met=key("number", "Share of the units that meet every requirement by a stable loop.", "share.value"),
    share_ci95=key("[number]", "95 % interval of that share in the population, exact for independent units.",
        lambda found: _ends(found.share), minItems=2, maxItems=2),
    share_asked=key("number", "Required share.", "share_asked"),
    reached=key("flag", "Whether enough units meet every requirement; if not, no gains were found with which more do."),
    units=key("whole", "Units judged.", "share.of"),
    future=key(FUTURE, "The same of units drawn from the population, which the fleet has not made yet; null where "
        "none were drawn.", null=True),
    worst=key(list_of(UNIT_VERDICT), "Units that fare worst, the worst first."),
    fails=key("{[text]}", "Names of the units that miss each requirement; one that none misses is left out."),
    searches=key("whole", "Searches made until these gains were found, each anew with the units that failed before."),
    says=key("text", "The same in a sentence."),
    settings=key("object", "Every field of `etcfit.control.settings.FleetDesignSettings`."),
)  # fmt: skip
SHARE = Record(
    share_met=key("number", "That meets every requirement by a stable loop.", "value"),
    share_ci95=key("[number]", "95 % interval of that share for the number of units alone, exact.",
        _ends, minItems=2, maxItems=2),
    of=key("whole", "How many there are."),
)  # fmt: skip
ON_UNITS = Record(
    **SHARE.within("share"),
    worst_rmse_pct=key("number?", "Largest tracking error among them; null is infinite.",
        lambda found: float(found.figures.rmse_pct.max())),
)  # fmt: skip
RULE_ON_PARTS = Record(
    "Its gains at the bench.",
    measured=key(ON_UNITS, "On the measured units."),
    drawn=key(ON_UNITS, "On units drawn from the population."),
    worst=key(UNIT_VERDICT, "The measured unit with the worst result."),
    fails=key("{[text]}", "Names of the measured units that miss each requirement; one that none misses is left out.",
        "measured.fails"),
)  # fmt: skip
CORNER_VERDICT = Record("", "", **{**UNIT_VERDICT.keys, "unit": key("text", "Its name, and the corner.")})
PARTS_CONDITIONS = Record(
    corners=key(SHARE, "Of the measured units, at every corner.", "share_at_corners"),
    hardest=key(CORNER_VERDICT, "The measured unit and corner at which most is missed, or least is left.",
        lambda found: found.corners.named(1)[0]),
    drawn=key(ON_UNITS, "On the drawn units, each under conditions drawn for it.", "anywhere"),
)  # fmt: skip
PARTS = Record(
    fleet=key("text", "Run folder of the fleet.", "where"),
    name=key("text", "Of the fleet."),
    units=key("[text]", "Names of the measured units, each by its shrunk values."),
    left_out=key("{text}", "Units of the fleet that are none of the parts, with why: odd, not converged, without a "
        "result."),
    of_run=key("[text]", "Parameters that the fleet does not tell: those of the run."),
    rules=key(by_name(RULE_ON_PARTS), "By rule that has gains."),
    conditions=key(PARTS_CONDITIONS, "The proposed gains under the conditions of a car, see `conditions`.", ""),
)  # fmt: skip
PID = file_of(
    "PID gains, every rule compared: written by `etcfit design`.",
    "fitted.config", "fitted",
    anyway=key("flag", "The gains were requested with --anyway: table and page give what is typed into an ECU even "
        "where the fit did not converge or is a compromise (`fit`). Absent in older files, then false.", optional=True),
    rule=key("text", "Whose gains are proposed.", "chosen.rule"),
    gains=key(GAINS, "v = Kp e + Ki integral of e + Kd de/dt, e in rad, v in V.", "chosen.gains"),
    ecu=key(ECU, "The same for an ECU that counts ticks: P = Kp, I = Ki T, D = Kd / T; and the ECU they were sought "
        "for.", lambda design: {**design.task.ecu._asdict(),
            **design.written(design.proposed, Notation(form="ticks"))._asdict()}),
    as_written=key(AS_WRITTEN, "The gains as the ECU of [ecu] in rig.toml writes them: numbers to type in; null where "
        "it names no unit.", lambda design: as_written(design, design.chosen.gains), null=True),
    linear=key(METRICS, "Of the proposed gains on the linear model and the paper's trapezoid; null where there are "
        "none.", "chosen.linear", null=True),
    nonlinear=key(METRICS, "Of the proposed gains on the fitted nonlinear model, the worst of all scenarios.",
        "chosen.nonlinear"),
    requirements=key(figures(LoopFigures, "", REQUIRED), "What each figure must stay below; null for no limit.",
        lambda design: design.task.requirements.limits()),
    margins_asked=key(figures(LoopFigures, "", MARGINS), "At least; required of the rule optimal only.",
        lambda design: design.task.requirements.limits(MARGINS)),
    met=key("{flag}", "By requirement, on the fitted nonlinear model in every scenario.", "chosen.met"),
    scenarios=key(
        by_name(METRICS, "One scenario: how well it is followed, the tracking error over all of it; of a log that "
        "alone."),
        "The proposed gains on the fitted nonlinear model, scenario by scenario.", "chosen.scenarios", optional=True),
    conditions=key(CONDITIONS, "The proposed gains where supply, winding and friction are not those of the bench.",
        "", optional=True),
    supply_table=key(SUPPLY_TABLE, "The proposed gains as a table over the supply with which the loop stays what was "
        "designed: in % they go with 1/U.",
        lambda design: supply_table_json(design.task, design.chosen.gains, design.supply_table), optional=True),
    front=key(list_of(FRONT_POINT), "Tracking against effort on the fitted model: the best gains within each limit of "
        "the duty's activity, the first without one.", optional=True),
    safety=key(SAFETY, "What the proposed gains do where something fails; positions and errors in % of the travel.",
        "", optional=True),
    stable=key("flag", "The linear loop is; of an unstable one no requirement counts as met, whatever one response "
        "shows.", "chosen.stable", optional=True),
    met_linear=key("{flag}", "By requirement of the paper, on the linear model and the paper's trapezoid.",
        "chosen.met_linear"),
    limits=key("[text]", "Where a requirement is missed, what keeps any gains from meeting it, one sentence each."),
    posterior=key(OVER_DRAWS, "Over draws of the parameters.", ""),
    setpoint=key(SETPOINT, "On which everything was judged."),
    feed_forward=key("flag", "The gains were found with a bias curve ahead of the PID.",
        lambda design: design.task.loop.bias is not None),
    bias_curve=key(BIAS_CURVE, "Voltages that hold the plate at positions that the ECU's own table can name, straight "
        "in between; in the loop only where `feed_forward` is true.", "bias", optional=True),
    feed_forward_terms=key(AHEAD, "Terms ahead of the PID, and the numbers of those that follow the setpoint's rate, "
        "asked for or not.", "", optional=True),
    rules=key(by_name(RULE), "By name, every rule.", lambda design: {
        name: {"tuned": tuned, "as_written": as_written(design, tuned.gains)} for name, tuned in design.tuned.items()}),
    rusefi=key(RUSEFI_GAINS, "The gains as rusEFI has them: % of duty over % of travel; null where they were sought "
        "for another controller (`etcfit design --ecu rusefi` seeks them for rusEFI's: 500 Hz, no filter, integral "
        "within 30 %, duty within 90 %).", rusefi, null=True),
    profile=key(PROFILE, "Settings of the make of ECU that was named (`etcfit design --ecu NAME`), as that ECU writes "
        "them; null where none was.", written_for, null=True, optional=True),
    fleet=key(FLEET, "How the proposed gains fare unit by unit; only in the design of a fleet, whose draws are units "
        "and whose nominal model is their mean.", optional=True),
    parts=key(PARTS, "How gains fare on the parts of one design; only where a fleet was given (--parts), over whose "
        "drawn units `optimal` was sought then.", optional=True),
    settings=key("object", "What the design decided by: every field of `etcfit.DesignSettings`."),
)  # fmt: skip
