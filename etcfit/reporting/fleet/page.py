"""RUN/fleet.html: one self-contained interactive page with all results of a fleet, up to ten thousand units.

The page contains a fleet as one JSON object: units are numbers, their values are packed arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...files import plain, write_text
from ...fleets.config import ZERO_CELSIUS
from .. import html, packed
from ..html import Parts, scripted
from . import TABLES, Content, title, verdict

if TYPE_CHECKING:
    import pandas as pd


NUMBERS = ("value", "stderr", "low", "high", "shrunk_value", "shrunk_stderr")


@dataclass(frozen=True, eq=False)
class SymbolColumns:
    """One symbol in every unit, NaN for units without it."""

    numbers: Mapping[str, np.ndarray]  # numbers by the table's column, SI, shape (units,) each
    status: np.ndarray  # indices into `statuses`, shape (units,); -1 if the unit has no such symbol
    statuses: tuple[str, ...]  # names

    def __getitem__(self, column: str) -> np.ndarray:
        return self.numbers[column]


@dataclass(frozen=True, eq=False)
class Columns:
    """Every symbol in every unit."""

    units: tuple[str, ...]  # names, in the order of fleet.json
    symbols: Mapping[str, SymbolColumns] = field(default_factory=dict)  # symbols by name

    @classmethod
    def of_units(cls, names: Sequence[str], units: pd.DataFrame) -> Columns:
        """Rows of units.parquet in the order of `names`, those of fleet.json; rows of other units are left out."""
        found = {str(symbol): _columns(names, rows) for symbol, rows in units.groupby("symbol", sort=False)}
        return cls(tuple(names), found)

    def place(self) -> dict[str, int]:
        """Values of each unit, by name."""
        return {name: k for k, name in enumerate(self.units)}


def _columns(names: Sequence[str], rows: Any) -> SymbolColumns:
    from pandas import Categorical

    aligned = rows.drop_duplicates("unit").set_index("unit").reindex(list(names))
    status = Categorical(aligned["status"])
    numbers = {column: aligned[column].to_numpy(dtype=float, na_value=np.nan) for column in NUMBERS}
    return SymbolColumns(numbers, np.asarray(status.codes, dtype=int), tuple(map(str, status.categories)))


GROUPS = ("batch", "rig", "operator", "part", "date")  # properties that many units share
_CARRIED = ("value", "low", "high", "shrunk_value", "shrunk_stderr")
_OWN = ("serial", "chi2_per_dof")
_MIDNIGHT = "T00:00:00"  # time of a date without a time


def carried(content: Content, units: pd.DataFrame) -> dict[str, Any]:
    """The data for the scripts, from fleet.json and units.parquet."""
    columns = Columns.of_units(content.get("units") or (), units)
    place, members = columns.place(), content.get("members") or {}
    kelvin = [_of(members, unit, "temperature") for unit in columns.units]
    celsius = [None if each is None else each - ZERO_CELSIUS for each in kelvin]
    return plain({
        "schema": "etcfit.fleet_page/1",
        "name": title(content),
        "units": columns.units,
        "groups": {name: _group([_of(members, unit, name) for unit in columns.units]) for name in GROUPS},
        "temperature": _own(celsius),
        **{name: _own([_of(members, unit, name) for unit in columns.units]) for name in _OWN},
        "stuck": [k for unit, k in place.items() if _of(members, unit, "converged") is False],
        "pages": {k: page for unit, k in place.items() if (page := _of(members, unit, "page"))},
        "symbols": [_symbol(content, name, each) for name, each in columns.symbols.items()],
        "correlation": content.get("correlation"),
        "odd": [{**each, "unit": place[each["unit"]]} for each in content.get("odd") or () if each["unit"] in place],
        "effects": [_effect(name, each, place) for name, each in (content.get("effects") or {}).items()],
        **_charts(content, place),
        "figures": [_figure(content, name, each, place) for name, each in (content.get("figures") or {}).items()],
    })  # fmt: skip


def _of(members: Mapping[str, Any], unit: str, key: str) -> Any:
    found = (members.get(unit) or {}).get(key)
    return found.removesuffix(_MIDNIGHT) if key == "date" and found is not None else found


def _group(values: Sequence[Any]) -> dict[str, Any] | None:
    """The different names, and for each unit an index into them, -1 for none; None if no unit has any."""
    names = sorted({str(each) for each in values if each is not None})
    where = {name: k for k, name in enumerate(names)}
    codes = [-1 if each is None else where[str(each)] for each in values]
    return {"names": names, "of": packed.codes(codes)} if names else None


def _own(values: Sequence[Any]) -> Any:
    """Text unchanged, figures packed; None if no unit has any."""
    if all(each is None for each in values):
        return None
    if any(isinstance(each, str) for each in values):
        return ["" if each is None else str(each) for each in values]
    return packed.numbers(packed.with_nan(values))


def limits_of(content: Content, name: str) -> tuple[float | None, float | None]:
    """The specification's limits of a symbol or figure, SI; None without limits."""
    found = (content.get("capability") or {}).get(name) or {}
    return found.get("low"), found.get("high")


