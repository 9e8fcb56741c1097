"""Makes a Rig from the data frames of a notebook, with the same checks and messages as for a folder of CSV."""

from __future__ import annotations

import hashlib
import math
import numbers
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from ..errors import MeasurementError
from .base import FRAMES, Rig, RigConfig
from .config import config_of
from .reader import KNOWN_TESTS, assembled, checked, log_of
from .rows import HUGE, not_a_number_error, number_in
from .table import Table, without_blanks
from .toml import Toml, closest, shown
from .user_text import refuse_foreign_names

CONFIG = "config"  # its name in messages
NAMELESS = "frames"  # name of a rig whose config gives none


def rig_from_frames(frames: Mapping[str, pd.DataFrame], config: Mapping[str, Any] | RigConfig) -> Rig:
    """See `Rig.from_frames`.

    `Rig.digests` has the SHA-256 of each frame and of the config, under the name that a file would have.
    """
    if not frames:
        raise MeasurementError("frames", "none given.", "A rig needs one trace or more.",
                               'Give {"response/1": DataFrame}.')  # fmt: skip
    toml = Toml(CONFIG, "", {} if isinstance(config, RigConfig) else _tables(config))
    config = config if isinstance(config, RigConfig) else config_of(toml, NAMELESS)
    for key in frames:
        _check_key(key)
    tables = {key: _table(frames[key], f"frame {key}") for key in sorted(frames)}
    config = checked(config, tables, toml)
    read = [log_of(table, f"frame {key}", key, config, toml) for key, table in tables.items()]
    digests = {"rig.toml": hashlib.sha256(repr(config).encode()).hexdigest()}
    digests |= {key: _digest(table) for key, table in tables.items()}
    return replace(assembled(FRAMES, config, read, (), toml), digests=digests)


def _tables(config: Any, key: str = CONFIG) -> Any:
    """A dictionary in the types of TOML: text keys, lists for tuples and arrays, plain numbers for those of NumPy."""
    if isinstance(config, Mapping):
        for name in config:
            if not isinstance(name, str):
                raise MeasurementError(key, f"key {shown(name)}.", "Keys must be texts, as in rig.toml.",
                                       "Put it in quotes.")  # fmt: skip
        return {name: _tables(value, name) for name, value in config.items()}
    if key == CONFIG:
        raise MeasurementError(key, f"found {shown(config)}.", "The tables of a rig.toml are required, or a RigConfig.",
                               'Give {"rig": {"gear_ratio": 20.68}}.')  # fmt: skip
    if isinstance(config, (list, tuple, np.ndarray)):
        return [_tables(value, key) for value in config]
    return config.item() if isinstance(config, np.generic) else config


def _check_key(key: Any) -> None:
    if isinstance(key, str):
        refuse_foreign_names(key)
    test, slash, name = key.partition("/") if isinstance(key, str) else ("", "", "")
    if not (slash and name) or "/" in name:
        raise MeasurementError("frames", f"key {shown(key)}.", "A frame's key is '<test>/<name>'.",
                               "Write, say, 'response/1'.")  # fmt: skip
    if test not in KNOWN_TESTS:
        raise MeasurementError(f"frame {key}", f"'{test}' is no known rig test.", f"Known: {', '.join(KNOWN_TESTS)}.",
                               closest(test, KNOWN_TESTS, "Correct the key."))  # fmt: skip


def _table(frame: Any, where: str) -> Table:
    """The frame with its columns as text and its cells as numbers."""
    if not isinstance(frame, pd.DataFrame):
        raise MeasurementError(where, f"found a {type(frame).__name__}.", "It must be a pandas DataFrame.",
                               "Write pandas.DataFrame({'time [s]': ..., 'voltage [V]': ...}).")  # fmt: skip
    header = tuple(_name(name, where) for name in frame.columns)
    if not frame.size:
        raise MeasurementError(where, "no row of numbers.", "A trace needs two rows.", "Leave the frame out.")
    bare = Table(header, 0, np.arange(len(frame)), np.empty((len(frame), 0)), ", row ")
    cells = np.array([_cells(frame.iloc[:, k], name, bare, where) for k, name in enumerate(header)]).T
    return without_blanks(replace(bare, cells=cells), where)


def _name(name: Any, where: str) -> str:
    if not isinstance(name, str):
        raise MeasurementError(where, f"column {shown(name)}.", "A column's name is the text 'quantity [unit]'.",
                               "Rename it, as in frame.rename(columns={0: 'time [s]'}).")  # fmt: skip
    return name.strip()


def _cells(column: pd.Series, name: str, table: Table, where: str) -> np.ndarray:
    """The numbers of one column, NaN where there is none."""
    if column.dtype.kind in "iuf":  # also pandas' own types with gaps
        values = column.to_numpy(dtype=float, na_value=np.nan)
        beyond = np.abs(values) > HUGE
        if beyond.any():
            row = int(np.argmax(beyond))
            raise not_a_number_error(str(values[row]), name, table.at(where, row))
        return values
    return np.array([_number(cell, name, table.at(where, row)) for row, cell in enumerate(column)])


def _number(cell: Any, column: str, place: str) -> float:
    """A cell of a column that does not hold numbers alone: texts are read as in a CSV."""
    if cell is None or cell is pd.NA:
        return np.nan
    if isinstance(cell, numbers.Real) and not isinstance(cell, (bool, np.bool_)):
        number = float(cell)
        number = number if math.isnan(number) or abs(number) <= HUGE else None
    else:
        number = number_in(cell) if isinstance(cell, str) else None
    if number is None:
        raise not_a_number_error(str(cell), column, place)
    return number


def _digest(table: Table) -> str:
    """SHA-256 of the header and the numbers, row by row, as little-endian float64."""
    cells = np.where(np.isnan(table.cells), np.nan, table.cells)  # one NaN for all
    names = "\n".join(table.header).encode("utf-8", "backslashreplace")
    return hashlib.sha256(names + b"\0" + np.ascontiguousarray(cells, dtype="<f8").tobytes()).hexdigest()
