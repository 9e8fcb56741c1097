"""The meaning of each column of a sheet: from the user, its name, its unit, or its relation to other columns.

current follows voltage          R^2 of i over v, with the plate's speed beside it
EMF follows the plate's speed    correlation of e and d theta/dt with the terminals open
a sensor stays between 0 and 5 V and moves smoothly

In an engine computer's log, only a name of its maker or a word of the plate makes a signal the throttle's.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..errors import MeasurementError
from ..rig.columns import HeaderError, parse_header
from ..rig.units import EXAMPLES, SI_UNIT, fits, is_percent, usual_unit
from . import shapes
from .answers import IGNORE, Answers, Target
from .names import (
    is_about,
    is_engines,
    is_of_the_motor,
    is_plates,
    is_plates_position,
    known,
    may_be_position,
    plain_words,
    quantity_named,
)
from .sheet import TIME, Column, Sheet, is_unknown_unit, quantities_in
from .take import LEFT_OUT, UNEXPLAINED, Take, left_out, signed, time_of, unit_by_range

_PLATE = ("position", "tps")
_OF_TRAVEL = ("position", "setpoint", "duty")  # logged in per cent by an engine computer if it gives no unit
_LEAD = 0.2  # least difference in the share of variance for a certain choice between two columns
_SENSOR = -0.2, 5.7  # possible readings of a position sensor, V
_MOST_DEG = 400.0  # larger whole numbers are no angle of a plate
_LEAST = 0.5  # correlation with the setpoint, at its best delay, below which a column is no plate if another is above


def takes_of(sheet: Sheet, answers: Answers) -> list[Take]:
    """The meaning of every column, time first.

    Raises:
        MeasurementError: no time, or a column whose name and unit contradict each other.
    """
    time = time_of(sheet, answers)
    others = [column for column in sheet.columns if column is not time.column]
    named = {id(column): take_by_itself(column, sheet, answers) for column in others}
    nameless = [column for column in others if named[id(column)] is None]
    found = [take for take in named.values() if take is not None]
    found += ([left_out(column, "no name of a throttle's") for column in nameless] if sheet.is_ecu
              else _by_relation(nameless, found, time))  # fmt: skip
    order = {id(column): k for k, column in enumerate(others)}
    found.sort(key=lambda take: order[id(take.column)])
    return [time, *map(signed, one_each(_without_engine(found), answers, sheet))]


def take_by_itself(column: Column, sheet: Sheet, answers: Answers) -> Take | None:
    """The meaning from the user, the name, or the unit; None if none of them gives it.

    Raises:
        MeasurementError: its name and its unit contradict each other, or the unit is not known.
    """
    if said := answers.wanted(sheet.file, column):
        return _as_said(column, said, sheet)
    with suppress(HeaderError):
        return Take(column, *parse_header(column.label), "it is called so")
    if not column.finite.size:
        return left_out(column, "it holds no number")
    named = quantity_of(column, sheet)
    if named == LEFT_OUT:
        return left_out(
            column,
            "by its name the engine's, not the throttle's" if sheet.is_ecu else "by its name it is not of the rig",
        )
    if named == TIME:
        return left_out(column, "another time")
    if named is None:
        return left_out(column, "no name of a throttle's") if sheet.is_ecu else _by_unit(column)
    if column.stated and not (sheet.is_ecu and known(column.name) is None) and is_unknown_unit(column.stated):
        raise _contradiction(sheet, column, named, "named as")
    return _by_name(column, named, sheet)


def quantity_of(column: Column, sheet: Sheet) -> str | None:
    """The quantity of a column's name; in an engine computer's log LEFT_OUT for signals of other parts."""
    if (found := known(column.name)) is not None:
        return found[0]
    if (sheet.is_ecu or not column.unit) and is_about(column.name):
        return LEFT_OUT
    named = quantity_named(column.name)
    if not sheet.is_ecu or named in (None, LEFT_OUT, TIME, "supply"):
        return LEFT_OUT if named == "setpoint" and is_engines(column.name) else named
    alone = plain_words(column.name) in ("target", "setpoint", "set point", "duty", "duty cycle", "pwm")
    if is_engines(column.name) or not (is_plates(column.name) or alone):
        return LEFT_OUT
    if named == "position" and not may_be_position(column.name):
        return LEFT_OUT
    if (
        named == "duty"
        and alone
        and not any(quantity_named(each.name) == "setpoint" and not is_engines(each.name) for each in sheet.columns)
    ):
        return LEFT_OUT  # the injectors'
    return named


def _as_said(column: Column, said: Target, sheet: Sheet) -> Take:
    if said.quantity == IGNORE:
        return left_out(column, "said so")
    if said.unit:
        return Take(column, said.quantity, said.unit, "said so", said=True)
    if column.unit and fits(said.quantity, column.unit):
        return Take(column, said.quantity, column.unit, "said so, in the file's unit", said=True)
    if column.unit or column.stated:
        raise _contradiction(sheet, column, said.quantity, "said to be")
    quantity, unit, sure = unit_by_range(said.quantity, column.peak)
    if quantity != said.quantity:
        unit, sure = usual_unit(said.quantity), False
    return Take(column, said.quantity, unit, f"said so; no unit: by its range in {unit}", sure)


def _by_name(column: Column, named: str, sheet: Sheet) -> Take | None:
    """Quantity from the name; unit from the file, else from the range."""
    if column.stated:
        return left_out(
            column, f"named as {named.replace('_', ' ')}, which is not logged in {column.stated}", sheet.is_ecu
        )
    if not column.unit and sheet.is_ecu and named in _OF_TRAVEL:
        whole = "1" if named == "duty" and column.peak <= 1.0 else "%"
        return Take(column, named, whole, "by its name, per cent of the travel as engine computers have it")
    if not column.unit:
        if named in ("position", "setpoint") and column.peak > _MOST_DEG and column.is_whole:
            raise MeasurementError(sheet.where, f"column '{column.label}' is named as {named}, and holds whole numbers "
                                   f"up to {column.peak:.0f} without a unit.",
                                   "Counts of a converter need what one count is.",
                                   f"Give it: --column '{column.label}={named} [{360 / 4096:.4g} deg]' for 4096 counts "
                                   f"a turn, or '{column.label}=ignore'.")  # fmt: skip
        quantity, unit, sure = unit_by_range(named, column.peak)
        if named == "duty" and unit == "%" and "pwm" in plain_words(column.name) and column.is_whole:
            reason = f"by its name; no unit: taken as %, but a whole number may be of 255: duty [{100 / 255:.4g} %]"
            return Take(column, named, unit, reason, False)
        return Take(column, quantity, unit, f"by its name; no unit: by its range in {unit}", sure)
    for quantity in (named, *(_PLATE if named in _PLATE else ())):
        if fits(quantity, column.unit):
            return Take(column, quantity, column.unit, f"by its name, in {column.unit}")
    if named in ("current", "torque", "motor_speed") and fits("voltage", column.unit):
        raise _contradiction(sheet, column, named, "named as")
    sure = sheet.is_ecu and known(column.name) is None
    return left_out(column, f"named as {named.replace('_', ' ')}, which is not logged in {column.unit}", sure)


def _contradiction(sheet: Sheet, column: Column, quantity: str, how: str) -> MeasurementError:
    probe, unit = f"{quantity} [10 {usual_unit(quantity)}]", column.unit or column.stated
    other = f"in '{unit}', which is no known unit" if column.stated else f"in {unit}"
    usage = " for a probe of 100 mV to one" if "V" in unit else " if it is ten"
    return MeasurementError(sheet.where, f"column '{column.label}' is {how} {quantity}, but {other}.",
                            f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                            f"Give the value of one {unit}: --column '{column.label}={probe}'{usage}, "
                            f"or '{column.label}=ignore'.")  # fmt: skip


def _by_unit(column: Column) -> Take | None:
    """Quantity from a unit that only this quantity has."""
    if not column.unit or is_percent(column.unit):
        return None
    possible = quantities_in(column.unit)
    for quantity, reason in (("current", ""), ("motor_speed", ""), ("torque", ""), ("temperature", ""),
                             ("position", "an angle")):  # fmt: skip
        if quantity in possible and "voltage" not in possible:
            why = reason or f"only {quantity.replace('_', ' ')} is logged in {column.unit}"
            return Take(column, quantity, column.unit, f"by its unit: {why}")
    return None


def _by_relation(nameless: Sequence[Column], known: Sequence[Take], time: Take) -> list[Take]:
    """Columns with unknown name and unit, from their relations."""
    # no unit, volts or per cent; another unit in the file means another quantity
    moving = [c for c in nameless if (c.unit in ("", "V", "mV") or is_percent(c.unit)) and not c.stated and c.varies]
    still = [c for c in nameless if c not in moving]
    by = {take.quantity: shapes.filled(take.si) for take in known if take.quantity}
    plate = next((by[name] for name in _PLATE if name in by), None)
    taken: list[Take] = []
    constants = [c for c in nameless if c.unit in ("V", "mV") and not c.varies]
    if "current" in by:
        taken = _beside_current(moving, by, plate, time)
        if not moving and not ({"voltage", "duty"} & set(by)) and len(constants) == 1:
            taken = [_volts(constants[0], "voltage", "the only voltage, with a current", True)]
    elif volts := [c for c in moving if not is_percent(c.unit)]:
        taken = _without_current(volts, by, plate, time)
    done = {id(take.column) for take in taken}
    rest = [c for c in nameless if id(c) not in done]
    return [*taken, *(_unexplained(c, c in still) for c in rest)]


def _beside_current(
    volts: Sequence[Column], by: dict[str, np.ndarray], plate: np.ndarray | None, time: Take
) -> list[Take]:
    """The current follows voltage or duty; the remaining column within a sensor's range is the sensor."""
    out: list[Take] = []
    rest = list(volts)
    if not {"voltage", "duty"} & set(by) and rest:
        drive, sure, why = _what_current_follows(rest, by, plate, time)
        if is_percent(drive.unit):
            out.append(Take(drive, "duty", drive.unit, why, sure))
        else:
            out.append(_volts(drive, "voltage", why, sure))
        rest = [c for c in rest if c is not drive]
    rest = [c for c in rest if not is_percent(c.unit)]
    if plate is None and (sensors := [c for c in rest if _like_a_sensor(c)]):
        out.append(_volts(sensors[0], "tps", "it stays between 0 and 5 V, and a current does not follow it",
                          len(sensors) == 1 and len(rest) == 1))  # fmt: skip
    return out


