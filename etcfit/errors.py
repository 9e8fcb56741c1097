"""Errors that carry their own cure, and how a message shows commands and names."""

from __future__ import annotations

import importlib
import re
import shlex
import sys
import unicodedata
from collections.abc import Sequence
from pathlib import Path

_DIRECTION = ("\u061c", "\u200e", "\u200f", *map(chr, range(0x202A, 0x202F)), *map(chr, range(0x2066, 0x206A)))
_UNSEEN = ("Cc", "Zl", "Zp", "Cs")  # controls, ends of lines and paragraphs, half characters


class MeasurementError(Exception):
    """The data (or the rig.toml) are wrong: where, what was found, what is required, how to mend it.

    Args:
        where: file, with a line or a column when there is one (`response/3.csv:118`).
        found: what stands there.
        required: what must stand there.
        mend: what the user can do about it.
    """

    def __init__(self, where: str, found: str, required: str, mend: str) -> None:
        self.where, self.found, self.required, self.mend = where, found, required, mend
        super().__init__(f"{where}: {found} {required} {mend}".strip())


class UsageError(Exception):
    """The command line asks for something that cannot be done; exit status 2."""


class SettingsError(UsageError, ValueError):
    """A setting that cannot be so: the command line's mistake, and in Python an ordinary wrong value."""


def command(*words: str | Path) -> str:
    """A command line of etcfit that a shell takes as it stands: words with blanks are in quotes."""
    return shlex.join(["etcfit", *map(str, words)])


def first_names(names: Sequence[str], most: int) -> str:
    """The first few names, and how many more there are: "a, b and 9 more"."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more:,} more" if more > 0 else "")


def unseen(name: str) -> str:
    """The control characters and marks of direction in a name, as U+202E, U+001B; "" where there are none."""
    found = [c for c in name if unicodedata.category(c) in _UNSEEN or c in _DIRECTION]
    return ", ".join(dict.fromkeys(f"U+{ord(c):04X}" for c in found))


def visible(text: str) -> str:
    """A text for a terminal, lines and tabs as they are: any other unseen character is its number, as (U+001B)."""
    if text.isprintable():
        return text
    return "".join(f"(U+{ord(c):04X})" if c not in "\n\t" and unseen(c) else c for c in text)


def require_extra(extra: str, purpose: str, *libraries: str) -> None:
    """Libraries that only an extra installs, checked before the work that needs them in the end.

    Args:
        extra: of this package, "fleet" or "import".
        purpose: what needs them, the subject of the message.
        libraries: names to import.
    Raises:
        UsageError: one cannot be imported.
    """
    for library in libraries:
        try:
            importlib.import_module(library)
        except ImportError as error:
            raise UsageError(f"{purpose} needs the library {library}, which is not installed. "
                             f"{how_to_install(extra)}") from error  # fmt: skip


def how_to_install(extra: str) -> str:
    """What to type for the libraries of one extra of etcfit, which no package index has: "Install them: ..."."""
    pip = f"{shlex.quote(sys.executable)} -m pip install"
    from_source = f"in the folder of etcfit's source, {pip} '.[{extra}]'."
    if not (wanted := _requirements(extra)):
        return f"Install them: {from_source}"
    return f"Install them: {pip} {' '.join(shlex.quote(each) for each in wanted)}, or, {from_source}"


def _requirements(extra: str) -> list[str]:
    """As the installed package names them: ["distributed>=2025.1", ...]; none where it is not installed itself."""
    from importlib import metadata  # a tenth of what `etcfit --help` would import

    try:
        every = metadata.requires("etcfit") or []
    except metadata.PackageNotFoundError:
        return []
    found = (re.fullmatch(r"([^;]+?)\s*;\s*extra == ['\"]([\w-]+)['\"]", each) for each in every)
    return [match[1] for match in found if match is not None and match[2] == extra]
