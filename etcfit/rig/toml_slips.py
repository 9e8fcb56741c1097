"""Finds the mistake in a line of TOML that was written by hand, and the text to write instead.

The parser reports only the place where it stopped, in the terms of programmers.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

DOTS = ("...", "…")
DOTS_FOUND = "the dots stand for a value that only you know."
DOTS_REQUIRED = "Each of them must be filled in."
# key -> an example of its value
EXAMPLES = {"name": '"bench"', "gear_ratio": "20.68", "supply_V": "12.0", "travel_deg": "90.0", "closed_V": "0.45",
            "open_V": "4.73", "files": '["response/2.csv"]', "effects": '["limp_home_spring"]'}  # fmt: skip

_SWITCHES = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}
_NUMBER = r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_QUOTED = re.compile(r"\"(?:[^\"\\]|\\.)*\"|'[^']*'")


class Slip(NamedTuple):
    """One slip."""

    line: int  # line, counted from 1
    found: str  # the mistake
    mend: str  # the text to write instead
    required: str = ""  # the requirement; "" for valid TOML


class Line(NamedTuple):
    """One line without its comment."""

    number: int  # counted from 1
    code: str  # the text before a #
    table: str  # the table to which it belongs, "" before the first

    @property
    def key(self) -> str:
        return self.code.partition("=")[0].strip() if "=" in self.code else ""

    @property
    def value(self) -> str:
        return self.code.partition("=")[2].strip()

    @property
    def bare(self) -> str:
        """The value without quoted texts."""
        return _QUOTED.sub("", self.value)

    def put(self, value: str) -> str:
        """The line with another value."""
        return f"Write {self.key} = {value}"


def slip(text: str, message: str, number: int) -> Slip | None:
    """The mistake in a text that is no TOML; None where no known mistake fits.

    Args:
        number: line at which the parser stopped.
    """
    lines = list(_lines(text))
    here = next((line for line in reversed(lines) if line.number <= number and line.code), None)
    if here is None:
        return None
    if "overwrite" in message or "twice" in message:
        return _twice(lines)
    if "Unclosed" in message:
        return _unclosed(lines, here)
    if said := _dots(here, lines):
        return said
    said = _of_signs(here) or _of_value(here) or _of_text(here)
    return Slip(here.number, *said) if said else None


def left_blank(tables: Mapping[str, Any], prefix: str = "") -> str | None:
    """The key of the first text that consists of dots only; None where there is none."""
    for key, value in tables.items():
        inner = f"{prefix}{key}"
        if isinstance(value, Mapping):
            if found := left_blank(value, f"{inner}."):
                return found
        elif any(each in DOTS for each in (value if isinstance(value, list) else [value]) if isinstance(each, str)):
            return inner
    return None


def filled(key: str) -> str:
    """How to fill in a value, for a message."""
    name = key.rpartition(".")[2].strip("\"' ")
    example = f"{name} = {EXAMPLES[name]}" if name in EXAMPLES else ""
    written = f"Write your value there{f', as in {example}' if example else ''}"
    return f"{written}; or put a # before the line, and before its whole table if the table needs this line."


def _lines(text: str) -> Iterator[Line]:
    table = ""
    for number, raw in enumerate(text.split("\n"), 1):
        masked = _QUOTED.sub(lambda match: "_" * len(match[0]), raw)  # a # in quotes begins no comment
        code = (raw[: masked.find("#")] if "#" in masked else raw).strip(" \t\r")
        if header := re.fullmatch(r"\[+\s*([^\[\]=]+?)\s*\]+", code):
            table = header[1]
        yield Line(number, code, table)


def _dots(line: Line, lines: Iterable[Line]) -> Slip | None:
    def has_dots(each: Line) -> bool:
        return bool(re.search(r"(?<![\w.])(?:\.{3}|…)(?![\w.])", each.bare if each.key else each.code))

    if not has_dots(line):
        return None
    others = [str(each.number) for each in lines if each.number != line.number and has_dots(each)]
    too = f" The same in line{'s' if len(others) > 1 else ''} {', '.join(others)}." if others else ""
    return Slip(line.number, f"{line.code}: {DOTS_FOUND}", filled(line.key) + too, DOTS_REQUIRED)


# Found and mend of the first mistake in a line. The order matters: earlier tests explain the line better.


def _of_signs(line: Line) -> tuple[str, str] | None:
    """Mistakes in TOML's own signs and in names."""
    code, key = line.code, line.key
    straight = re.sub("[“”„«»]", '"', re.sub("[‘’]", "'", code))
    if straight != code:
        return "the quotes are those of a word processor.", f"Use straight quotes: {straight}"
    if any(each.isspace() and each not in " \t" for each in code):
        return "there is a blank that is no ordinary space.", "Type the line again; do not copy it."
    if match := re.search(r"(?:^|\s)(//|;)", _QUOTED.sub("", code)):
        return f"{match[1]} begins no comment in TOML.", f"Write # instead of {match[1]}."
    if line.value.startswith("="):
        return "found ==.", f"{line.put(line.value[1:].strip())}."
    if "=" not in code and re.fullmatch(r"\[+[^\[\]]+|[^\[\]]+\]+", code):
        return f"{code}: a bracket is missing.", f"Write [{code.strip('[] ')}]."
    if key and key[0] not in "\"'" and not re.fullmatch(r"[A-Za-z0-9_.-]+", key):
        what = "a space" if " " in key else "a letter that TOML takes in quotes only"
        name = "_".join(key.split()) if " " in key and line.table != "columns" else f'"{key}"'
        return f"the name {key} has {what} in it.", f"Write {name} = {line.value}."
    if not key and (match := re.fullmatch(r"(\w+|\"[^\"]*\")(?:\s*:\s*|\s+)(\S.*)", code)):
        return f"{code} has no = in it.", f"Write {match[1]} = {match[2]}."
    return None


