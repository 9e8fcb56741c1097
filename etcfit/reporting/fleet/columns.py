"""units.parquet as arrays, a column a symbol: what pictures and page draw from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

NUMBERS = ("value", "stderr", "low", "high", "shrunk_value", "shrunk_stderr")


@dataclass(frozen=True, eq=False)
class SymbolColumns:
    """One symbol in every unit, NaN where a unit has nothing of it.

    Args:
        numbers: by the table's column, SI, shape (units,) each.
        status: places in `statuses`, shape (units,); -1 where the unit has no such symbol.
        statuses: names.
    """

    numbers: Mapping[str, np.ndarray]
    status: np.ndarray
    statuses: tuple[str, ...]

    def __getitem__(self, column: str) -> np.ndarray:
        return self.numbers[column]


@dataclass(frozen=True, eq=False)
class Columns:
    """Every symbol in every unit.

    Args:
        units: names, in the order of fleet.json.
        symbols: by name.
    """

    units: tuple[str, ...]
    symbols: Mapping[str, SymbolColumns] = field(default_factory=dict)

    @classmethod
    def of(cls, names: Sequence[str], units: pd.DataFrame) -> Columns:
        """The table's rows put in the order of `names`; rows of other units are left out.

        Args:
            names: of the units, as fleet.json has them.
            units: units.parquet.
        """
        found = {str(symbol): _columns(names, rows) for symbol, rows in units.groupby("symbol", sort=False)}
        return cls(tuple(names), found)

    def place(self) -> dict[str, int]:
        """Of each unit, by name."""
        return {name: k for k, name in enumerate(self.units)}


def _columns(names: Sequence[str], rows: Any) -> SymbolColumns:
    from pandas import Categorical

    aligned = rows.drop_duplicates("unit").set_index("unit").reindex(list(names))
    status = Categorical(aligned["status"])
    numbers = {column: aligned[column].to_numpy(dtype=float, na_value=np.nan) for column in NUMBERS}
    return SymbolColumns(numbers, np.asarray(status.codes, dtype=int), tuple(map(str, status.categories)))
