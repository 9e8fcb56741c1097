"""The tables of docs/validation/confusion.md."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from scipy.stats import binomtest

from independent import CATALOGUE, OUTSIDE

from .cases import LEVELS, PARAMETERS
from .verdicts import (
    NEAR,
    Record,
    counted,
    first,
    has_no_other,
    is_clear,
    is_first,
    is_found,
    is_open,
    is_silent,
    is_true,
    least_left,
    of_kind,
    over_least,
    said,
    says_unexplained,
    stated,
    sure,
    wholly_found,
)

_STATED = ((0.05, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.9), (0.9, 1.01))  # probabilities, in groups


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def share(flags: Sequence[bool]) -> str:
    return f"{sum(flags)} of {len(flags)} ({100 * sum(flags) / len(flags):.0f} %)" if flags else "-"


def confusion(records: Sequence[Record]) -> str:
    """Rows: what was in the folder; columns, by number of a row: what was named first."""
    rows = ("clean", *CATALOGUE, *OUTSIDE)
    counts = counted(records)
    named = {column for _, column in counts}
    columns = ("-", *(name for name in rows if name in named), *sorted(named - {"-", *rows}))
    body = [
        [f"{n} {name}" if n else name, *(str(counts[name, column] or "") for column in columns)]
        for n, name in enumerate(rows)
        if any(counts[name, column] for column in columns)
    ]
    numbers = ["nothing" if c == "-" else str(rows.index(c)) if c in rows else c for c in columns]
    return markdown(["in the folder", *numbers], body)


def found(records: Sequence[Record]) -> str:
    """Rates by strength: named first by its own name, first or tied with the first, found at all."""
    body = []
    for label, levels in (*((level, (level,)) for level in LEVELS), ("medium and high", LEVELS[1:])):
        chosen = [r for r in of_kind(records, "single") if r["strength"][0] in levels]
        exact = [first(r) == r["names"][0] for r in chosen]
        alone = [r["added"] == r["names"] for r in chosen]
        anywhere = [is_found(r, r["names"][0]) for r in chosen]
        body.append([label, share(exact), share([is_first(r) for r in chosen]), share(anywhere), share(alone)])
    return markdown(["strength", "named first", "first, or tied with it", "found at all", "and nothing else"], body)


def by_effect(records: Sequence[Record]) -> str:
    """For each effect alone, a strength a column: what was named."""
    body = []
    for name in (*CATALOGUE, *OUTSIDE):
        chosen = [r for r in of_kind(records, "single", "outside") if r["names"] == [name]]
        if chosen:
            body.append([name, *("; ".join(said(r) for r in chosen if r["strength"] == [level]) for level in LEVELS)])
    return markdown(["in the folder", *LEVELS], body)


def others(records: Sequence[Record]) -> str:
    """Clean folders, pairs, and what is outside the catalogue."""
    clean, pairs, outside = (of_kind(records, kind) for kind in ("clean", "pair", "outside"))
    lines = [
        ["clean: nothing added", share([r["added"] == [] for r in clean])],
        ["clean: nothing added, nothing unexplained", share([is_silent(r) for r in clean])],
        ["pair: both found", share([wholly_found(r) for r in pairs])],
        ["pair: at least one found", share([any(is_found(r, name) for name in r["names"]) for r in pairs])],
        ["pair: nothing found that is not there", share([has_no_other(r) for r in pairs])],
        ["outside: no name given", share([r["added"] == [] for r in outside])],
        ["outside: no name given, called unexplained", share([is_open(r) for r in outside])],
        ["outside, medium and high: no name, unexplained", share([is_open(r) for r in outside if is_clear(r)])],
    ]
    return markdown(["folders", "share"], lines)


def coverage(records: Sequence[Record]) -> str:
    """How many 95 % intervals hold the truth, before and after, by kind of folder."""
    groups = [
        ("clean", of_kind(records, "clean")),
        ("one effect, low", [r for r in of_kind(records, "single") if not is_clear(r)]),
        ("one effect, medium and high", [r for r in of_kind(records, "single") if is_clear(r)]),
        ("... found alone", [r for r in of_kind(records, "single") if is_clear(r) and r["added"] == r["names"]]),
        ("two effects", of_kind(records, "pair")),
        ("... both found", [r for r in of_kind(records, "pair") if wholly_found(r)]),
        ("outside the catalogue", of_kind(records, "outside")),
        ("all", list(records)),
    ]
    body = []
    for label, chosen in groups:
        if chosen:
            body.append([label, *_intervals(chosen, "before"), *_intervals(chosen, "after")])
    head = ["folders", "before: inside %", "worst z", "no interval", "after: inside %", "worst z", "no interval"]
    return markdown(head, body)


def _intervals(records: Sequence[Record], when: str) -> list[str]:
    known, inside = sure(records, when), stated(records, when)
    z = max((abs(p["value"] - p["truth"]) / p["stderr"] for p in known), default=float("nan"))
    without = sum(len(r[when]["parameters"]) for r in records) - len(known)
    return [f"{100 * np.mean(inside):.1f}" if inside else "-", f"{z:.1f}", str(without)]


def by_parameter(records: Sequence[Record]) -> str:
    """Of every parameter over all folders: median relative error and coverage, before and after."""
    body = []
    for s in PARAMETERS:
        cells = [s]
        for when in ("before", "after"):
            each = [r[when]["parameters"][s] for r in records]
            sure = [p for p in each if p["low"] is not None]
            error = [100 * abs(p["value"] / p["truth"] - 1) for p in sure]
            inside = [p["low"] <= p["truth"] <= p["high"] for p in sure]
            cells += [f"{np.median(error):.3f}", f"{100 * np.mean(inside):.1f}"] if sure else ["-", "-"]
        body.append(cells)
    return markdown(["parameter", "before: median error %", "inside %", "after: median error %", "inside %"], body)


def held_out(records: Sequence[Record]) -> str:
    """Free-running error on traces never fitted, over the sensors' noise, and over what the body itself leaves.

    The body itself: the generator's own plant under the voltage and at the times that were logged. The noise of that
    voltage and the clock's jitter are in what it leaves as they are in what any model leaves.
    """
    body = []
    for kind in ("clean", "single", "pair", "outside"):
        chosen = of_kind(records, kind)
        for key, channels in (("holdout", ("current", "position")), ("holdout_position", ("position",))):
            if chosen:
                cells = [cell for when in ("before", "after") for cell in _near([r[when][key] for r in chosen])]
                least = [least_left(r, channels) for r in chosen]
                over = _near([r["after"][key] / each for r, each in zip(chosen, least, strict=True)])
                body.append([kind, " and ".join(channels), *cells, f"{np.median(least):.2f}", *over])
    head = ["folders", "of", "before: median error / noise", f"within {NEAR}", "after: median", f"within {NEAR}",
            "the body itself: median", "after / the body itself: median", f"within {NEAR}"]  # fmt: skip
    return markdown(head, body)


def _near(ratios: Sequence[float]) -> tuple[str, str]:
    return f"{np.median(ratios):.2f}", share([ratio <= NEAR for ratio in ratios])


# what is asked for, and how it is judged: words, share, records it is asked of, what is true of each of them
ASKED: tuple[tuple[str, str, Callable[[Sequence[Record]], list[bool]]], ...] = (
    ("clean: nothing added", "97 %", lambda R: [r["added"] == [] for r in of_kind(R, "clean")]),
    ("one effect, medium or high: found first", "92 %", lambda R: [is_first(r) for r in _single(R)]),
    ("... found at all", "95 %", lambda R: [is_found(r, r["names"][0]) for r in _single(R)]),
    ("... held-out position within 1.2 of the sensor's noise", "all", lambda R: _near_noise(_single(R))),
    ("... within 1.2 of what the body itself leaves", "", lambda R: [over_least(r) <= NEAR for r in _single(R)]),
    ("clean: held-out position within 1.2 of the noise", "", lambda R: _near_noise(of_kind(R, "clean"))),
    (
        "clean: within 1.2 of what the body itself leaves",
        "",
        lambda R: [over_least(r) <= NEAR for r in of_kind(R, "clean")],
    ),
    ("one effect, low: found", "", lambda R: [is_found(r, r["names"][0]) for r in _single(R, faint=True)]),
    ("one effect, low: nothing else named", "", lambda R: [has_no_other(r) for r in _single(R, faint=True)]),
    ("clean: nothing called unexplained", "", lambda R: [not says_unexplained(r) for r in of_kind(R, "clean")]),
    ("pairs: both found", "80 %", lambda R: [wholly_found(r) for r in of_kind(R, "pair")]),
    ("pairs: nothing else named", "", lambda R: [has_no_other(r) for r in of_kind(R, "pair")]),
    ("outside the catalogue: no wrong name", "85 %", lambda R: [r["added"] == [] for r in of_kind(R, "outside")]),
    (
        "outside, medium or high: no name, called unexplained",
        "80 %",
        lambda R: [is_open(r) for r in of_kind(R, "outside") if is_clear(r)],
    ),
    ("95 % intervals that hold the truth: one effect", "92 to 98 %", lambda R: stated(_single(R), "after")),
    ("... before the loop", "", lambda R: stated(_single(R), "before")),
    ("intervals, clean", "92 to 98 %", lambda R: stated(of_kind(R, "clean"), "after")),
    ("intervals, pairs", "92 to 98 %", lambda R: stated(of_kind(R, "pair"), "after")),
    ("intervals, outside", "92 to 98 %", lambda R: stated(of_kind(R, "outside"), "after")),
    ("intervals, all folders", "92 to 98 %", lambda R: stated(R, "after")),
    ("intervals, all folders, before the loop", "", lambda R: stated(R, "before")),
)


def _near_noise(records: Sequence[Record]) -> list[bool]:
    return [r["after"]["holdout_position"] <= NEAR for r in records]


def _single(records: Sequence[Record], faint: bool = False) -> list[Record]:
    return [r for r in of_kind(records, "single") if is_clear(r) is not faint]


def asked(parts: Mapping[str, Sequence[Record]]) -> str:
    """A row for each thing asked for, a column a part; the last with a 95 % interval of the rate (Wilson)."""
    *some, last = parts
    body = []
    for words, wanted, judged in ASKED:
        flags = judged(parts[last])
        cells = [share(judged(parts[part])) for part in some]
        body.append([words, wanted, *cells, f"{share(flags)}{_rate(flags)}"])
    return markdown(["", "asked", *some, f"{last}, and the rate's 95 % interval"], body)


def _rate(flags: Sequence[bool]) -> str:
    if not flags:
        return ""
    low, high = binomtest(sum(flags), len(flags)).proportion_ci(method="wilson")
    return f", {100 * low:.0f} to {100 * high:.0f} %"


def calibration(records: Sequence[Record]) -> str:
    """Stated probabilities and how often they were right; those that say hardly anything are left out."""
    judged = [(p, is_true(r, name)) for r in records for name, p in r.get("probabilities", {}).items()]
    body = []
    for low, high in _STATED:
        within = [(p, right) for p, right in judged if low <= p < high]
        if within:
            stated, right = np.mean(within, axis=0)
            body.append([f"{low:g} to {high:g}", f"{len(within)}", f"{100 * stated:.0f} %", f"{100 * right:.0f} %"])
    return markdown(["stated", "how often", "mean", "right"], body)


def tables(records: Sequence[Record]) -> str:
    """All of the README's."""
    failed = [r for r in records if "error" in r]
    good = [r for r in records if "error" not in r]
    seconds = [r["seconds"] for r in good]
    converged = sum(r["after"]["converged"] for r in good)
    summary = (
        f"{len(records)} folders, seeds {min(r['seed'] for r in records)} to {max(r['seed'] for r in records)}; "
        f"{converged} converged, {len(failed)} failed; {np.median(seconds):.0f} s a folder (median), "
        f"{max(seconds):.0f} s at most"
    )
    parts = [confusion, found, others, coverage, by_parameter, held_out, by_effect]
    parts += [calibration] if any("probabilities" in r for r in good) else []
    failures = [f"seed {r['seed']} ({' + '.join(r['names'])}): {r['error']}" for r in failed]
    return "\n\n".join([summary, *(part(good) for part in parts), *failures])
