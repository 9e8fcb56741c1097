"""All pictures of a fit: paths in RUN/pictures and drawing functions; the picture of all parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import FitResult
from ..model.effects import EFFECT_BY_NAME
from ..model.paper import TABLE_2
from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from ..rig import TEST_BY_NAME
from ..rig.base import RigConfig
from ..rig.paper_readings import known
from ..run_folder.fit import readings_of
from . import style, traces
from .drawing import Job
from .numbers import counted, is_share, short, with_error
from .tables import model_words

_AT_THE_MOTOR = {"K_b": 1, "K_m": 1, "B_m": 2}  # symbol -> power of N that refers it to the plate


def beside(config: RigConfig) -> dict[str, float]:
    """Values of Table 2 to compare with this rig's parameters, SI by symbol, with combinations.

    Empty for a rig that is no plate between two stops. If the gear ratio is not known, the rig's motor is described
    at the plate, and so is the table's. J_m and J_L are left out: they contradict the J_eq printed with them.
    """
    if not all(map(math.isfinite, config.travel)):
        return {}
    n = TABLE_2["N"]
    combined = {symbol: lump.formula(TABLE_2, n) for symbol, lump in LUMPS.items()}
    printed = {symbol: value for symbol, value in TABLE_2.items() if symbol not in ("J_m", "J_L", "N")}
    if not config.gear_ratio_given:
        printed |= {symbol: n**power * TABLE_2[symbol] for symbol, power in _AT_THE_MOTOR.items()}
    return combined | printed


_LINEAR = 0.1  # per cent of the fitted value: range about zero in which the axis is linear, not logarithmic
_EDGE = 100.0  # per cent
_TICKS = (-100.0, -10.0, -1.0, -0.1, 0.0, 0.1, 1.0, 10.0, 100.0)


@dataclass(frozen=True)
class _Mark:
    """Style of a value that is not the fit's; fields are matplotlib's."""

    label: str
    marker: str
    color: str
    markerfacecolor: str
    markersize: float


_READING = _Mark("graph reading", "o", style.READING, style.READING, 8.0)
# larger than a reading, so that an arrow is visible behind another
_TABLE_2 = _Mark("the paper's Table 2: another rig", "s", style.MEASURED, "white", 9.5)

_INTERVAL: dict[str, Any] = {"color": style.SIMULATED, "label": "fit, 95 % interval"}
_RANGE: dict[str, Any] = {
    "color": style.SIMULATED,
    "alpha": 0.35,
    "label": "compromise: range that subsets of the data give",
}


@dataclass(frozen=True, eq=False)
class ParameterPicture:
    """Contents of the picture of the parameters."""

    rig: str
    model: str  # the model in words
    intervals: Mapping[str, Interval]  # intervals by symbol
    units: Mapping[str, str]  # SI units by symbol
    readings: Mapping[str, float]  # readings, SI by symbol
    # values of the paper's table, for another rig: neither true values nor measurements of this one; SI by symbol
    table_2: Mapping[str, float]
    synthetic: bool  # whether the data are synthetic


def draw_parameters(picture: ParameterPicture) -> Figure:
    """One row per free parameter: its 95 % interval, and the distances of reading and Table 2 from the fitted value.

    Shares of a single rig test, such as a place between two samples, are left out: per cent of a value near 0 have no
    meaning.
    """
    free = {s: i for s, i in picture.intervals.items() if i.status in ("estimated", "not identifiable", "compromise")}
    shown = {s: i for s, i in free.items() if not is_share(s, picture.units[s])}
    title = f"{picture.rig}  ·  parameters of {picture.model}"
    fig, panel = style.titled(title, 1.6 + 0.42 * max(1, len(shown)), (0.2, 0.64), picture.synthetic)
    panel.axvline(0.0, color="black", lw=0.8)
    others = [(picture.table_2, _TABLE_2), (picture.readings, _READING)]
    for row, (symbol, interval) in enumerate(shown.items()):
        _row(panel, row, interval)
        for values, mark in others:
            _mark(panel, row, interval, values.get(symbol), mark)
        text = _words(interval, picture.units[symbol])
        panel.text(1.02, row, text, transform=panel.get_yaxis_transform(), va="center", fontsize=10)
    _axes(panel, list(shown))
    known = {symbol for symbol, interval in shown.items() if interval.low is not None}
    for values, mark in reversed(others):
        if values.keys() & known:
            panel.plot([], [], ls="none", **vars(mark))
    style.legend_above(fig, panel)
    return fig


def _row(panel: Axes, row: int, interval: Interval) -> None:
    if interval.low is None or interval.high is None or interval.value == 0.0:
        panel.axhspan(row - 0.4, row + 0.4, color=style.BAND, lw=0)
        return
    low, high = (_relative(end, interval.value) for end in (interval.low, interval.high))
    look = _RANGE if interval.status == "compromise" else _INTERVAL
    panel.plot([low, high], [row, row], lw=5, solid_capstyle="butt", **look)


def _mark(panel: Axes, row: int, interval: Interval, value: float | None, mark: _Mark) -> None:
    """Another value of the parameter; a value beyond the edge is an arrow there, which is not in the legend."""
    if value is None or interval.low is None or interval.value == 0.0:
        return
    distance = _relative(value, interval.value)
    marker = mark.marker if abs(distance) < _EDGE else ("<" if distance < 0 else ">")
    look = replace(mark, marker=marker, label="")
    panel.plot(np.clip(distance, -_EDGE, _EDGE), row, ls="none", clip_on=False, **vars(look))


def _relative(value: float, fitted: float) -> float:
    return 100.0 * (value - fitted) / abs(fitted)


def _words(interval: Interval, unit: str) -> str:
    if interval.status == "not identifiable":
        return "not identifiable"
    remarks = [interval.remark] if interval.remark else []
    remarks += ["compromise"] if interval.status == "compromise" else []
    return ", ".join([f"{with_error(interval.value, interval.stderr, interval.spread)} {unit}", *remarks])


def _axes(panel: Axes, symbols: list[str]) -> None:
    panel.set_xscale("symlog", linthresh=_LINEAR, linscale=0.6)
    panel.set_xlim(-_EDGE, _EDGE)
    panel.xaxis.set_major_locator(FixedLocator(_TICKS))
    panel.xaxis.set_minor_locator(FixedLocator([]))
    panel.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    panel.set_yticks(range(len(symbols)), symbols)
    panel.set_ylim(len(symbols) - 0.4, -0.6)
    panel.set_xlabel("distance from the fitted value [%]")


_BRIEF = 36  # largest number of letters of a model's name in a title


def summary(result: FitResult) -> list[Job]:
    """The summary picture of a fit, from `jobs`."""
    return [(Path("parameters.png"), partial(draw_parameters, parameter_picture(result)))]


def jobs(result: FitResult) -> list[Job]:
    """Every picture: path below RUN/pictures, and the call that draws it."""
    every = all_traces(result)
    tests = dict.fromkeys(trace.test.name for trace in every)
    return [
        *summary(result),
        *((Path("tests") / f"{name}.png", partial(traces.draw_test, _test_picture(result, name))) for name in tests),
        *((Path("traces") / file_name(trace), partial(traces.draw_trace, _trace_picture(result, k)))
          for k, trace in enumerate(every)),
    ]  # fmt: skip


def all_traces(result: FitResult) -> tuple[Trace, ...]:
    """Fitted traces, then held-out ones."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    return (*result.problem.batch.traces, *held_out)


