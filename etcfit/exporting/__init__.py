"""A fitted model in the formats of other programs: what each cannot hold is said in its files and on the terminal."""

from __future__ import annotations

from .base import Export, Format, Source
from .formats import FORMATS, named
from .settings import ExportSettings
from .write import write

__all__ = ["FORMATS", "Export", "ExportSettings", "Format", "Source", "named", "write"]
