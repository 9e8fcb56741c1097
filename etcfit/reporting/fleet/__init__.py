"""Output of a fleet: sentences, the same on the terminal and at the top of the page, and tables.

Source: AIAG, Statistical Process Control, 2nd ed. 2005 (Cpk of 1.33), and Measurement Systems Analysis, 4th ed. 2010
(30 % of repeatability and reproducibility).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import RenderableType
from rich.text import Text

from ...errors import first_names
from ..blocks import headline, stacked
from ..numbers import Digits, counted, mean_digits, short
from ..table import Cell, Column, Kind, Notes, Table, of_texts

Content = Mapping[str, Any]  # fleet.json


CAPABLE = 1.33  # least Cpk of a process that keeps its limits
GAUGE = 30.0  # largest repeatability and reproducibility together, per cent of the whole spread
_NAMED = 4  # number of units that a sentence names before it only counts the others


@dataclass(frozen=True)
class Sentence:
    """A sentence of the verdict."""

    text: str  # plain text
    bad: bool = False  # whether it needs action


def verdict(content: Content) -> tuple[Sentence, ...]:
    """Sentences on units, odd units, drift, specification limits, gauge and effects, in this order."""
    parts = (_units, _odd_units, _drifts, _capable, _gauges, _effects_found)
    return tuple(sentence for part in parts for sentence in part(content))


def title(content: Content) -> str:
    """The fleet's name, or a substitute."""
    return content.get("name") or "Fleet without a name"


def _units(content: Content) -> Iterator[Sentence]:
    fitted = len(content.get("units") or ())
    failed, stuck = (len(content.get(key) or ()) for key in ("failed", "not_converged"))
    verb = "has" if fitted == 1 else "have"
    text = f"{counted(fitted, 'unit')} {verb} a result, {stuck:,} of them not converged; {failed:,} failed."
    yield Sentence(text, bad=failed + stuck > 0)


def _odd_units(content: Content) -> Iterator[Sentence]:
    odd, of = content.get("odd"), len(content.get("units") or ())
    if odd is None or not of:
        return
    if not odd:
        yield Sentence("No unit is odd.")
        return
    named = [f"{each['unit']} ({', '.join(each['symbols'])})" if each["symbols"] else each["unit"] for each in odd]
    verb = "is" if len(odd) == 1 else "are"
    share = f"{short(100.0 * len(odd) / of, 2)} %"
    text = f"{counted(len(odd), 'unit')} {verb} odd ({share}): {first_names(named, _NAMED)}."
    yield Sentence(text, bad=True)


def _drifts(content: Content) -> Iterator[Sentence]:
    drift = content.get("drift")
    if drift is None:
        return
    if not drift:
        yield Sentence("Nothing drifts.")
    for each in drift:
        unit = unit_of(content, each["symbol"])
        way = "higher" if each["size"] > 0 else "lower"
        size = f"{short(abs(each['size']))} {unit}".strip()
        sd, p = each.get("size_sd"), each.get("p")
        known = [f"{short(abs(sd), 2)} standard deviations"] if sd is not None else []
        known += [f"p = {short(p, 2)}"] if p is not None else []
        beside = f" ({', '.join(known)})" if known else ""
        when = "slowly, in the end" if each.get("kind") == "trend" else f"from {each['since']} on"
        yield Sentence(f"{each['symbol']} drifts: {when} it is {size} {way}{beside}.", bad=True)


def unit_of(content: Content, symbol: str) -> str:
    """A symbol's unit of measure if known; "" for a ratio."""
    for kind in ("charts", "population", "figures"):
        found = (content.get(kind) or {}).get(symbol)
        if found:
            return "" if found["unit"] == "1" else found["unit"]
    return ""


def _capable(content: Content) -> Iterator[Sentence]:
    known = {name: each["cpk"] for name, each in (content.get("capability") or {}).items() if each["cpk"] is not None}
    if not known:
        return
    poor = [f"{name} ({short(cpk)})" for name, cpk in known.items() if cpk < CAPABLE]
    if poor:
        yield Sentence(f"Cpk below {CAPABLE:g}: {', '.join(poor)}.", bad=True)
    else:
        yield Sentence(f"Cpk is {CAPABLE:g} or above for {', '.join(known)}.")


def _gauges(content: Content) -> Iterator[Sentence]:
    known = {name: each["rr_percent"] for name, each in (content.get("gauge") or {}).items()
             if each["rr_percent"] is not None}  # fmt: skip
    poor = [f"{name} ({short(share)} %)" for name, share in known.items() if share > GAUGE]
    if poor:
        text = f"Measuring takes more than {GAUGE:g} % of the spread: {', '.join(poor)}."
        yield Sentence(text, bad=True)


