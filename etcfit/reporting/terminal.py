"""A terminal on which no text of a user can give orders: what nobody sees is shown as its number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook
from rich.segment import Segment

from ..errors import visible


class _Visible:
    """Any renderable, its text as `visible` has it; the marks of style that rich itself adds stay."""

    def __init__(self, inner: ConsoleRenderable) -> None:
        self._inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for text, style, control in console.render(self._inner, options):
            yield Segment(text if control else visible(text), style, control)


class _Hook(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Visible(each) for each in renderables]


def console(**how: Any) -> Console:
    """A console of rich, made with these arguments."""
    made = Console(**how)
    made.push_render_hook(_Hook())
    return made
