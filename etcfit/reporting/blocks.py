"""Tables for a terminal with their titles and sentences, and a console that does not interpret a user's text."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, ConsoleRenderable, Group, RenderableType, RenderHook, RenderResult
from rich.padding import Padding
from rich.segment import Segment
from rich.text import Text

from ..errors import visible
from .table import Notes, Part, Table, there

if TYPE_CHECKING:  # a console does not need these modules
    from ..estimation.fitted_model import FitState
    from ..rig.base import RigConfig

_GAP = 2, 1  # characters between columns: usually, and if space is scarce
_STYLES = {"": "", "bad": "bold red", "doubt": "bold yellow", "dim": "dim", "strong": "bold"}
_COMFORT = 24  # least number of characters per line of prose, as long as there are columns to omit


class PlainTable:
    """A table laid out for a terminal: optional columns are omitted first, then columns continue below.

    Texts are not interpreted: `channel_gain[response]` is a name, not a style called "response".
    """

    def __init__(self, table: Table) -> None:
        self.columns, self.file = table.columns, table.file
        self.keys = [k for k, c in enumerate(self.columns[: table.keys]) if not c.spare and c.kind != "prose"]
        self.spare = [c.head for c in sorted(self.columns, key=lambda c: c.spare) if c.spare]
        self.rows = [[Text(cell.text, style=_STYLES[cell.tone]) for cell in row] for row in table.cells]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, every = options.max_width, range(len(self.columns))
        for spared in range(len(self.spare) + 1):
            kept = [k for k in every if self.columns[k].head not in self.spare[:spared]]
            if self._total(kept, tight=False) <= width:
                yield from self._block(console, kept, width, tight=False)
                yield from self._left_out(spared, width)
                return
        kept = [k for k in every if self.columns[k].head not in self.spare]
        for number, block in enumerate(self._blocks(kept, width)):
            if number:
                yield Text()
            yield from self._block(console, block, width, tight=self._total(block, tight=False) > width)
        yield from self._left_out(len(self.spare), width)

    def _left_out(self, spared: int, width: int) -> Iterator[Text]:
        names = [c.head for c in self.columns if c.head in self.spare[:spared]]
        if names:
            wide = self._total(range(len(self.columns)), tight=False)
            elsewhere = f"; so does {self.file}" if self.file else ""
            them = "it" if len(names) == 1 else "them"
            said = f"Left out at a width of {width}: {', '.join(names)}. A width of {wide} shows {them}{elsewhere}."
            yield Text(said, style="dim")

    def _least(self, k: int, tight: bool) -> int:
        column, cells = self.columns[k], [row[k] for row in self.rows]
        head = _longest(column.head.split())
        if column.kind == "prose":
            words = _longest(word for cell in cells for word in cell.plain.split())
            return max(head, words, 0 if tight else min(_COMFORT, self._most(k)))
        if column.kind == "path" and tight:
            return max(head, _longest(part for cell in cells for part in _parts(cell.plain)))
        return max(head, *(cell.cell_len for cell in cells), 0)

    def _most(self, k: int) -> int:
        return max(_longest(self.columns[k].head.splitlines()), *(row[k].cell_len for row in self.rows), 0)

    def _total(self, shown: Iterable[int], tight: bool) -> int:
        widths = [self._least(k, tight) for k in shown]
        return sum(widths) + _GAP[tight] * (len(widths) - 1)

    def _blocks(self, kept: Sequence[int], width: int) -> list[list[int]]:
        """Columns side by side in each block, the keys first."""
        keys = [k for k in self.keys if k in kept]
        blocks = [list(keys)]
        for k in kept:
            if k not in keys:
                if len(blocks[-1]) > len(keys) and self._total([*blocks[-1], k], tight=True) > width:
                    blocks.append(list(keys))
                blocks[-1].append(k)
        return blocks

    def _widths(self, shown: Sequence[int], width: int, tight: bool) -> list[int]:
        """Extra width goes to prose and file names first, then to headers."""
        widths = [self._least(k, tight) for k in shown]
        free = width - self._total(shown, tight)
        if free < 0:  # one name is longer than the width of the terminal
            widest = widths.index(max(widths))
            widths[widest] = max(1, widths[widest] + free)
            return widths
        elastic = [self.columns[k].kind in ("prose", "path") for k in shown]
        for now in (True, False):
            lacks = [self._most(k) - w if e is now else 0 for k, w, e in zip(shown, widths, elastic, strict=True)]
            share = min(1.0, free / max(1, sum(lacks)))
            widths = [w + int(share * lack) for w, lack in zip(widths, lacks, strict=True)]
            free -= sum(int(share * lack) for lack in lacks)
        return widths

    def _block(self, console: Console, shown: Sequence[int], width: int, tight: bool) -> Iterator[Text]:
        widths, gap = self._widths(shown, width, tight), " " * _GAP[tight]
        # a header may contain line ends: a name above its unit
        heads = [[piece for line in self.columns[k].head.split("\n") for piece in _folded(console, Text(line), w)]
                 for k, w in zip(shown, widths, strict=True)]  # fmt: skip
        deepest = max(map(len, heads), default=0)
        if any(self.columns[k].head for k in shown):
            yield from self._lines([[Text()] * (deepest - len(head)) + head for head in heads], shown, widths, gap)
        for row in self.rows:
            cells = [
                (_at_slashes if self.columns[k].kind == "path" else _folded)(console, row[k], w)
                for k, w in zip(shown, widths, strict=True)
            ]
            yield from self._lines(cells, shown, widths, gap)

    def _lines(self, cells: list[list[Text]], shown: Sequence[int], widths: Sequence[int], gap: str) -> Iterator[Text]:
        for number in range(max(map(len, cells), default=0)):
            line = Text(no_wrap=True, overflow="ignore", end="\n")
            for place, (k, width) in enumerate(zip(shown, widths, strict=True)):
                part = cells[place][number] if number < len(cells[place]) else Text()
                blank = " " * (width - part.cell_len)
                line.append(gap if place else "")
                line.append_text(Text(blank) + part if self.columns[k].kind == "figure" else part + Text(blank))
            line.rstrip()
            yield line


def _longest(words: Iterable[str]) -> int:
    return max((Text(word).cell_len for word in words), default=0)


def _folded(console: Console, text: Text, width: int) -> list[Text]:
    """Broken at spaces; within a word only if the word alone is too long."""
    if text.cell_len <= width:
        return [text]
    return list(text.wrap(console, width, justify="left", overflow="fold"))


def _parts(path: str) -> list[str]:
    *folders, name = path.split("/")
    return [*(f"{folder}/" for folder in folders), name]


def _at_slashes(console: Console, text: Text, width: int) -> list[Text]:
    lines = [""]
    for part in _parts(text.plain):
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return [piece for line in lines for piece in _folded(console, Text(line, style=text.style), width)]


def rig_title(config: RigConfig, rest: str) -> Text:
    """Title with the name of the rig, and a remark if the data are synthetic."""
    return headline(f"{config.name}: {rest}", config.synthetic)


def headline(text: str, synthetic: bool) -> Text:
    """First lines of a command's output, with a remark if the data are synthetic."""
    head = Text(text, style="bold")
    if synthetic:
        head.append("  SYNTHETIC DATA", style="bold magenta")
    return head


