"""Fields of settings with the range that each may have: a wrong value is refused where it is written.

@dataclass(frozen=True)
class LineSettings:
    rounds: int = whole(3, 1, 100)
    tolerance: float = real(1e-3, above=0.0, high=1.0)
    __post_init__ = check_ranges
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, TypeVar

from .errors import SettingsError

S = TypeVar("S")


@dataclass(frozen=True)
class Range:
    """Numbers from `low` to `high`; an infinite end is no bound."""

    # low, high: the ends
    low: float = -math.inf
    high: float = math.inf
    # open_low, open_high: whether the end itself is left out
    open_low: bool = False
    open_high: bool = False

    def __contains__(self, value: float) -> bool:
        """Whether a number lies in it: never NaN, never an infinite one."""
        over = self.low < value if self.open_low else self.low <= value
        under = value < self.high if self.open_high else value <= self.high
        try:
            return math.isfinite(value) and over and under
        except OverflowError:  # a whole number that no float can hold
            return False

    def __str__(self) -> str:
        """As an error message says it: "from 0 to 1", "1 or more", "greater than 0 and less than 1"."""
        if math.isfinite(self.low) and math.isfinite(self.high) and not (self.open_low or self.open_high):
            return f"from {self.low:g} to {self.high:g}"
        low = f"greater than {self.low:g}" if self.open_low else f"{self.low:g} or more"
        high = f"less than {self.high:g}" if self.open_high else f"{self.high:g} or less"
        ends = [words for words, end in ((low, self.low), (high, self.high)) if math.isfinite(end)]
        return " and ".join(ends) or "finite"


def whole(default: int, low: float = -math.inf, high: float = math.inf) -> Any:
    """A field that holds a whole number from `low` to `high`, both allowed."""
    return _field(default, "a whole number", Range(low, high))


def real(
    default: float,
    low: float = -math.inf,
    high: float = math.inf,
    *,
    above: float | None = None,
    below: float | None = None,
) -> Any:
    """A field that holds a finite number.

    Args:
        default: of the field.
        low, high: least and largest number allowed.
        above, below: in their place, numbers that are themselves not allowed.
    """
    left = low if above is None else above
    right = high if below is None else below
    return _field(default, "a number", Range(left, right, above is not None, below is not None))


def wholes(default: tuple[int, ...], low: float = -math.inf, high: float = math.inf) -> Any:
    """A field that holds a tuple of one or more whole numbers, each from `low` to `high`."""
    return _field(default, "a whole number", Range(low, high), many=True)


def reals(default: tuple[float, ...], low: float = -math.inf, high: float = math.inf) -> Any:
    """A field that holds a tuple of one or more finite numbers, each from `low` to `high`."""
    return _field(default, "a number", Range(low, high), many=True)


def _field(default: Any, kind: str, allowed: Range, many: bool = False) -> Any:
    return field(default=default, metadata={"kind": kind, "range": allowed, "many": many})


def check_ranges(settings: Any) -> None:
    """Refuse a value outside its field's range; the `__post_init__` of every settings object.

    Args:
        settings: a dataclass whose fields were made by the functions above, or hold settings themselves.
    Raises:
        SettingsError: names object and field, the value found, and what is allowed.
    """
    for each in fields(settings):
        value, allowed = getattr(settings, each.name), each.metadata
        if not allowed:
            continue
        many = allowed["many"]
        entries = value if many and isinstance(value, tuple) else (value,)
        if (many and not (isinstance(value, tuple) and value)) or not all(_inside(v, allowed) for v in entries):
            what = f"a tuple of one or more numbers, each {allowed['kind']}" if many else allowed["kind"]
            raise SettingsError(f"{type(settings).__name__}.{each.name} = {_shown(value)}: "
                                f"it must be {what}, {allowed['range']}.")  # fmt: skip


def _shown(value: Any) -> str:
    """As it was written, as far as that says anything."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of more digits than Python prints
        return f"a {type(value).__name__} of very many digits"
    return text if len(text) <= 80 else f"{text[:60]}... ({len(text)} characters)"


def _inside(value: Any, allowed: Mapping[str, Any]) -> bool:
    kinds = int if allowed["kind"] == "a whole number" else (int, float)
    return not isinstance(value, bool) and isinstance(value, kinds) and value in allowed["range"]


def from_json(kind: type[S], written: Mapping[str, Any]) -> S:
    """The settings object that a run folder's JSON file holds as `written`.

    Args:
        kind: its class; settings within it are made likewise.
        written: field -> value; a field that is not there has its default, so that older files can be read.
    Raises:
        ValueError: a field that `kind` does not have, or a value outside its range.
    """
    known = {each.name: each for each in fields(kind)}  # type: ignore[arg-type]
    if unknown := sorted(set(written) - set(known)):
        raise ValueError(f"{kind.__name__} has no field {', '.join(unknown)}. It has: {', '.join(known)}.")
    return kind(**{name: _of_json(getattr(kind(), name), value) for name, value in written.items()})


def _of_json(default: Any, value: Any) -> Any:
    """A value of the type that the default has: JSON has lists for tuples, and may have 1 for 1.0."""
    if is_dataclass(default) and not isinstance(default, type):
        return from_json(type(default), value)
    if isinstance(default, tuple):
        return tuple(_of_json(default[0], v) for v in value)
    return float(value) if isinstance(default, float) and isinstance(value, int) else value
