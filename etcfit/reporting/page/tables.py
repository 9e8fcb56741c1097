"""The page's tables of the model: parameters by fit, posterior and reading; free-running errors of test and channel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from ..html import Table, measured, number, span, symbol, unit
from ..pool import Pool, grouped
from .contents import Contents, rows_of

LOST, COMPROMISE = "not identifiable", "compromise"


def parameter_table(contents: Contents) -> Table:
    """Every parameter of the final model; one that is not identifiable gets no number."""
    every = contents.final["parameters"]
    rows, marked = [_row(name, p) for name, p in every.items()], _lost(every)
    unsure = any(p["status"] == COMPROMISE for p in every.values())
    return Table("Parameters of the final model" + (_RANGES if unsure else ""), _HEAD, rows, 1, marked)


def influence_table(contents: Contents) -> Table | None:
    """The largest pulls of whole tests and of single traces; of the final model."""
    pulls = contents.final.get("influence") or ()
    rows = [(p["test"].replace("_", " "), p["file"] or "all of it", symbol(p["parameter"]), number(p["pull"]))
            for p in pulls[:_PULLS]]  # fmt: skip
    head = ["test", "left out", "parameter", "moves by, standard errors"]
    return Table("Influence: what leaving out a test or a trace would move most", head, rows, 3) if rows else None


_PULLS = 10  # shown
_RANGES = "; of a compromise the interval is the range that subsets of the data give, not a statistical one"


def lumped_table(contents: Contents) -> Table | None:
    """Combinations that may be known where their parts are not; of the fit, so only where nothing was added to it."""
    lumps = contents.files["fit"].get("lumped") or {}
    if not lumps or contents.added:
        return None
    return Table("Combinations", _HEAD, [_row(name, p) for name, p in lumps.items()], 1, _lost(lumps))


def posterior_table(contents: Contents) -> Table | None:
    """What was sampled, beside the fit's standard error and the profile; what the sampler says of its own chains."""
    posterior = contents.get("posterior")
    draws = posterior.get("parameters") or {}
    if not draws:
        return None
    exact = _AS_EXACT if posterior.get("exact") else ""
    apart = frozenset(k for k, p in enumerate(draws.values()) if p.get("apart"))
    differ = "; in red where fit, profile and posterior differ by more than 20 % in width" if apart else ""
    shown = [name for name, cell in _SAMPLED.items() if any(cell(p) for p in draws.values())]
    rows = [(symbol(name), *(_SAMPLED[head](p) for head in shown)) for name, p in draws.items()]
    return Table(f"Posterior{exact}{differ}", ["", *shown], rows, 1, apart)


_AS_EXACT = ", formulas of effects taken as exact (the intervals above allow for inexact ones)"
_HEAD = ["", "value ± s.e.", "95 % interval", "unit", "graph reading", "status", "meaning"]
_SAMPLED: dict[str, Callable[[Mapping[str, Any]], Any]] = {
    "mean ± s.d.": lambda p: measured(p.get("mean"), p.get("sd")),
    "95 % interval": lambda p: span(p.get("ci95"), p.get("sd")),
    "unit": lambda p: unit(p.get("unit")),
    "s.d. / fit’s s.e.": lambda p: number(p["sd"] / p["laplace_sd"]) if p.get("sd") and p.get("laplace_sd") else "",
    "profile": lambda p: (p.get("profile") or {}).get("kind", ""),
    "effective samples": lambda p: number(p.get("ess"), 4),
    "R̂": lambda p: number(p.get("r_hat"), 4),
    "meaning": lambda p: p.get("meaning", ""),
}


def _lost(every: Mapping[str, Mapping[str, Any]]) -> frozenset[int]:
    return frozenset(k for k, p in enumerate(every.values()) if p["status"] in (LOST, COMPROMISE))


def _row(name: str, p: Mapping[str, Any]) -> tuple[Any, ...]:
    lost = p["status"] == LOST
    value, interval = ("–", "–") if lost else (measured(p["value"], p["stderr"]), span(p["ci95"], p["stderr"]))
    remark = f" ({p['remark']})" if p.get("remark") else ""
    return (symbol(name), value, interval, unit(p["unit"]), number(p.get("reading"), 4), p["status"] + remark,
            p["meaning"])  # fmt: skip


Key = tuple[str, str, str]


def ledger_table(contents: Contents) -> Table:
    """Held-out traces first, then the fitted ones; each channel of each test pooled over its traces."""
    diagnosis = contents.get("diagnosis")
    if not diagnosis:
        return _alone(contents.files["fit"]["score"])
    head = ["test", "channel", "", "traces", "before", "after", "unit", "before, σ", "after, σ"]
    rows = [
        (test, channel.replace("_", " "), which, was.traces, number(was.rms), number(now.rms), unit(of),
         number(was.ratio), number(now.ratio))
        for which, part in (("held out", "holdout"), ("fitted", "fit"))
        for (test, channel, of), was, now in _pairs(diagnosis["before"][part], diagnosis["after"][part])
    ]  # fmt: skip
    return Table("Free-running error, rms, before and after the diagnosis; σ is the noise of one sample", head, rows, 3)


def _alone(score: Mapping[str, Any]) -> Table:
    head = ["test", "channel", "", "traces", "rms", "unit", "rms, σ"]
    rows = [
        (test, channel.replace("_", " "), which, pool.traces, number(pool.rms), unit(of), number(pool.ratio))
        for which, part in (("held out", "holdout"), ("fitted", "fit"))
        for (test, channel, of), pool in _pools(score[part]).items()
    ]
    return Table("Free-running error of the fit, rms; σ is the noise of one sample", head, rows, 3)


def _pairs(before: Any, after: Any) -> Iterable[tuple[Key, Pool, Pool]]:
    shared = {row["file"] for row in after}  # a trace of another rig has no error afterwards
    was, now = _pools([row for row in before if row["file"] in shared]), _pools(after)
    return ((key, was[key], now[key]) for key in was if key in now)


def _pools(rows: Any) -> dict[Key, Pool]:
    return {key: Pool.of(group) for key, group in grouped(rows_of(rows)).items()}
