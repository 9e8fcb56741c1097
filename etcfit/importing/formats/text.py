"""Text: whichever dialect of scopes and data loggers its first lines show."""

from __future__ import annotations

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


def _read(source: Source) -> list[Sheet]:
    text = decode(source.path.read_bytes(), source.where).removeprefix("\ufeff")
    reader = next(read for begins, read in DIALECTS if begins(text))
    return reader(text, source.where)


FORMAT = Format("text", (".csv", ".txt", ".tsv", ".asc", ".dat", ".lvm"), _read)
