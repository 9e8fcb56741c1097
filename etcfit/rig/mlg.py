"""MegaLogViewer's binary log (.mlg) as a table.

    header   "MLVLG\\0", version, timestamp, start of info, start of data, bytes of a record, number of fields
    field    type, name (34), unit (10), display style, scale, transform, digits [, category (34) in version 2]
    block    0, counter, time (16 bit, 10 us), the fields' values, sum of their bytes modulo 256
             1, counter, time, a marker's message (50)

    value = (raw + transform) scale

All big-endian. Source: EFI Analytics, MLG binary log format, versions 1 and 2; read as rusEFI and Speeduino write it.
Differs from source: bit fields are skipped, as nothing here is a switch.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import MeasurementError
from .msl import named
from .table import Table

_MAGIC = b"MLVLG\0"
_HEADERS = {1: struct.Struct(">HIHH"), 2: struct.Struct(">IIHH")}  # behind magic, version and timestamp
_PREFIX, _HEAD = struct.Struct(">6sHI"), struct.Struct(">BBH")  # of the file, of a block
_FIELD, _FIELD_BYTES = struct.Struct(">B34s10sBffb"), {1: 55, 2: 89}
_TYPES = {0: "u1", 1: "i1", 2: ">u2", 3: ">i2", 4: ">u4", 5: ">i4", 6: ">i8", 7: ">f4",
          10: "u1", 11: ">u2", 12: ">u4"}  # fmt: skip
_BITS = (10, 11, 12)
_MESSAGE = 50  # bytes of a marker
_TICK, _WRAP = 1e-5, 1 << 16  # s, ticks
TIME = "Time [s]"


@dataclass(frozen=True)
class Field:
    """One quantity of a record.

    Args:
        kind: its type, a key of the format's table.
        header: `name [unit]`.
        scale, transform: value = (raw + transform) scale.
    """

    kind: int
    header: str
    scale: float
    transform: float


def read_mlg(raw: bytes, where: str) -> Table:
    """Columns named `name [unit]`; records that were spoilt on the way to the card are left out.

    A log without a time of its own gets that of its blocks.

    Args:
        raw: the file.
        where: its path, as the user gave it.
    Raises:
        MeasurementError: another format or version, or cut off before the first record.
    """
    start, size, fields = _header(raw, where)
    layout = np.dtype([(f"f{k}", _TYPES[field.kind]) for k, field in enumerate(fields)])
    if layout.itemsize != size:
        found = f"its records have {size} bytes, its fields {layout.itemsize}."
        raise _unreadable(where, found)
    blocks = list(_records(raw, start, size, where))
    if len(blocks) < 2:
        raise _unreadable(where, f"{len(blocks)} record in the file.")
    records = np.frombuffer(b"".join(raw[at : at + size] for at, _ in blocks), dtype=layout)
    shown = [(field, records[f"f{k}"].astype(float)) for k, field in enumerate(fields) if field.kind not in _BITS]
    header = [field.header for field, _ in shown]
    columns = [(values + field.transform) * field.scale for field, values in shown]
    if not any(name.partition(" [")[0].casefold() == "time" for name in header):
        header, columns = [TIME, *header], [_unwrapped([tick for _, tick in blocks]), *columns]
    return Table(tuple(header), 1, np.array([at for at, _ in blocks]), np.stack(columns, axis=1))


def _header(raw: bytes, where: str) -> tuple[int, int, list[Field]]:
    """Where the data begin, bytes of a record, fields."""
    if len(raw) < _PREFIX.size or raw[: len(_MAGIC)] != _MAGIC:
        raise _unreadable(where, "it does not begin with MLVLG.")
    version = _PREFIX.unpack_from(raw)[1]
    if version not in _HEADERS:
        raise _unreadable(where, f"version {version} of the format.")
    try:
        _, start, size, count = _HEADERS[version].unpack_from(raw, _PREFIX.size)
        first = _PREFIX.size + _HEADERS[version].size
        fields = [_field(raw, first + k * _FIELD_BYTES[version], where) for k in range(count)]
    except struct.error:
        raise _unreadable(where, "it ends within its header.") from None
    return start, size, fields


def _field(raw: bytes, at: int, where: str) -> Field:
    kind, name, unit, _, scale, transform, _ = _FIELD.unpack_from(raw, at)
    if kind not in _TYPES:
        raise _unreadable(where, f"a field of unknown type {kind}.")
    return Field(kind, named(_text(name), _text(unit)), scale, transform)


def _text(padded: bytes) -> str:
    return padded.partition(b"\0")[0].decode("utf-8", "replace").strip()


def _records(raw: bytes, at: int, size: int, where: str) -> Iterator[tuple[int, int]]:
    """Where each sound record's values begin, and the ticks it was logged at."""
    while at + _HEAD.size + min(size, _MESSAGE) <= len(raw):
        kind, _, tick = _HEAD.unpack_from(raw, at)
        at += _HEAD.size
        if kind == 1:
            at += _MESSAGE
        elif kind == 0:
            if at + size < len(raw) and sum(raw[at : at + size]) % 256 == raw[at + size]:
                yield at, tick
            at += size + 1
        else:
            raise _unreadable(where, f"a block of unknown type {kind} at byte {at - _HEAD.size}.")


def _unwrapped(ticks: list[int]) -> np.ndarray:
    """Seconds from the first record, of a clock that starts anew every 0.65536 s."""
    steps = np.diff(np.array(ticks)) % _WRAP
    return _TICK * np.concatenate(([0], np.cumsum(steps)))


def _unreadable(where: str, found: str) -> MeasurementError:
    required = "An .mlg is a binary log of MegaLogViewer, version 1 or 2."
    return MeasurementError(where, found, required, "Export it from MegaLogViewer as .msl or CSV.")
