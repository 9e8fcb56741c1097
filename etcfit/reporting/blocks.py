"""What the tables for the terminal are put together from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from ..rig.base import RigConfig
from .plain_table import PlainTable as PlainTable
from .plain_table import plain_table as plain_table


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
