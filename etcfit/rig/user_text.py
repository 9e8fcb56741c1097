"""Makes texts of a user safe: visible names, and comments and strings of other languages that a text cannot end.

Any text remains data: one function for each language escapes what ends a comment, or a string, there. Names of rigs,
files and folders go into reports, JSON files and exported code: they must be visible UTF-8.
"""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Callable, Iterable
from pathlib import PurePath

from ..errors import MeasurementError, unseen

_C_MARKS = re.compile(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)")
_HYPHENS = re.compile(r"(?<=-)(?=-)")
VISIBLE = "A name must hold no control characters and no marks of direction, because they hide its text."


def one_line(text: str) -> str:
    """Printable characters only: any white space becomes one space, an invisible character its number, as (U+202E)."""
    return "".join(c if c.isprintable() else f"(U+{ord(c):04X})" for c in " ".join(text.split()))


def in_c(text: str) -> str:
    """A line inside a block comment of C or C++.

    A backslash becomes a slash, because at the end of a line it would join that line with the next one; so would ??/.
    """
    return _C_MARKS.sub(" ", one_line(text).replace("\\", "/"))


def c_comment(lines: Iterable[str]) -> str:
    """A block comment of C or C++, a line or more for each."""
    return f"/*\n{_wrapped(lines, in_c, ' * ')}\n */"


def hash_comment(lines: Iterable[str]) -> str:
    """Comment lines of CSV and TOML."""
    return _wrapped(lines, one_line, "# ")


def toml_string(text: str) -> str:
    """A text in quotes for TOML: as in JSON, except for one character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def python_comment(lines: Iterable[str]) -> str:
    """Comment lines for the top of a file in Python.

    The first line is a coding line: Python obeys the first one that it finds in two lines (PEP 263), and a text could
    contain one.
    """
    return f"# -*- coding: utf-8 -*-\n{hash_comment(lines)}"


def matlab_comment(lines: Iterable[str]) -> str:
    """Comment lines of MATLAB and Octave."""
    return _wrapped(lines, one_line, "% ")


def xml_comment(lines: Iterable[str]) -> str:
    """The text of a comment of XML, for `xml.etree.ElementTree.Comment`, which escapes nothing."""
    return f"\n{_wrapped(lines, lambda line: _HYPHENS.sub(' ', one_line(line)), '  ')}\n"


def _wrapped(lines: Iterable[str], safe: Callable[[str], str], mark: str) -> str:
    """One or more comment lines for each line, with the indentation of the line."""
    marks = ((line, mark + " " * (len(line) - len(line.lstrip(" ")))) for line in lines)
    return "\n".join(textwrap.fill(safe(line), 110, initial_indent=begin, subsequent_indent=begin) or begin.rstrip()
                     for line, begin in marks)  # fmt: skip


def refuse_foreign_names(folder: str, *names: str) -> None:
    r"""Refuse a name that is no UTF-8, or has invisible characters; Linux allows any bytes.

    Args:
        folder: the folder of the names, as the user gave it; its own name is checked too.
    Raises:
        MeasurementError: names the first, with foreign bytes as \xe9 and invisible characters as (U+202E).
    """
    for path in (folder, *(f"{folder}/{name}" for name in names)):
        try:
            path.encode("utf-8")
        except UnicodeEncodeError:
            raise MeasurementError(escaped(path), "the name is no UTF-8.",
                                   "Names of files and folders must be UTF-8; reports and JSON files repeat them.",
                                   "Rename it; plain letters, digits, - and _ are always right.") from None  # fmt: skip
        if found := unseen(PurePath(path).name):
            raise MeasurementError(one_line(path), f"{found} in the name.", VISIBLE, "Rename it.")


def escaped(path: str) -> str:
    """The path with every byte that is no UTF-8 escaped."""
    try:
        return os.fsencode(path).decode("utf-8", "backslashreplace")
    except UnicodeEncodeError:  # a lone surrogate that is not from a file system
        return path.encode("utf-8", "backslashreplace").decode("utf-8")
