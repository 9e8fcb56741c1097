"""What the user says about columns and files: options of a script, or answers on a terminal."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

from ..errors import UsageError
from ..rig.base import CHANNELS
from ..rig.columns import DROP, HeaderError, parse_header
from ..rig.config import UNIT_SLUGS
from ..rig.reader import KNOWN_TESTS
from ..rig.toml import closest
from .sheet import Column, Sheet

QUANTITIES = ("time", "tps", *CHANNELS)
IGNORE = "ignore"


@dataclass(frozen=True)
class Target:
    """What a column shall be.

    Args:
        quantity: IGNORE where it shall be left out.
        unit: "" where the file's is right.
    """

    quantity: str
    unit: str = ""


@dataclass(frozen=True)
class Answers:
    """All that was said.

    Args:
        columns: (file or "" for all, label or name of the column) -> what it shall be.
        tests: file -> rig test.
        accepted: keys of doubts whose guess was taken.
        period: between the samples of a file without a time, s; None where nobody said.
    """

    columns: Mapping[tuple[str, str], Target] = field(default_factory=dict)
    tests: Mapping[str, str] = field(default_factory=dict)
    accepted: frozenset[str] = frozenset()
    period: float | None = None

    def __post_init__(self) -> None:
        """Refuse a period in which time stands or runs backwards.

        Raises:
            UsageError: it is one.
        """
        if self.period is not None and not 0.0 < self.period < inf:
            raise UsageError(f"--period: found {self.period:g} s. It must be longer than 0. Write, say, --period 1ms.")

    def of(self, file: str, column: Column) -> Target | None:
        """What was said of this column; of this file before all files."""
        keys = [(each, label) for each in (*names_of(file), "") for label in labels_of(column)]
        return next((self.columns[key] for key in keys if key in self.columns), None)

    def test_of(self, file: str) -> str | None:
        """The rig test that was said for this file."""
        return next((self.tests[each] for each in names_of(file) if each in self.tests), None)

    def refuse_unused(self, sheets: Iterable[Sheet]) -> None:
        """Refuse a column that no file has: a slip of the pen must not pass for an answer.

        Raises:
            UsageError: naming the columns that there are.
        """
        sheets = tuple(sheets)
        for file, label in self.columns:
            mine = [sheet for sheet in sheets if not file or file in names_of(sheet.file)]
            labels = {text: None for sheet in mine for c in sheet.columns for text in labels_of(c)}
            if label not in labels:
                there = ", ".join(f"'{c.label}'" for sheet in mine[:3] for c in sheet.columns[:20])
                raise UsageError(f"--column '{label}': no file has it. There are: {there}.")

    def accepting(self, keys: Iterable[str]) -> Answers:
        """With these guesses taken."""
        return replace(self, accepted=self.accepted | frozenset(keys))

    def with_column(self, file: str, label: str, target: Target) -> Answers:
        """With one column named."""
        return replace(self, columns={**self.columns, (file, label): target})

    def with_test(self, file: str, test: str) -> Answers:
        """With one file's rig test."""
        return replace(self, tests={**self.tests, file: test})


def labels_of(column: Column) -> tuple[str, ...]:
    """How the user may name a column: as it stands in the file, with or without its unit."""
    unit = column.unit or column.stated
    return column.label, column.name, f"{column.name} [{unit}]", f"{column.name} ({unit})"


def names_of(file: str) -> tuple[str, ...]:
    """How the user may name a file."""
    return file, Path(file).name, Path(file).stem


def parsed(columns: Sequence[str], tests: Sequence[str], files: Sequence[str], period: float | None = None) -> Answers:
    """The answers that options give.

    Args:
        columns: `HEADER=QUANTITY [UNIT]` or `FILE:HEADER=QUANTITY [UNIT]`.
        tests: `FILE=TEST`.
        files: that are imported.
        period: between the samples of a file without a time, s.
    Raises:
        UsageError: an option of another form, or a file, quantity or test that is none.
    """
    known = {name for file in files for name in names_of(file)}
    said = {key: wanted for key, wanted in (_column(text, known) for text in columns)}
    return Answers(said, dict(_test(text, known) for text in tests), frozenset(), period)


def _column(text: str, files: set[str]) -> tuple[tuple[str, str], Target]:
    header, equals, wanted = (part.strip() for part in text.rpartition("="))
    file, colon, rest = header.partition(":")
    if colon and file in files:
        return _column_key(file, rest, text, equals), target(wanted, f"--column '{text}'")
    return _column_key("", header, text, equals), target(wanted, f"--column '{text}'")


def _column_key(file: str, header: str, text: str, equals: str) -> tuple[str, str]:
    header = " ".join(header.split())
    if not equals or not header:
        raise UsageError(f"--column '{text}': no header and no =. Write 'HEADER=position [deg]', or 'HEADER=ignore'.")
    return file, header


def target(wanted: str, where: str) -> Target:
    """`position [deg]`, `position_deg`, `position` or `ignore`.

    Raises:
        UsageError: no quantity, or a unit that is not one of it.
    """
    wanted = " ".join(wanted.split())
    if wanted.casefold() in DROP:
        return Target(IGNORE)
    if wanted in QUANTITIES:
        return Target(wanted)
    slug = next((q for q in sorted(QUANTITIES, key=len, reverse=True) if wanted.startswith(f"{q}_")), None)
    if slug and re.fullmatch(r"[\w]+", wanted):
        unit = wanted.removeprefix(f"{slug}_")
        wanted = f"{slug} [{UNIT_SLUGS.get(unit, unit)}]"
    try:
        return Target(*parse_header(wanted))
    except HeaderError as err:
        raise UsageError(f"{where}: {err}") from None


def _test(text: str, files: set[str]) -> tuple[str, str]:
    file, equals, test = (part.strip() for part in text.rpartition("="))
    if not equals or file not in files:
        raise UsageError(f"--test '{text}': no such file among those to import. Write FILE=TEST, as 'a.csv=response'.")
    if test not in KNOWN_TESTS:
        known = f"Known: {', '.join(KNOWN_TESTS)}."
        raise UsageError(f"--test '{text}': '{test}' is no rig test. {closest(test, KNOWN_TESTS, known)}")
    return file, test
