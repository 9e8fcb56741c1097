"""What is wrong in a line of TOML that somebody wrote by hand, and what to write instead.

The parser says where it gave up, in words for programmers. Each function below knows one slip; the first that knows the
line speaks.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

DOTS = ("...", "…")
DOTS_FOUND = "the dots stand for a value that only you know."
DOTS_REQUIRED = "Each of them must be filled in."
# key -> a value to show how it is written
EXAMPLES = {"name": '"bench"', "gear_ratio": "20.68", "supply_V": "12.0", "travel_deg": "90.0", "closed_V": "0.45",
            "open_V": "4.73", "files": '["response/2.csv"]', "effects": '["limp_home_spring"]'}  # fmt: skip

_SWITCHES = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}
_NUMBER = r"[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_QUOTED = re.compile(r"\"(?:[^\"\\]|\\.)*\"|'[^']*'")


class Slip(NamedTuple):
    """One slip.

    Args:
        line: where, counted from 1.
        found: what stands there.
        mend: what to write instead.
        required: what must stand there; "" for valid TOML.
    """

    line: int
    found: str
    mend: str
    required: str = ""


@dataclass(frozen=True)
class Line:
    """One line without its remark.

    Args:
        number: counted from 1.
        code: what stands before a #.
        table: the table that it belongs to, "" before the first.
    """

    number: int
    code: str
    table: str

    @property
    def key(self) -> str:
        return self.code.partition("=")[0].strip() if "=" in self.code else ""

    @property
    def value(self) -> str:
        return self.code.partition("=")[2].strip()

    @property
    def bare(self) -> str:
        """The value without what stands in quotes."""
        return _QUOTED.sub("", self.value)

    def put(self, value: str) -> str:
        """The line with another value."""
        return f"Write {self.key} = {value}"


def slip(text: str, message: str, number: int) -> Slip | None:
    """What is wrong in a text that is no TOML; None where no slip is known that looks so.

    Args:
        text: of the file.
        message: of the parser.
        number: of the line at which it gave up.
    """
    lines = list(_lines(text))
    here = next((line for line in reversed(lines) if line.number <= number and line.code), None)
    if here is None:
        return None
    if "overwrite" in message or "twice" in message:
        return _twice(lines)
    if "Unclosed" in message:
        return _unclosed(lines, here)
    for known in _KNOWN:
        if said := known(here, lines):
            return said
    return None


def left_blank(tables: Mapping[str, Any], prefix: str = "") -> str | None:
    """The key of the first text that is nothing but dots; None where there is none."""
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
    return f"{written}; or put a # before the line, and before its whole table where that means nothing without it."


def _lines(text: str) -> Iterator[Line]:
    table = ""
    for number, raw in enumerate(text.split("\n"), 1):
        code = _without_remark(raw).strip(" \t\r")
        if header := re.fullmatch(r"\[+\s*([^\[\]=]+?)\s*\]+", code):
            table = header[1]
        yield Line(number, code, table)


def _without_remark(raw: str) -> str:
    """Up to a # that does not stand in quotes."""
    masked = _QUOTED.sub(lambda match: "_" * len(match[0]), raw)
    return raw[: masked.find("#")] if "#" in masked else raw


