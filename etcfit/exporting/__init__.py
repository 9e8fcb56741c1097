"""The way out: a fitted model in the formats of other programs, a writer a format; each says what it cannot hold."""

from __future__ import annotations

from .base import Export, Format, Source
from .formats import FORMATS, named
from .settings import ExportSettings
from .write import write

__all__ = ["FORMATS", "Export", "ExportSettings", "Format", "Source", "named", "write"]
