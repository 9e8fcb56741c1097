"""What `etcfit fleet` prints: the verdict, population, limits, odd units, drift, effects, figures, gauge, failed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..blocks import PlainTable, headed, plain_table, sentences
from ..numbers import Digits, short
from .words import JUDGEMENT, Content, Judgement, title, verdict

_FILE = "RUN/fleet.json"
_MOST = 20  # rows of units; fleet.json and the page have them all


def fleet_table(content: Content, judgement: Judgement = JUDGEMENT) -> RenderableType:
    """A fleet for stdout.

    Args:
        content: fleet.json.
        judgement: when a figure is called bad.
    """
    parts = [
        _head(content, judgement),
        _population(content, judgement),
        _capability(content, judgement),
        _odd(content),
        _drift(content),
        _effects(content),
        _figures(content),
        _gauge(content, judgement),
        _without("Not converged", content.get("not_converged") or ()),
        _without("Failed, and in nothing above", content.get("failed") or ()),
    ]
    return Group(*(part for part in parts if part is not None))


def _head(content: Content, judgement: Judgement) -> RenderableType:
    head = Text(title(content), style="bold")
    if content.get("synthetic"):
        head.append("  SYNTHETIC DATA", style="bold magenta")
    lines = [Text(f"- {each.text}", style="bold red" if each.bad else "") for each in verdict(content, judgement)]
    return Group(head, *lines)


def _titled(name: str, table: PlainTable) -> RenderableType | None:
    return headed(name, table) if table.row_count else None


def _population(content: Content, judgement: Judgement) -> RenderableType | None:
    table = plain_table(
        "parameter", "mean", "95 % interval of mean", "spread, 1 sd", "95 % interval of spread", "Cpk",
        "units that tell it", "unit", words=("unit",), file=_FILE,
        spare=("units that tell it", "95 % interval of spread", "95 % interval of mean"),
    )  # fmt: skip
    for symbol, each in (content.get("population") or {}).items():
        mean = _by(each["mean"], each["mean_ci95"], each["sd"])
        shared = each.get("shared", False)
        spread = (Text("shared by all", style="dim"), "-") if shared else (
            _by(each["sd"], each["sd_ci95"], None), _span(each["sd_ci95"]))  # fmt: skip
        cells = (mean, _span(each["mean_ci95"]), *spread)
        table.add_row(symbol, *cells, _cpk(each.get("cpk"), judgement), _count(each.get("informed")), each["unit"])
    return _titled("Population", table)


def _count(count: int | None) -> str:
    return "-" if count is None else f"{count:,}"


def _by(value: float | None, interval: Sequence[float] | None, spread: float | None) -> str:
    """As many digits as its interval warrants; four where there is none."""
    half = spread if not interval or None in interval else 0.5 * (interval[1] - interval[0])
    return "-" if value is None else Digits.of(value, half)(value)


def _span(interval: Sequence[float] | None) -> str:
    if not interval or None in interval:
        return "-"
    low, high = interval
    return Digits.of(max(abs(low), abs(high)), 0.5 * (high - low)).span(low, high)


def _cpk(value: float | None, judgement: Judgement) -> Text:
    return Text(short(value), style="bold red" if value is not None and value < judgement.capable else "")


def _capability(content: Content, judgement: Judgement) -> RenderableType | None:
    table = plain_table(
        "limit of", "low", "high", "mean", "spread, 1 sd", "Cp", "Cpk", "95 % interval of Cpk", "outside", "unit",
        words=("unit",), spare=("Cp", "95 % interval of Cpk", "spread, 1 sd"), file=_FILE,
    )  # fmt: skip
    for name, each in (content.get("capability") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        limits = short(each["low"], 4), short(each["high"], 4)
        outside = "-" if each["outside"] is None else f"{short(100.0 * each['outside'], 2)} %"
        table.add_row(name, *limits, of(each["mean"]), of(each["sd"]), short(each["cp"]), _cpk(each["cpk"], judgement),
                      _span(each["cpk_ci95"]), outside, each["unit"])  # fmt: skip
    return _titled("Specification limits", table)


def _odd(content: Content) -> RenderableType | None:
    odd = content.get("odd") or ()
    table = plain_table("unit", "why", "distance", "p", left=2, prose=("why",), spare=("distance",), file=_FILE)
    for each in odd[:_MOST]:
        table.add_row(each["unit"], each["why"], short(each["distance"]), short(each["p"], 2))
    return _titled(_of("Odd units, the oddest first", len(odd)), table)


def _of(name: str, count: int) -> str:
    return name if count <= _MOST else f"{name}: {_MOST} of {count:,}"


def _drift(content: Content) -> RenderableType | None:
    table = plain_table("drift of", "since unit", "size", "unit", "in sd", "p", left=2, words=("unit",))
    for each in content.get("drift") or ():
        table.add_row(each["symbol"], each["since"], f"{each['size']:+.3g}", each.get("unit"),
                      _signed(each.get("size_sd")), short(each.get("p"), 2))  # fmt: skip
    return _titled("Drift", table)


def _signed(value: float | None) -> str:
    return "-" if value is None else f"{value:+.2g}"


def _effects(content: Content) -> RenderableType | None:
    table = plain_table("effect", "units with it", "of", "median", "parameter", "unit", words=("parameter", "unit"))
    for name, each in (content.get("effects") or {}).items():
        table.add_row(name, f"{len(each['units']):,}", f"{each['of']:,}", short(each["median"]), each.get("symbol"),
                      each.get("unit"))  # fmt: skip
    return _titled("Effects beyond Eqs. 1-2", table)


def _figures(content: Content) -> RenderableType | None:
    table = plain_table("figure", "meaning", "mean", "spread, 1 sd", "95 % of units", "unit", left=2, words=("unit",),
                        prose=("meaning",), spare=("meaning",), file=_FILE)  # fmt: skip
    for name, each in (content.get("figures") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        cells = of(each["mean"]), of(each["sd"]), of.span(each["low"], each["high"])
        table.add_row(name.replace("_", " "), each["meaning"], *cells, each["unit"])
    return _titled("What the line measures", table)


def _gauge(content: Content, judgement: Judgement) -> RenderableType | None:
    table = plain_table("gauge of", "repeatability", "reproducibility", "part", "total", "R&R", "ndc", "unit",
                        words=("unit",), spare=("total", "part"), file=_FILE)  # fmt: skip
    for name, each in (content.get("gauge") or {}).items():
        sizes = (short(each[key]) for key in ("repeatability", "reproducibility", "part", "total"))
        share: Any = each["rr_percent"]
        bad = share is not None and share > judgement.gauge
        percent = Text("-" if share is None else f"{short(share)} %", style="bold red" if bad else "")
        table.add_row(name, *sizes, percent, short(each["ndc"], 2), each["unit"])
    return _titled("Gauge R&R, standard deviations", table)


def _without(name: str, units: Sequence[Any]) -> RenderableType | None:
    lines = [f"{each['unit']}: {each['why']}" for each in units[:_MOST]]
    return sentences(_of(name, len(units)), lines)
