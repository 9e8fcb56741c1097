"""Converts the columns of a table to quantities in SI.

A header is `quantity [unit]`, or a name that [columns] of rig.toml maps to one.

A current that was logged at the bridge's supply is converted to that of the motor:

    i = i_s / d,    d = duty, or v / V_s

Where the duty is near zero the supply's current does not determine the motor's, and there is no value. The noise grows
as the duty falls; one value is used for all samples of a test.

Source: Mohan, Undeland and Robbins 2003, ch. 7 (full bridge: mean current of its source). Differs from source: no.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MeasurementError
from .base import RigConfig
from .table import Table
from .toml import Toml
from .units import EXAMPLES, SI_UNIT, Conversion, UnitError, conversion, is_percent, to_channel, usual_unit
from .user_text import toml_string

DROP = ("", "ignore")  # right-hand sides in [columns] that leave a column out
_FORM = re.compile(r"(?P<quantity>[^\[\]]+?)\s*\[\s*(?P<unit>[^\[\]]*?)\s*\]")
SUPPLY_CURRENT = "supply_current"
LEAST, SHARE = 0.1, 0.5  # least duty that is used, and its share of a trace's largest duty, where that is small
_BITS = {"duty": (15, 10)}  # possible sign bits; none for a setpoint, which may step across half of a converter's range
_ANY = (15,)
_FULL = 0.75  # share of the range below the bit that neither part may reach; otherwise the bit is not a sign


@dataclass(frozen=True, eq=False)
class Column:
    """One column, converted."""

    header: str  # as in the CSV
    quantity: str  # `time` or a channel
    unit: str  # as the user logged it
    conversion: Conversion  # logged -> SI
    logged: np.ndarray  # shape (n,), as written; NaN where the cell is empty

    @property
    def value(self) -> np.ndarray:
        """SI, shape (n,)."""
        return self.values(slice(None))

    def values(self, rows: slice) -> np.ndarray:
        """SI, of some rows."""
        return self.conversion.scale * self.logged[rows] + self.conversion.offset


@dataclass(frozen=True, eq=False)
class Log:
    """One CSV, converted but still by row, so that messages can name the lines of the file."""

    where: str  # path of the CSV as the user gave it
    file: str  # its path relative to the rig folder
    test: str  # the rig test
    lines: np.ndarray  # line of each row in the file, shape (n,)
    columns: Mapping[str, Column]  # by quantity, including `time`
    row_mark: str = ":"  # as in `Table`

    def at(self, row: int) -> str:
        """File and line of a row, for a message."""
        return f"{self.where}{self.row_mark}{self.lines[row]}"

    @property
    def time(self) -> np.ndarray:
        """s, shape (n,)."""
        return self.columns["time"].value

    @property
    def channels(self) -> dict[str, Column]:
        """All columns except time."""
        return {name: column for name, column in self.columns.items() if name != "time"}


def read_columns(table: Table, config: RigConfig, where: str, toml: Toml) -> dict[str, Column]:
    """Every column that is not ignored, by quantity.

    Args:
        toml: the rig.toml, which an error names where [columns] contains the header.

    Raises:
        MeasurementError: an unknown header, a wrong unit, a quantity named twice, or no time.
    """
    columns: dict[str, Column] = {}
    for k, header in enumerate(table.header):
        ours = config.columns.get(" ".join(header.split()), header)
        if ours.casefold() in DROP:
            continue
        place = _place(header, config.columns, table.head(where), toml)
        column = _column(header, ours, table.cells[:, k], config, place)
        if other := columns.get(column.quantity):
            raise MeasurementError(
                place,
                f"columns '{other.header}' and '{header}' are both {column.quantity}.",
                "A trace has one column for each quantity.",
                f'Delete one, or set {toml_string(header)} = "ignore" under [columns].',
            )
        columns[column.quantity] = column
    if "time" not in columns:
        raise MeasurementError(table.head(where), f"no time column among '{', '.join(table.header)}'.",
                               "Every trace needs one.",
                               "Add 'time [s]', or map its name under [columns].")  # fmt: skip
    return columns


def _place(header: str, mapped: Mapping[str, str], where: str, toml: Toml) -> str:
    """The line of rig.toml that names the header, otherwise the CSV; without a line where the config is not from a
    file."""
    name = " ".join(header.split())
    return f"{toml.place(f'columns.{name}')} [columns], for {where}" if name in mapped else where


def _column(header: str, ours: str, cells: np.ndarray, config: RigConfig, place: str) -> Column:
    try:
        quantity, unit = parse_header(ours)
    except HeaderError as err:
        raise MeasurementError(place, err.found, err.required, err.mend) from err
    try:
        channel, conversion = to_channel(quantity, unit, config.travel, config.tps)
    except UnitError as err:
        raise MeasurementError(place, f"column '{header}': {err}", "The rig.toml must say how to read it.",
                               "Add [tps] with closed_V, open_V, travel_deg." if quantity == "tps" else
                               "Log in degrees, or give both ends in [rig] travel_deg.") from err  # fmt: skip
    return Column(header, channel, unit, conversion, cells)


class HeaderError(ValueError):
    """A header without a known quantity or unit; it holds the three texts of a MeasurementError without its place."""

    def __init__(self, found: str, required: str, mend: str) -> None:
        self.found, self.required, self.mend = found, required, mend
        super().__init__(f"{found} {required} {mend}")


def parse_header(header: str) -> tuple[str, str]:
    """Quantity and unit of `quantity [unit]`; letter case and spaces in the quantity do not matter.

    Raises:
        HeaderError: unknown quantity, unit missing, or a unit of the wrong dimension.
    """
    match = _FORM.fullmatch(header.strip())
    quantity = "_".join((match["quantity"] if match else header).casefold().split())
    if quantity not in SI_UNIT:
        near = difflib.get_close_matches(quantity, SI_UNIT, n=1, cutoff=0.75)
        guess = f" Did you mean '{near[0]} [{usual_unit(near[0])}]'?" if near else ""
        raise HeaderError(f"column '{header}' is not known.", f"Known: {', '.join(SI_UNIT)}.",
                          f"Add it to rig.toml under [columns], as {toml_string(header)} = \"position [deg]\" "
                          f"(or = \"ignore\"), or delete the column.{guess}")  # fmt: skip
    if match is None or not match["unit"]:
        raise HeaderError(f"column '{header}' has no unit.", f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                          f"Write the unit in brackets, as in '{quantity} [{usual_unit(quantity)}]'.")  # fmt: skip
    try:
        if not (quantity in ("position", "setpoint") and is_percent(match["unit"])):
            conversion(quantity, match["unit"])
    except UnitError as err:
        raise HeaderError(f"column '{header}': {err}", f"Accepted: {quantity} in {EXAMPLES[quantity]}.",
                          f"Correct the unit, as in '{quantity} [{usual_unit(quantity)}]'.") from err  # fmt: skip
    return quantity, match["unit"]


def with_motor_current(columns: Mapping[str, Column], config: RigConfig, where: str) -> Mapping[str, Column]:
    """The columns with `current` in place of `supply_current`.

    Raises:
        MeasurementError: `current` is there too, or no column gives the duty.
    """
    logged = columns.get(SUPPLY_CURRENT)
    if logged is None:
        return columns
    if "current" in columns:
        both = f"columns '{columns['current'].header}' and '{logged.header}' are both a current."
        raise MeasurementError(where, both,
                               "The model has one, the motor's.",
                               "Leave the supply's out: set it to \"ignore\" under [columns].")  # fmt: skip
    duty = _duty(columns, config, where, logged.header)
    size = np.abs(duty)
    least = min(LEAST, SHARE * float(np.nanmax(size, initial=0.0)))
    value = logged.logged / np.where(size > least, duty, np.nan)
    out = {name: column for name, column in columns.items() if name != SUPPLY_CURRENT}
    return out | {"current": replace(logged, quantity="current", logged=value)}


def _duty(columns: Mapping[str, Column], config: RigConfig, where: str, header: str) -> np.ndarray:
    """Duty from -1 to 1, shape (n,); NaN in rows without it."""
    if "duty" in columns:
        return columns["duty"].value
    volts = columns["supply"].value if "supply" in columns else config.supply_V
    if "voltage" not in columns or volts is None:
        raise MeasurementError(where, f"column '{header}' without a duty.",
                               "The motor's current is that of the supply over the duty.",
                               "Log the duty; or the voltage, with [rig] supply_V in rig.toml.")  # fmt: skip
    return columns["voltage"].value / volts


def without_sign_bit(values: np.ndarray, bit: int) -> np.ndarray:
    """raw below 2^bit, -(raw - 2^bit) from there on, shape (n,); negative values are not changed."""
    most = float(2**bit)
    return np.where(values >= most, most - values, values)


def sign_bit(values: np.ndarray, quantity: str) -> int | None:
    """The bit that holds the sign of these numbers; None where no bit does.

    Both parts must lie well below the bit, and adjacent samples must lie on either side of it.
    """
    there = values[np.isfinite(values)]
    if there.size < 3 or np.any(there < 0) or np.any(there != np.round(there)):
        return None
    for bit in _BITS.get(quantity, _ANY):
        most = float(2**bit)
        high = there >= most
        if not high.any() or high.all() or there.max() >= 2.0 * most:
            continue
        size = np.where(high, there - most, there)
        if np.max(size) < _FULL * most and np.any(np.diff(high.astype(int)) != 0):
            return bit
    return None
