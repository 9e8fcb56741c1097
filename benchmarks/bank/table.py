"""The table: folder by folder what got worse and what got better, then the rates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from .judging import FAR, GRADES, Record, errors, grade, hold, missed, said, title, worst, wrong
from .rates import RATES, interval
from .work import Key, clock

_GROUPS = ((0.05, 0.2), (0.2, 0.5), (0.5, 0.8), (0.8, 0.95), (0.95, 1.01))  # stated probabilities
_LOST = 2  # intervals that miss, more than before, from which on a folder got worse


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def table(new: Mapping[Key, Record], old: Mapping[Key, Record] | None = None) -> str:
    """All of it, in Markdown."""
    records = [*new.values()]
    parts = [summary(records)]
    if old is not None:
        both = {k: (old[k], r) for k, r in new.items() if k in old}
        parts += [f"{len(both)} folders are in both files, by {_commits(old.values())} before.", changes(both)]
        return "\n\n".join([*parts, rates(records, [was for was, _ in both.values()]), classes(records)])
    parts += [rates(records), classes(records), parameters(records), probabilities(records), wrongs(records)]
    return "\n\n".join(parts)


def summary(records: Sequence[Record]) -> str:
    """How many, of which seeds, by which commit, at what cost."""
    seconds = np.array([r["seconds"] for r in records])
    seeds = [r["seed"] for r in records]
    failed = sum("error" in r for r in records)
    return (
        f"SYNTHETIC. {len(records)} folders, seeds {min(seeds)} to {max(seeds)}, commit {_commits(records)}; "
        f"{failed} failed; processor time {np.median(seconds):.0f} s a folder (median), {seconds.max():.0f} s at most, "
        f"{clock(seconds.sum())} in all."
    )


def _commits(records: Iterable[Record]) -> str:
    return ", ".join(sorted({r["commit"] for r in records}))


def changes(both: Mapping[Key, tuple[Record, Record]]) -> str:
    """What got worse, then what got better, a line a folder."""
    worse = [(new, why) for old, new in both.values() if (why := worsened(old, new))]
    better = [(new, why) for old, new in both.values() if not worsened(old, new) and (why := worsened(new, old))]
    lines = [f"**Worse: {len(worse)}**", "", *(f"- {title(r)}: {_now(why)}; {said(r)}" for r, why in worse)]
    lines += ["", f"**Better: {len(better)}**", "", *(f"- {title(r)}: {_was(why)}; {said(r)}" for r, why in better)]
    return "\n".join(lines)


def worsened(old: Record, new: Record) -> list[tuple[str, str, str]]:
    """In what a folder got worse: of what, before, now."""
    out = []
    if GRADES.index(grade(new)) < GRADES.index(grade(old)):
        out.append(("", grade(old), grade(new)))
    (far, _), (further, whose) = worst([old]), worst([new])
    if further >= FAR and further > far + 1.0:
        out.append(("worst |z|", f"{far:.1f}", f"{further:.1f} ({whose.partition(',')[0]})"))
    if missed(new) >= missed(old) + _LOST:
        out.append(("intervals that miss", str(missed(old)), str(missed(new))))
    if len(errors(new)) + _LOST < len(errors(old)):
        out.append(("intervals stated", str(len(errors(old))), str(len(errors(new)))))
    if old["converged"] and new["converged"] and old["converged"][-1] and not new["converged"][-1]:
        out.append(("", "converged", "not converged"))
    return out


def _now(why: Sequence[tuple[str, str, str]]) -> str:
    return ", ".join(f"{what} {now} (was {before})".strip() for what, before, now in why)


def _was(why: Sequence[tuple[str, str, str]]) -> str:
    return ", ".join(f"{what} {before} (was {now})".strip() for what, before, now in why)


def rates(records: Sequence[Record], before: Sequence[Record] | None = None) -> str:
    """A row for each rate that these folders have; `before`: the same folders of an older file."""
    rows = []
    for rate in RATES:
        if not (flags := rate.of(records)):
            continue
        low, high = interval(flags)
        cells = [rate.words, share(flags), f"{100 * low:.0f} to {100 * high:.0f} %", rate.target]
        cells += [] if before is None else [share(rate.of(before))]
        rows.append([*cells, rate.verdict(flags)])
    head = ["", "now", "its 95 % interval", "asked", *([] if before is None else ["before"]), ""]
    return markdown(head, rows)


def share(flags: Sequence[bool]) -> str:
    return f"{sum(flags)} of {len(flags)} ({100 * sum(flags) / len(flags):.0f} %)" if flags else "-"


def classes(records: Sequence[Record]) -> str:
    """A row a class: what became of its folders, how its intervals hold, what it costs."""
    rows = []
    for kind in dict.fromkeys(r["class"] for r in records):
        some = [r for r in records if r["class"] == kind]
        count = [sum(grade(r) == g for r in some) for g in reversed(GRADES)]
        z, whose = worst(some)
        apart = np.array([each for r in some for each in errors(r).values()])
        far = [f"{np.sqrt(np.mean(apart**2)):.2f}", f"{z:.1f} ({whose})"] if apart.size else ["-", "-"]
        median = f"{np.median([r['seconds'] for r in some]):.0f} s"
        cells = [*(str(n or "") for n in count), share(hold(some, "before")), share(hold(some)), *far, median]
        rows.append([kind, str(len(some)), *cells])
    head = ["class", "folders", *reversed(GRADES), "95 % hold, before", "after", "rms z", "worst z", "median"]
    return markdown(head, rows)


def parameters(records: Sequence[Record]) -> str:
    """A row a parameter, over all folders: how its intervals hold; its errors are in standard errors."""
    every: dict[str, list[tuple[float, bool]]] = {}
    for record in records:
        for symbol, each in record.get("intervals", {}).get("after", {}).items():
            if each["z"] is not None:
                every.setdefault(symbol, []).append((each["z"], each["holds"]))
    rows = []
    for symbol, some in every.items():
        z = np.array([each for each, _ in some])
        cells = [share([holds for _, holds in some]), f"{np.mean(z):+.2f}", f"{np.sqrt(np.mean(z**2)):.2f}"]
        rows.append([f"`{symbol}`", *cells, f"{np.abs(z).max():.1f}"])
    return markdown(["parameter", "95 % hold", "mean z", "rms z", "worst"], rows)


def probabilities(records: Sequence[Record]) -> str:
    """Stated probabilities in groups, and how often what they say was so."""
    judged = [(p, right) for r in records for _, p, right in r["statements"] if right is not None]
    rows = []
    for low, high in _GROUPS:
        if within := [(p, right) for p, right in judged if low <= p < high]:
            mean, right = np.mean(np.array(within, dtype=float), axis=0)
            rows.append(
                [f"{low:g} to {min(high, 1.0):g}", str(len(within)), f"{100 * mean:.0f} %", f"{100 * right:.0f} %"]
            )
    return markdown(["stated", "how often", "mean", "right"], rows)


def wrongs(records: Sequence[Record]) -> str:
    """Every folder that did not come out right, the worst first."""
    rest = sorted((r for r in records if grade(r) != "right"), key=lambda r: (GRADES.index(grade(r)), not wrong(r)))
    return "\n".join(["**Not right**", "", *(f"- {grade(r)}: {title(r)}: {said(r)}" for r in rest)])
