"""The user's answers about columns and files, from options or on a terminal; and the doubtful guesses that the user
should confirm, each with the option that settles it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path

from ..errors import MeasurementError, UsageError
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
    """The meaning that the user gives a column."""

    quantity: str  # IGNORE: the column is left out
    unit: str = ""  # "": the file's unit is right


@dataclass(frozen=True)
class Answers:
    """All answers of the user.

    Raises:
        UsageError: a period that is not positive.
    """

    # (file or "" for all, label or name of the column) -> its meaning
    columns: Mapping[tuple[str, str], Target] = field(default_factory=dict)
    tests: Mapping[str, str] = field(default_factory=dict)  # file -> rig test
    accepted: frozenset[str] = frozenset()  # keys of doubts whose guess was accepted
    period: float | None = None  # sampling period of a file without a time, s; None if not given

    def __post_init__(self) -> None:
        if self.period is not None and not 0.0 < self.period < inf:
            raise UsageError(f"--period: found {self.period:g} s. It must be longer than 0. Write, say, --period 1ms.")

    def wanted(self, file: str, column: Column) -> Target | None:
        """The answer for this column; an answer for this file takes precedence over one for all files."""
        keys = [(each, label) for each in (*_names_of(file), "") for label in _labels_of(column)]
        return next((self.columns[key] for key in keys if key in self.columns), None)

    def test_of(self, file: str) -> str | None:
        """The rig test that the user gave for this file."""
        return next((self.tests[each] for each in _names_of(file) if each in self.tests), None)

    def refuse_unused(self, sheets: Sequence[Sheet]) -> None:
        """Refuse an answer for a column that no file has, such as a misspelt one.

        Raises:
            UsageError: with the names of the existing columns.
        """
        for file, label in self.columns:
            mine = [sheet for sheet in sheets if not file or file in _names_of(sheet.file)]
            if not any(label in _labels_of(c) for sheet in mine for c in sheet.columns):
                there = ", ".join(f"'{c.label}'" for sheet in mine[:3] for c in sheet.columns[:20])
                raise UsageError(f"--column '{label}': no file has it. There are: {there}.")

    def options(self, of_files: bool) -> list[str]:
        """The answers about columns as options, in the form for `parsed`.

        Args:
            of_files: include answers for the columns of single files.
        """
        said = [(f"{file}:{label}" if file else label, wanted) for (file, label), wanted in self.columns.items()
                if of_files or not file]  # fmt: skip
        return [f"{place}={to.quantity}" + (f" [{to.unit}]" if to.unit else "") for place, to in said]

    def accepting(self, keys: Iterable[str]) -> Answers:
        """The answers with these guesses accepted."""
        return replace(self, accepted=self.accepted | frozenset(keys))


def _labels_of(column: Column) -> tuple[str, ...]:
    """Names that the user may use for a column: that in the file, with or without its unit."""
    unit = column.unit or column.stated
    return column.label, column.name, f"{column.name} [{unit}]", f"{column.name} ({unit})"


def _names_of(file: str) -> tuple[str, ...]:
    """Names that the user may use for a file."""
    return file, Path(file).name, Path(file).stem


def parsed(columns: Sequence[str], tests: Sequence[str], files: Sequence[str], period: float | None = None) -> Answers:
    """The answers from options.

    Args:
        columns: `HEADER=QUANTITY [UNIT]` or `FILE:HEADER=QUANTITY [UNIT]`.
        tests: `FILE=TEST`.
        period: sampling period of a file without a time, s.
    Raises:
        UsageError: an option in another form, or an unknown file, quantity or test.
    """
    known = {name for file in files for name in _names_of(file)}
    return Answers(
        dict(_column(text, known) for text in columns), dict(_test(text, known) for text in tests), period=period
    )


def _column(text: str, files: set[str]) -> tuple[tuple[str, str], Target]:
    header, equals, wanted = (part.strip() for part in text.rpartition("="))
    file, colon, rest = header.partition(":")
    file, header = (file, rest) if colon and file in files else ("", header)
    header = " ".join(header.split())
    if not equals or not header:
        raise UsageError(f"--column '{text}': no header and no =. Write 'HEADER=position [deg]', or 'HEADER=ignore'.")
    return (file, header), target(wanted, f"--column '{text}'")


def target(wanted: str, where: str) -> Target:
    """`position [deg]`, `position_deg`, `position` or `ignore`.

    Raises:
        UsageError: an unknown quantity, or a unit of another quantity.
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


