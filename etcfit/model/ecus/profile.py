"""One make of engine computer: its controller, and how its gains and limits are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from ..ecu import Ecu, Notation
from ..feed_forward import Term


class Limit(NamedTuple):
    """A setting of an ECU in addition to its gains.

    Args:
        name: its name in the ECU's own program.
        unit: unit of its value.
        value: function of the controller to be tuned and the plate's travel (rad): the setting with which the ECU is
            that controller.
    """

    name: str
    unit: str
    value: Callable[[Ecu, float], float]


@dataclass(frozen=True)
class BiasTable:
    """Feed-forward as an ECU has it: % of duty over % of target position, linear between points.

    Args:
        bins, values: the ECU's names of the two rows.
        points: number of points.
        positions: number of positions that a bin can have, evenly spaced over the travel, with both ends.
        decimals: number of decimals of a duty in %.
    """

    bins: str
    values: str
    points: int = 8
    positions: int = 20_001
    decimals: int = 2


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

    Args:
        name: name for `--ecu`.
        title: name in tables.
        source: source of this profile.
        notation: how it writes gains; None if that is not published: gains are then multiples of the user's.
        gains: its names of P, I and D.
        fixes: values that the source fixes, by field of `Ecu`.
        assumes: values assumed because the maker publishes nothing, by field of `Ecu`.
        assumed: these and all other assumptions in words.
        limits: its settings in addition to the gains.
        bias: its table of feed-forward; None if it has none.
        code: terms of feed-forward that its user can add to the output in code, in addition to that table.
        scheduling: whether its gains can follow the supply, according to `source`.
        pasting: how settings are entered into it.
        jam: its names of error (%) and timeout (s) of its jam check; None if not known.
    """

    name: str
    title: str
    source: str
    notation: Notation | None
    gains: tuple[str, str, str]
    fixes: Mapping[str, float]
    assumes: Mapping[str, float] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()
    limits: tuple[Limit, ...] = ()
    bias: BiasTable | None = None
    code: tuple[Term, ...] = ()
    scheduling: Scheduling = Scheduling.UNKNOWN
    pasting: Pasting = Pasting.BY_HAND
    jam: tuple[str, str] | None = None

    @property
    def terms(self) -> tuple[Term, ...]:
        """Terms of feed-forward that this controller can have."""
        return (*((Term.SPRING,) if self.bias is not None else ()), *self.code)

    def clashes(self, given: Mapping[str, float]) -> tuple[str, ...]:
        """Given fields that its source fixes at another value."""
        return tuple(name for name, value in given.items() if abs(self.fixes.get(name, value) - value) > 1e-9)

    def completed(self, given: Mapping[str, float]) -> dict[str, float]:
        """Values by field of `Ecu`: fixed, given, and assumed ones."""
        return {**self.assumes, **given, **self.fixes}


def differences(ecu: Ecu, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Fields in which an ECU differs from one whose source fixes some."""
    return tuple(name for name, value in fixed.items() if abs(getattr(ecu, name) - value) > 1e-9)