def _effects_found(content: Content) -> Iterator[Sentence]:
    effects = content.get("effects")
    if not effects:
        return
    named = [f"{name.replace('_', ' ')} in {len(e['units']):,} of {e['of']:,} units" for name, e in effects.items()]
    yield Sentence(f"Effects beyond Eqs. 1-2: {', '.join(named)}.")


_FILE = "RUN/fleet.json"
_UNIT: Mapping[str, Kind] = {"unit": "word"}
_MOST = 20  # largest number of rows of units; fleet.json and the page have all


def fleet_table(content: Content) -> RenderableType:
    """fleet.json for stdout."""
    return stacked(
        headline(title(content), bool(content.get("synthetic"))),
        *(Text(f"- {each.text}", style="bold red" if each.bad else "") for each in verdict(content)),
        population_table(content),
        capability_table(content),
        _odd(content),
        _drift(content),
        effects_table(content),
        figures_table(content),
        gauge_table(content),
        predictions_table(content),
        _without("Not converged", content.get("not_converged") or ()),
        _without("Failed, and in nothing above", content.get("failed") or ()),
    )


def population_table(content: Content) -> Table:
    """The scatter between units without their own uncertainty."""
    rows = []
    for symbol, each in (content.get("population") or {}).items():
        ends = {f"{name}_{side}": end for name in ("mean", "sd")
                for side, end in zip(("low", "high"), each[f"{name}_ci95"] or (None, None), strict=True)}  # fmt: skip
        rows.append({"symbol": symbol, "cpk": None, "shared": False, "informed": None, **each, **ends})

    def own(show: Callable[[Mapping[str, Any]], str], instead: str) -> Callable[[Mapping[str, Any]], Cell]:
        return lambda row: Cell(instead, "dim") if row["shared"] else Cell(show(row))

    return Table("Population: what is left of the units' differences once their own uncertainty is taken off", (
        Column("parameter", "symbol", "symbol"),
        Column("mean", lambda row: _by(row["mean"], row["mean_ci95"], row["sd"])),
        Column("95 % interval of mean", lambda row: _span(row["mean_ci95"]), spare=3),
        Column("spread, 1 sd", own(lambda row: _by(row["sd"], row["sd_ci95"], None), "shared by all")),
        Column("95 % interval of spread", own(lambda row: _span(row["sd_ci95"]), "-"), spare=2),
        Column("Cpk", lambda row: _cpk(row["cpk"])),
        Column("units that tell it", lambda row: "-" if row["informed"] is None else f"{row['informed']:,}", spare=1),
        Column("unit", "unit", "unit")), rows, file=_FILE)  # fmt: skip


def _by(value: float | None, interval: Sequence[float] | None, spread: float | None) -> str:
    """The significant digits by its interval; four without an interval."""
    half = spread if not interval or None in interval else 0.5 * (interval[1] - interval[0])
    return "-" if value is None else Digits.of_value(value, half)(value)


def _span(interval: Sequence[float] | None) -> str:
    if not interval or None in interval:
        return "-"
    low, high = interval
    return Digits.of_value(max(abs(low), abs(high)), 0.5 * (high - low)).span(low, high)


def _cpk(value: float | None) -> Cell:
    return Cell(short(value), "bad" if value is not None and value < CAPABLE else "")


def _named(content: Content, kind: str, name: str) -> list[dict[str, Any]]:
    """Records of an object of fleet.json, with their names."""
    return [{name: key, **each} for key, each in (content.get(kind) or {}).items()]


_MEAN = (
    Column("mean", lambda row: mean_digits(row)(row["mean"])),
    Column("spread, 1 sd", lambda row: mean_digits(row)(row["sd"]), spare=3),
)


def capability_table(content: Content) -> Table:
    """Quantities with limits, and the share of units expected outside."""
    return Table(f"Specification limits; a Cpk below {CAPABLE:g} is marked", (
        Column("limit of", "name", "symbol"), Column("low", "low", digits=4), Column("high", "high", digits=4), *_MEAN,
        Column("Cp", "cp", spare=1), Column("95 % interval of Cp", lambda row: _span(row["cp_ci95"]), spare=4),
        Column("Cpk", lambda row: _cpk(row["cpk"])),
        Column("95 % interval of Cpk", lambda row: _span(row["cpk_ci95"]), spare=2),
        Column("outside", lambda row: "-" if row["outside"] is None else f"{short(100.0 * row['outside'], 2)} %"),
        Column("unit", "unit", "unit")), _named(content, "capability", "name"), file=_FILE)  # fmt: skip


