"""fit.json, and the parts of it that other files of the run folder share."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from importlib import metadata
from typing import Any

import numpy as np

from .. import __version__
from ..estimation.explained import Explained, by_place, explained, share_of
from ..estimation.identifiability import sentences
from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.result import FitResult
from ..files import plain
from ..model.parameters import Parameter
from ..problem.prediction_error import PredictionError
from ..rig.base import Rig

GEAR_RATIO = "gear ratio, motor turns per plate turn"


def fit_json(result: FitResult) -> dict[str, Any]:
    """The object of fit.json (docs/formats.md), and what else a reader may want to know."""
    config = result.rig.config
    return {
        "schema": "etcfit.fit/1",
        "rig": config.name,
        "synthetic": config.synthetic,
        "converged": result.converged,
        "reason": result.reason,
        "reason_code": result.reason_code,
        "model": {"effects": list(effects_of(result))},
        **known_json(result),
        "score": score_json(result),
        "not_identifiable": directions_json(result),
        "starts": plain(result.starts),
        "warnings": list(result.warnings),
        "noise": _noise(result.rig),
        "widening": plain(result.widening),
        "settings": plain(result.settings),
        "folder": result.rig.folder,
        "files": hashes(result.rig),
        "versions": versions(),
    }


def known_json(result: FitResult) -> dict[str, Any]:
    """What is known of the parameters, and what pulls at them."""
    return {
        "parameters": parameters_json(result),
        "lumped": lumped_json(result),
        **influence_json(result),
        **budget_json(result),
    }


def parameters_json(result: FitResult) -> dict[str, dict[str, Any]]:
    """Every parameter as docs/formats.md has it."""
    declared = {p.symbol: p for p in result.free_parameters.layout.parameters}
    read = readings_of(result)
    return {symbol: _parameter(declared.get(symbol), interval, read.get(symbol))
            for symbol, interval in intervals(result).items()}  # fmt: skip


def effects_of(result: FitResult) -> tuple[str, ...]:
    """Names of all effects of a fit's model, those of Eqs. 1-2 among them."""
    return tuple(effect.name for effect in result.free_parameters.layout.types)


def score_json(result: FitResult) -> dict[str, Any]:
    """Errors of a model, see docs/formats.md: of the fitted channels also what is left by the one rule
    (`estimation.goodness`)."""
    left = {(each.file, each.channel): each.left for each in result.goodness}
    fitted, held_out = (explained(rows, result.rig.measurements) for rows in (result.score_fit, result.score_holdout))
    rows = zip(result.score_fit, rows_json(result.score_fit, fitted), strict=True)
    return {
        "fit": [{**row, "left": left[own.file, own.channel]} for own, row in rows],
        "holdout": rows_json(result.score_holdout, held_out),
        "chi2_per_dof": plain(float(result.chi2_per_dof)),
        "explained": plain(share_of(fitted)),
        "explained_holdout": plain(share_of(held_out)),
    }


def rows_json(rows: Iterable[PredictionError], found: Iterable[Explained] = ()) -> list[dict[str, Any]]:
    """Free-running errors, a row of `score` each, see docs/formats.md; with the share that is explained, where it is
    known."""
    keys = ("file", "test", "channel", "unit", "n", "rms", "sigma")
    shares = by_place(found)
    return [plain({key: getattr(row, key) for key in keys}
                  | ({"explained": shares[row.file, row.channel]} if (row.file, row.channel) in shares else {}))
            for row in rows]  # fmt: skip


def readings_of(result: FitResult) -> dict[str, float]:
    """What the paper's graphs say, SI: read, not merely assumed, and finite."""
    readings = result.readings
    assumed = readings.nominal | {s for s, other in result.free_parameters.layout.ties if other in readings.nominal}
    return {s: float(v) for s, v in readings.values.items() if s not in assumed and np.isfinite(v)}


