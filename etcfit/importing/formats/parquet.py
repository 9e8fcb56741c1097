"""Apache Parquet, by pyarrow; a field's unit from its metadata, instants as seconds since the first.

Source: Apache Arrow, Parquet columns and field metadata. Differs from source: no.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..labels import column
from ..sheet import Column, Sheet
from .base import Format, Source, unreadable

_KIND = "a Parquet file"
_UNITS = (b"unit", b"units", b"Unit")


def _read(source: Source) -> list[Sheet]:
    from pyarrow import parquet

    try:
        table = parquet.read_table(source.path)
    except Exception as err:  # whatever its parser makes of bytes that are no such file
        raise unreadable(source.where, "it cannot be read", _KIND, err) from err
    made = [_column(table.schema.field(k), table.column(k).to_numpy()) for k in range(table.num_columns)]
    return [Sheet(source.where, "", tuple(each for each in made if each is not None))]


def _column(field: Any, values: np.ndarray) -> Column | None:
    metadata = field.metadata or {}
    unit = next((metadata[key].decode() for key in _UNITS if key in metadata), "")
    if values.dtype.kind == "M":
        return column(field.name, (values - values[0]) / np.timedelta64(1, "s"), "s")
    if values.dtype.kind == "m":
        return column(field.name, values / np.timedelta64(1, "s"), "s")
    return column(field.name, values.astype(float), unit) if values.dtype.kind in "iuf" else None


FORMAT = Format("Parquet", (".parquet", ".pq"), _read, "pyarrow")