def errors_of(result: FitResult, file: str) -> tuple[PredictionError, ...]:
    """Errors of one trace, one per channel."""
    return tuple(row for row in (*result.score_fit, *result.score_holdout) if row.file == file)


def briefly(result: FitResult) -> str:
    """The model for a title: complete, without rig effects, or with the number of effects."""
    whole = model_words(result)
    first, *others = whole.split(" + ")
    of_throttle = " + ".join([first, *(name for name in others if name in EFFECT_BY_NAME)])
    brief = f"{first} + {counted(len(others), 'effect')}"
    return next((each for each in (whole, of_throttle) if len(each) <= _BRIEF), brief)


def file_name(trace: Trace) -> str:
    """Title of a trace's picture."""
    return f"{trace.test.name}__{PurePosixPath(trace.measurement.file).stem}.png"


def _trace_picture(result: FitResult, k: int) -> traces.TracePicture:
    trace = all_traces(result)[k]
    file = trace.measurement.file
    predicted = result.predicted[file]
    if k < len(result.whitened):
        residual, label = result.whitened[k], "error [σ]" if result.far else "whitened\nresidual [σ]"
    else:
        residual, label = (trace.data - predicted) / np.asarray(trace.sigma)[None, :], "error [σ]"
    synthetic = result.rig.config.synthetic
    return traces.TracePicture(trace, predicted, residual, label, errors_of(result, file), synthetic, briefly(result))


def _test_picture(result: FitResult, name: str) -> traces.TestPicture:
    test, config = TEST_BY_NAME[name], result.rig.config
    every = tuple(trace for trace in all_traces(result) if trace.test.name == name)
    read, scales = result.readings.graphs.get(name, ()), known(config, result.readings.values)
    predicted = {trace.measurement.file: result.predicted[trace.measurement.file] for trace in every}
    model = traces.read_model(test, every, predicted, config, scales) if read else ()
    lines = _lines(result, name)
    return traces.TestPicture(test, read, model, every, predicted, lines, config.synthetic, briefly(result))


def _lines(result: FitResult, test: str) -> tuple[str, ...]:
    """The readings of this test's parameters from its graph, and their fitted values."""
    known_, units, read = intervals(result) | lumped(result), _units(result), readings_of(result)
    return tuple(
        f"{symbol} [{units[symbol] or '1'}]: reading {short(read[symbol], 4)}, fit {_fitted(known_[symbol])}"
        for symbol, origin in result.readings.source.items()
        if origin == test and symbol in read and symbol in known_
    )


def _fitted(interval: Interval) -> str:
    if interval.status == "not identifiable":
        return "not identifiable"
    return with_error(interval.value, interval.stderr, interval.spread)


def _units(result: FitResult) -> dict[str, str]:
    declared = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    return declared | {"N": "1"} | {symbol: lump.unit for symbol, lump in LUMPS.items()}


def parameter_picture(result: FitResult) -> ParameterPicture:
    config = result.rig.config
    every = intervals(result) | lumped(result)
    read, table_2 = readings_of(result), beside(config)
    model, units = model_words(result), _units(result)
    return ParameterPicture(config.name, model, every, units, read, table_2, config.synthetic)
