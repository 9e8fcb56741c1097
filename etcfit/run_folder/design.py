"""What is worked out for pid.json: gains as ECUs write them, lines of code, a table over the supply."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..control.design import Design
from ..control.own_numbers import said, shares
from ..control.pid import Gains, Task
from ..control.pid.feedforward import Sliding
from ..control.supply_table import NEAR, AtSupply, OverPosition, SupplyTable
from ..model.ecu import Ecu, Notation, Terms
from ..model.ecus import GENERIC, NOT_DIVIDED, RUSEFI, BiasTable, EcuProfile, Scheduling, differences
from ..model.feed_forward import Term

_FOLLOWS = {Scheduling.NONE: ": fixed gains it must be", Scheduling.UNKNOWN: ": look for one before you plan with it"}


def ecu_with_gains(design: Design) -> dict[str, Any]:
    """The ECU by field, with the gains as one that counts ticks has them: P = Kp, I = Ki T, D = Kd / T, all V/rad."""
    assert design.chosen.gains is not None, "the proposed rule has gains"
    return design.task.ecu._asdict() | design.written(design.chosen.gains, Notation(form="ticks"))._asdict()


def as_written(design: Design, gains: Gains | None) -> dict[str, Any] | None:
    """Gains in unit and form of [ecu] of rig.toml; None where it names no unit."""
    notation = design.fitted.config.notation
    if notation is None or gains is None:
        return None
    return {**design.written(gains, notation)._asdict(), "unit": notation.unit, "form": notation.form}


def rules_as_written(design: Design) -> dict[str, dict[str, Any]]:
    """Every rule by name: what it came to, and its gains as the user's ECU writes them."""
    return {
        name: {"tuned": tuned, "as_written": as_written(design, tuned.gains)} for name, tuned in design.tuned.items()
    }


def jam_with_names(design: Design) -> dict[str, Any] | None:
    """The jam check, and as the ECU writes it, the error rounded up: a larger one is passed for a shorter time."""
    check, profile = design.safety.jam, design.task.profile
    if check is None:
        return None
    if profile is None or profile.jam is None:
        return {"check": check, "written": None}
    error, timeout = profile.jam
    return {"check": check, "written": {error: float(math.ceil(100.0 * check.error)), timeout: check.timeout}}


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
