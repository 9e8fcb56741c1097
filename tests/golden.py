"""Views kept as text in tests/golden/: the words must be the same, and the figures within a part in a thousand.

`ETCFIT_GOLDEN=write pytest ...` writes the files anew; their diff then shows what a change does to what people see.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

import etcfit

FOLDER = Path(__file__).parent / "golden"
FIGURE = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.])")


def check_view(name: str, text: str, *folders: str | Path) -> None:
    """Compare a view with its file. Folders of this run and the version of the package do not count."""
    for k, folder in enumerate(folders):
        text = text.replace(str(folder), f"FOLDER_{k}")
    text = re.sub(r"[^\S\n]+\n", "\n", text.replace(etcfit.__version__, "VERSION")).strip() + "\n"
    file = FOLDER / name
    if os.environ.get("ETCFIT_GOLDEN") == "write":
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    kept = file.read_text(encoding="utf-8")
    assert _words(text) == _words(kept), f"{name}: where this is meant, ETCFIT_GOLDEN=write writes it anew"
    found, expected = ([float(each) for each in FIGURE.findall(every)] for every in (text, kept))
    assert found == pytest.approx(expected, rel=1e-3, abs=1e-12)


def _words(text: str) -> list[list[str]]:
    """Line by line, a figure as #, whatever its width."""
    return [FIGURE.sub("#", line).split() for line in text.splitlines()]
