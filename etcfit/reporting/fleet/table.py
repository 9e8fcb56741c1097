"""What `etcfit fleet` prints: the verdict, population, limits, odd units, drift, effects, figures, gauge, failed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from ..blocks import sentences, stacked, table
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
    return stacked(
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
    )


def _head(content: Content, judgement: Judgement) -> RenderableType:
    head = Text(title(content), style="bold")
    if content.get("synthetic"):
        head.append("  SYNTHETIC DATA", style="bold magenta")
    lines = [Text(f"- {each.text}", style="bold red" if each.bad else "") for each in verdict(content, judgement)]
    return Group(head, *lines)


def _population(content: Content, judgement: Judgement) -> RenderableType | None:
    rows = []
    for symbol, each in (content.get("population") or {}).items():
        mean = _by(each["mean"], each["mean_ci95"], each["sd"])
        spread = (Text("shared by all", style="dim"), "-") if each.get("shared", False) else (
            _by(each["sd"], each["sd_ci95"], None), _span(each["sd_ci95"]))  # fmt: skip
        count = "-" if (informed := each.get("informed")) is None else f"{informed:,}"
        rows.append((symbol, mean, _span(each["mean_ci95"]), *spread, _cpk(each.get("cpk"), judgement), count,
                     each["unit"]))  # fmt: skip
    head = ("parameter", "mean", "95 % interval of mean", "spread, 1 sd", "95 % interval of spread", "Cpk",
            "units that tell it", "unit")  # fmt: skip
    spare = "units that tell it", "95 % interval of spread", "95 % interval of mean"
    return table("Population", head, rows, words=("unit",), spare=spare, file=_FILE)


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
    rows = []
    for name, each in (content.get("capability") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        outside = "-" if each["outside"] is None else f"{short(100.0 * each['outside'], 2)} %"
        rows.append((name, short(each["low"], 4), short(each["high"], 4), of(each["mean"]), of(each["sd"]),
                     short(each["cp"]), _cpk(each["cpk"], judgement), _span(each["cpk_ci95"]), outside,
                     each["unit"]))  # fmt: skip
    head = ("limit of", "low", "high", "mean", "spread, 1 sd", "Cp", "Cpk", "95 % interval of Cpk", "outside", "unit")
    spare = "Cp", "95 % interval of Cpk", "spread, 1 sd"
    return table("Specification limits", head, rows, words=("unit",), spare=spare, file=_FILE)


def _odd(content: Content) -> RenderableType | None:
    odd = content.get("odd") or ()
    rows = [(each["unit"], each["why"], short(each["distance"]), short(each["p"], 2)) for each in odd[:_MOST]]
    return table(_of("Odd units, the oddest first", len(odd)), ("unit", "why", "distance", "p"), rows, left=2,
                 prose=("why",), spare=("distance",), file=_FILE)  # fmt: skip


def _of(name: str, count: int) -> str:
    return name if count <= _MOST else f"{name}: {_MOST} of {count:,}"


def _drift(content: Content) -> RenderableType | None:
    rows = [(each["symbol"], each["since"], f"{each['size']:+.3g}", each.get("unit"),
             "-" if (sd := each.get("size_sd")) is None else f"{sd:+.2g}", short(each.get("p"), 2))
            for each in content.get("drift") or ()]  # fmt: skip
    return table("Drift", ("drift of", "since unit", "size", "unit", "in sd", "p"), rows, left=2, words=("unit",))


def _effects(content: Content) -> RenderableType | None:
    rows = [(name, f"{len(each['units']):,}", f"{each['of']:,}", short(each["median"]), each.get("symbol"),
             each.get("unit")) for name, each in (content.get("effects") or {}).items()]  # fmt: skip
    head = "effect", "units with it", "of", "median", "parameter", "unit"
    return table("Effects beyond Eqs. 1-2", head, rows, words=("parameter", "unit"))


def _figures(content: Content) -> RenderableType | None:
    rows = []
    for name, each in (content.get("figures") or {}).items():
        of = Digits.of(each["mean"] or 0.0, each["sd"])
        cells = of(each["mean"]), of(each["sd"]), of.span(each["low"], each["high"])
        rows.append((name.replace("_", " "), each["meaning"], *cells, each["unit"]))
    head = "figure", "meaning", "mean", "spread, 1 sd", "95 % of units", "unit"
    return table("What the line measures", head, rows, left=2, words=("unit",), prose=("meaning",), spare=("meaning",),
                 file=_FILE)  # fmt: skip


def _gauge(content: Content, judgement: Judgement) -> RenderableType | None:
    rows = []
    for name, each in (content.get("gauge") or {}).items():
        sizes = (short(each[key]) for key in ("repeatability", "reproducibility", "part", "total"))
        share: Any = each["rr_percent"]
        bad = share is not None and share > judgement.gauge
        percent = Text("-" if share is None else f"{short(share)} %", style="bold red" if bad else "")
        rows.append((name, *sizes, percent, short(each["ndc"], 2), each["unit"]))
    head = "gauge of", "repeatability", "reproducibility", "part", "total", "R&R", "ndc", "unit"
    return table("Gauge R&R, standard deviations", head, rows, words=("unit",), spare=("total", "part"), file=_FILE)


def _without(name: str, units: Sequence[Any]) -> RenderableType | None:
    lines = [f"{each['unit']}: {each['why']}" for each in units[:_MOST]]
    return sentences(_of(name, len(units)), lines)
