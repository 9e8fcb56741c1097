"""Parameters with their intervals: by the fit, by the posterior where it was sampled, by the paper's reading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .contents import Contents
from .table import Table
from .typeset import measured, number, span, symbol, unit

LOST = "not identifiable"


def parameter_table(contents: Contents) -> Table:
    """Every parameter of the final model; one that is not identifiable gets no number."""
    every = contents.final["parameters"]
    draws = contents.get("posterior").get("parameters") or {}
    sampled = ["posterior, 95 %"] if draws else []
    head = ["", "value ± s.e.", "95 % interval", *sampled, "unit", "graph reading", "status", "meaning"]
    rows = [_row(name, p, draws.get(name) if draws else None, bool(draws)) for name, p in every.items()]
    marked = frozenset(k for k, p in enumerate(every.values()) if p["status"] == LOST)
    return Table("Parameters of the final model", head, rows, 1, marked)


def lumped_table(contents: Contents) -> Table | None:
    """Combinations that may be known where their parts are not; of the fit, so only where nothing was added to it."""
    lumps = contents.files["fit"].get("lumped") or {}
    if not lumps or contents.added:
        return None
    head = ["", "value ± s.e.", "95 % interval", "unit", "graph reading", "status", "meaning"]
    marked = frozenset(k for k, p in enumerate(lumps.values()) if p["status"] == LOST)
    return Table("Combinations", head, [_row(n, p, None, False) for n, p in lumps.items()], 1, marked)


def posterior_table(contents: Contents) -> Table | None:
    """What the sampler says of its own chains."""
    draws = contents.get("posterior").get("parameters") or {}
    keys = {"ess": "effective samples", "r_hat": "R̂", "rhat": "R̂"}
    shown = [key for key in keys if any(p.get(key) is not None for p in draws.values())]
    if not draws:
        return None
    head = ["", "mean ± s.d.", "95 % interval", "unit", *(keys[key] for key in shown)]
    rows = [
        (symbol(name), measured(p.get("mean"), p.get("sd")), span(_interval(p), p.get("sd")), unit(p.get("unit")),
         *(number(p.get(key), 4) for key in shown))
        for name, p in draws.items()
    ]  # fmt: skip
    return Table("Posterior", head, rows)


def _row(name: str, p: Mapping[str, Any], draw: Mapping[str, Any] | None, sampled: bool) -> tuple[Any, ...]:
    lost = p["status"] == LOST
    value = "–" if lost else measured(p["value"], p["stderr"])
    remark = f" ({p['remark']})" if p.get("remark") else ""
    posterior = (span(_interval(draw), draw.get("sd")) if draw else "–",) if sampled else ()
    interval = "–" if lost else span(p["ci95"], p["stderr"])
    return (symbol(name), value, interval, *posterior, unit(p["unit"]), number(p.get("reading"), 4),
            p["status"] + remark, p["meaning"])  # fmt: skip


def _interval(draw: Mapping[str, Any]) -> Any:
    return draw.get("ci95") or draw.get("interval95") or draw.get("hdi95")
