"""What is asked of the bank as a whole (issue 37, section 3): a rate, its interval, its target."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from scipy.stats import binomtest

from .judging import (
    FAR,
    HABITS,
    SURE,
    Record,
    errors,
    found,
    grade,
    hold,
    is_faint,
    is_right,
    says_unexplained,
    worst,
    wrong,
)

Flags = list[bool]
AT_09, AT_07 = (0.85, 0.95), (0.6, 0.8)  # what counts as stated at 0.9, and at 0.7


@dataclass(frozen=True)
class Rate:
    """One rate.

    Args:
        words: what is counted.
        low, high: between which it must lie; None, None where nothing is asked.
        of: the flags that it is the share of.
    """

    words: str
    low: float | None
    high: float | None
    of: Callable[[Sequence[Record]], Flags]

    @property
    def target(self) -> str:
        """In words."""
        if self.low is None or self.high is None:
            return ""
        low, high = f"{100 * self.low:.0f}", f"{100 * self.high:.0f} %"
        if self.high >= 1.0:
            return f"at least {low} %" if self.low < 1.0 else "all"
        return f"at most {high}" if self.low <= 0.0 else f"{low} to {high}"

    def verdict(self, flags: Flags) -> str:
        """Whether the target is met, and whether so few folders can tell; at least one flag."""
        if self.low is None or self.high is None:
            return ""
        share = sum(flags) / len(flags)
        low, high = interval(flags)
        if self.low <= share <= self.high:
            return "met" if self.low <= low and high <= self.high else "met, few"
        return "**missed**" if high < self.low or low > self.high else "**missed**, few"


def interval(flags: Flags) -> tuple[float, float]:
    """95 %, of Wilson; flags of one folder are taken as independent, which intervals of one fit are not quite."""
    low, high = binomtest(sum(flags), len(flags)).proportion_ci(method="wilson")
    return float(low), float(high)


def of(records: Sequence[Record], *classes: str) -> list[Record]:
    """Of these classes, what failed left out of them never: a folder that broke is one more that is not right."""
    return [r for r in records if r["class"] in classes]


def diagnosed(records: Sequence[Record]) -> list[Record]:
    return [r for r in records if r["class"] != "ecu"]


def clear(records: Sequence[Record]) -> list[Record]:
    """One effect, medium or strong."""
    return [r for r in of(records, "single") if not is_faint(r)]


def faint(records: Sequence[Record]) -> list[Record]:
    return [r for r in of(records, "single") if is_faint(r)]


def silent(record: Record) -> bool:
    """Read, and no name."""
    return "error" not in record and not record["named"]


def first(record: Record) -> bool:
    """What is there was named first, or cannot be told from it."""
    return bool(record["named"]) and record["named"][0]["right"]


def whole(record: Record) -> bool:
    """All that is there was named."""
    return len(found(record)) == len(record["truth"]["names"])


def are_told(record: Record) -> bool:
    """Whether the model with all that is there, fitted by hand, shows each effect that was missed; records that do not
    say so count as if it did."""
    missed = record.get("missed")
    return not missed or (missed["chi2"] is not None and all(e["tell"] for k, e in missed.items() if k != "chi2"))


def by_checks(record: Record) -> bool:
    """The rig's checks found the mistake, at its place, or refused the data by its name."""
    before = [n for n in record["named"] if n.get("before_any_fit")]
    return any(is_right(record["truth"], each) for each in (*before, *_findings(record)))


def alarms(record: Record) -> list[str]:
    """What the rig's checks found that is not there; an effect may be a habit of the rig as well, and rightly named."""
    there = {HABITS.get(name) for name in record["truth"]["names"]}
    there |= {"synchronous_edges"} if record["truth"]["edges"] else set()
    there |= {"slow_log"} if record["class"] == "slow" else set()
    return [each["kind"] for each in _findings(record) if each["kind"] not in there]


def _findings(record: Record) -> list[dict[str, Any]]:
    return [{"name": each["kind"], **each} for each in record["check"]["found"]]


