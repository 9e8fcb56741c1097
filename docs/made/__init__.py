"""Parts of pages that are made from the program and committed: `python -m docs.made` writes them anew.

A part stands between `<!-- NAME: begin -->` and `<!-- NAME: end -->`; the line `<!-- NAME -->` is where a new one goes.
NAME is one of `PARTS`, or `options: COMMAND` or `schema: KIND`. `tests/test_docs.py` fails where a part is stale.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.page import Between

from . import commands, ecus, effects, howtos, rooms, schemas

ROOT = Path(__file__).resolve().parents[2]
PARTS: dict[str, Callable[[], str]] = {
    "verbs": commands.verbs,
    "effects": effects.catalogue,
    "rig effects": effects.of_the_rig,
    "symbols": effects.symbols,
    "ecus": ecus.table,
    "rooms": rooms.table,
    "howtos": howtos.table,
}
OF_A_NAME: dict[str, Callable[[str], str]] = {"options": commands.options, "schema": schemas.table}
MARKER = re.compile(r"^<!-- ([a-z ]+(?:: (?!begin|end)\w+)?)(?:: begin)? -->$", re.MULTILINE)


def pages() -> list[Path]:
    """Every page that may hold a made part."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def made(page: str) -> Iterator[tuple[str, str]]:
    """Name and text, as the program has it now, of each part that a page has a place for."""
    for name in dict.fromkeys(MARKER.findall(page)):
        kind, _, of = name.partition(": ")
        if name in PARTS:
            yield name, PARTS[name]()
        elif of and kind in OF_A_NAME:
            yield name, OF_A_NAME[kind](of)


def renewed(page: str) -> str:
    """The page with every part as the program has it now."""
    for name, text in made(page):
        place = Between.named(name)
        page = place.filled(page.replace(f"<!-- {name} -->", f"{place.begin}\n{place.end}"), text)
    return page
