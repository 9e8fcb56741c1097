"""A figure of a result is declared once: unit, name and meaning stand on its field, and every view reads them there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Figure:
    """A figure of a result.

    Args:
        symbol: name of the field, and key in JSON; it ends in the unit.
        unit: as people read it, "" for none.
        name: in a few words, as it stands in a sentence.
        meaning: one sentence for whoever reads JSON or the reference.
        heading: over its column in a table; empty: it is told in a sentence below the table.
        limit: that it must stay below where nothing else is required; infinite for none.
        how: what the class that declares it needs to compute it.
    """

    symbol: str
    unit: str
    name: str
    meaning: str
    heading: str = ""
    limit: float = math.inf
    how: Mapping[str, Any] = field(default_factory=dict)


def figure(unit: str, name: str, meaning: str, heading: str = "", limit: float = math.inf, **how: Any) -> Any:
    """Declare a field of a result to be a figure; None where it is not known.

    Args:
        unit, name, meaning, heading, limit, how: see `Figure`. The symbol is the field's name.
    """
    return field(default=None, metadata={"figure": (unit, name, meaning, heading, limit, how)})


def figures_of(result: Any) -> dict[str, Figure]:
    """The figures that a result, or its class, declares, by symbol, in the order of its fields."""
    return {f.name: Figure(f.name, *f.metadata["figure"]) for f in dataclasses.fields(result) if "figure" in f.metadata}
