"""Fields of a settings object with the range each may have, so that a wrong one is refused where it is written.

@dataclass(frozen=True)
class LineSettings:
    rounds: int = whole(3, 1, 100)
    tolerance: float = real(1e-3, 0.0, 1.0)
    __post_init__ = check_ranges
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, fields, is_dataclass
from typing import Any, TypeVar

S = TypeVar("S")


def whole(default: int, low: int, high: int) -> Any:
    """A field that holds a whole number from `low` to `high`, both allowed."""
    return field(default=default, metadata={"kind": "a whole number", "low": low, "high": high})


def real(default: float, low: float, high: float) -> Any:
    """A field that holds a finite number from `low` to `high`, both allowed."""
    return field(default=default, metadata={"kind": "a number", "low": low, "high": high})


def wholes(default: tuple[int, ...], low: int, high: int) -> Any:
    """A field that holds one or more whole numbers, each from `low` to `high`."""
    return field(default=default, metadata={"kind": "a whole number", "low": low, "high": high, "many": True})


def reals(default: tuple[float, ...], low: float, high: float) -> Any:
    """A field that holds one or more finite numbers, each from `low` to `high`."""
    return field(default=default, metadata={"kind": "a number", "low": low, "high": high, "many": True})


def check_ranges(settings: Any) -> None:
    """Refuse a value outside its field's range; the `__post_init__` of every settings object.

    Args:
        settings: a dataclass whose fields were made by the functions above, or hold settings themselves.
    Raises:
        ValueError: names object and field, the value found, and what is allowed.
    """
    for each in fields(settings):
        value, allowed = getattr(settings, each.name), each.metadata
        if not allowed:
            continue
        many = allowed.get("many", False)
        entries = value if many and isinstance(value, tuple) else (value,)
        if (many and not (isinstance(value, tuple) and value)) or not all(_inside(v, allowed) for v in entries):
            what = f"a tuple of one or more numbers, each {allowed['kind']}" if many else allowed["kind"]
            raise ValueError(f"{type(settings).__name__}.{each.name} = {value!r}: "
                             f"it must be {what} from {allowed['low']:g} to {allowed['high']:g}.")  # fmt: skip


def _inside(value: Any, allowed: Mapping[str, Any]) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    if allowed["kind"] == "a whole number" and not isinstance(value, int):
        return False
    return math.isfinite(value) and allowed["low"] <= value <= allowed["high"]


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
