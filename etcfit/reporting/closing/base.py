"""The three lines themselves."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_NAMED = 2  # of many things, before a line counts the others


@dataclass(frozen=True)
class Closing:
    """How a command ends.

    Args:
        answer: what came of it, in plain words.
        next: the command to type, with its arguments; or what to do outside, as a sentence.
        look: files to open, the most telling first; those that are not on the disk are left out.
    """

    answer: str
    next: str
    look: tuple[Path, ...] = ()

    def __str__(self) -> str:
        there = " and ".join(shlex.quote(str(path)) for path in self.look if path.exists())
        return "\n".join((f"Answer: {self.answer}", *([f"Look:   {there}"] if there else []), f"Next:   {self.next}"))


def mended(line: str, folder: str | Path, then: str) -> str:
    """A command, and what to change before it is given."""
    return f"{then}, after this change in {shlex.quote(str(Path(folder) / 'rig.toml'))}: {line}"


def counted(names: Sequence[str]) -> str:
    """The first names, and how many more there are: "R_a, K_b and 9 more"."""
    from ...estimation.identifiability import listed  # with it comes the model, which `new` and `import` do without

    more = len(names) - _NAMED
    return f"{', '.join(names[:_NAMED])} and {more} more" if more > 1 else listed(names)


def number_of(count: int, thing: str) -> str:
    """ "1 file", "2 files"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"
