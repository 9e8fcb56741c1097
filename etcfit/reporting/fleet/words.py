"""A fleet in a few sentences, the same ones on the terminal and at the top of the page.

Source: AIAG, Statistical Process Control, 2nd ed. 2005 (Cpk of 1.33), and Measurement Systems Analysis, 4th ed. 2010
(30 % of repeatability and reproducibility).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...ranges import check_ranges, real, whole
from ..numbers import short

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
    parts = (_units, _odd, _drift, _capable, _gauge, _effects)
    return tuple(sentence for part in parts for sentence in part(content, judgement))


def title(content: Content) -> str:
    """The fleet's name; one without is called so."""
    return content.get("name") or "Fleet without a name"


def counted(count: int, thing: str) -> str:
    """ "1 unit", "2,000 units"."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"


def first_of(units: Sequence[str], named: int) -> str:
    """The first few names, and how many more there are."""
    more = len(units) - named
    return ", ".join(units[:named]) + (f" and {more:,} more" if more > 0 else "")


def _units(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    fitted = len(content.get("units") or ())
    failed, stuck = (len(content.get(key) or ()) for key in ("failed", "not_converged"))
    verb = "has" if fitted == 1 else "have"
    text = f"{counted(fitted, 'unit')} {verb} a result, {stuck:,} of them not converged; {failed:,} failed."
    yield Sentence(text, bad=failed + stuck > 0)


def _odd(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    odd, of = content.get("odd"), len(content.get("units") or ())
    if odd is None or not of:
        return
    if not odd:
        yield Sentence("No unit is odd.")
        return
    named = [f"{each['unit']} ({', '.join(each['symbols'])})" if each["symbols"] else each["unit"] for each in odd]
    verb = "is" if len(odd) == 1 else "are"
    share = f"{short(100.0 * len(odd) / of, 2)} %"
    text = f"{counted(len(odd), 'unit')} {verb} odd ({share}): {first_of(named, judgement.named)}."
    yield Sentence(text, bad=True)


def _drift(content: Content, judgement: Judgement) -> Iterator[Sentence]:
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


def _gauge(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    known = {name: each["rr_percent"] for name, each in (content.get("gauge") or {}).items()
             if each["rr_percent"] is not None}  # fmt: skip
    poor = [f"{name} ({short(share)} %)" for name, share in known.items() if share > judgement.gauge]
    if poor:
        text = f"Measuring takes more than {judgement.gauge:g} % of the spread: {', '.join(poor)}."
        yield Sentence(text, bad=True)


def _effects(content: Content, judgement: Judgement) -> Iterator[Sentence]:
    effects = content.get("effects")
    if not effects:
        return
    named = [f"{name.replace('_', ' ')} in {len(e['units']):,} of {e['of']:,} units" for name, e in effects.items()]
    yield Sentence(f"Effects beyond Eqs. 1-2: {', '.join(named)}.")