def _dots(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not _has_dots(line):
        return None
    others = [each.number for each in lines if each.number != line.number and _has_dots(each)]
    too = ""
    if others:
        too = f" The same in line{'s' if len(others) > 1 else ''} {', '.join(map(str, others))}."
    return Slip(line.number, f"{line.code}: {DOTS_FOUND}", filled(line.key) + too, DOTS_REQUIRED)


def _has_dots(line: Line) -> bool:
    return bool(re.search(r"(?<![\w.])(?:\.{3}|…)(?![\w.])", line.bare if line.key else line.code))


def _curly_quotes(line: Line, lines: Iterable[Line]) -> Slip | None:
    straight = re.sub("[“”„«»]", '"', re.sub("[‘’]", "'", line.code))
    if straight == line.code:
        return None
    return Slip(line.number, "the quotes are those of a word processor.", f"Use straight quotes: {straight}")


def _other_remark(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not (match := re.search(r"(?:^|\s)(//|;)", _QUOTED.sub("", line.code))):
        return None
    return Slip(line.number, f"{match[1]} begins no remark in TOML.", f"Write # instead of {match[1]}.")


def _odd_blank(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not any(each.isspace() and each not in " \t" for each in line.code):
        return None
    return Slip(line.number, "there is a blank that is no ordinary space.", "Type the line anew; do not copy it.")


def _comma(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not re.fullmatch(r"[+-]?\d+,\d+", line.value):
        return None
    return Slip(line.number, f"{line.value} has a decimal comma.", f"{line.put(line.value.replace(',', '.'))}.")


def _unit(line: Line, lines: Iterable[Line]) -> Slip | None:
    match = re.fullmatch(rf"({_NUMBER})\s*(?![eE]$)([A-Za-zµΩ°%][\w*/%°²+.\s-]*)", line.value)
    if not match:
        return None
    if line.table == "accuracy":
        return _no_quotes(line)
    said = f"{line.value} has a unit behind the number."
    return Slip(line.number, said, f"{line.put(match[1])}: the key itself says the unit.")


def _switch(line: Line, lines: Iterable[Line]) -> Slip | None:
    word = _SWITCHES.get(line.value.casefold())
    return Slip(line.number, f"found {line.value}.", f"{line.put(word)}, in lower case.") if word else None


def _nothing(line: Line, lines: Iterable[Line]) -> Slip | None:
    if re.fullmatch(r"[+-]?inf(inity)?", line.value, re.IGNORECASE):
        sign = "-" if line.value.startswith("-") else ""
        return Slip(line.number, f"found {line.value}.", f"{line.put(f'{sign}inf')}, in lower case.")
    if line.key and line.value.casefold() in ("", "none", "null", "nan", "n/a"):
        found = f"{line.key} has no value."
        return Slip(line.number, found, "Write its value, or put a # before the line if there is none.")
    return None


def _number(line: Line, lines: Iterable[Line]) -> Slip | None:
    try:
        value = float(line.value)
    except ValueError:
        return None
    if re.fullmatch(r"[+-]?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?", line.value):
        return None  # the slip is elsewhere
    return Slip(line.number, f"found {line.value}.", f"{line.put(repr(value))}: a digit on each side of the point, no "
                "zero in front.")  # fmt: skip


def _backslash(line: Line, lines: Iterable[Line]) -> Slip | None:
    if '"' not in line.value or "\\" not in line.value:
        return None
    with_slashes = line.put(line.value.replace("\\", "/"))
    return Slip(line.number, "there is a \\ in a text.", f"{with_slashes}, with / for \\.")


def _open_text(line: Line, lines: Iterable[Line]) -> Slip | None:
    for quote in "\"'":
        if _QUOTED.sub("", line.code).count(quote) == 1:
            return Slip(line.number, "a text has no closing quote.", f"Put {quote} at both ends of the text.")
    return None


def _bare_word(line: Line, lines: Iterable[Line]) -> Slip | None:
    return _no_quotes(line) if line.key and re.match(r"[^\W\d]", line.value) else None


def _no_quotes(line: Line) -> Slip:
    quoted = f'"{line.value}"'
    return Slip(line.number, f"{line.value} is a text without quotes.", f"{line.put(quoted)}.")


def _equals_twice(line: Line, lines: Iterable[Line]) -> Slip | None:
    return (
        Slip(line.number, "found ==.", f"{line.put(line.value[1:].strip())}.") if line.value.startswith("=") else None
    )


def _header(line: Line, lines: Iterable[Line]) -> Slip | None:
    if "=" in line.code or not re.fullmatch(r"\[+[^\[\]]+|[^\[\]]+\]+", line.code):
        return None
    name = line.code.strip("[] ")
    return Slip(line.number, f"{line.code}: a bracket is missing.", f"Write [{name}].")


def _odd_key(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not line.key or line.key[0] in "\"'" or re.fullmatch(r"[A-Za-z0-9_.-]+", line.key):
        return None
    what = "a space" if " " in line.key else "a letter that TOML takes in quotes only"
    plain = " " in line.key and line.table != "columns"
    name = "_".join(line.key.split()) if plain else f'"{line.key}"'
    return Slip(line.number, f"the name {line.key} has {what} in it.", f"Write {name} = {line.value}.")


def _no_equals(line: Line, lines: Iterable[Line]) -> Slip | None:
    match = re.fullmatch(r"(\w+|\"[^\"]*\")(?:\s*:\s*|\s+)(\S.*)", line.code)
    if line.key or not match:
        return None
    return Slip(line.number, f"{line.code} has no = in it.", f"Write {match[1]} = {match[2]}.")


def _broken_braces(line: Line, lines: Iterable[Line]) -> Slip | None:
    if not line.value.startswith("{") or "}" in line.value:
        return None
    return Slip(line.number, "what begins with { goes on in the next line.", "Put all of it, up to }, in one line.")


_KNOWN: tuple[Callable[[Line, Iterable[Line]], Slip | None], ...] = (
    _dots, _curly_quotes, _odd_blank, _other_remark, _equals_twice, _header, _odd_key, _no_equals, _comma, _switch,
    _nothing, _unit, _number, _broken_braces, _open_text, _backslash, _bare_word,
)  # fmt: skip


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
            return Slip(line.number, f"{what[1]} stands here and in line {first[what]}.", mend)
        first.setdefault(what, line.number)
    return None


def _unclosed(lines: Iterable[Line], here: Line) -> Slip | None:
    """Where the list or the table in braces begins at which the parser still was."""
    before = [line for line in lines if line.number <= here.number]
    begun = next((line for line in reversed(before) if re.match(r"[\[{]", line.value)), None)
    if begun is None:
        return None
    if (dots := next((said for line in before[begun.number - 1 :] if (said := _dots(line, lines))), None)) is not None:
        return dots
    bare = begun.bare
    close = "]" if begun.value.startswith("[") else "}"
    if close in bare:
        return Slip(begun.number, f"{begun.value}: a comma is missing.", "Put a comma between each two entries.")
    return Slip(begun.number, f"{begun.code}: the closing {close} is missing.", f"Put {close} behind its last entry.")
