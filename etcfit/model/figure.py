"""Declaration of a figure of a result: its field has unit, name and meaning, and every view reads them there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A figure of a result."""

    symbol: str  # name of the field, and key in JSON; it ends in the unit
    unit: str  # unit for readers, "" for none
    name: str  # a few words for use in a sentence
    meaning: str  # one sentence for readers of JSON or the reference
    heading: str = ""  # heading of its column in a table; empty: a sentence below the table states it
    limit: float = math.inf  # default upper limit; infinite for none
    how: Mapping[str, Any] = field(default_factory=dict)  # further data with which the declaring class computes it


def figure(unit: str, name: str, meaning: str, heading: str = "", limit: float = math.inf, **how: Any) -> Any:
    """Declare a field of a result to be a figure; its value is None if it is not known.

    Args:
        unit, name, meaning, heading, limit, how: see `Figure`. The symbol is the field's name.
    """
    return field(default=None, metadata={"figure": (unit, name, meaning, heading, limit, how)})


def figures_of(result: Any) -> dict[str, Figure]:
    """The figures that a result, or its class, declares, by symbol, in the order of its fields."""
    return {f.name: Figure(f.name, *f.metadata["figure"]) for f in dataclasses.fields(result) if "figure" in f.metadata}
