"""The meaning of a column, with the reason and whether it is certain: unit by the size of its numbers, sign, time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MeasurementError
from ..rig.columns import sign_bit, without_sign_bit
from ..rig.units import conversion, fits, is_percent
from .answers import Answers
from .names import quantity_named
from .sheet import TIME, Column, Sheet, quantities_in, time_base

UNEXPLAINED = "neither its name nor its values show what it is"
LEFT_OUT = ""  # the quantity of a column that is left out
_SLOWEST_LOG = 2.0  # longest time between rows of an engine computer's log, s
_FINEST_IN_SECONDS, _COARSEST_IN_SECONDS = 1e-7, 0.5  # range of the time between samples in s
_END = float("inf")
# quantity by its name -> (largest peak, quantity, unit, whether that is certain); a position between 0 and 1 is a share
# of the usual 90 degrees
_RANGES: dict[str, tuple[tuple[float, str, str, bool], ...]] = {
    "voltage": ((40.0, "voltage", "V", True), (150.0, "voltage", "V", False), (_END, "voltage", "mV", True)),
    "current": ((30.0, "current", "A", True), (150.0, "current", "A", False), (_END, "current", "mA", True)),
    "emf": ((15.0, "emf", "V", True), (60.0, "emf", "V", False), (_END, "emf", "mV", True)),
    "supply": ((60.0, "supply", "V", True), (_END, "supply", "mV", True)),
    "tps": ((6.0, "tps", "V", True), (400.0, "position", "deg", False), (_END, "tps", "mV", False)),
    "position": ((1.06, "position", "90 deg", False), (1.75, "position", "rad", False), (5.6, "tps", "V", False),
                 (96.0, "position", "deg", False), (110.0, "position", "%", False), (_END, "tps", "mV", False)),
    "setpoint": ((1.75, "setpoint", "rad", False), (96.0, "setpoint", "deg", False), (_END, "setpoint", "%", False)),
    "motor_speed": ((_END, "motor_speed", "rpm", False),),
    "duty": ((1.05, "duty", "1", True), (100.5, "duty", "%", True), (255.5, "duty", f"{100 / 255:.10g} %", False),
             (1023.5, "duty", f"{100 / 1023:.10g} %", False), (_END, "duty", f"{100 / 4095:.10g} %", False)),
    "torque": ((_END, "torque", "N m", False),),
    "temperature": ((200.0, "temperature", "degC", True), (_END, "temperature", "K", False)),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Take:
    """One column with its meaning."""

    column: Column  # the column of the file
    quantity: str  # quantity of a measurement folder's CSV; LEFT_OUT for none
    unit: str  # unit in that CSV, with a number before it if the sign is turned; "" if not yet known
    reason: str  # the reason in words
    sure: bool = True  # False if the user should confirm it
    said: bool = False  # whether the user gave it, so that no guess changes it

    @property
    def header(self) -> str:
        """Header in the folder's CSV."""
        return f"{self.quantity} [{self.unit}]"

    @property
    def si(self) -> np.ndarray:
        """Values in SI, shape (n,); a share of the travel for per cent of it, sensor volts for `tps`."""
        if is_percent(self.unit):
            return 0.01 * self.column.values
        to_si = conversion(self.quantity, self.unit)
        return to_si.scale * self.column.values + to_si.offset

    def turned(self, why: str, sure: bool) -> Take:
        """The take with its sign turned."""
        if is_percent(self.unit):  # a header cannot turn the sign of a share of the travel, but of an angle
            why, unit = f"{why} (100 % as 90 degrees)", "-0.9 deg"
        else:
            unit = self.unit.removeprefix("-1 ") if self.unit.startswith("-1 ") else f"-1 {self.unit}"
        return replace(self, unit=unit, reason=f"{self.reason}; sign turned: {why}", sure=self.sure and sure)


def left_out(column: Column, reason: str, sure: bool = True) -> Take:
    """A column that is left out."""
    return Take(column, LEFT_OUT, "", reason, sure)


def unit_by_range(quantity: str, peak: float) -> tuple[str, str, bool]:
    """The unit in which numbers of this size are plausible for a rig.

    Args:
        quantity: quantity from the name.
        peak: largest magnitude.
    Returns:
        Quantity (`tps` may have become `position`, or vice versa), unit, and whether that is certain.
    """
    _, found, unit, sure = next(each for each in _RANGES[quantity] if peak <= each[0])
    return found, unit, sure


