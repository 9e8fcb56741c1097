"""Text: whichever dialect of scopes and data loggers its first lines show."""

from __future__ import annotations

from dataclasses import replace

from ...rig.table import decode
from ..sheet import Sheet
from . import delimited, lvm, rigol, tektronix
from .base import Format, Source

# (does a file begin like it?, read it); the first that fits, the general one last
DIALECTS = (
    (lvm.begins, lvm.read),
    (rigol.begins, rigol.read),
    (tektronix.begins, tektronix.read),
    (delimited.begins, delimited.read),
)


_NO_END = "the last line has no end: it may be cut off, and is left out"


def _read(source: Source) -> list[Sheet]:
    raw = source.path.read_bytes()
    if raw.endswith(b"\r") and b"\r\n" in raw:  # half of a line end
        raw = raw[:-1]
    text = decode(raw, source.where).removeprefix("\ufeff")
    reader = next(read for begins, read in DIALECTS if begins(text))
    whole, end, rest = text.rpartition("\n")
    if not (end and rest.strip()):
        return reader(text, source.where)
    return [replace(sheet, losses=(*sheet.losses, _NO_END)) for sheet in reader(whole + end, source.where)]


FORMAT = Format("text", (".csv", ".txt", ".tsv", ".asc", ".dat", ".lvm"), _read)