@dataclass(frozen=True)
class Doubt:
    """A guess that the user should confirm."""

    where: str  # file, and column if it is about one
    taken: str  # the guess; "" if there is none
    reason: str  # the reason in words
    mend: str  # the option that settles it
    choices: str  # possible answers, in a few words
    # adds a text as the answer, or raises a UsageError; None if only the guess can be accepted
    answer: Callable[[str, Answers], Answers] | None = None

    @property
    def key(self) -> str:
        """Identifies the doubt when the guesses are made again."""
        return f"{self.where}: {self.taken}"

    def accepted(self, answers: Answers) -> Answers:
        """The answers with this guess accepted.

        Raises:
            UsageError: there is no guess.
        """
        if not self.taken:
            raise UsageError(f"{self.where}: there is no guess to take. Name {self.choices}.")
        return answers.accepting([self.key])

    def answered(self, text: str, answers: Answers) -> Answers:
        """The answers with this answer added.

        Raises:
            UsageError: the text is no valid answer.
            MeasurementError: only the guess could be accepted.
        """
        if self.answer is None:
            raise refused([self])
        return self.answer(text, answers)


def column_doubt(sheet: Sheet, label: str, taken: str, reason: str) -> Doubt:
    """The doubt about the meaning of a column."""
    where = f"{sheet.where}, column '{label}'"

    def answer(text: str, answers: Answers) -> Answers:
        return replace(answers, columns={**answers.columns, (sheet.file, label): target(text, where)})

    wanted = "position [deg]" if taken == "left out" else taken
    return Doubt(where, taken, reason, f"--column '{label}={wanted}'", "QUANTITY [UNIT], or ignore", answer)


def rig_test_doubt(sheet: Sheet, taken: str, reason: str) -> Doubt:
    """The doubt about the rig test of a file."""
    file = sheet.file

    def answer(text: str, answers: Answers) -> Answers:
        return replace(answers, tests={**answers.tests, **parsed([], [f"{file}={text}"], [file]).tests})

    mend = f"--test '{file}={taken or 'response'}'"
    return Doubt(sheet.where, taken, reason, mend, f"one of {', '.join(KNOWN_TESTS)}", answer)


def rig_doubt(taken: str, reason: str) -> Doubt:
    """The doubt about the nameplate: sensor or travel."""
    mend = "--rig RIG.TOML, a rig.toml that says it (make one with `etcfit new`)"
    return Doubt("rig.toml", taken, reason, mend, "Enter takes it, anything else stops")


def loss_doubt(sheet: Sheet) -> Doubt:
    """The doubt whether the rest of a damaged file is enough: it may lack what distinguishes one rig test from
    another."""
    taken, reason = f"{sheet.rows} whole rows of {len(sheet.columns)} columns", "; ".join(sheet.missing)
    return Doubt(sheet.where, taken, reason, "a whole copy of the file",
                 "Enter takes what is there, anything else stops")  # fmt: skip


Resolve = Callable[[Sequence[Doubt], Answers], Answers]


def accept_all(doubts: Sequence[Doubt], answers: Answers) -> Answers:
    """Accept every guess, but refuse a file without any guess for its test.

    Raises:
        MeasurementError: there is such a file.
    """
    if without := [doubt for doubt in doubts if not doubt.taken]:
        raise refused(without)
    return answers.accepting(doubt.key for doubt in doubts)


def refuse(doubts: Sequence[Doubt], answers: Answers) -> Answers:
    """Refuse all doubts, if no user can be asked.

    Raises:
        MeasurementError: always, with each doubt and the option that settles it.
    """
    raise refused(doubts)


def refused(doubts: Sequence[Doubt]) -> MeasurementError:
    """The error for the first doubt, with a list of the others."""
    first, others = doubts[0], doubts[1:]
    more = "".join(f"\n  {each.where}: {each.taken}? ({each.reason}.) {each.mend}" for each in others)
    listed = f"\n{len(others)} more to settle:{more}" if others else ""
    guess = f"taken as {first.taken}, but that is in doubt" if first.taken else "nothing says what it is"
    every = "--yes takes every guess, or settle it" if first.taken else "Settle it"
    return MeasurementError(first.where, f"{guess}: {first.reason}.", "A guess in doubt needs a word from you.",
                            f"{every} with {first.mend}.{listed}")  # fmt: skip
