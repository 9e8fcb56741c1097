"""What pages that are one file and ask no network share: packed numbers, style, small scripts, the charts' library."""

from __future__ import annotations

from .parts import LIBRARY, LIBRARY_STYLE, LICENCE, SHARED, Parts, as_text

__all__ = ["LIBRARY", "LIBRARY_STYLE", "LICENCE", "SHARED", "Parts", "as_text"]
