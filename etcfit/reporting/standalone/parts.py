"""Styles, scripts and data as they stand inside the one file of a page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

Room = tuple[str, str]  # a package, and a folder in it
SHARED: Room = ("etcfit.reporting.standalone", "assets")
LIBRARY, LIBRARY_STYLE = "vendor/uPlot.iife.min.js", "vendor/uPlot.min.css"
LICENCE = "vendor/uPlot.LICENSE.txt"
_VENDOR: Room = ("etcfit.reporting.interactive", "page")  # the package's list of licences names this folder


@dataclass(frozen=True)
class Parts:
    """Files of a page, by name.

    Args:
        own: rooms where they are looked for before those that every page shares.
    """

    own: tuple[Room, ...]

    def __call__(self, name: str) -> str:
        """A file's text.

        Raises:
            FileNotFoundError: no room has it.
        """
        for package, folder in (*self.own, SHARED, _VENDOR):
            file = files(package) / folder / name
            if file.is_file():
                return file.read_text(encoding="utf-8")
        raise FileNotFoundError(f"no file {name!r} in {[*self.own, SHARED]}")

    def every(self, names: Sequence[str]) -> list[str]:
        """The texts of several, in this order."""
        return [self(name) for name in names]


def as_text(data: dict[str, Any]) -> str:
    """The object as it stands inside a <script type="application/json">: no tag can end in it."""
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