def signed(take: Take) -> Take:
    """The column with its sign decoded from a sign bit; unchanged if there is no such bit.

    Feetech's STS has it in bit 10 of the load and in bit 15 of speed and position, older Dynamixels in bit 10.

    Source: Feetech, STS3215 memory table; Robotis, AX-12 control table, "Present Load". Differs from source: no.
    """
    if take.quantity in (LEFT_OUT, TIME, "tps", "supply", "temperature"):
        return take
    raw = take.column.values
    bit = sign_bit(raw, take.quantity)
    if bit is None:
        return take
    largest = np.array([np.nanmax(raw)])
    why = f"the sign is in bit {bit}: {largest[0]:.0f} is {without_sign_bit(largest, bit)[0]:.0f}"
    column = replace(take.column, values=without_sign_bit(raw, bit))
    return replace(take, column=column, reason=f"{take.reason}; {why}")


def time_of(sheet: Sheet, answers: Answers) -> Take:
    """The time of a sheet.

    Raises:
        MeasurementError: the sheet has no time, or one in an unknown unit.
    """
    for column in sheet.columns:
        if (said := answers.wanted(sheet.file, column)) and said.quantity == TIME:
            return _united(column, said.unit, "said so", sheet.is_ecu)
    free = [column for column in sheet.columns if answers.wanted(sheet.file, column) is None]
    tried: tuple[tuple[Callable[[Column], bool], str], ...] = (
        (lambda c: c.quantity == TIME, "the format's own time"),
        (lambda c: quantity_named(c.name) == TIME and (not c.unit or fits(TIME, c.unit)), "by its name"),
        (lambda c: quantities_in(c.unit) == (TIME,) and _rises(c.values), "by its unit, and it rises"),
        (lambda c: not c.unit and quantity_named(c.name) is None and _rises(c.values) and _is_even(c.values),
         "it alone rises evenly"),
    )  # fmt: skip
    for test, reason in tried:
        if column := next(filter(test, free), None):
            if column.stated and not column.unit:
                raise MeasurementError(sheet.where, f"time column '{column.label}' is in '{column.stated}', "
                                       "which is no known unit.", "Accepted: time in s or ms.",
                                       f"Say what it is: --column '{column.label}=time [s]'.")  # fmt: skip
            return _united(column, "", reason, sheet.is_ecu)
    if answers.period is not None:
        made = time_base(answers.period * np.arange(sheet.rows))
        return Take(made, TIME, "s", f"the file has none: --period, {answers.period:g} s")
    labels = "', '".join(column.label for column in sheet.columns[:40])
    raise MeasurementError(sheet.where, f"no time among its columns '{labels}'.", "Every trace needs one.",
                           "Name it: --column 'HEADER=time [s]', "
                           "or let `etcfit import` give it one: --period 1ms.")  # fmt: skip


def _rises(values: np.ndarray) -> bool:
    """Whether values mostly rise: several runs in one file begin again."""
    steps = np.diff(values)
    return bool(np.isfinite(values).all()) and steps.size > 0 and float(np.mean(steps > 0.0)) > 0.99


def _is_even(values: np.ndarray) -> bool:
    steps = np.diff(values)
    return float(np.std(steps)) < 0.2 * float(np.mean(steps))


def _united(column: Column, unit: str, reason: str, ecu: bool) -> Take:
    """The time with its unit, from the usual step if neither file nor user gives one."""
    if unit or column.unit:
        return Take(column, TIME, unit or column.unit, reason)
    step = float(np.median(np.diff(column.values))) if column.values.size > 1 else 0.0
    if ecu and step < _SLOWEST_LOG:
        return Take(column, TIME, "s", f"{reason}; engine computers log it in seconds")
    if _FINEST_IN_SECONDS < step < _COARSEST_IN_SECONDS and step not in (0.1, 0.2, 0.25, 0.05):
        return Take(column, TIME, "s", f"{reason}; no unit: samples {step:.3g} apart are taken as seconds", False)
    unit = "ms" if step < 200.0 else "us"
    return Take(column, TIME, unit, f"{reason}; no unit: samples {step:.3g} apart are taken as {unit}", False)