def _of_value(line: Line) -> tuple[str, str] | None:
    """Mistakes in numbers and switches, and missing values."""
    key, value = line.key, line.value
    if re.fullmatch(r"[+-]?\d+,\d+", value):
        return f"{value} has a decimal comma.", f"{line.put(value.replace(',', '.'))}."
    if word := _SWITCHES.get(value.casefold()):
        return f"found {value}.", f"{line.put(word)}, in lower case."
    if re.fullmatch(r"[+-]?inf(inity)?", value, re.IGNORECASE):
        sign = "-" if value.startswith("-") else ""
        return f"found {value}.", f"{line.put(f'{sign}inf')}, in lower case."
    if key and value.casefold() in ("", "none", "null", "nan", "n/a"):
        return f"{key} has no value.", "Write its value, or put a # before the line if there is none."
    if match := re.fullmatch(rf"({_NUMBER})\s*(?![eE]$)([A-Za-zµΩ°%][\w*/%°²+.\s-]*)", value):
        if line.table == "accuracy":
            return _no_quotes(line)
        return f"{value} has a unit behind the number.", f"{line.put(match[1])}: the key itself says the unit."
    try:
        number = float(value)
    except ValueError:
        return None
    if re.fullmatch(r"[+-]?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?", value):
        return None  # the slip is elsewhere
    return f"found {value}.", f"{line.put(repr(number))}: a digit on each side of the point, no zero in front."


def _of_text(line: Line) -> tuple[str, str] | None:
    """Mistakes in braces and quotes."""
    if line.value.startswith("{") and "}" not in line.value:
        return "a table that begins with { continues in the next line.", "Write all of it, up to }, in one line."
    for quote in "\"'":
        if _QUOTED.sub("", line.code).count(quote) == 1:
            return "a text has no closing quote.", f"Put {quote} at both ends of the text."
    if '"' in line.value and "\\" in line.value:
        slashes = line.value.replace("\\", "/")
        return "there is a \\ in a text.", f"{line.put(slashes)}, with / for \\."
    return _no_quotes(line) if line.key and re.match(r"[^\W\d]", line.value) else None


def _no_quotes(line: Line) -> tuple[str, str]:
    quoted = f'"{line.value}"'
    return f"{line.value} is a text without quotes.", f"{line.put(quoted)}."


def _twice(lines: Iterable[Line]) -> Slip | None:
    """The second of two keys, or of two tables, of one name."""
    first: dict[tuple[str, str], int] = {}
    seen: Counter[str] = Counter()
    for line in lines:
        header = line.code.startswith("[") and not line.code.startswith("[[")
        seen[line.table] += header
        what = ("", f"[{line.table}]") if header else (f"{line.table} {seen[line.table]}", line.key.strip("\"'"))
        if what[1] and what in first:
            mend = "Put all its keys below one of the two." if header else "Delete one of the two lines."
            return Slip(line.number, f"{what[1]} is here and in line {first[what]}.", mend)
        first.setdefault(what, line.number)
    return None


def _unclosed(lines: Iterable[Line], here: Line) -> Slip | None:
    """The mistake in the list or the inline table that is not closed where the parser stopped."""
    before = [line for line in lines if line.number <= here.number]
    begun = next((line for line in reversed(before) if re.match(r"[\[{]", line.value)), None)
    if begun is None:
        return None
    if dots := next((said for line in before[begun.number - 1 :] if (said := _dots(line, lines))), None):
        return dots
    close = "]" if begun.value.startswith("[") else "}"
    if close in begun.bare:
        return Slip(begun.number, f"{begun.value}: a comma is missing.", "Put a comma between each two entries.")
    return Slip(begun.number, f"{begun.code}: the closing {close} is missing.", f"Put {close} behind its last entry.")
