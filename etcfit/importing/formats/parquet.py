"""Apache Parquet, by pyarrow; a field's unit from its metadata, instants as seconds since the first.

Source: Apache Arrow, Parquet columns and field metadata. Differs from source: texts and truth values are left out.
"""

from __future__ import annotations

from typing import Any

from ...rig.rows import is_number
from ..sheet import Column, Sheet, column
from .base import Format, Source, reading, seconds, unreadable

_KIND = "a Parquet file"
_UNITS = (b"unit", b"units", b"Unit")
_TICKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # units of Arrow's times, s
_LOOKED_AT = 1000  # number of a column's texts that are tested for being numbers
_NO_SIGNAL = ("texts", "truth values", "it is empty")


def _read(source: Source) -> list[Sheet]:
    from pyarrow import parquet

    with reading(source, _KIND), parquet.ParquetFile(source.path, page_checksum_verification=True) as file:
        rows, why_not = file.metadata.num_rows, {field.name: _why_no_signal(file, field) for field in file.schema_arrow}
        wanted = [name for name, why in why_not.items() if not why]
        source.refuse_larger(8 * rows * len(wanted))
        table = file.read(columns=wanted)
        fields = [(field, k) for k, field in enumerate(table.schema) if not why_not.get(field.name, "nested")]
        made = tuple(_column(field, table.column(k)) for field, k in fields)
    if made and table.num_rows != rows:
        raise unreadable(source.where, f"it says that it has {rows} rows, and holds {table.num_rows}", _KIND)
    remarks = tuple(f"'{name}' is left out: {why}" for name, why in why_not.items() if why in _NO_SIGNAL)
    missing = tuple(f"'{name}' cannot be read: {why}" for name, why in why_not.items() if why not in ("", *_NO_SIGNAL))
    return [Sheet(source.where, "", made, remarks, missing=missing)]


def _why_no_signal(file: Any, field: Any) -> str:
    """Why a field is no column of numbers; "" if it is one."""
    from pyarrow import types

    kind = field.type.value_type if types.is_dictionary(field.type) else field.type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_temporal(kind):
        return ""
    if types.is_null(kind):
        return "it is empty"
    if types.is_boolean(kind):
        return "truth values"
    if not (types.is_string(kind) or types.is_large_string(kind)):
        return f"its type is {field.type}"
    batch = next(file.iter_batches(_LOOKED_AT, columns=[field.name]), None)
    texts = [text for text in (batch.column(0).to_pylist() if batch is not None else ()) if text]
    if not texts or not all(is_number(text) for text in texts):
        return "texts"
    return next((f"numbers with a comma, written as texts ('{text}')" for text in texts if "," in text), "")


def _column(field: Any, values: Any) -> Column:
    """The column of numbers; NaN for missing ones."""
    from pyarrow import compute, float64, int32, int64, types

    metadata = field.metadata or {}
    unit = next((metadata[key].decode("utf-8", "replace") for key in _UNITS if key in metadata), "")
    kind = field.type.value_type if types.is_dictionary(field.type) else field.type
    values = values.cast(kind)
    if types.is_timestamp(kind) or types.is_date(kind):
        return column(field.name, seconds(values.to_numpy()), "s")
    if types.is_temporal(kind):
        ticks = values.cast(int32()).cast(int64()) if types.is_time32(kind) else values.cast(int64())
        return column(field.name, _TICKS[kind.unit] * ticks.to_numpy().astype(float), "s")
    if types.is_integer(kind) or types.is_floating(kind):
        return column(field.name, values.to_numpy().astype(float), unit)
    return column(field.name, compute.cast(values, float64()).to_numpy(), unit)


FORMAT = Format("Parquet", (".parquet", ".pq"), _read, "pyarrow")
