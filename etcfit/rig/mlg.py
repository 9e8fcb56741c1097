"""Reads MegaLogViewer's binary log (.mlg) as a table.

    header   "MLVLG\\0", version, timestamp, start of info, start of data, bytes of a record, number of fields
    field    type, name (34), unit (10), display style, scale, transform, digits [, category (34) in version 2]
    block    0, counter, time (16 bit, 10 us), the fields' values, sum of their bytes modulo 256
             1, counter, time, a marker's message (50)

    value = (raw + transform) scale

All big-endian; start of info is 0 where there is none.

Source: EFI Analytics, MLG binary log format, versions 1 and 2, as rusEFI quotes it (mlg_types.h), as its firmware and
its console write it, and as mlg-converter and LibreTune read it. Differs from source: bit fields (types 10 to 12, which
have a style, an index of names and a number of bits in place of scale, transform and digits) are skipped, because no
quantity here is a switch. A field of a type that the format does not name is skipped too: its width is the rest of the
record, its meaning is unknown (mlg-converter, whose v2.mlg has such a field, reads one byte).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

import numpy as np

from ..errors import MeasurementError
from .table import Table, headed

_MAGIC = b"MLVLG\0"
_HEADERS = {1: struct.Struct(">HIHH"), 2: struct.Struct(">IIHH")}  # behind magic, version and timestamp
_PREFIX, _HEAD = struct.Struct(">6sHI"), struct.Struct(">BBH")  # of the file, of a block
_FIELD, _FIELD_BYTES = struct.Struct(">B34s10sBffb"), {1: 55, 2: 89}
_TYPES = {0: "u1", 1: "i1", 2: ">u2", 3: ">i2", 4: ">u4", 5: ">i4", 6: ">i8", 7: ">f4",
          10: "u1", 11: ">u2", 12: ">u4"}  # fmt: skip
_BITS = (10, 11, 12)
_RECORD, _MARKER = 0, 1  # types of block
_MESSAGE = 50  # bytes of a marker's
_TICK, _WRAP = 1e-5, 1 << 16  # s, ticks
_FITTING = 0.5  # share of right check sums below which the writer uses another check sum
TIME = "Time [s]"


@dataclass(frozen=True)
class Field:
    """One quantity of a record."""

    kind: int  # its type, mostly a key of the format's table
    header: str  # `name [unit]`
    scale: float  # value = (raw + transform) scale
    transform: float  # value = (raw + transform) scale

    @property
    def is_scalar(self) -> bool:
        """Whether the field is a number: neither bits nor of an unknown type."""
        return self.kind in _TYPES and self.kind not in _BITS


@dataclass(frozen=True, eq=False)
class Records:
    """The records after the header, without markers."""

    at: np.ndarray  # begin of the values of each, bytes, shape (n,)
    ticks: np.ndarray  # time of each, 10 us since the first block, shape (n,)
    fits: np.ndarray  # true where the check sum is right, shape (n,)
    end: int  # end of the last block, also if it is cut off

    @property
    def sound(self) -> Records:
        """The records with a right check sum.

        All records where hardly any check sum is right: some writers compute it differently, and other readers accept
        them.
        """
        keep = self.fits if np.sum(self.fits) >= _FITTING * self.fits.size else np.ones_like(self.fits)
        return replace(self, at=self.at[keep], ticks=self.ticks[keep], fits=self.fits[keep])


def read_mlg(raw: bytes, where: str) -> Table:
    """The table with columns named `name [unit]`; NaN for a value that is no number.

    Records with a wrong check sum and a record that is cut off are left out, and `losses` reports them. A log without a
    time column gets the time of its blocks, which does not show pauses above 0.3 s.

    Raises:
        MeasurementError: another format or version, damaged, or cut off before the second record.
    """
    start, size, fields = _header(raw, where)
    layout = _layout(fields, size, where)
    found = _records(raw, start, size, where)
    kept = found.sound
    if kept.at.size < 2:
        raise _unreadable(where, f"sound records in the file: {kept.at.size}.")
    records = np.frombuffer(b"".join(raw[at : at + size] for at in kept.at), dtype=layout)
    shown = [(field, records[f"f{k}"].astype(float)) for k, field in enumerate(fields) if field.is_scalar]
    header = [field.header for field, _ in shown]
    scaled = [(values + field.transform) * field.scale for field, values in shown]
    columns = [np.where(np.isfinite(values), values, np.nan) for values in scaled]
    if not any(name.partition(" [")[0].casefold() == "time" for name in header):
        header, columns = [TIME, *header], [_TICK * (kept.ticks - kept.ticks[0]), *columns]
    unknown = (f"'{each.header}' is left out: its type, {each.kind}, is unknown"
               for each in fields if each.kind not in _TYPES)  # fmt: skip
    over, spoilt = len(raw) - found.end, found.at.size - kept.at.size
    losses = [
        "the last record is cut off and left out" if over < 0 else "",
        f"its last {over} bytes were never written: it ends where the power was cut" if over > 0 else "",
        f"{spoilt} records whose check sum is wrong are left out" if spoilt else "",
    ]
    return Table(tuple(header), 1, kept.at, np.stack(columns, axis=1), losses=(*filter(None, losses), *unknown))


def _layout(fields: list[Field], size: int, where: str) -> np.dtype:
    """Layout of a record of `size` bytes; fields of unknown type share the remaining bytes equally."""
    unknown = [field for field in fields if field.kind not in _TYPES]
    known = sum(np.dtype(_TYPES[field.kind]).itemsize for field in fields if field.kind in _TYPES)
    width, odd = divmod(size - known, len(unknown)) if unknown else (0, size - known)
    if odd or width < bool(unknown):
        kinds = f", {len(unknown)} more of unknown type {unknown[0].kind}" if unknown else ""
        raise _unreadable(where, f"its records have {size} bytes, its fields {known}{kinds}.")
    # several unknown types may have different widths, unless there is one byte for each
    if width > 1 and len({field.kind for field in unknown}) > 1:
        kinds = " and ".join(str(kind) for kind in sorted({field.kind for field in unknown}))
        raise _unreadable(where, f"fields of unknown types {kinds}, whose widths cannot be told apart.")
    return np.dtype([(f"f{k}", _TYPES.get(field.kind, f"V{width}")) for k, field in enumerate(fields)])


def _header(raw: bytes, where: str) -> tuple[int, int, list[Field]]:
    """Begin of the data, bytes of a record, fields."""
    if len(raw) < _PREFIX.size or raw[: len(_MAGIC)] != _MAGIC:
        raise _unreadable(where, "it does not begin with MLVLG.")
    version = _PREFIX.unpack_from(raw)[1]
    if version not in _HEADERS:
        raise _unreadable(where, f"version {version} of the format.")
    try:
        _, start, size, count = _HEADERS[version].unpack_from(raw, _PREFIX.size)
        first = _PREFIX.size + _HEADERS[version].size
        heads = (_FIELD.unpack_from(raw, first + k * _FIELD_BYTES[version]) for k in range(count))
        fields = [Field(kind, headed(_text(name), _text(unit)), scale, transform)
                  for kind, name, unit, _, scale, transform, _ in heads]  # fmt: skip
    except struct.error:
        raise _unreadable(where, "it ends within its header.") from None
    return start, size, fields


def _text(padded: bytes) -> str:
    text = padded.partition(b"\0")[0]
    try:
        return text.decode("utf-8").strip()
    except UnicodeDecodeError:  # a degree sign of an older writer
        return text.decode("latin-1").strip()


def _records(raw: bytes, at: int, size: int, where: str) -> Records:
    """Every whole record; the clock, which restarts every 0.65536 s, is unrolled over all blocks, including markers."""
    found: list[tuple[int, int, bool]] = []
    lengths = {_RECORD: size + 1, _MARKER: _MESSAGE}
    # where the power was cut, unwritten bytes of the card follow the log
    written, clock, last = min(len(raw.rstrip(b"\0")), len(raw.rstrip(b"\xff"))), 0, None
    while at < written and at + _HEAD.size <= len(raw):
        kind, _, tick = _HEAD.unpack_from(raw, at)
        if kind not in lengths:
            raise _unreadable(where, f"a block of unknown type {kind} at byte {at}.")
        if last is not None:  # a step back by less than half the clock's range is no restart
            clock += tick - last + (_WRAP if last - tick > _WRAP // 2 else 0)
        at, last = at + _HEAD.size, tick
        if kind == _RECORD and at + size < len(raw) and (at + size < written or any(raw[at : at + size])):
            found.append((at, clock, sum(raw[at : at + size]) % 256 == raw[at + size]))
        at += lengths[kind]
    if at < written:  # a part of the next block's head
        at += _HEAD.size
    places, ticks, fits = zip(*found, strict=True) if found else ((), (), ())
    return Records(np.array(places, dtype=int), np.array(ticks, dtype=int), np.array(fits, dtype=bool), at)


def _unreadable(where: str, found: str) -> MeasurementError:
    required = "An .mlg is a binary log of MegaLogViewer, version 1 or 2."
    return MeasurementError(where, found, required, "Export it from MegaLogViewer as .msl or CSV.")
