"""fit.json, declared: every key, what it means and what of a fit it is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..estimation.agreement import Pull
from ..estimation.contradiction import Contradiction
from ..estimation.explained import Explained, by_place, explained, share_of
from ..estimation.identifiability import sentences
from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.result import FitResult, Reason, StartSummary
from ..problem.prediction_error import PredictionError
from ..rig.base import Rig
from .declared import CONVERGED, MODEL, REASON, SYMBOL, WARNINGS, Record, by_name, file_of, key, list_of, record_of

GEAR_RATIO = "gear ratio, motor turns per plate turn"
STATUSES = ["estimated", "fixed", "tied", "not identifiable", "compromise"]  # of a parameter
_STATISTICAL, _STATED = "statistical only", "statistical and stated accuracy"
_LEAST, _MOST = 0.5, 50  # standard errors a pull must have to be written, and how many are


def ends(interval: Interval) -> list[float] | None:
    """[low, high]; None where there is none."""
    return None if interval.low is None or interval.high is None else [interval.low, interval.high]


def readings_of(result: FitResult) -> dict[str, float]:
    """What the paper's graphs say, SI: read, not merely assumed, and finite."""
    readings = result.readings
    assumed = readings.nominal | {s for s, other in result.free_parameters.layout.ties if other in readings.nominal}
    return {s: float(v) for s, v in readings.values.items() if s not in assumed and np.isfinite(v)}


def rows_of(rows: Iterable[PredictionError], found: Iterable[Explained] = ()) -> list[dict[str, Any]]:
    """Free-running errors, with the share that is explained where it is known."""
    shares, own = by_place(found), [((row.file, row.channel), vars(row)) for row in rows]
    return [row | ({"explained": shares[place]} if place in shares else {}) for place, row in own]


def budget_of(result: FitResult) -> dict[str, dict[str, Any]]:
    """Of each free parameter that is known its standard error without [accuracy] of rig.toml, and the shares of its
    variance, by source; {} where rig.toml has none."""
    budget = result.budget
    if budget is None:
        return {}
    slope = np.abs(result.free_parameters.layout.numbers(result.x)[1])
    statistical = slope * np.sqrt(np.maximum(np.diag(budget.statistical), 0.0))
    shares, names = budget.shares(), (*budget.sources, "statistical")
    return {
        symbol: {
            "stderr_statistical": float(statistical[k]),
            "shares": dict(zip(names, shares[:, k].tolist(), strict=True)),
        }
        for k, symbol in enumerate(result.free_parameters.layout.free)
        if symbol not in result.identifiability.lost
    }


def described(result: FitResult, found: Mapping[str, Interval]) -> dict[str, dict[str, Any]]:
    """Intervals by symbol, each with unit, meaning and reading."""
    read, declared = readings_of(result), {p.symbol: p for p in result.free_parameters.layout.parameters} | LUMPS
    return {
        s: vars(each) | {
            "ci95": ends(each),
            "unit": declared[s].unit if s in declared else "1",
            "meaning": declared[s].meaning if s in declared else GEAR_RATIO,
            "reading": read.get(s),
        }
        for s, each in found.items()
    }  # fmt: skip


def score_of(result: FitResult) -> dict[str, Any]:
    """Of the fitted channels also what is left by the one rule (`estimation.goodness`)."""
    left = {(each.file, each.channel): each.left for each in result.goodness}
    fitted, held_out = (explained(rows, result.rig.measurements) for rows in (result.score_fit, result.score_holdout))
    return {
        "fit": [row | {"left": left[row["file"], row["channel"]]} for row in rows_of(result.score_fit, fitted)],
        "holdout": rows_of(result.score_holdout, held_out),
        "chi2_per_dof": result.chi2_per_dof,
        "explained": share_of(fitted),
        "explained_holdout": share_of(held_out),
    }


def _directions(result: FitResult) -> list[dict[str, Any]]:
    directions = result.identifiability.directions
    said = sentences(directions, result.problem.batch.traces)
    return [vars(each) | {"null": each.null, "says": says} for each, says in zip(directions, said, strict=True)]


def _contradictions(result: FitResult) -> list[dict[str, Any]]:
    unit = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    return [vars(each) | {"unit": unit[each.parameter]} for each in result.contradictions]


def _sensors(rig: Rig) -> list[dict[str, Any]]:
    """One entry for each sensor of each test, in SI."""
    seen: dict[tuple[str, str, float], dict[str, Any]] = {}
    for trace in rig.measurements:
        for name, channel in trace.channels.items():
            seen.setdefault((trace.test, name, channel.sigma), vars(channel) | {"test": trace.test, "channel": name})
    return list(seen.values())


