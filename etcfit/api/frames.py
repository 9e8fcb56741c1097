"""Results as DataFrames: numbers as float64, NaN where nothing is known, words as str."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from ..diagnosis.findings import Diagnosis
from ..estimation.intervals import LUMPS, Interval
from ..estimation.result import FitResult
from ..problem.prediction_error import PredictionError


def units_of(result: FitResult) -> dict[str, str]:
    """SI unit of every parameter and combination, by symbol."""
    declared = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    return declared | {"N": "1"} | {symbol: lump.unit for symbol, lump in LUMPS.items()}


def numbers(values: Iterable[float | None]) -> np.ndarray:
    """float64, NaN for None, shape (n,)."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def words(values: Iterable[str]) -> pd.Series:
    """Of dtype str, also where there are none."""
    return pd.Series(list(values), dtype="str")


def interval_frame(known: Mapping[str, Interval], units: Mapping[str, str]) -> pd.DataFrame:
    """A row a symbol: value, stderr, low, high (SI, 95 %), unit, status; NaN where there is no interval."""
    rows = list(known.values())
    columns = {key: numbers(getattr(row, key) for row in rows) for key in ("value", "stderr", "low", "high")}
    texts = {"unit": [units[s] for s in known], "status": [row.status for row in rows]}
    return indexed(columns | {key: words(text) for key, text in texts.items()}, list(known))


def influence_frame(result: FitResult) -> pd.DataFrame:
    """A row a test and a trace left out, and a parameter: pull (standard errors of noise alone), the largest first.

    Columns: test, file (None where the whole test is left out), parameter, pull.
    """
    pulls = result.influence.pulls
    texts = {"test": words(p.test for p in pulls), "file": pd.Series([p.file for p in pulls], dtype="object")}
    return pd.DataFrame(
        texts | {"parameter": words(p.parameter for p in pulls), "pull": numbers(p.pull for p in pulls)}
    )


def contradiction_frame(result: FitResult) -> pd.DataFrame:
    """A row a test that the others contradict, worst first: parameter that it pulls most, pull, value, without (SI)."""
    every = result.contradictions
    figures = {key: numbers(getattr(c, key) for c in every) for key in ("pull", "value", "without", "p", "share")}
    return indexed({"parameter": words(c.parameter for c in every)} | figures, [c.test for c in every], "test")


def indexed(columns: Mapping[str, Any], names: Sequence[str], index: str = "symbol") -> pd.DataFrame:
    """Columns under names for their rows."""
    frame = pd.DataFrame(dict(columns))
    frame.index = pd.Index(list(names), dtype="str", name=index)
    return frame


def _placed(columns: Mapping[str, Any], rows: Sequence[PredictionError]) -> pd.DataFrame:
    """Columns under file and channel."""
    frame = pd.DataFrame({key: np.asarray(value) if isinstance(value, list) else value
                          for key, value in columns.items()})  # fmt: skip
    frame.index = pd.MultiIndex.from_arrays(
        [words(row.file for row in rows), words(row.channel for row in rows)], names=["file", "channel"]
    )
    return frame


def score_frame(result: FitResult) -> pd.DataFrame:
    """Free-running error, one row a file and channel, fitted traces first.

    Columns: test, held_out, unit, n (samples), rms and sigma (in that unit), in_sigma (rms / sigma).
    """
    rows = (*result.score_fit, *result.score_holdout)
    rms, sigma = numbers(row.rms for row in rows), numbers(row.sigma for row in rows)
    return _placed(_where(result, rows) | {"rms": rms, "sigma": sigma, "in_sigma": rms / sigma}, rows)


def _where(result: FitResult, rows: Sequence[PredictionError]) -> dict[str, Any]:
    fitted = len(result.score_fit)
    return {
        "test": words(row.test for row in rows),
        "held_out": np.arange(len(rows)) >= fitted,
        "unit": words(row.unit or "1" for row in rows),
        "n": np.array([row.n for row in rows], dtype=np.int64),
    }


def ledger_frame(diagnosis: Diagnosis) -> pd.DataFrame:
    """Free-running error of the first and of the final model, one row a file and channel, fitted traces first.

    Columns: test, held_out, unit, n (samples), sigma (noise of one sample), before and after (rms, in that unit),
    before_in_sigma and after_in_sigma (over that noise).
    """
    was, now = diagnosis.before, diagnosis.after
    rows = (*was.score_fit, *was.score_holdout)
    later = {(row.file, row.channel): row.rms for row in (*now.score_fit, *now.score_holdout)}
    sigma, before = numbers(row.sigma for row in rows), numbers(row.rms for row in rows)
    after = numbers(later.get((row.file, row.channel)) for row in rows)
    columns = {"sigma": sigma, "before": before, "after": after,
               "before_in_sigma": before / sigma, "after_in_sigma": after / sigma}  # fmt: skip
    return _placed(_where(was, rows) | columns, rows)


def candidate_frame(diagnosis: Diagnosis) -> pd.DataFrame:
    """Every effect that was tried, one row a round and effect: what it promised, and what refitting with it came to."""
    every = [(k, each, c) for k, each in enumerate(diagnosis.rounds, start=1) for c in each.candidates]
    keys = ("screened", "fit_rms_ratio", "holdout_rms_ratio", "holdout_chi2_change", "bic_change")
    frame = pd.DataFrame({key: numbers(getattr(c, key) for _, _, c in every) for key in keys})
    frame.insert(0, "added", np.array([c.effect == each.added for _, each, c in every], dtype=bool))
    frame.index = pd.MultiIndex.from_arrays(
        [np.array([k for k, _, _ in every], dtype=np.int64), words(c.effect for _, _, c in every)],
        names=["round", "effect"],
    )
    return frame
