"""One make of engine computer: its controller, and how its gains and limits are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from ...errors import UsageError
from ..ecu import Ecu, Notation
from ..feed_forward import Term


class Limit(NamedTuple):
    """A setting of an ECU in addition to its gains."""

    name: str  # its name in the ECU's own program
    unit: str  # unit of its value
    # function of the controller to be tuned and the plate's travel (rad): the setting with which the ECU is that
    # controller
    value: Callable[[Ecu, float], float]


@dataclass(frozen=True)
class BiasTable:
    """Feed-forward as an ECU has it: % of duty over % of target position, linear between points."""

    # bins, values: the ECU's names of the two rows
    bins: str
    values: str
    points: int = 8  # number of points
    positions: int = 20_001  # number of positions that a bin can have, evenly spaced over the travel, with both ends
    decimals: int = 2  # number of decimals of a duty in %


class Pasting(Enum):
    """How settings are entered into the ECU."""

    TUNE_FILE = "lines of its tune file (.msq)"
    BY_HAND = "settings to type in"


class Scheduling(Enum):
    """Whether the gains of an ECU can follow the supply."""

    TABLE = "tables of gains over the supply"
    CODE = "gains that code of yours can set at run time"
    NONE = "one number for each gain"
    UNKNOWN = "no known table of gains"


NOT_DIVIDED = "no division by the battery voltage; say --divides-by-battery if yours does"


@dataclass(frozen=True)
class EcuProfile:
    """One make of engine computer: a constant in a file of this folder, and one line in `ecus/__init__.py`.

    A field of `Ecu` is known from the source (`fixes`), or assumed because the maker publishes nothing (`assumes`), or
    left to the user: clock, delay and filter of a closed ECU come from the options and [ecu] of rig.toml, else they
        have
    their defaults. `assumed` states the assumptions in words, which the table and pid.json show.
    """

    name: str  # name for `--ecu`
    title: str  # name in tables
    source: str  # source of this profile
    # how it writes gains; None if that is not published: gains are then multiples of the user's
    notation: Notation | None
    gains: tuple[str, str, str]  # its names of P, I and D
    fixes: Mapping[str, float]  # values that the source fixes, by field of `Ecu`
    # values assumed because the maker publishes nothing, by field of `Ecu`
    assumes: Mapping[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()  # these and all other assumptions in words
    limits: tuple[Limit, ...] = ()  # its settings in addition to the gains
    bias: BiasTable | None = None  # its table of feed-forward; None if it has none
    # terms of feed-forward that its user can add to the output in code, in addition to that table
    code: tuple[Term, ...] = ()
    scheduling: Scheduling = Scheduling.UNKNOWN  # whether its gains can follow the supply, according to `source`
    pasting: Pasting = Pasting.BY_HAND  # how settings are entered into it
    jam: tuple[str, str] | None = None  # its names of error (%) and timeout (s) of its jam check; None if not known

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of feed-forward that this controller can have."""
        return (*((Term.SPRING,) if self.bias is not None else ()), *self.code)

    def clashes(self, given: Mapping[str, float]) -> tuple[str, ...]:
        """Given fields that its source fixes at another value."""
        return tuple(name for name, value in given.items() if abs(self.fixes.get(name, value) - value) > 1e-9)

    def completed(self, given: Mapping[str, float]) -> dict[str, float]:
        """Values by field of `Ecu`: fixed, given, and assumed ones.

        Raises:
            UsageError: a given field that its source fixes at another value.
        """
        if clash := self.clashes(given):
            raise UsageError(f"{clash[0]}: {self.title} fixes it at {self.fixes[clash[0]]:g}. Leave it out.")
        return {**self.assumes, **given, **self.fixes}


def differences(ecu: Ecu, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Fields in which an ECU differs from one whose source fixes some."""
    return tuple(name for name, value in fixed.items() if abs(getattr(ecu, name) - value) > 1e-9)
