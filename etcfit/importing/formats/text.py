"""Text: whichever dialect of scopes its first lines show, else any layout that the reader of text knows."""

from __future__ import annotations

from dataclasses import replace

from ...rig.layout import TextTable, read_msl, read_text
from ...rig.mlg import read_mlg
from ...rig.table import Table, decode
from ..labels import column
from ..sheet import Sheet
from . import lvm, rigol, tektronix
from .base import Format, Source

# (does a file begin like it?, read it); the first that fits
DIALECTS = (
    (lvm.begins, lvm.read),
    (rigol.begins, rigol.read),
    (tektronix.begins, tektronix.read),
    (lambda text: True, lambda text, where: [sheet_of(read_text(text, where), where)]),
)
_NO_END = "the last line has no end: it may be cut off, and is left out"


def sheet_of(found: TextTable, where: str, losses: tuple[str, ...] = (), missing: tuple[str, ...] = ()) -> Sheet:
    """A column for each name; those without name and number, which a trailing separator makes, left out."""
    names, cells = found.layout.names, found.numbers.cells
    columns = tuple(
        column(name or f"column {k + 1}", cells[:, k], found.units[k])
        for k, name in enumerate(names)
        if name or not all(cells[:, k] != cells[:, k])
    )
    return Sheet(where, "", columns, found.remarks, (*found.numbers.losses, *losses), missing)


def _read(source: Source) -> list[Sheet]:
    raw = source.path.read_bytes()
    if raw.endswith(b"\r") and b"\r\n" in raw:  # half of a line end
        raw = raw[:-1]
    text = decode(raw, source.where).removeprefix("\ufeff")
    if source.path.suffix.casefold() == ".msl":
        whole, _, rest = text.rpartition("\n")
        return [sheet_of(read_msl(f"{whole}\n", source.where), source.where, (_NO_END,) if rest.strip() else ())]
    reader = next(read for begins, read in DIALECTS if begins(text))
    whole, end, rest = text.rpartition("\n")
    if not (end and rest.strip()):
        return reader(text, source.where)
    return [replace(sheet, losses=(*sheet.losses, _NO_END)) for sheet in reader(whole + end, source.where)]


def _of_records(table: Table, where: str) -> list[Sheet]:
    columns = tuple(column(name, table.cells[:, k]) for k, name in enumerate(table.header))
    return [Sheet(where, "", columns, losses=table.losses)]


FORMAT = Format("text", (".csv", ".txt", ".tsv", ".asc", ".dat", ".lvm", ".log", ".msl"), _read)
MEGALOG = Format(
    "MegaLogViewer binary", (".mlg",), lambda s: _of_records(read_mlg(s.path.read_bytes(), s.where), s.where)
)
