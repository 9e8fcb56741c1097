"""Refuses impossible traces: ranges, durations and motion that no throttle rig has, with the likely mistake.

The limits are wide: they find a unit that is wrong by a thousand, not an unusual rig.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ..errors import MeasurementError
from .base import RigConfig
from .columns import Column, Log, sign_bit

# channel -> lowest and highest value possible, SI
POSSIBLE: dict[str, tuple[float, float]] = {
    "voltage": (-100.0, 100.0),
    "current": (-500.0, 500.0),
    "emf": (-100.0, 100.0),
    "motor_speed": (-2e4, 2e4),
    "duty": (-1.005, 1.005),  # the last count may be rounded
    "supply": (1.0, 60.0),
    "torque": (-1e3, 1e3),
    "temperature": (-60.0, 250.0),
}
SHORTEST, LONGEST, FINEST = 1e-3, 86400.0, 1e-6  # s: a trace, a trace, the time between two samples
BEYOND_STOP, BEYOND_STOP_RAD = 0.05, np.radians(2.0)  # allowed distance beyond a stop: share of the travel, and least
SENSOR_FAILS = 0.02  # largest share of samples beyond the end points that counts as single failures of the sensor
SETPOINT_BEYOND = 0.5  # share of the travel by which a setpoint may lie beyond the stops
OHMS = (0.02, 1e3)  # peak voltage over peak current with the plate held; real windings have 0.1 to 100 ohm
OHMS_VOLTAGE, OHMS_CURRENT = 0.1, 0.2  # V, A: below these peaks the ratio is dominated by noise


@dataclass(frozen=True)
class Plausible:
    """Limits for a trace of one rig test."""

    varies: tuple[str, ...] = ()  # channels that must not be constant
    # channel -> least peak, SI, in at least one trace of the test
    peaks: Mapping[str, float] = field(default_factory=dict)
    stroke: float = 0.0  # least share of the travel that the plate sweeps
    shortest: float = SHORTEST  # s, least duration
    coarsest: float = float("inf")  # s, greatest median time between samples


DRIVEN = {"voltage": 0.02, "duty": 0.02, "torque": 1e-4}
PLAUSIBLE: dict[str, Plausible] = {
    "resistance": Plausible(peaks={"voltage": 0.02, "current": 1e-3}),
    "inductance": Plausible(("current",), {"voltage": 0.02, "current": 1e-3}, coarsest=0.02),
    "back_emf": Plausible(("position", "emf", "voltage"), {"emf": 0.02, "voltage": 0.02}, 0.03, 0.02, 0.1),
    "static_load": Plausible(("position", "voltage", "duty", "torque"), DRIVEN, 0.0, 0.1, 5.0),
    "viscous": Plausible((), {**DRIVEN, "motor_speed": 0.1}, 0.0, 0.02, 0.5),
    "inertia": Plausible(("position", "emf"), {}, 0.03, 0.02, 0.1),
    "response": Plausible(("position",), DRIVEN, 0.0, 0.02, 0.5),
    "closed_loop": Plausible(("position",), {}, 0.0, 0.02, 0.5),
    "sine": Plausible(("position", "setpoint"), {}, 0.0, 0.02, 0.5),
    "drive": Plausible((), {}, 0.0, 0.1, 2.0),
}

# unit -> units that the numbers may really have
TOO_LARGE = {"V": "mV", "A": "mA", "N m": "mN m", "Nm": "mNm", "N*m": "mN*m", "1": "%", "-": "%", "rad": "deg or %",
             "s": "ms or us", "rad/s": "rpm", "mV": "uV", "mA": "uA", "ms": "us", "degC": "K"}  # fmt: skip
TOO_SMALL = {"mV": "V", "mA": "A", "mN m": "N m", "mNm": "Nm", "%": "1", "deg": "rad", "ms": "s", "us": "ms or s",
             "rpm": "rad/s", "K": "degC"}  # fmt: skip


def check_log(log: Log, config: RigConfig) -> None:
    """Refuse an impossible trace.

    Raises:
        MeasurementError: for the first violation.
    """
    test = PLAUSIBLE.get(log.test, Plausible())
    _check_time(log, test)
    for column in log.channels.values():
        _check_range(log, column, config)
        if column.quantity in test.varies and np.nanmin(column.logged) == np.nanmax(column.logged):
            raise MeasurementError(log.where, f"column '{column.header}' never changes from "
                                   f"{np.nanmin(column.logged):.6g} {column.unit}.",
                                   f"A {log.test} test needs it to move.",
                                   "Check the sensor, or delete the file.")  # fmt: skip
    position, travel = log.channels.get("position"), config.travel[1] - config.travel[0]
    if position is not None and np.isfinite(travel):
        stroke = float(np.nanmax(position.value) - np.nanmin(position.value)) / travel
        if stroke < test.stroke:
            raise MeasurementError(log.where, f"column '{position.header}' sweeps {100 * stroke:.2g} % of the travel.",
                                   f"A {log.test} test lets the plate go from open: at least {100 * test.stroke:g} %.",
                                   _cure(position.unit, TOO_SMALL))  # fmt: skip
    voltage, current = log.channels.get("voltage"), log.channels.get("current")
    if log.test in ("resistance", "inductance") and voltage is not None and current is not None:
        volts, amperes = _peak(voltage), _peak(current)
        too_low = amperes > OHMS_CURRENT and volts < OHMS[0] * amperes
        too_high = volts > OHMS_VOLTAGE and volts > OHMS[1] * amperes
        if too_low or too_high:
            raise MeasurementError(log.where, f"peaks of {volts:.3g} V and {amperes:.3g} A do not belong together.",
                                   f"Voltage over current must lie between {OHMS[0]:g} and {OHMS[1]:g} ohm.",
                                   f"Correct the unit of '{voltage.header}' or of '{current.header}'.")  # fmt: skip


def check_peaks(test: str, logs: Iterable[Log]) -> None:
    """Refuse a rig test in all of whose traces a channel is so small that its unit must be wrong.

    Raises:
        MeasurementError: names the first file.
    """
    logs = tuple(logs)
    for name, least in PLAUSIBLE.get(test, Plausible()).peaks.items():
        having = [log for log in logs if name in log.channels]
        highest = max((_peak(log.channels[name]) for log in having), default=np.inf)
        if highest < least:
            column = having[0].channels[name]
            raise MeasurementError(having[0].where,
                                   f"column '{column.header}' stays below {_logged(highest, column)} in every trace.",
                                   f"A {test} test must reach {_logged(least, column)} in one of them.",
                                   _cure(column.unit, TOO_SMALL))  # fmt: skip


def _check_time(log: Log, test: Plausible) -> None:
    time, unit = log.time, log.columns["time"].unit
    duration, steps = time[-1] - time[0], np.diff(time)
    if not test.shortest * (1 - 1e-6) <= duration <= LONGEST:
        table = TOO_SMALL if duration < test.shortest else TOO_LARGE
        raise MeasurementError(log.where, f"the trace lasts {duration:.3g} s.",
                               f"A {log.test} trace must last {test.shortest:g} s to a day.",
                               _cure(unit, table))  # fmt: skip
    if steps.min() < FINEST * (1 - 1e-6):
        raise MeasurementError(log.at(1 + int(np.argmin(steps))),
                               f"this sample is {steps.min():.3g} s after the one before.",
                               f"At least {FINEST:g} s is required.", _cure(unit, TOO_SMALL))  # fmt: skip
    if np.median(steps) > test.coarsest:
        raise MeasurementError(log.where, f"the samples are {np.median(steps):.3g} s apart.",
                               f"A {log.test} trace needs one every {test.coarsest:g} s.",
                               _cure(unit, TOO_LARGE))  # fmt: skip


def _check_range(log: Log, column: Column, config: RigConfig) -> None:
    if column.quantity in POSSIBLE:
        low, high = POSSIBLE[column.quantity]
    else:
        low, high = config.travel
        part = SETPOINT_BEYOND if column.quantity == "setpoint" else BEYOND_STOP
        more = max(part * (high - low), BEYOND_STOP_RAD)
        low, high = low - more, high + more
    value = column.value
    bad = (value < low) | (value > high)
    if not bad.any():
        return
    k = int(np.argmax(bad))
    found = f"column '{column.header}' is {column.logged[k]:.6g} {column.unit}."
    required = f"{column.quantity} must lie between {_logged(low, column)} and {_logged(high, column)}"
    mend = _cure(column.unit, TOO_LARGE)
    if (bit := sign_bit(column.logged, column.quantity)) is not None:
        mend = (f"The register keeps its sign in bit {bit}: from {2**bit} on the value is {2**bit} - raw. "
                "`etcfit import` reads it so.")  # fmt: skip
    elif column.quantity == "duty":
        mend = f"{mend} Or give what one count is, as in 'duty [0.1 %]'."
    if column.quantity not in POSSIBLE:  # an angle
        required += ", the travel and a little more"
        if not column.unit.endswith("V"):
            mend = f"{mend} Or correct [rig] travel_deg."
        elif np.mean(bad) <= SENSOR_FAILS:
            mend = "Correct [tps] or [rig] travel_deg in rig.toml, or empty the cell if the sensor failed."
        else:
            found = (f"sensor_end_points: column '{column.header}' is beyond the end points of [tps] in "
                     f"{int(bad.sum())} of {value.size} samples: it shows {np.nanmin(column.logged):.4g} to "
                     f"{np.nanmax(column.logged):.4g} {column.unit}.")  # fmt: skip
            mend = "Correct [tps] in rig.toml: what the sensor shows with the plate at each stop."
    raise MeasurementError(log.at(k), found, f"{required}.", mend)


def _peak(column: Column) -> float:
    return float(np.nanmax(np.abs(column.value)))


def _logged(value: float, column: Column) -> str:
    """An SI value in the logged unit, for a message."""
    return f"{(value - column.conversion.offset) / column.conversion.scale:.4g} {column.unit}"


def _cure(unit: str, slips: Mapping[str, str]) -> str:
    likely = f" Is the log really in {slips[unit]}?" if unit in slips else ""
    return f"Correct the unit '{unit}' in the header, or the numbers.{likely}"
