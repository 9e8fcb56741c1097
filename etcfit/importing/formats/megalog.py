"""MegaLogViewer's logs: `.msl` text and `.mlg` binary, as `etcfit drive` reads them."""

from __future__ import annotations

from ...rig.mlg import read_mlg
from ...rig.msl import read_msl
from ...rig.table import Table
from ..labels import column
from ..sheet import Sheet
from .base import Format


def _sheet(table: Table, where: str) -> list[Sheet]:
    columns = tuple(column(name, table.cells[:, k]) for k, name in enumerate(table.header))
    return [Sheet(where, "", columns, losses=table.losses)]


TEXT = Format("MegaLogViewer text", (".msl",), lambda s: _sheet(read_msl(s.path.read_bytes(), s.where), s.where))
BINARY = Format("MegaLogViewer binary", (".mlg",), lambda s: _sheet(read_mlg(s.path.read_bytes(), s.where), s.where))