def stated(records: Sequence[Record], low: float, high: float) -> Flags:
    """Whether statements of this probability were right."""
    every = (s for r in records for s in r["statements"])
    return [right for _, p, right in every if right is not None and low <= p <= high]


def gains(told: str) -> Callable[[Sequence[Record]], Flags]:
    """Intervals of logs under an ECU, by how its gains are told."""
    return lambda R: hold([r for r in of(R, "ecu") if r["truth"]["names"] == [told]])


RATES: tuple[Rate, ...] = (
    Rate("clean: left alone", 0.97, 1.0, lambda R: [silent(r) for r in of(R, "clean")]),
    Rate("clean: not called unexplained", 0.95, 1.0, lambda R: [not says_unexplained(r) for r in of(R, "clean")]),
    Rate("one clear effect: named first", 0.95, 1.0, lambda R: [first(r) for r in clear(R)]),
    Rate("one clear effect: named, and nothing else", None, None, lambda R: [grade(r) == "right" for r in clear(R)]),
    Rate("one faint effect: no wrong name", None, None, lambda R: [not wrong(r) for r in faint(R)]),
    Rate("pairs: both named", 0.80, 1.0, lambda R: [whole(r) for r in of(R, "pair")]),
    Rate("pairs: both named, where the data tell both", None, None,
         lambda R: [whole(r) for r in of(R, "pair") if whole(r) or are_told(r)]),
    Rate("pairs: no wrong name", None, None, lambda R: [not wrong(r) for r in of(R, "pair")]),
    Rate("outside: no wrong name", 0.90, 1.0, lambda R: [silent(r) for r in of(R, "outside")]),
    Rate("outside, clear: called unexplained", None, None,
         lambda R: [says_unexplained(r) for r in of(R, "outside") if not is_faint(r)]),
    Rate("mistakes of the rig: named", 0.95, 1.0, lambda R: [whole(r) for r in of(R, "mistake")]),
    Rate("mistakes of the rig: no wrong name", None, None, lambda R: [not wrong(r) for r in of(R, "mistake")]),
    Rate("mistakes of the rig: found by its checks", None, None, lambda R: [by_checks(r) for r in of(R, "mistake")]),
    Rate("no mistake: none found by the rig's checks", None, None,
         lambda R: [not any(alarms(r)) for r in diagnosed(R) if r["class"] != "mistake"]),
    Rate("slow logs: no name", None, None, lambda R: [silent(r) for r in of(R, "slow")]),
    Rate("slow logs: found by the rig's checks", None, None,
         lambda R: ["slow_log" in {each["kind"] for each in _findings(r)} for r in of(R, "slow")]),
    Rate("edges on samples: what is there, alone", None, None, lambda R: [grade(r) == "right" for r in of(R, "edges")]),
    Rate("all folders: a wrong name at 0.8 or more", 0.0, 0.02, lambda R: [bool(wrong(r, SURE)) for r in diagnosed(R)]),
    *(Rate(f"95 % intervals hold: {words}", 0.93, 0.97, lambda R, kind=kind: hold(of(R, kind)))
      for kind, words in (("clean", "clean"), ("single", "one effect"), ("pair", "pairs"), ("outside", "outside"),
                          ("mistake", "mistakes"), ("slow", "slow logs"), ("edges", "edges on samples"))),
    *(Rate(f"95 % intervals hold: `[ecu]`, gains {t}", 0.92, 0.98, gains(t)) for t in ("known", "scaled", "free")),
    Rate("stated at 0.9 (0.85 to 0.95): right", 0.86, 0.94, lambda R: stated(R, *AT_09)),
    Rate("stated at 0.7 (0.6 to 0.8): right", 0.62, 0.78, lambda R: stated(R, *AT_07)),
    Rate("all folders: no parameter 5 standard errors off", 1.0, 1.0,
         lambda R: [worst([r])[0] < FAR for r in R if errors(r)]),
)  # fmt: skip