def _what_current_follows(
    volts: Sequence[Column], by: dict[str, np.ndarray], plate: np.ndarray | None, time: Take
) -> tuple[Column, bool, str]:
    """The column that the current follows, whether that is certain, and the reason."""
    current, clock = by["current"], time.si
    if len(volts) == 1:
        (only,) = volts
        values = shapes.filled(only.values)
        moves = shapes.span(values) > 20.0 * shapes.noise(values) and shapes.explained(current, values) < shapes.FOLLOWS
        strange = is_percent(only.unit) or (moves and _like_a_sensor(only))
        return only, not strange, "the only voltage, with a current" + ("; it does not follow it" if moves else "")
    scores = []
    for column in volts:
        own = shapes.filled(column.values)
        places = [plate] if plate is not None else [shapes.filled(c.values) for c in volts if c is not column]
        speeds = [shapes.slope(place, clock) for place in places]
        scores.append(max(shapes.explained(current, own, speed) for speed in speeds))
    first, second = sorted(range(len(volts)), key=lambda k: -scores[k])[:2]
    why = f"current follows it: {100 * scores[first]:.0f} % of its variance, against {100 * scores[second]:.0f} %"
    return volts[first], scores[first] > shapes.FOLLOWS and scores[first] - scores[second] > _LEAD, why