def _parameter(parameter: Parameter | None, interval: Interval, reading: float | None) -> dict[str, Any]:
    ci95 = None if interval.low is None else [interval.low, interval.high]
    return plain({
        "value": interval.value,
        "unit": parameter.unit if parameter else "1",
        "stderr": interval.stderr,
        "ci95": ci95,
        "status": interval.status,
        "reading": reading,
        "meaning": parameter.meaning if parameter else GEAR_RATIO,
        **({"remark": interval.remark} if interval.remark else {}),
    })  # fmt: skip


def lumped_json(result: FitResult) -> dict[str, dict[str, Any]]:
    read = readings_of(result)
    return {
        symbol: plain({"value": i.value, "unit": LUMPS[symbol].unit, "stderr": i.stderr,
                       "ci95": None if i.low is None else [i.low, i.high], "status": i.status,
                       "reading": read.get(symbol), "meaning": LUMPS[symbol].meaning})
        for symbol, i in lumped(result).items()
    }  # fmt: skip


def directions_json(result: FitResult) -> list[dict[str, Any]]:
    directions = result.identifiability.directions
    return [
        plain({"symbols": d.symbols, "shares": d.shares, "null": d.null, "sd": None if d.null else d.sd, "says": says})
        for d, says in zip(directions, sentences(directions, result.problem.batch.traces), strict=True)
    ]


def _noise(rig: Rig) -> list[dict[str, Any]]:
    """One entry for each sensor of each test, in SI."""
    seen: dict[tuple[str, str, float], dict[str, Any]] = {}
    for trace in rig.measurements:
        for name, channel in trace.channels.items():
            origin = "estimated" if channel.sigma_estimated else "given"
            seen.setdefault((trace.test, name, channel.sigma), {
                "test": trace.test, "channel": name, "sigma": channel.sigma, "quantum": channel.quantum,
                "origin": origin,
            })  # fmt: skip
    return plain(list(seen.values()))


def hashes(rig: Rig) -> dict[str, str]:
    """SHA-256 of every file (or data frame) that was read, by its name."""
    return dict(rig.digests)


def versions() -> dict[str, str]:
    ours = {"etcfit": __version__, "python": platform.python_version()}
    return ours | {name: metadata.version(name) for name in ("jax", "optimistix", "numpy", "scipy")}


def budget_json(result: FitResult) -> dict[str, Any]:
    """`intervals` says what they allow for; `budget` has the shares of each parameter's variance, by source."""
    budget = result.budget
    if budget is None:
        return {"intervals": "statistical only", "budget": {}}
    slope = np.abs(result.free_parameters.layout.numbers(result.x)[1])
    statistical = slope * np.sqrt(np.maximum(np.diag(budget.statistical), 0.0))
    shares = budget.shares()
    known = [s not in result.identifiability.lost for s in result.free_parameters.layout.free]
    return {
        "intervals": "statistical and stated accuracy",
        "budget": {
            symbol: plain({
                "stderr_statistical": float(statistical[k]),
                "shares": dict(zip((*budget.sources, "statistical"), shares[:, k].tolist(), strict=True)),
            })
            for k, symbol in enumerate(result.free_parameters.layout.free)
            if known[k]
        },
    }  # fmt: skip


_LEAST, _MOST = 0.5, 50  # standard errors a pull must have to be written, and how many are


def influence_json(result: FitResult) -> dict[str, Any]:
    """The keys `influence`, `only_told_by`, `contradictions` and `compromise`."""
    layout = result.free_parameters.layout
    unit = {p.symbol: p.unit for p in layout.parameters}
    return {
        "influence": [plain({"test": p.test, "file": p.file, "parameter": p.parameter, "pull": p.pull})
                      for p in result.influence.largest(_LEAST, _MOST)],
        "only_told_by": dict(result.influence.alone),
        "contradictions": [
            plain({"test": c.test, "parameter": c.parameter, "pull": c.pull, "value": c.value, "without": c.without,
                   "unit": unit[c.parameter], "p": c.p, "share": c.share})
            for c in result.contradictions
        ],
        "compromise": None if result.compromise is None else result.compromise.why,
    }  # fmt: skip
