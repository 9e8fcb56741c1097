"""Output of `etcfit drive`: tables for page and terminal; with --foretold, a log and the prediction of `etcfit
tune`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ...car_log import Study, record_next
from ...car_log.criteria import Judgement, Verdict
from ...car_log.foretold import Comparison, Figure
from ...car_log.study import verdict
from ...car_log.usage import SHARE
from ...rig.base import RigConfig
from ..blocks import dashed, rig_title, shown, spaced, stacked
from ..numbers import between, or_never, short
from ..table import Cell, Column, Kind, Notes, Table, of_texts

_MOST = 20  # largest number of steps in a table, the worst ones
_NAMES = {"good": "good", "not good": "NOT GOOD", "cannot be said": "not known"}


def tables_of(each: Study) -> tuple[Table, ...]:
    """Verdict, steps, parts of the travel, duty, and both sensors, as far as the log has them."""
    every = (judgements_table(each.verdict.judgements), _steps(each), _ranges(each), _duty(each), _settings(each))
    return tuple(table for table in every if table is not None and table.rows)


def says_of(each: Study) -> tuple[str, ...]:
    """Sentences in addition to the tables: oscillation at rest, and the pair of sensors."""
    cycle = () if each.cycle is None else (each.cycle.says,)
    pair = () if each.sensors is None else each.sensors.findings
    return (*cycle, *pair)


def judgements_table(judgements: Sequence[Judgement]) -> Table:
    """One row per threshold."""
    rows = [(j.name, _found(j), _limit(j), _judged(_NAMES[j.word], j), j.where, j.source) for j in judgements]
    kinds: dict[str, Kind] = {"verdict": "word", "where": "prose", "threshold from": "prose"}
    return of_texts("Good enough?", ("figure", "found", "good is", *kinds), rows, 1, kinds, ("threshold from", "where"),
                    file=_FILE)  # fmt: skip


def _judged(word: str, each: Judgement) -> Cell:
    return Cell(word, "bad" if each.word == "not good" else "")


def in_a_word(verdict: Verdict) -> str:
    """The verdict without figures: "Not good enough: overshoot, lag."."""
    bad = [each.name for each in verdict.judgements if each.word == "not good"]
    if bad:
        return f"Not good enough: {', '.join(bad)}."
    if verdict.word != "good":
        return "Whether it is good enough cannot be said."
    unknown = [each.name for each in verdict.judgements if each.word == "cannot be said"]
    return f"Good enough in what this log shows; not known: {', '.join(unknown)}." if unknown else "Good enough."


def _found(each: Judgement) -> str:
    return "-" if each.value is None else or_never(each.value)


def _steps(each: Study) -> Table:
    worst = sorted(each.steps, key=lambda s: (-s.settling, -s.overshoot))[:_MOST]
    rows = [(f"{s.begin:.2f}", f"{s.before:.1f}", f"{s.after:.1f}", short(s.overshoot, 2),
             "never" if s.settling == float("inf") else f"{1e3 * s.settling:.0f}",
             "-" if s.lag is None else f"{1e3 * s.lag:.0f}", f"{s.error:+.2f}", short(s.rms, 2))
            for s in sorted(worst, key=lambda s: s.begin)]  # fmt: skip
    more = f", the {_MOST} slowest of {len(each.steps)}" if len(each.steps) > _MOST else ""
    heads = ("at s", "from %", "to %", "overshoot % of step", "settling ms", "half way ms", "error at rest %", "rms %")
    return of_texts(f"Steps of the setpoint{more}", heads, rows, 0, spare=("rms %", "half way ms"), file=_FILE)


def _ranges(each: Study) -> Table | None:
    if each.tracking is None:
        return None
    rows = [
        (f"{r.low:.0f} to {r.high:.0f}", short(r.seconds), short(r.rmse), f"{r.mean:+.2f}")
        for r in each.tracking.ranges
    ]
    return of_texts("Error by parts of the travel", ("setpoint %", "s", "rms %", "mean %"), rows)


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
    return of_texts("Duty", ("figure", "found"), rows, 2)


def _settings(each: Study) -> Table | None:
    if each.sensors is None:
        return None
    rows = [(s.ecu, s.name, f"{s.value:g}", s.unit) for s in each.sensors.table]
    return of_texts("Both sensors: what to type into the ECU", ("ECU", "setting", "value", "unit"), rows, 2,
                    {"unit": "word"})  # fmt: skip


_FILE = "drive.json of --out RUN"


def drive_table(config: RigConfig, studies: Sequence[Study]) -> RenderableType:
    """One row per log, then each log compared with the thresholds; for two logs also the changes."""
    logs = [each.log for each in studies]
    # the names in the file: a pedal taken for the plate shows here
    columns = [f"{log.name}: " + ", ".join(f"{quantity} '{header}'" for quantity, header in log.columns.items())
               for log in logs if log.columns]  # fmt: skip
    to_record = [f"{lack.name} ({lack.found:.3g} of {lack.needed:g} {lack.unit}): {lack.record}. "
                 f"It determines {lack.why}"
                 for lack in record_next(logs)]  # fmt: skip
    return stacked(
        rig_title(config, "logs from the car"),
        logs_table(studies),
        Notes("Columns that were taken", columns),
        Notes("What to look at", [f"{log.name}: {log.hint}" for log in logs if log.hint]),
        *(part for each in studies for part in _answer(each)),
        spaced(Text(f"{logs[0].name} -> {logs[1].name}: {verdict(*studies)}")) if len(studies) == 2 else None,
        Notes("To record next, on the bench as closed_loop/ or from the car", to_record),
    )  # fmt: skip


_CHANGES: dict[str, Kind] = {"figure": "prose", "good is": "prose", "verdict": "word"}


def compared_table(config: RigConfig, before: Study, after: Study) -> RenderableType:
    """Changes from one log to the other: the verdict, then one row per figure."""
    was = {each.name: each for each in before.verdict.judgements}
    rows = []
    for now in after.verdict.judgements:
        if (then := was.get(now.name)) is None or (then.value is None and now.value is None):
            continue
        limits = dict.fromkeys(_limit(each) for each in (then, now))  # that of the tracking error depends on the log
        words = dict.fromkeys(_NAMES[each.word] for each in (then, now))  # a single word if nothing changed
        rows.append((now.name, " / ".join(limits), _judged(" -> ".join(words), now), _found(then), _found(now)))
    heads = ("figure", "good is", "verdict", "before", "after")
    return stacked(
        rig_title(config, "two logs from the car"),
        spaced(Text(f"{before.log.name} -> {after.log.name}: {verdict(before, after)}")),
        of_texts("What changed", heads, rows, 1, _CHANGES, file=_FILE),
        Notes("At rest, and both sensors",
              [f"{each.log.name}: {said}" for each in (before, after) for said in says_of(each)]),
    )  # fmt: skip


def _limit(each: Judgement) -> str:
    return f"{'>=' if each.at_least else '<='} {each.limit:.3g} {each.unit}"


def good_enough(each: Study) -> Table:
    """One log compared with the thresholds, with the findings at rest and on its sensors."""
    return replace(
        judgements_table(each.verdict.judgements), title=f"{each.log.name}: good enough?", notes=says_of(each)
    )


def _answer(each: Study) -> Iterator[RenderableType]:
    yield spaced(Text(f"{each.log.name}: {in_a_word(each.verdict)}", style="bold"))
    yield from dashed(says_of(each))
    yield from (shown(replace(one, title=f"{each.log.name}: {one.title}")) for one in tables_of(each))


def logs_table(studies: Sequence[Study]) -> Table:
    """One row per log."""
    return Table("In per cent of the travel; +-: one standard error", (
        Column("log", "log", "path"), Column("length", lambda row: f"{row['seconds']:.0f} s", spare=7),
        Column("between %", lambda row: "{:g}..{:g}".format(*row["study"].usage.bounds), spare=5),
        Column("share of time %", lambda row: f"{100.0 * row['share_between']:.1f}"),
        Column(f"{100 * SHARE:.0f} % of time within %",
               lambda row: "{:.1f} .. {:.1f}".format(*row["study"].usage.shortest)),
        Column("dominant Hz", "dominant_hz", spare=6),
        Column("half of power below Hz", lambda row: _fixed(row["half_hz"], 2), spare=3),
        Column("RMSE %", lambda row: _fixed(row["rmse_pct"], 2)),
        Column("RMSE +- %", lambda row: _spread(row["rmse_stderr"], 0.01)),
        Column("lag ms", lambda row: _fixed(row["lag_s"], 0, 1e3)),
        Column("lag +- ms", lambda row: _spread(row["lag_stderr"] if row["lag_s"] is not None else None, 0.1, 1e3)),
        # relative to the setpoint delayed by the lag
        Column("RMSE without lag %", "left_pct", spare=4), Column("setpoint moves %/s", "demand_pct_s", spare=2),
        Column("verdict", lambda row: in_a_word(row["study"].verdict), "word", spare=1)),
        [_row(each) for each in studies], file=_FILE)  # fmt: skip


def _row(each: Study) -> dict[str, Any]:
    """A record of a log; None for figures that it does not determine."""
    follows, tones = each.tracking, each.spectrum
    return {
        "log": each.log.name,
        "seconds": float(np.ptp(each.log.position.time)),
        "share_between": each.usage.between,
        "dominant_hz": tones and tones.dominant,
        "half_hz": tones and tones.half,
        "rmse_pct": follows and follows.rmse,
        "rmse_stderr": follows and follows.stderr,
        "lag_s": follows and follows.lag,
        "lag_stderr": follows and follows.lag_stderr,
        "left_pct": follows and follows.left,
        "demand_pct_s": follows and follows.demand,
        "study": each,
    }


def _fixed(value: float | None, decimals: int, scale: float = 1.0) -> str:
    return "-" if value is None else f"{scale * value:.{decimals}f}"


def _spread(stderr: float | None, least: float, scale: float = 1.0) -> str:
    """A standard error, with no more decimals than its figure."""
    if stderr is None:
        return "-"
    return short(scale * stderr, 2) if scale * stderr >= 0.5 * least else f"<{least:g}"


@dataclass(frozen=True)
class Held:
    """One log compared with the prediction for its gains."""

    log: str  # name of its file
    run: Path  # run folder of `etcfit tune`
    made_with: str  # name of the step in `tuned`
    tuned: Mapping[str, Any]  # the object of tune.json
    found: Comparison  # the comparison

    @property
    def says(self) -> str:
        """Whether the log is as predicted, and what follows."""
        gains = f"the {self.made_with.replace('_', '-')} gains"
        if self.found.as_foretold:
            meant = "the model can be trusted with the next step" if self.made_with != "proposed" else "keep them"
            return f"As foretold for {gains}: {', '.join(map(_figure_found, self.found.figures))}. So {meant}."
        off = [f"{_figure_found(each)}, foretold {between(each.low, each.high)}"
               for each in self.found.figures if not each.as_foretold]  # fmt: skip
        off += ["the plate tracks no better than with the gains before"] if self.found.better is False else []
        said = f"Not as foretold for {gains}: {'; '.join(off)}."
        if self.found.unchanged:
            said += " The error is that of the gains before."
        return said


def foretold_table(held: Held) -> RenderableType:
    """One row per figure: predicted, allowed range, found."""
    levels = held.tuned["large_steps"]
    rows = [(f"{figure.name}, {figure.unit}", between(figure.low, figure.high), _as_foretold(figure),
             or_never(figure.found),
             "as foretold" if figure.as_foretold else Cell("NOT as foretold", "bad"))
            for figure in held.found.figures]  # fmt: skip
    gains = f"the {held.made_with.replace('_', '-')} gains"
    title = (f"{held.log}: {held.found.steps} steps from {levels['low_pct']:g} to {levels['high_pct']:g} % of the "
             f"travel and back, beside what {held.run} foretold for {gains}")  # fmt: skip
    heads = ("figure", "foretold", "as foretold", "in this log", "verdict")
    return shown(of_texts(title, heads, rows, 1, {"verdict": "word"}))


def _as_foretold(figure: Figure) -> str:
    if not isfinite(figure.most):
        return "any"
    return between(figure.least, figure.most) if isfinite(figure.least) else f"<= {short(figure.most)}"


def _figure_found(figure: Figure) -> str:
    return f"{figure.name} {or_never(figure.found)}" + (f" {figure.unit}" if isfinite(figure.found) else "")
