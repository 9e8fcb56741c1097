"""A fleet as `etcfit fleet` would leave it, made up: fleet.json as a dict, units.parquet as a table; no fit behind it.

theta_u ~ N(mean, C),    value_u = theta_u + stderr_u e,    a few units moved off, and from one on a step in K_s
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

import numpy as np
import pandas as pd

SYMBOLS = {"R_a": (1.5, 0.05, "ohm"), "L_a": (1.5e-3, 6e-5, "H"), "K_b": (0.0160, 3e-4, "V*s/rad"),
           "J_m": (4.0e-6, 2e-7, "kg*m**2"), "B_m": (8.0e-6, 1e-6, "N*m*s/rad"), "B_L": (2.0e-4, 3e-5, "N*m*s/rad"),
           "K_s": (0.13, 0.006, "N*m/rad"), "T_p": (0.30, 0.012, "N*m"), "T_f": (0.055, 0.006, "N*m")}  # fmt: skip
FIGURES = {"default_position": (0.12, 0.004, "rad", "where the plate rests without current"),
           "opening_time": (0.092, 0.006, "s", "from rest to 90 % of the travel at 12 V"),
           "closing_time": (0.110, 0.009, "s", "from open to 10 % of the travel at -12 V"),
           "hysteresis": (0.41, 0.03, "A", "of the current over the angle, opening less closing, mean")}  # fmt: skip
LIMITS: dict[str, tuple[float | None, float | None]] = {
    "K_s": (0.11, 0.15), "T_f": (None, 0.075), "opening_time": (None, 0.120)}  # fmt: skip
SHIFT = 1.2  # standard deviations of K_s, from 60 % of the units on
_SLACK, _DECISION = 0.5, 5.0  # of the CUSUM


@dataclass(frozen=True)
class Made:
    """What was made, and where the odd ones are."""

    content: dict[str, Any]  # fleet.json
    units: pd.DataFrame  # units.parquet
    odd: tuple[str, ...]  # names of the units that were moved off


def fleet(n: int = 60, odd: int = 3, seed: int = 4100, synthetic: bool = True) -> Made:
    """A fleet of n units with a result, `odd` of which were moved off by eight standard deviations."""
    rng = np.random.default_rng(seed)
    names = [f"unit_{k + 1:05d}" for k in range(n)]
    mean, sd = (np.array([each[k] for each in SYMBOLS.values()]) for k in (0, 1))
    matrix = _correlation(rng, len(SYMBOLS))
    score = rng.multivariate_normal(np.zeros(len(SYMBOLS)), matrix, n)
    spring = list(SYMBOLS).index("K_s")
    score[int(0.6 * n) :, spring] += SHIFT
    moved = sorted(rng.choice(n, odd, replace=False).tolist())
    for k in moved:
        score[k, rng.integers(len(SYMBOLS))] += 8.0 * rng.choice([-1.0, 1.0])
    error = 0.25 * sd * rng.uniform(0.6, 1.8, (n, len(SYMBOLS)))
    value = mean + sd * score + error * rng.standard_normal(score.shape)
    shrink = sd**2 / (sd**2 + error**2)
    shrunk = mean + shrink * (value - mean)
    columns = _Columns(names, value, error, shrunk, np.sqrt(shrink) * error)
    content = _content(rng, columns, matrix, [names[k] for k in moved], synthetic)
    return Made(content, _table(columns), tuple(names[k] for k in moved))


@dataclass(frozen=True)
class _Columns:
    """Arrays of shape (n, symbols)."""

    names: list[str]
    value: np.ndarray
    stderr: np.ndarray
    shrunk: np.ndarray
    shrunk_stderr: np.ndarray


def _correlation(rng: np.random.Generator, size: int) -> np.ndarray:
    loading = rng.normal(0.0, 0.5, (size, 2))
    loading[-2:, 0] += 1.0
    c = loading @ loading.T + np.eye(size)
    d = np.sqrt(np.diag(c))
    return c / np.outer(d, d)


def _table(c: _Columns) -> pd.DataFrame:
    n, p = c.value.shape
    status = np.full((n, p), "estimated", dtype=object)
    low, high = c.value - 1.96 * c.stderr, c.value + 1.96 * c.stderr
    value, stderr = c.value.copy(), c.stderr.copy()
    status[::17, 4] = "not identifiable"
    for each in (stderr, low, high):
        each[::17, 4] = np.nan
    return pd.DataFrame({
        "unit": np.repeat(c.names, p), "symbol": np.tile(list(SYMBOLS), n), "value": value.ravel(),
        "stderr": stderr.ravel(), "low": low.ravel(), "high": high.ravel(), "status": status.ravel(),
        "shrunk_value": c.shrunk.ravel(), "shrunk_stderr": c.shrunk_stderr.ravel(),
    })  # fmt: skip


def _content(
    rng: np.random.Generator, c: _Columns, matrix: np.ndarray, odd: Sequence[str], synthetic: bool
) -> dict[str, Any]:
    n = len(c.names)
    figures = {name: _figure(rng, c.names, *each) for name, each in FIGURES.items()}
    charts = {symbol: _chart(c, k, unit) for k, (symbol, (_, _, unit)) in enumerate(SYMBOLS.items())}
    return {
        "schema": "etcfit.fleet/1",
        "version": "0.9.0",
        "name": "line 4, week 31",
        "synthetic": synthetic,
        "units": c.names,
        "failed": [{"unit": "unit_x1", "why": "unit_x1/response/3.csv:118: time falls from 0.412 to 0.398 s. Time must "
                    "rise strictly; sort the log or split it."},
                   {"unit": "unit_x2", "why": "unit_x2: no rig test here. <b>Required</b>: one folder a rig test."}],
        "not_converged": [{"unit": c.names[5], "why": "the step limit of 200 was reached"}],
        "members": {name: _member(k, name in odd) for k, name in enumerate(c.names)},
        "population": {s: _population(c, k, s, unit) for k, (s, (_, _, unit)) in enumerate(SYMBOLS.items())},
        "uninformed": [],
        "left_out": list(odd),
        "correlation": {"symbols": list(SYMBOLS), "matrix": matrix.tolist()},
        "odd": _odd(c, odd),
        "effects": {"backlash": _effect(c.names[:: max(2, n // 3)], n, "delta", "rad", 0.01, rng),
                    "brush_voltage_drop": _effect(c.names[1::2], n, "V_b", "V", 0.6, rng)},
        "drift": [{"symbol": "K_s", "since": c.names[int(0.6 * n)], "kind": "step", "unit": "N*m/rad",
                   "size": SHIFT * SYMBOLS["K_s"][1],
                   "size_sd": SHIFT, "p": 3e-7}],
        "charts": charts,
        "capability": _capabilities(c, figures),
        "gauge": {"K_s": {"unit": "N*m/rad", "repeatability": 6e-4, "rig": 3e-4, "operator": 2e-4,
                          "reproducibility": 3.6e-4, "part": 6e-3, "total": 6.04e-3, "rr_percent": 11.6, "ndc": 12,
                          "parts": 10, "measurements": 30, "untold": []},
                  "T_f": {"unit": "N*m", "repeatability": 2e-3, "rig": 1e-3, "operator": 0.0,
                          "reproducibility": 1e-3, "part": 6e-3, "total": 6.4e-3, "rr_percent": 35.0, "ndc": 3,
                          "parts": 10, "measurements": 30, "untold": []}},
        "figures": figures,
        "predictions": [_prediction(name, kelvin, volts) for name, kelvin in (("cold", 253.15), ("hot", 373.15))
                        for volts in (9.0, 12.0, 16.0)],
        "settings": {"odd": 0.01}, "rig_toml": "", "position_noise": 0.001, "versions": {"etcfit": "0.9.0"},
    }  # fmt: skip


def _member(k: int, odd: bool) -> dict[str, Any]:
    name = f"unit_{k + 1:05d}"
    day = date(2026, 7, 27) + timedelta(days=k // 40)
    return {
        "serial": f"S{100_000 + k}", "date": day.isoformat(), "batch": f"B{k // 40 % 7}", "rig": f"rig {k % 3 + 1}",
        "operator": None if k % 11 == 0 else ("Ann", "Bo")[k % 2], "temperature": 293.15 + k % 5,
        "part": f"part {k % 10}" if k < 30 else None, "chi2_per_dof": 1.0 + 0.001 * (k % 90) + 3.0 * odd,
        "converged": k != 5, "seconds": 1.2, "warnings": [], "odd": odd,
        "page": f"units/{name}/report.html" if odd else None,
    }  # fmt: skip


def _population(c: _Columns, k: int, symbol: str, unit: str) -> dict[str, Any]:
    n, mean, sd = len(c.names), float(np.mean(c.shrunk[:, k])), float(np.std(c.shrunk[:, k], ddof=1))
    low, high = LIMITS.get(symbol, (None, None))
    sides = [abs(limit - mean) / (3.0 * sd) for limit in (low, high) if limit is not None]
    half, wide = 1.96 * sd / n**0.5, 1.96 * sd / (2.0 * n) ** 0.5
    return {"mean": mean, "sd": 0.0 if symbol == "K_b" else sd, "mean_ci95": [mean - half, mean + half],
            "sd_ci95": None if symbol == "K_b" else [sd - wide, sd + wide], "unit": unit,
            "cpk": min(sides) if sides else None, "shared": symbol == "K_b",
            "informed": n - len(range(0, n, 17)) * (k == 4)}  # fmt: skip


def _odd(c: _Columns, odd: Sequence[str]) -> list[dict[str, Any]]:
    mean, sd = c.value.mean(axis=0), c.value.std(axis=0)
    z = (c.value - mean) / sd
    inverse = np.linalg.inv(np.corrcoef(z, rowvar=False))
    distance = np.sqrt(np.einsum("ij,jk,ik->i", z, inverse, z))
    found = []
    for name in sorted(odd, key=lambda each: -distance[c.names.index(each)]):
        k = c.names.index(name)
        worst = list(SYMBOLS)[int(np.argmax(np.abs(z[k])))]
        score = float(z[k, list(SYMBOLS).index(worst)])
        found.append({"unit": name, "distance": float(distance[k]), "rank": len(SYMBOLS), "rate": 0.001,
                      "drives": {worst: 1.0}, "misfit": 4.0, "p": 10.0 ** -float(distance[k]),
                      "symbols": [worst], "scores": {worst: score},
                      "traces": [{"file": "response/1.csv", "misfit": 3.1, "z": 8.0}],
                      "why": f"{worst} is {abs(score):.1f} sd {'above' if score > 0 else 'below'} the others; "
                             "response/1.csv is explained 3.1 times worse than its noise"})  # fmt: skip
    return found


def _effect(
    units: Sequence[str], n: int, symbol: str, unit: str, size: float, rng: np.random.Generator
) -> dict[str, Any]:
    strength = {name: float(size * np.exp(0.3 * rng.standard_normal())) for name in units}
    median = float(np.median(list(strength.values())))
    return {"units": list(units), "of": n, "median": median, "unit": unit, "symbol": symbol, "strength": strength}


def _chart(c: _Columns, k: int, unit: str) -> dict[str, Any]:
    value, head = c.value[:, k], max(8, int(0.4 * len(c.names)))
    centre, sd = float(np.median(value[:head])), float(np.std(value, ddof=1))
    z, high, low = (value - centre) / sd, [0.0], [0.0]
    for each in np.clip(z, -4.0, 4.0):
        high.append(max(0.0, high[-1] + each - _SLACK))
        low.append(max(0.0, low[-1] - each - _SLACK))
    return {"unit": unit, "order": c.names, "value": value.tolist(), "stderr": c.stderr[:, k].tolist(),
            "centre": centre, "lower": centre - 3.0 * sd, "upper": centre + 3.0 * sd, "cusum_high": high[1:],
            "cusum_low": low[1:], "decision": _DECISION, "sd": sd, "run_length": 470.0}  # fmt: skip


def _figure(
    rng: np.random.Generator, names: Sequence[str], mean: float, sd: float, unit: str, meaning: str
) -> dict[str, Any]:
    value = rng.normal(mean, sd, len(names))
    low, high = np.quantile(value, [0.025, 0.975]).tolist()
    told: dict[str, float | None] = dict(zip(names, value.tolist(), strict=True))
    told[names[-1]] = None
    return {"meaning": meaning, "unit": unit, "mean": float(value.mean()), "sd": float(value.std(ddof=1)), "low": low,
            "high": high, "told": len(names) - 1, "why": "it never gets there", "value": told}  # fmt: skip


def _capabilities(c: _Columns, figures: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, (low, high) in LIMITS.items():
        if name in figures:
            mean, sd, unit = figures[name]["mean"], figures[name]["sd"], figures[name]["unit"]
        else:
            k = list(SYMBOLS).index(name)
            mean, sd, unit = float(c.shrunk[:, k].mean()), float(c.shrunk[:, k].std(ddof=1)), SYMBOLS[name][2]
        sides = [abs(limit - mean) / (3.0 * sd) for limit in (low, high) if limit is not None]
        cp = None if low is None or high is None else (high - low) / (6.0 * sd)
        found[name] = {"low": low, "high": high, "unit": unit, "mean": mean, "sd": sd, "cp": cp,
                       "cp_ci95": None if cp is None else [0.9 * cp, 1.1 * cp], "cpk": min(sides),
                       "cpk_ci95": [0.9 * min(sides), 1.1 * min(sides)], "outside": 2.3e-4,
                       "outside_ci95": [1e-5, 3e-3]}  # fmt: skip
    return found


def _prediction(name: str, kelvin: float, volts: float) -> dict[str, Any]:
    time = 0.092 * (12.0 / volts) * (kelvin / 293.15) ** 0.4
    more = {"told": 60, "why": ""}
    return {"condition": f"{name}, {volts:g} V", "winding_C": kelvin - 273.15, "supply_V": volts, "friction": 1.0,
            "figures": {"opening_time": {"mean": time, "sd": 0.1 * time, "low": 0.85 * time, "high": 1.2 * time,
                                         "unit": "s", **more},
                        "default_position": {"mean": 0.12, "sd": 0.004, "low": 0.112, "high": 0.128, "unit": "rad",
                                             **more}}}  # fmt: skip
