"""Tables of one log, as the page and the terminal both show them: cells are text."""

from __future__ import annotations

from collections.abc import Sequence

from ...car_log import Study
from ...car_log.criteria import Judgement, Verdict
from ..numbers import short
from ..page.table import Table

_MOST = 20  # steps that a table shows, the least good ones
_NAMES = {"good": "good", "not good": "NOT GOOD", "cannot be said": "not known"}


def tables_of(each: Study) -> tuple[Table, ...]:
    """Verdict, steps, parts of the travel, duty, and both sensors: those that the log has."""
    every = (judgements_table(each.verdict.judgements), _steps(each), _ranges(each), _duty(each), _settings(each))
    return tuple(table for table in every if table is not None and table.rows)


def says_of(each: Study) -> tuple[str, ...]:
    """What the tables do not hold: sentences on the oscillation at rest and on the pair of sensors."""
    cycle = () if each.cycle is None else (each.cycle.says,)
    pair = () if each.sensors is None else each.sensors.findings
    return (*cycle, *pair)


def judgements_table(judgements: Sequence[Judgement], caption: str = "Good enough?") -> Table:
    """A row a threshold."""
    rows = [(j.name, _found(j), f"{'>=' if j.at_least else '<='} {j.limit:.3g} {j.unit}", _NAMES[j.word], j.where,
             j.source) for j in judgements]  # fmt: skip
    marked = frozenset(k for k, j in enumerate(judgements) if j.word == "not good")
    return Table(caption, ("figure", "found", "good is", "verdict", "where", "threshold from"), rows, 6, marked)


def in_a_word(verdict: Verdict) -> str:
    """The verdict without figures: "Not good enough: overshoot, lag."."""
    bad = [each.name for each in verdict.judgements if each.word == "not good"]
    if bad:
        return f"Not good enough: {', '.join(bad)}."
    return "Good enough." if verdict.word == "good" else "Whether it is good enough cannot be said."


def _found(each: Judgement) -> str:
    return "-" if each.value is None else "never" if each.value == float("inf") else short(each.value)


def _steps(each: Study) -> Table:
    worst = sorted(each.steps, key=lambda s: (-s.settling, -s.overshoot))[:_MOST]
    rows = [(f"{s.begin:.2f}", f"{s.before:.1f}", f"{s.after:.1f}", short(s.overshoot, 2),
             "never" if s.settling == float("inf") else f"{1e3 * s.settling:.0f}",
             "-" if s.lag is None else f"{1e3 * s.lag:.0f}", f"{s.error:+.2f}", short(s.rms, 2))
            for s in sorted(worst, key=lambda s: s.begin)]  # fmt: skip
    more = f", the {_MOST} slowest of {len(each.steps)}" if len(each.steps) > _MOST else ""
    return Table(f"Steps of the setpoint{more}",
                 ("at s", "from %", "to %", "overshoot % of step", "settling ms", "half way ms",
                  "error at rest %", "rms %"), rows, 0)  # fmt: skip


def _ranges(each: Study) -> Table | None:
    if each.tracking is None:
        return None
    rows = [
        (f"{r.low:.0f} to {r.high:.0f}", short(r.seconds), short(r.rmse), f"{r.mean:+.2f}")
        for r in each.tracking.ranges
    ]
    return Table("Error by parts of the travel", ("setpoint %", "s", "rms %", "mean %"), rows, 1)


def _duty(each: Study) -> Table | None:
    d = each.duty
    if d is None:
        return None
    at = "none seen" if d.limit is None else f"{d.limit:.3g} %"
    rows = [
        ("lowest .. highest", f"{d.lowest:.3g} .. {d.highest:.3g} %"),
        ("restless at rest (standard deviation)", "-" if d.activity is None else f"{d.activity:.2g} %"),
        ("from sample to sample at rest", "-" if d.jitter is None else f"{d.jitter:.2g} %"),
        ("limit", at),
        ("at its limit", f"{100.0 * d.saturated:.2g} % of the time, {d.longest:.2g} s at the longest"),
    ]
    return Table("Duty", ("figure", "found"), rows, 2)


def _settings(each: Study) -> Table | None:
    if each.sensors is None:
        return None
    rows = [(s.ecu, s.name, f"{s.value:g}", s.unit) for s in each.sensors.table]
    return Table("Both sensors: what to type into the ECU", ("ECU", "setting", "value", "unit"), rows, 2)