def _odd(content: Content) -> Table:
    odd = content.get("odd") or ()
    rows = [(each["unit"], each["why"], short(each["distance"]), short(each["p"], 2)) for each in odd[:_MOST]]
    return of_texts(_of("Odd units, the oddest first", len(odd)), ("unit", "why", "distance", "p"), rows, 1,
                    {"why": "prose"}, ("distance",), file=_FILE)  # fmt: skip


def _of(name: str, count: int) -> str:
    return name if count <= _MOST else f"{name}: {_MOST} of {count:,}"


def _drift(content: Content) -> Table:
    rows = [(each["symbol"], each["since"], f"{each['size']:+.3g}", each.get("unit"),
             "-" if (sd := each.get("size_sd")) is None else f"{sd:+.2g}", short(each.get("p"), 2))
            for each in content.get("drift") or ()]  # fmt: skip
    return of_texts("Drift", ("drift of", "since unit", "size", "unit", "in sd", "p"), rows, 2, _UNIT)


def effects_table(content: Content) -> Table:
    """Effects of the common model."""
    rows = [{**row, "present": len(row["units"])} for row in _named(content, "effects", "effect")]
    return Table("Effects beyond Eqs. 1-2", (
        Column("effect", "effect", "word"), Column("units with it", lambda row: f"{row['present']:,}"),
        Column("of", lambda row: f"{row['of']:,}"), Column("median", "median"),
        Column("parameter", lambda row: row.get("symbol") or "", "word"),
        Column("unit", lambda row: row.get("unit") or "", "word")), rows)  # fmt: skip


def figures_table(content: Content) -> Table:
    """Figures of each unit's fitted model."""
    return Table("What the line measures", (
        Column("figure", lambda row: row["figure"].replace("_", " "), "word"),
        Column("meaning", "meaning", "prose", spare=1), _MEAN[0], _MEAN[1]._replace(spare=0),
        Column("95 % of units", lambda row: mean_digits(row).span(row["low"], row["high"])),
        Column("unit", "unit", "word")), _named(content, "figures", "figure"), file=_FILE)  # fmt: skip


def gauge_table(content: Content) -> Table:
    """Repeatability and reproducibility."""

    def percent(row: Mapping[str, Any]) -> Cell:
        share = row["rr_percent"]
        return Cell("-") if share is None else Cell(f"{short(share)} %", "bad" if share > GAUGE else "")

    title = f"Gauge R&R, standard deviations of the same units measured again; more than {GAUGE:g} % is marked"
    return Table(title, (
        Column("gauge of", "symbol", "symbol"), Column("repeatability", "repeatability"),
        Column("rig", "rig", spare=4), Column("operator", "operator", spare=3),
        Column("reproducibility", "reproducibility"), Column("part", "part", spare=2),
        Column("total", "total", spare=1), Column("R&R", percent), Column("ndc", "ndc", digits=2),
        Column("unit", "unit", "unit")),
        _named(content, "gauge", "symbol"), file=_FILE)  # fmt: skip


def predictions_table(content: Content) -> Table:
    """The figures in other conditions."""
    rows = content.get("predictions") or ()
    units = {name: each["unit"] for row in rows for name, each in row["figures"].items()}

    def shown(row: Mapping[str, Any], name: str) -> str:
        each = row["figures"].get(name)
        return "-" if each is None else f"{short(each['mean'])} ({_span((each['low'], each['high']))})"

    columns = [Column(f"{name.replace('_', ' ')}\n{unit}", lambda row, name=name: shown(row, name))
               for name, unit in units.items()]  # fmt: skip
    return Table("Hot and cold, 9 to 16 V: mean, and where 95 % of the units lie", (
        Column("condition", "condition", "word"), Column("winding\ndegC", "winding_C"), *columns),
        rows, file=_FILE)  # fmt: skip


# tables that fleet.html shows unchanged; it draws the others
TABLES = {"population": population_table, "capability": capability_table, "gauge": gauge_table,
          "predictions": predictions_table}  # fmt: skip


def _without(name: str, units: Sequence[Any]) -> Notes:
    return Notes(_of(name, len(units)), [f"{each['unit']}: {each['why']}" for each in units[:_MOST]])