def _without_current(
    volts: Sequence[Column], by: dict[str, np.ndarray], plate: np.ndarray | None, time: Take
) -> list[Take]:
    """With open terminals the EMF follows the speed of the plate, or of the sensor."""
    clock = time.si
    if plate is not None:
        speed = shapes.slope(plate, clock)
        follows = {id(c): abs(shapes.correlation(shapes.filled(c.values), speed)) for c in volts}
        best = max(volts, key=lambda c: follows[id(c)])
        is_emf = follows[id(best)] > shapes.FOLLOWS and shapes.comes_to_rest(speed)
        if is_emf and "emf" not in by and "voltage" not in by:
            return [_emf(best, follows[id(best)])]
        return [_volts(best, "voltage", "the only voltage, with a position", False)] if len(volts) == 1 else []
    if len(volts) != 2:
        sensors = [c for c in volts if _like_a_sensor(c)]
        if len(sensors) == 1 and len(volts) == 1 and {"voltage", "duty", "emf"} & set(by):
            return [_volts(sensors[0], "tps", "it stays between 0 and 5 V, and another column drives the plate", True)]
        return []
    tried = [(abs(shapes.correlation(shapes.filled(a.values), shapes.slope(shapes.filled(b.values), clock))), a, b)
             for a, b in (volts, volts[::-1])]  # fmt: skip
    best, emf, sensor = max(tried, key=lambda each: each[0])
    if best > shapes.FOLLOWS:
        why = "the other voltage follows its rate of change: it is the sensor"
        return [_emf(emf, best), _volts(sensor, "tps", why, best > shapes.SURELY_FOLLOWS)]
    return []