def _symbol(content: Content, name: str, each: SymbolColumns) -> dict[str, Any]:
    known = (content.get("population") or {}).get(name) or {}
    kept = {column: packed.numbers(each[column]) for column in _CARRIED}
    other = {int(k): each.statuses[each.status[k]] for k in np.flatnonzero(each.status >= 0)
             if each.statuses[each.status[k]] != "estimated"}  # fmt: skip
    return {
        "symbol": name,
        "unit": known.get("unit", ""),
        "mean": known.get("mean"),
        "sd": known.get("sd"),
        "shared": known.get("shared", False),
        "limits": limits_of(content, name),
        "known": bool(known),
        "status": other,
        **kept,
    }


def _effect(name: str, each: Mapping[str, Any], place: Mapping[str, int]) -> dict[str, Any]:
    units = sorted((unit for unit in each["units"] if unit in place), key=lambda unit: place[unit])
    strength = [(each.get("strength") or {}).get(unit) for unit in units]
    return {
        "name": name,
        **{key: each.get(key) for key in ("of", "median", "unit", "symbol")},
        "at": packed.codes([place[unit] for unit in units]),
        "strength": packed.numbers(packed.with_nan(strength)),
    }


def _charts(content: Content, place: Mapping[str, int]) -> dict[str, Any]:
    """Charts, and their orders of units, each once: most charts have the same order."""
    orders: dict[tuple[str, ...], int] = {}
    charts = [_chart(content, symbol, each, place, orders) for symbol, each in (content.get("charts") or {}).items()]
    known = [packed.codes([place[unit] for unit in order if unit in place]) for order in orders]
    return {"charts": charts, "orders": known}


def _chart(
    content: Content, symbol: str, each: Mapping[str, Any], place: Mapping[str, int], orders: dict[tuple[str, ...], int]
) -> dict[str, Any]:
    kept = np.array([unit in place for unit in each["order"]], dtype=bool)
    order = tuple(unit for unit in each["order"] if unit in place)
    spots = {unit: k for k, unit in enumerate(order)}
    drift = [d for d in content.get("drift") or () if d["symbol"] == symbol]

    def column(key: str) -> np.ndarray:
        return packed.with_nan(each[key])[kept]

    return {
        "symbol": symbol,
        **{key: each[key] for key in ("unit", "centre", "lower", "upper", "decision")},
        "order": orders.setdefault(order, len(orders)),
        "value": packed.numbers(column("value")),
        "stderr": packed.values(column("stderr")),
        "cusum_high": packed.values(column("cusum_high")),
        "cusum_low": packed.values(column("cusum_low")),
        "since": [{"at": spots[d["since"]], "size": d["size"]} for d in drift if d["since"] in spots],
    }


def _figure(content: Content, name: str, each: Mapping[str, Any], place: Mapping[str, int]) -> dict[str, Any]:
    value = packed.with_nan([(each.get("value") or {}).get(unit) for unit in place])
    return {
        "name": name,
        **{key: each.get(key) for key in ("meaning", "unit", "mean", "sd", "low", "high")},
        "limits": limits_of(content, name),
        "value": packed.numbers(value),
    }


NAME = "fleet.html"
# in the order of execution; each is plain JavaScript that exports its functions in `etcfit`
SCRIPTS = ("decode.js", "numbers.js", "theme.js", "store.js", "panel.js", "points.js", "bars.js", "filters.js",
           "card.js", "sections.js", "main.js")  # fmt: skip
part = Parts((("etcfit.reporting.fleet", "template"),))


def write_fleet_page(run: Path, content: Content, units: pd.DataFrame) -> Path:
    """Write RUN/fleet.html from fleet.json and units.parquet, completely or not at all; return its path."""
    write_text(run / NAME, render(content, units))
    return run / NAME


def render(content: Content, units: pd.DataFrame) -> str:
    """The whole page, HTML: it contains texts and tables, and its scripts draw the charts from the data."""
    return scripted(
        part,
        carried(content, units),
        "fleet.css",
        SCRIPTS,
        synthetic=content.get("synthetic"),
        fleet=content,
        title=title(content),
        verdict=verdict(content),
        tables={name: table(content) for name, table in TABLES.items()},
        symbol=html.symbol,
        number=html.number,
    )