def stacked(*parts: RenderableType | Part | None) -> Group:
    """Parts one below the other, tables and notes as `shown`; without those that are None or empty."""
    blocks = []
    for part in parts:
        if isinstance(part, Table | Notes):
            blocks += map(shown, there(part))
        elif part is not None:
            blocks.append(part)
    return Group(*blocks)


def shown(part: Part) -> Padding:
    """A table with its notes, or notes, under their title; see `table.py`."""
    if isinstance(part, Table):
        return headed(part.title, Group(PlainTable(part), *dashed(part.notes)))
    code = (Text(line, no_wrap=True, overflow="ignore") for line in part.texts)
    return headed(part.title, Group(*(code if part.code else dashed(part.texts))))


def outcome(converged: bool, words: tuple[str, str], rest: str) -> Text:
    """The outcome of a computation: the first of two words in green if it converged, else the second in red."""
    word, style = (words[0], "bold green") if converged else (words[1], "bold red")
    return Text.assemble((word, style), f": {rest}")


def dashed(texts: Iterable[str]) -> list[Padding]:
    """A dash and a line each."""
    return [Padding(Text(f"- {text}"), (0, 0, 0, 2)) for text in texts]


def headed(title: str, part: RenderableType) -> Padding:
    """A part under its title, after an empty line."""
    return spaced(Group(Text(title, style="bold"), part))


def spaced(part: RenderableType) -> Padding:
    """A part, after an empty line."""
    return Padding(part, (1, 0, 0, 0))


def render(part: RenderableType, width: int = 140) -> str:
    """A renderable as plain text, for logs, notebooks and tests."""
    from rich.console import Console

    console: Any = Console(width=width, color_system=None, force_terminal=False, force_jupyter=False)
    with console.capture() as capture:
        console.print(part)
    return capture.get()


def cautioned(part: RenderableType, state: FitState) -> RenderableType:
    """A table, with the cautions of its fit above."""
    if not state.cautions:
        return part
    return Group(shown(Notes("Caution", state.cautions)), "", part)


class _Visible:
    """Any renderable with its text made `visible`; style marks of rich itself stay."""

    def __init__(self, inner: ConsoleRenderable) -> None:
        self._inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for text, style, control in console.render(self._inner, options):
            yield Segment(text if control else visible(text), style, control)


class _Hook(RenderHook):
    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        return [_Visible(each) for each in renderables]


def console(**how: Any) -> Console:
    """A console of rich with these arguments."""
    made = Console(**how)
    made.push_render_hook(_Hook())
    return made