def _emf(column: Column, correlation: float) -> Take:
    why = f"no current, and it follows the speed of the plate (correlation {correlation:.2f})"
    return _volts(column, "emf", why, correlation > shapes.SURELY_FOLLOWS)


def _like_a_sensor(column: Column) -> bool:
    values = column.finite * (1e-3 if column.unit == "mV" else 1.0)
    least, most = _SENSOR
    return float(np.min(values)) >= least and float(np.max(values)) <= most


def _volts(column: Column, quantity: str, reason: str, sure: bool) -> Take:
    if column.unit:
        return Take(column, quantity, column.unit, reason, sure)
    guessed, unit, plain = unit_by_range(quantity, column.peak)
    unit = unit if guessed == quantity else "V"
    return Take(column, quantity, unit, f"{reason}; no unit: by its range in {unit}", sure and plain)


def _unexplained(column: Column, known_kind: bool) -> Take:
    """A column without a known meaning; if it could matter, it is in doubt."""
    if not column.varies:
        return left_out(column, f"neither name nor unit shows what it is, and it stays at {column.values[0]:.4g}")
    matters = not known_kind or is_percent(column.unit) or bool(set(quantities_in(column.unit)) & set(SI_UNIT))
    return left_out(column, UNEXPLAINED, not matters)


def _without_engine(takes: Sequence[Take]) -> list[Take]:
    """Leave out the engine's speed in an ECU's log, which is not that of the throttle's motor."""
    has_plate = any(take.quantity in (*_PLATE, "setpoint") for take in takes)
    return [
        left_out(take.column, "by its name the speed of the engine, not of the throttle's motor")
        if has_plate and take.quantity == "motor_speed" and not is_of_the_motor(take.column.name) else take
        for take in takes
    ]  # fmt: skip


def one_each(takes: Sequence[Take], answers: Answers, sheet: Sheet) -> list[Take]:
    """Keep one column for each quantity: the user's choice, else the one with the surest name, else the first.

    An engine computer's per cent take precedence over its sensor's volts, which need a calibration. A plate follows its
    setpoint: of several columns, one that does not is not the plate. The first of several is in doubt.
    """
    out = list(takes)
    setpoint = next((take.column for take in takes if take.quantity == "setpoint"), None)
    for quantity in {_place(take) for take in takes} - {LEFT_OUT}:
        same = [k for k, take in enumerate(takes) if _place(take) == quantity]
        said = [k for k in same if answers.wanted(sheet.file, takes[k].column)]
        ranked = sorted(
            said or same, key=lambda k: (_rank(takes[k].column), sheet.is_ecu and takes[k].quantity == "tps")
        )
        if quantity == "position" and setpoint is not None and not said:
            ranked.sort(key=lambda k: not _follows(takes[k].column, setpoint))
        kept = ranked[0]
        for k in same:
            if k != kept:
                out[k] = left_out(
                    takes[k].column, f"'{takes[kept].column.label}' is the {takes[kept].quantity} already"
                )
        equals = [k for k in ranked if not sheet.is_ecu or _rank(takes[k].column) == _rank(takes[kept].column)]
        if len(equals) > 1 and not said and not (sheet.is_ecu and quantity == "supply"):
            others = ", ".join(f"'{takes[k].column.label}'" for k in equals if k != kept)
            out[kept] = replace(takes[kept], sure=False, reason=f"{takes[kept].reason}; the first of several: {others}")
    return out


def _rank(column: Column) -> int:
    """Rank of the name, 0 the surest."""
    found = known(column.name)
    return found[1] if found is not None else 50 if is_plates_position(column.name) else 1000


def _follows(column: Column, setpoint: Column) -> bool:
    """Whether a column moves with the setpoint, with a delay of at most a tenth of the record."""
    there = np.isfinite(column.values) & np.isfinite(setpoint.values)
    if np.sum(there) < 3:
        return True  # logged in different rows: unknown
    y, u = column.values[there], setpoint.values[there]
    lags = np.unique(np.linspace(0, max(1, y.size // 10), 40).astype(int))
    return max(shapes.correlation(y[lag:], u[: u.size - lag]) for lag in lags) > _LEAST or bool(np.ptp(u) == 0.0)


def _place(take: Take) -> str:
    """The quantity, with position and sensor volts as one."""
    return "position" if take.quantity == "tps" else take.quantity
