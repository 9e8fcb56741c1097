"""The three lines at the end of every command: the answer in words, where to look, what to type next."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import command
from ..numbers import counted

if TYPE_CHECKING:
    from ...importing import Imported

NEXT_LOG = "NEXT_LOG"  # stands in a command for a file that is not recorded yet
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


def first_few(names: Sequence[str]) -> str:
    """The first names, and how many more there are: "R_a, K_b and 9 more"."""
    from ...estimation.identifiability import listed

    more = len(names) - _NAMED
    return f"{', '.join(names[:_NAMED])} and {more} more" if more > 1 else listed(names)


_TOML = "rig.toml"


def of_new(folder: Path) -> Closing:
    """A folder to be filled in."""
    answer = "A rig.toml with every key explained, and a folder for each rig test that says what to record."
    further = command("import", "RECORDING", "--to", "FOLDER", "--rig", folder / _TOML)
    return Closing(answer, f"{further}, once you have filled in each ... of that file", (folder / _TOML,))


def of_imported(done: Imported) -> Closing:
    """Foreign recordings as traces."""
    tests = len({file.partition("/")[0] for file, _, _ in done.traces})
    warned = f", with {counted(len(done.warnings), 'warning')}" if done.warnings else ""
    answer = f"{counted(len(done.traces), 'trace')} of {counted(tests, 'rig test')}{warned}: check units and signs."
    return Closing(answer, command("check", done.folder), (done.folder / _TOML,))


def of_fetched(name: str, folder: Path) -> Closing:
    """A public data set."""
    return Closing(f"{name} is a measurement folder now; its README says what was converted and assumed.",
                   command("check", folder), (folder / "README.md",))  # fmt: skip