PARAMETER = Record(
    "One parameter, SI.", "parameter",
    value=key("number?", "At the optimum. Of a parameter that is not identifiable it is where the search stopped, and "
        "means nothing."),
    unit=key("text", "SI unit."),
    stderr=key("number?", "Standard error; null where it is fixed or not identifiable."),
    ci95=key("[number]?", "95 % interval [low, high]; null where there is none. Where status is compromise: the range "
        "that subsets of the data give, not a statistical interval.", minItems=2, maxItems=2),
    status=key("text", "estimated; fixed (given in rig.toml); tied (equal to another parameter); not identifiable "
        "(these data do not tell it); compromise (the model is far from its data, so the value is a compromise "
        "between its errors).", enum=STATUSES),
    reading=key("number?", "What the paper's method of reading graphs gives; null where it reads nothing."),
    meaning=key("text", "In words."),
    remark=key("text", "What else must be known of it, such as: at its bound, or K_m = K_b. Absent where there is "
        "nothing to say.", lambda each: each["remark"] or None, optional=True),
)  # fmt: skip
PULL = record_of(Pull, without=("moved",))
CONTRADICTION = record_of(
    Contradiction, without=("moved",), shares=("p", "share"), unit=key("text", "SI unit of value and without.")
)
BUDGET = Record(
    "One parameter.",
    stderr_statistical=key("number?", "Standard error without the instruments' accuracy, SI."),
    shares=key("{number}", "Share of the variance by source: \"scale of current\", \"zero of position\", \"gear "
        "ratio\", \"statistical\"; they add up to 1."),
).closed()  # fmt: skip
ROW = record_of(
    PredictionError,
    null=("rms",),
    ref="row",
    n=key("whole", "Samples compared.", minimum=0),
    explained=key("number?", "1 - sum (y - y_hat)^2 / sum (y - mean y)^2; null: the channel hardly moves, or was not "
        "logged itself.", optional=True),
    left=key("text", "What is left in a fitted channel. fits: noise, and the free run within 3 sigma; strays: noise, "
        "the free run further off; more: larger than its noise, or not independent; far: a mean squared residual of 2 "
        "or more.", optional=True, enum=["fits", "strays", "more", "far"]),
)  # fmt: skip
SCORE = Record(
    fit=key(list_of(ROW), "Of the fitted traces."),
    holdout=key(list_of(ROW), "Of the traces held out: never fitted, only predicted."),
    chi2_per_dof=key("number?", "Sum of squares of the whitened residual over the degrees of freedom: 1 where the "
        "model explains the data up to their noise."),
    explained=key("number?", "Share of the motion that is explained, all fitted traces together: of position, else of "
        "speed; null where nothing moves."),
    explained_holdout=key("number?", "Likewise of the traces held out."),
)  # fmt: skip
DIRECTION = Record(
    "One direction.",
    symbols=key("[text]", "The parameters it mixes, largest share first."),
    shares=key("[number]", "Their shares."),
    null=key("flag", "The data do not determine it at all."),
    sd=key("number?", "Standard deviation along it, relative; null where the data say nothing.",
        lambda found: None if found["null"] else found["sd"]),
    says=key("text", "The same in words, with the measurement that would tell."),
)  # fmt: skip
START = record_of(StartSummary, null=("chi2_before", "chi2_after"))
SENSOR = Record(
    "One sensor.",
    test=key("text", "Rig test."),
    channel=key("text", "Quantity."),
    sigma=key("number", "Standard deviation of one sample."),
    quantum=key("number", "Resolution of the logger; 0 where none is seen."),
    origin=key("text", "given in rig.toml, or estimated from the data.",
        lambda sensor: "estimated" if sensor["sigma_estimated"] else "given", enum=["given", "estimated"]),
)  # fmt: skip
AGREEMENT = Record(
    influence=key(list_of(PULL), "What leaving a rig test, or one file of it, out would do to each parameter; the "
        "largest first. Half a standard error at least, 50 entries at most.",
        lambda result: result.influence.largest(_LEAST, _MOST)),
    only_told_by=key("{text}", "By symbol: the rig test, or the file, that alone tells this parameter. Nothing checks "
        "it there, and leaving it out has no figure.", "influence.alone"),
    contradictions=key(list_of(CONTRADICTION), "Rig tests that the others contradict, worst first; empty where none "
        "does.", _contradictions),
    compromise=key("text?", "Why parameters are a compromise; null where they are estimates.", "compromise.why"),
)  # fmt: skip
FIT = file_of(
    "The joint fit of all traces: written by `etcfit fit`.",
    "rig.config", "", "rig",
    converged=CONVERGED,
    reason=REASON,
    reason_code=key("text?", "The same for programs; null where no joint fit judged the end.", optional=True,
        enum=[*map(str, Reason), None]),
    model=key(MODEL, "The model.", ""),
    parameters=key(by_name(PARAMETER), "By symbol, every parameter of the model, of the tests' circuits "
        "(series_ohm.TEST), and the gear ratio N.", lambda result: described(result, intervals(result)),
        propertyNames=SYMBOL),
    lumped=key(by_name(PARAMETER), "By symbol, combinations that may be known where their parts are not: J_eq, B_eq, "
        "and in volts V_PL, V_f, V_s, V_w.", lambda result: described(result, lumped(result)), propertyNames=SYMBOL),
    **AGREEMENT.keys,
    intervals=key("text", "What the intervals allow for; the latter where rig.toml has [accuracy].",
        lambda result: _STATISTICAL if result.budget is None else _STATED, enum=[_STATISTICAL, _STATED]),
    budget=key(by_name(BUDGET), "Where the uncertainty of each free parameter that is known comes from; {} where "
        "intervals are statistical only.", budget_of),
    score=key(SCORE, "How well the fitted model predicts, running free.", score_of),
    not_identifiable=key(list_of(DIRECTION), "Combinations of parameters that these data determine badly or "
        "not at all, worst first.", _directions),
    starts=key(list_of(START), "Where each start of the fit began and ended."),
    warnings=WARNINGS,
    noise=key(list_of(SENSOR), "The noise assumed of each sensor of each test, SI.",
        lambda result: _sensors(result.rig)),
    widening=key("{number?}", "By symbol: factor by which intervals were widened, because residuals are larger than "
        "their noise or not independent."),
    settings=key("object", "What the fit decided by: every field of `etcfit.FitSettings`."),
)  # fmt: skip
