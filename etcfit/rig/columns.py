"""Columns of a table -> quantities in SI."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..errors import MeasurementError
from .base import RigConfig
from .comments import toml_string
from .header import DROP, HeaderError, parse_header
from .table import Table
from .toml import Toml
from .units import Conversion, UnitError, to_channel


@dataclass(frozen=True, eq=False)
class Column:
    """One column, converted.

    Args:
        header: as it stands in the CSV.
        quantity: `time` or a channel.
        unit: as the user logged it.
        conversion: logged -> SI.
        logged: shape (n,), as written; NaN where the cell is empty.
    """

    header: str
    quantity: str
    unit: str
    conversion: Conversion
    logged: np.ndarray

    @property
    def value(self) -> np.ndarray:
        """SI, shape (n,)."""
        return self.values(slice(None))

    def values(self, rows: slice) -> np.ndarray:
        """SI, of some rows."""
        return self.conversion.scale * self.logged[rows] + self.conversion.offset

    @property
    def is_angle(self) -> bool:
        """Held against the travel rather than against fixed limits."""
        return self.quantity in ("position", "setpoint")


@dataclass(frozen=True, eq=False)
class Log:
    """One CSV, converted, still row by row: what can be checked against the file's lines.

    Args:
        where: path of the CSV as the user gave it.
        file: the same, relative to the rig folder.
        test: the rig test.
        lines: where each row stands in the file, shape (n,).
        columns: by quantity, `time` among them.
        row_mark: as in `Table`.
    """

    where: str
    file: str
    test: str
    lines: np.ndarray
    columns: Mapping[str, Column]
    row_mark: str = ":"

    def at(self, row: int) -> str:
        """Where a row stands, for a message."""
        return f"{self.where}{self.row_mark}{self.lines[row]}"

    @property
    def time(self) -> np.ndarray:
        """s, shape (n,)."""
        return self.columns["time"].value

    @property
    def channels(self) -> dict[str, Column]:
        """All columns but time."""
        return {name: column for name, column in self.columns.items() if name != "time"}


def read_columns(table: Table, config: RigConfig, where: str, toml: Toml) -> dict[str, Column]:
    """Every column that is not to be ignored, by quantity.

    Args:
        where: path of the CSV.
        toml: the rig.toml, which is at fault where [columns] names the header.

    Raises:
        MeasurementError: a header not known, of a wrong unit, or a quantity named twice; no time.
    """
    columns: dict[str, Column] = {}
    for k, header in enumerate(table.header):
        ours = config.columns.get(" ".join(header.split()), header)
        if ours.casefold() in DROP:
            continue
        place = partial(_place, header, config.columns, table.head(where), toml)
        column = _column(header, ours, table.cells[:, k], config, place)
        if other := columns.get(column.quantity):
            raise MeasurementError(
                place(),
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
    """The line of rig.toml that names the header, else the CSV; where the config was never a file, without a line."""
    name = " ".join(header.split())
    return f"{toml.place(f'columns.{name}')} [columns], for {where}" if name in mapped else where


def _column(header: str, ours: str, cells: np.ndarray, config: RigConfig, place: Callable[[], str]) -> Column:
    try:
        quantity, unit = parse_header(ours)
    except HeaderError as err:
        raise MeasurementError(place(), err.found, err.required, err.mend) from err
    try:
        channel, conversion = to_channel(quantity, unit, config.travel, config.tps)
    except UnitError as err:
        raise MeasurementError(place(), f"column '{header}': {err}", "The rig.toml must say how to read it.",
                               "Add [tps] with closed_V, open_V, travel_deg." if quantity == "tps" else
                               "Log in degrees, or give both ends in [rig] travel_deg.") from err  # fmt: skip
    return Column(header, channel, unit, conversion, cells)
