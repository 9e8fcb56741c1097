"""Which column is the time, and in what unit."""

from __future__ import annotations

import numpy as np

from ..errors import MeasurementError
from .answers import Answers
from .labels import fits, quantities_in
from .sheet import TIME, Column, Sheet, time_base
from .take import Take
from .words import quantity_named

_SLOWEST_LOG = 2.0  # s between rows of an engine computer's log
_FINEST_IN_SECONDS, _COARSEST_IN_SECONDS = 1e-7, 0.5  # between samples


def time_of(sheet: Sheet, answers: Answers) -> Take:
    """The time of a sheet.

    Raises:
        MeasurementError: it has none.
    """
    columns = sheet.columns
    for column in columns:
        if (said := answers.of(sheet.file, column)) and said.quantity == TIME:
            return _united(column, said.unit, "said so", sheet.is_ecu)
    tried = (
        (lambda c: c.quantity == TIME, "the format's own time"),
        (lambda c: quantity_named(c.name) == TIME and c.unit in ("", *_units(c)), "by its name"),
        (lambda c: quantities_in(c.unit) == (TIME,) and _rises(c.values), "by its unit, and it rises"),
        (lambda c: not c.unit and quantity_named(c.name) is None and _rises(c.values) and _is_even(c.values),
         "it alone rises evenly"),
    )  # fmt: skip
    for test, reason in tried:
        if column := next((c for c in columns if test(c) and not _ignored(sheet, c, answers)), None):
            if column.stated and not column.unit:
                raise MeasurementError(sheet.where, f"time column '{column.label}' is in '{column.stated}', "
                                       "which is no known unit.", "Accepted: time in s or ms.",
                                       f"Say what it is: --column '{column.label}=time [s]'.")  # fmt: skip
            return _united(column, "", reason, sheet.is_ecu)
    if answers.period is not None:
        made = time_base(answers.period * np.arange(columns[0].values.size))
        return Take(made, TIME, "s", f"the file has none: --period, {answers.period:g} s")
    labels = "', '".join(column.label for column in columns[:40])
    raise MeasurementError(sheet.where, f"no time among its columns '{labels}'.", "Every trace needs one.",
                           "Name it: --column 'HEADER=time [s]', or give its period: --period 1ms.")  # fmt: skip


def _ignored(sheet: Sheet, column: Column, answers: Answers) -> bool:
    return answers.of(sheet.file, column) is not None


def _units(column: Column) -> tuple[str, ...]:
    return (column.unit,) if fits(TIME, column.unit) else ()


def _rises(values: np.ndarray) -> bool:
    """Mostly: several runs in one file begin anew."""
    steps = np.diff(values)
    return bool(np.isfinite(values).all()) and steps.size > 0 and float(np.mean(steps > 0.0)) > 0.99


def _is_even(values: np.ndarray) -> bool:
    steps = np.diff(values)
    return float(np.std(steps)) < 0.2 * float(np.mean(steps))


def _united(column: Column, unit: str, reason: str, ecu: bool) -> Take:
    if unit or column.unit:
        return Take(column, TIME, unit or column.unit, reason)
    step = float(np.median(np.diff(column.values))) if column.values.size > 1 else 0.0
    if ecu and step < _SLOWEST_LOG:
        return Take(column, TIME, "s", f"{reason}; engine computers log it in seconds")
    if _FINEST_IN_SECONDS < step < _COARSEST_IN_SECONDS and step not in (0.1, 0.2, 0.25, 0.05):
        return Take(column, TIME, "s", f"{reason}; no unit: samples {step:.3g} apart are taken as seconds", False)
    unit = "ms" if step < 200.0 else "us"
    return Take(column, TIME, unit, f"{reason}; no unit: samples {step:.3g} apart are taken as {unit}", False)
