"""What is known of one make of engine computer: the controller in it, and how its gains and limits are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from ..ecu import Ecu, Notation
from ..feed_forward import Term


class Limit(NamedTuple):
    """A setting of an ECU beside its gains.

    Args:
        name: as the ECU's own program calls it.
        unit: of its value.
        value: from the controller that gains are sought for and the plate's travel (rad); what makes the ECU that one.
    """

    name: str
    unit: str
    value: Callable[[Ecu, float], float]


@dataclass(frozen=True)
class BiasTable:
    """Feed-forward as an ECU has it: % of duty over % of target position, linear between points.

    Args:
        bins, values: what the ECU calls the two rows.
        points: how many.
        positions: places that a bin can name, evenly over the travel, both ends among them.
        decimals: of a duty, %.
    """

    bins: str
    values: str
    points: int = 8
    positions: int = 20_001
    decimals: int = 2


class Pasting(Enum):
    """How settings come into the ECU."""

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
    """One make of engine computer: a constant in a file beside this one, and one line in `ecus/__init__.py`.

    A field of `Ecu` is known from the source (`fixes`), or the maker publishes nothing and it is taken to be something
    (`assumes`), or it is left to the user: clock, delay and filter of a closed ECU are what the options and [ecu] of
    rig.toml say, else by default. What is taken without a source is said in words (`assumed`), which reach the table
    and pid.json.

    Args:
        name: of `--ecu`.
        title: of tables.
        source: what all this is taken from.
        notation: how it writes gains; None where that is not published: they are shares of the user's then.
        gains: what it calls P, I and D.
        fixes: by field of `Ecu`, what the source fixes.
        assumes: by field of `Ecu`, what is taken where the maker publishes nothing.
        assumed: the same in words, and whatever else is taken without a source.
        limits: its settings beside the gains.
        bias: its table of feed-forward; None where it has none.
        code: terms of feed-forward that its user adds to the output in code of his own, besides that table.
        scheduling: whether its gains can follow the supply, by what `source` says.
        pasting: how the settings come into it.
        jam: what it calls error (%) and timeout (s) of its jam check; None where that is not known.
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
        """Of feed-forward that this controller can have."""
        return (*((Term.SPRING,) if self.bias is not None else ()), *self.code)

    def clashes(self, given: Mapping[str, float]) -> tuple[str, ...]:
        """Fields given that its source fixes at something else."""
        return tuple(name for name, value in given.items() if abs(self.fixes.get(name, value) - value) > 1e-9)

    def completed(self, given: Mapping[str, float]) -> dict[str, float]:
        """By field of `Ecu`: what it fixes, what is given, and what is assumed of the rest."""
        return {**self.assumes, **given, **self.fixes}


def differences(ecu: Ecu, fixed: Mapping[str, float]) -> tuple[str, ...]:
    """Fields in which an ECU differs from one whose source fixes some."""
    return tuple(name for name, value in fixed.items() if abs(getattr(ecu, name) - value) > 1e-9)
