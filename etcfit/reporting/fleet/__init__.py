"""What a person sees of a fleet: sentences, the same on the terminal and at the top of the page, and the tables.

Source: AIAG, Statistical Process Control, 2nd ed. 2005 (Cpk of 1.33), and Measurement Systems Analysis, 4th ed. 2010
(30 % of repeatability and reproducibility).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ...errors import first_names
from ...ranges import check_ranges, real, whole
from ..blocks import all_shown, stacked
from ..numbers import Digits, short
from ..table import Cell, Kind, Notes, Table, of_texts

Content = Mapping[str, Any]  # fleet.json


@dataclass(frozen=True)
class Judgement:
    """When a fleet's figures are called bad.

    Args:
        capable: least Cpk of a process that keeps its limits.
        gauge: most repeatability and reproducibility together, per cent of the whole spread.
        named: how many units a sentence names before it counts the others.
    """

    capable: float = real(1.33, 0.0, 10.0)
    gauge: float = real(30.0, 0.0, 100.0)
    named: int = whole(4, 1)
    __post_init__ = check_ranges


JUDGEMENT = Judgement()


@dataclass(frozen=True)
class Sentence:
    """One of the verdict's.

    Args:
        text: plain.
        bad: whether somebody must do something about it.
    """

    text: str
    bad: bool = False


def verdict(content: Content, judgement: Judgement = JUDGEMENT) -> tuple[Sentence, ...]:
    """Units, odd ones, drift, specification limits, gauge, effects: what was worked out, in this order."""
    parts = (_units, _odd_units, _drifts, _capable, _gauges, _effects_found)
    return tuple(sentence for part in parts for sentence in part(content, judgement))


def title(content: Content) -> str:
    """The fleet's name; one without is called so."""
    return content.get("name") or "Fleet without a name"


def counted(count: int, thing: str) -> str:
    """ "1 unit", "2,000 units"."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"


def _units(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    fitted = len(content.get("units") or ())
    failed, stuck = (len(content.get(key) or ()) for key in ("failed", "not_converged"))
    verb = "has" if fitted == 1 else "have"
    text = f"{counted(fitted, 'unit')} {verb} a result, {stuck:,} of them not converged; {failed:,} failed."
    yield Sentence(text, bad=failed + stuck > 0)


def _odd_units(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    odd, of = content.get("odd"), len(content.get("units") or ())
    if odd is None or not of:
        return
    if not odd:
        yield Sentence("No unit is odd.")
        return
    named = [f"{each['unit']} ({', '.join(each['symbols'])})" if each["symbols"] else each["unit"] for each in odd]
    verb = "is" if len(odd) == 1 else "are"
    share = f"{short(100.0 * len(odd) / of, 2)} %"
    text = f"{counted(len(odd), 'unit')} {verb} odd ({share}): {first_names(named, judgement.named)}."
    yield Sentence(text, bad=True)


def _drifts(content: Content, judgement: Judgement) -> Iterator[Sentence]:
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
    """A symbol's unit of measure where it is known; "" for a ratio."""
    for kind in ("charts", "population", "figures"):
        found = (content.get(kind) or {}).get(symbol)
        if found:
            return "" if found["unit"] == "1" else found["unit"]
    return ""


