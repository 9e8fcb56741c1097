"""All pictures of a fit: where each goes in RUN/pictures and how it is drawn, in the order of interest."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from ..estimation.intervals import LUMPS, Interval, intervals, lumped
from ..estimation.joint_fit import FitResult
from ..model.effects import EFFECT_BY_NAME
from ..problem.trace import Trace
from ..rig import TEST_BY_NAME
from ..rig.paper_readings import known
from ..run_folder.fit import readings_of
from . import graphs, overview, traces
from .drawing import Job
from .numbers import Digits, short
from .table_2 import beside
from .tables import model_words

_BRIEF = 36  # letters of a model's name in a title


def summary(result: FitResult) -> list[Job]:
    """The picture that sums up a fit, as `jobs` has it."""
    return [(Path("parameters.png"), partial(overview.draw, parameter_picture(result)))]


def jobs(result: FitResult) -> list[Job]:
    """Every picture: path below RUN/pictures, and the call that draws it."""
    every = all_traces(result)
    tests = dict.fromkeys(trace.test.name for trace in every)
    return [
        *summary(result),
        *((Path("tests") / f"{name}.png", partial(graphs.draw, _test_picture(result, name))) for name in tests),
        *((Path("traces") / file_name(trace), partial(traces.draw, _trace_picture(result, k)))
          for k, trace in enumerate(every)),
    ]  # fmt: skip


def all_traces(result: FitResult) -> tuple[Trace, ...]:
    """Fitted traces, then those held out."""
    held_out = result.holdout.batch.traces if result.holdout is not None else ()
    return (*result.problem.batch.traces, *held_out)


def briefly(result: FitResult) -> str:
    """The model as a title has room for it: whole, without what is the rig's, or with its effects counted."""
    whole = model_words(result)
    first, *others = whole.split(" + ")
    of_throttle = " + ".join([first, *(name for name in others if name in EFFECT_BY_NAME)])
    return next((each for each in (whole, of_throttle) if len(each) <= _BRIEF), f"{first} + {counted(others)}")


def counted(effects: Sequence[str]) -> str:
    """ "2 effects"."""
    return f"{len(effects)} effect{'s' if len(effects) > 1 else ''}"


def file_name(trace: Trace) -> str:
    """Of a trace's picture."""
    return f"{trace.test.name}__{PurePosixPath(trace.measurement.file).stem}.png"


def _trace_picture(result: FitResult, k: int) -> traces.TracePicture:
    trace = all_traces(result)[k]
    file = trace.measurement.file
    predicted = result.predicted[file]
    if k < len(result.whitened):
        residual, label = result.whitened[k], "error [σ]" if result.far else "whitened\nresidual [σ]"
    else:
        residual, label = (trace.data - predicted) / np.asarray(trace.sigma)[None, :], "error [σ]"
    rows = tuple(row for row in (*result.score_fit, *result.score_holdout) if row.file == file)
    synthetic = result.rig.config.synthetic
    return traces.TracePicture(trace, predicted, residual, label, rows, synthetic, briefly(result))


def _test_picture(result: FitResult, name: str) -> graphs.TestPicture:
    test, config = TEST_BY_NAME[name], result.rig.config
    every = tuple(trace for trace in all_traces(result) if trace.test.name == name)
    read, scales = result.readings.graphs.get(name, ()), known(config, result.readings.values)
    predicted = {trace.measurement.file: result.predicted[trace.measurement.file] for trace in every}
    model = graphs.read_model(test, every, predicted, config, scales) if read else ()
    lines = _lines(result, name)
    return graphs.TestPicture(test, read, model, every, predicted, lines, config.synthetic, briefly(result))


def _lines(result: FitResult, test: str) -> tuple[str, ...]:
    """What this test's graph said of its parameters, and what the fit says."""
    known_, units, read = intervals(result) | lumped(result), _units(result), readings_of(result)
    return tuple(
        f"{symbol} [{units[symbol] or '1'}]: reading {short(read[symbol], 4)}, fit {_fitted(known_[symbol])}"
        for symbol, origin in result.readings.source.items()
        if origin == test and symbol in read and symbol in known_
    )


def _fitted(interval: Interval) -> str:
    if interval.status == "not identifiable":
        return "not identifiable"
    digits = Digits.of(interval.value, interval.spread)
    return digits(interval.value) + ("" if interval.stderr is None else f" ± {digits(interval.stderr)}")


def _units(result: FitResult) -> dict[str, str]:
    declared = {p.symbol: p.unit for p in result.free_parameters.layout.parameters}
    return declared | {"N": "1"} | {symbol: lump.unit for symbol, lump in LUMPS.items()}


def parameter_picture(result: FitResult) -> overview.ParameterPicture:
    config = result.rig.config
    every = intervals(result) | lumped(result)
    read, table_2 = readings_of(result), beside(config)
    model, units = model_words(result), _units(result)
    return overview.ParameterPicture(config.name, model, every, units, read, table_2, config.synthetic)
