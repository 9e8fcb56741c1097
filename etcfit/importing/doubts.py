"""Guesses that somebody should confirm, each with what settles it."""

from __future__ import annotations

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ..errors import MeasurementError, UsageError
from ..rig.reader import KNOWN_TESTS
from .answers import Answers, parsed, target


@dataclass(frozen=True)
class AbstractDoubt(abc.ABC):
    """One guess.

    Args:
        where: file, and column if it is about one.
        taken: the guess.
        reason: in words.
    """

    where: str
    taken: str
    reason: str

    @property
    def key(self) -> str:
        """By which it is recognised when the guesses are made anew."""
        return f"{self.where}: {self.taken}"

    @property
    @abc.abstractmethod
    def mend(self) -> str:
        """The option that settles it."""

    @property
    @abc.abstractmethod
    def choices(self) -> str:
        """What an answer may be, in a few words."""

    def accepted(self, answers: Answers) -> Answers:
        """The answers with this guess taken.

        Raises:
            UsageError: there is none.
        """
        if not self.taken:
            raise UsageError(f"{self.where}: there is no guess to take. Name {self.choices}.")
        return answers.accepting([self.key])

    @abc.abstractmethod
    def answered(self, text: str, answers: Answers) -> Answers:
        """The answers with this one.

        Raises:
            UsageError: the text is none.
        """


@dataclass(frozen=True)
class ColumnDoubt(AbstractDoubt):
    """What a column is.

    Args:
        file, label: of the column.
    """

    file: str
    label: str

    @property
    def mend(self) -> str:
        wanted = "position [deg]" if self.taken == "left out" else self.taken
        return f"--column '{self.label}={wanted}'"

    @property
    def choices(self) -> str:
        return "QUANTITY [UNIT], or ignore"

    def answered(self, text: str, answers: Answers) -> Answers:
        return answers.with_column(self.file, self.label, target(text, self.where))


@dataclass(frozen=True)
class TestDoubt(AbstractDoubt):
    """Which rig test a file shows.

    Args:
        file: as the user gave it.
    """

    __test__ = False  # no test of pytest's
    file: str

    @property
    def mend(self) -> str:
        return f"--test '{self.file}={self.taken or 'response'}'"

    @property
    def choices(self) -> str:
        return f"one of {', '.join(KNOWN_TESTS)}"

    def answered(self, text: str, answers: Answers) -> Answers:
        said = parsed([], [f"{self.file}={text}"], [self.file])
        return answers.with_test(self.file, said.tests[self.file])


class _NoOtherAnswer(AbstractDoubt):
    """A doubt whose guess is taken, or nothing is."""

    def answered(self, text: str, answers: Answers) -> Answers:
        raise refused([self])


@dataclass(frozen=True)
class RigDoubt(_NoOtherAnswer):
    """What a nameplate should say: sensor or travel."""

    @property
    def mend(self) -> str:
        return "--rig RIG.TOML, a rig.toml that says it (make one with `etcfit new`)"

    @property
    def choices(self) -> str:
        return "Enter takes it, anything else stops"


@dataclass(frozen=True)
class LossDoubt(_NoOtherAnswer):
    """Whether what is left of a damaged file is enough."""

    @property
    def mend(self) -> str:
        return "a whole copy of the file"

    @property
    def choices(self) -> str:
        return "Enter takes what is there, anything else stops"


Resolve = Callable[[Sequence[AbstractDoubt], Answers], Answers]


def accept_all(doubts: Sequence[AbstractDoubt], answers: Answers) -> Answers:
    """Every guess is taken, but for a file of which nothing says what test it is.

    Raises:
        MeasurementError: there is one.
    """
    if without := [doubt for doubt in doubts if not doubt.taken]:
        raise refused(without)
    return answers.accepting(doubt.key for doubt in doubts)


def refuse(doubts: Sequence[AbstractDoubt], answers: Answers) -> Answers:
    """Nobody is there to ask.

    Raises:
        MeasurementError: always, naming each doubt and what settles it.
    """
    raise refused(doubts)


def refused(doubts: Sequence[AbstractDoubt]) -> MeasurementError:
    """The message on the first doubt, the others listed."""
    first, others = doubts[0], doubts[1:]
    more = "".join(f"\n  {each.where}: {each.taken}? ({each.reason}.) {each.mend}" for each in others)
    listed = f"\n{len(others)} more to settle:{more}" if others else ""
    guess = f"taken as {first.taken}, but that is in doubt" if first.taken else "nothing says what it is"
    every = "--yes takes every guess, or settle it" if first.taken else "Settle it"
    return MeasurementError(first.where, f"{guess}: {first.reason}.", "A guess in doubt needs a word from you.",
                            f"{every} with {first.mend}.{listed}")  # fmt: skip