def _capable(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    known = {name: each["cpk"] for name, each in (content.get("capability") or {}).items() if each["cpk"] is not None}
    if not known:
        return
    poor = [f"{name} ({short(cpk)})" for name, cpk in known.items() if cpk < judgement.capable]
    if poor:
        yield Sentence(f"Cpk below {judgement.capable:g}: {', '.join(poor)}.", bad=True)
    else:
        yield Sentence(f"Cpk is {judgement.capable:g} or above for {', '.join(known)}.")


def _gauges(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    known = {name: each["rr_percent"] for name, each in (content.get("gauge") or {}).items()
             if each["rr_percent"] is not None}  # fmt: skip
    poor = [f"{name} ({short(share)} %)" for name, share in known.items() if share > judgement.gauge]
    if poor:
        text = f"Measuring takes more than {judgement.gauge:g} % of the spread: {', '.join(poor)}."
        yield Sentence(text, bad=True)


def _effects_found(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    effects = content.get("effects")
    if not effects:
        return
    named = [f"{name.replace('_', ' ')} in {len(e['units']):,} of {e['of']:,} units" for name, e in effects.items()]
    yield Sentence(f"Effects beyond Eqs. 1-2: {', '.join(named)}.")


_FILE = "RUN/fleet.json"
_UNIT: Mapping[str, Kind] = {"unit": "word"}
_MOST = 20  # rows of units; fleet.json and the page have them all


def fleet_table(content: Content, judgement: Judgement = JUDGEMENT) -> RenderableType:
    """fleet.json for stdout."""
    return stacked(
        _head(content, judgement),
        all_shown(
            _population(content, judgement),
            _capability(content, judgement),
            _odd(content),
            _drift(content),
            _effects(content),
            _figures(content),
            _gauge(content, judgement),
            _without("Not converged", content.get("not_converged") or ()),
            _without("Failed, and in nothing above", content.get("failed") or ()),
        ),
    )


def _head(content: Content, judgement: Judgement) -> RenderableType:
    head = Text(title(content), style="bold")
    if content.get("synthetic"):
        head.append("  SYNTHETIC DATA", style="bold magenta")
    lines = [Text(f"- {each.text}", style="bold red" if each.bad else "") for each in verdict(content, judgement)]
    return Group(head, *lines)


def _population(content: Content, judgement: Judgement) -> Table:
    rows = []
    for symbol, each in (content.get("population") or {}).items():
        mean = _by(each["mean"], each["mean_ci95"], each["sd"])
        spread = (Cell("shared by all", "dim"), "-") if each.get("shared", False) else (
            _by(each["sd"], each["sd_ci95"], None), _span(each["sd_ci95"]))  # fmt: skip
        count = "-" if (informed := each.get("informed")) is None else f"{informed:,}"
        rows.append((symbol, mean, _span(each["mean_ci95"]), *spread, _cpk(each.get("cpk"), judgement), count,
                     each["unit"]))  # fmt: skip
    head = ("parameter", "mean", "95 % interval of mean", "spread, 1 sd", "95 % interval of spread", "Cpk",
            "units that tell it", "unit")  # fmt: skip
    spare = "units that tell it", "95 % interval of spread", "95 % interval of mean"
    return of_texts("Population", head, rows, 1, _UNIT, spare, file=_FILE)


def _by(value: float | None, interval: Sequence[float] | None, spread: float | None) -> str:
    """As many digits as its interval warrants; four where there is none."""
    half = spread if not interval or None in interval else 0.5 * (interval[1] - interval[0])
    return "-" if value is None else Digits.of(value, half)(value)


def _span(interval: Sequence[float] | None) -> str:
    if not interval or None in interval:
        return "-"
    low, high = interval
    return Digits.of(max(abs(low), abs(high)), 0.5 * (high - low)).span(low, high)


def _cpk(value: float | None, judgement: Judgement) -> Cell:
    return Cell(short(value), "bad" if value is not None and value < judgement.capable else "")


def _capability(content: Content, judgement: Judgement) -> Table:
    rows = []
    for name, each in (content.get("capability") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        outside = "-" if each["outside"] is None else f"{short(100.0 * each['outside'], 2)} %"
        rows.append((name, short(each["low"], 4), short(each["high"], 4), of(each["mean"]), of(each["sd"]),
                     short(each["cp"]), _cpk(each["cpk"], judgement), _span(each["cpk_ci95"]), outside,
                     each["unit"]))  # fmt: skip
    head = ("limit of", "low", "high", "mean", "spread, 1 sd", "Cp", "Cpk", "95 % interval of Cpk", "outside", "unit")
    spare = "Cp", "95 % interval of Cpk", "spread, 1 sd"
    return of_texts("Specification limits", head, rows, 1, _UNIT, spare, file=_FILE)


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


def _effects(content: Content) -> Table:
    rows = [(name, f"{len(each['units']):,}", f"{each['of']:,}", short(each["median"]), each.get("symbol"),
             each.get("unit")) for name, each in (content.get("effects") or {}).items()]  # fmt: skip
    head = "effect", "units with it", "of", "median", "parameter", "unit"
    return of_texts("Effects beyond Eqs. 1-2", head, rows, 1, {"parameter": "word", "unit": "word"})


def _figures(content: Content) -> Table:
    rows = []
    for name, each in (content.get("figures") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        cells = of(each["mean"]), of(each["sd"]), of.span(each["low"], each["high"])
        rows.append((name.replace("_", " "), each["meaning"], *cells, each["unit"]))
    head = "figure", "meaning", "mean", "spread, 1 sd", "95 % of units", "unit"
    return of_texts("What the line measures", head, rows, 1, {"meaning": "prose", "unit": "word"}, ("meaning",),
                    file=_FILE)  # fmt: skip


def _gauge(content: Content, judgement: Judgement) -> Table:
    rows = []
    for name, each in (content.get("gauge") or {}).items():
        sizes = (short(each[key]) for key in ("repeatability", "reproducibility", "part", "total"))
        share: Any = each["rr_percent"]
        bad = share is not None and share > judgement.gauge
        percent = Cell("-" if share is None else f"{short(share)} %", "bad" if bad else "")
        rows.append((name, *sizes, percent, short(each["ndc"], 2), each["unit"]))
    head = "gauge of", "repeatability", "reproducibility", "part", "total", "R&R", "ndc", "unit"
    return of_texts("Gauge R&R, standard deviations", head, rows, 1, _UNIT, ("total", "part"), file=_FILE)


def _without(name: str, units: Sequence[Any]) -> Notes:
    return Notes(_of(name, len(units)), [f"{each['unit']}: {each['why']}" for each in units[:_MOST]])
