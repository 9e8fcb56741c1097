"""What the tables for the terminal are put together from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..rig.base import RigConfig


class PlainTable(Table):
    """A table whose texts are what they say: `channel_gain[response]` is a name, and no style called "response"."""

    def add_row(self, *cells: RenderableType | None, **how: Any) -> None:
        super().add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in cells), **how)


def plain_table(*columns: str, left: int = 1) -> PlainTable:
    """A plain table; the first columns are words, the others figures."""
    table = PlainTable(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="")
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k < left else "right", no_wrap=k > 0)
    return table


def rig_title(config: RigConfig, rest: str) -> Text:
    """Names the rig, and made-up data as such."""
    text = Text(f"{config.name}: {rest}", style="bold")
    if config.synthetic:
        text.append("  SYNTHETIC DATA", style="bold magenta")
    return text


def sentences(title: str, texts: Sequence[str]) -> RenderableType | None:
    """A dash and a line each; None where there is nothing to say."""
    if not texts:
        return None
    lines = [Padding(Text("- " + text), (0, 0, 0, 2)) for text in texts]
    return headed(title, Group(*lines))


def headed(title: str, part: RenderableType) -> RenderableType:
    """A part under its title, a line apart."""
    return spaced(Group(Text(title, style="bold"), part))


def spaced(part: RenderableType) -> RenderableType:
    """A part, a line apart."""
    return Padding(part, (1, 0, 0, 0))


def render(part: RenderableType, width: int = 140) -> str:
    """A renderable as plain text, for logs, notebooks and tests."""
    from rich.console import Console

    console: Any = Console(width=width, color_system=None, force_terminal=False, force_jupyter=False)
    with console.capture() as capture:
        console.print(part)
    return capture.get()
