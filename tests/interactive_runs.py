"""Runs for the interactive page: a folder with a diagnosis and gains, and two hundred traces of a long log each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import diagnoses
import results
import runs
from etcfit.control.setpoint import trapezoid
from etcfit.diagnosis.findings import Diagnosis
from etcfit.estimation.result import FitResult
from etcfit.files import write_json
from etcfit.problem.trace import Trace
from etcfit.reporting.pictures import all_traces
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.manifest import replacing
from etcfit.run_folder.state import save_diagnosis

# of an ECU as pid.json has it
ECU = {"period_s": 1e-3, "supply_V": 12.0, "derivative_filter_s": 2e-3, "delay_s": 0.0, "pwm_V": 0.0, "noise_rad": 0.0,
       "resolution_rad": 3.84e-4, "duty_limit": 1.0, "integral_limit": None, "input_filter_s": 0.0,
       "slew_V_per_s": None, "dead_band_rad": 0.0, "setpoint_weight": 1.0, "derivative_weight": 1.0}  # fmt: skip


def pid() -> dict[str, Any]:
    """Gains of a hand-made pid.json on the paper's trapezoid."""
    course = trapezoid()
    setpoint = {"scenarios": ["trapezoid"], "times_s": course.times, "shares_of_travel": course.shares}
    return runs.pid() | {"ecu": ECU, "setpoint": setpoint, "feed_forward": False}


def run_folder(path: Path, synthetic: bool = True, gains: bool = True) -> RunFolder:
    """RUN of a hand-made diagnosis: the first model 20 sigma off, the last half a sigma."""
    return kept(path / "run", diagnoses.diagnosis(results.rig(path / "rig", synthetic)), gains)


def kept(run: Path, found: Diagnosis, gains: bool = True) -> RunFolder:
    save_diagnosis(run, found)
    if gains:
        with replacing(run, "design", 0, {}) as draft:
            write_json(draft / "pid.json", "pid", pid())
    return RunFolder(run)


def many(rig: Path, count: int, samples: int, worst: int) -> Diagnosis:
    """A hand-made diagnosis of so many traces of a response, one of them far off.

    Args:
        rig: an empty folder.
        count: traces.
        samples: of each.
        worst: number of the one that is far off.
    """
    found = diagnoses.diagnosis(results.rig(rig))
    one = next(trace for trace in all_traces(found.after) if trace.test.name == "response")
    traces = tuple(_long(one, k, samples) for k in range(count))
    before, after = (_of(result, traces, off, worst) for result, off in ((found.before, 20.0), (found.after, 0.1)))
    motion = diagnoses.motion(one.measurement.file, False, 0, samples)
    motions = tuple(replace(motion, file=trace.measurement.file) for trace in traces)
    return replace(found, before=before, after=after, motions=motions)


def _long(trace: Trace, k: int, samples: int) -> Trace:
    rng, m = np.random.default_rng(k), len(trace.channels)
    instants = 1e-3 * np.arange(samples)
    wave = np.sin(instants[:, None] * (1.0 + np.arange(m)) + 0.05 * k) + 1.0
    measurement = replace(trace.measurement, file=f"response/log_{k:03d}.csv", time=instants)
    level = 3.0 + np.where(np.sin(2.0 * instants + k) > 0.0, 2.0, -1.0) + 0.1 * np.sin(9.0 * instants)
    assert trace.input is not None
    flat = np.zeros(samples)
    signal = replace(trace.input, value=level, error=flat, memory=flat, edge=np.zeros(samples - 1, dtype=bool))
    data = 0.3 * wave + trace.sigma * rng.standard_normal((samples, m))
    return replace(trace, measurement=measurement, instants=instants, data=data, input=signal)


def _of(result: FitResult, traces: tuple[Trace, ...], off: float, worst: int) -> FitResult:
    from etcfit.problem.prediction_error import rows
    from etcfit.problem.problem import EstimationProblem

    problem = EstimationProblem.of_traces(result.rig.config, result.free_parameters, traces)
    rng, predicted = np.random.default_rng(1), {}
    for k, trace in enumerate(traces):
        noise = rng.standard_normal(trace.data.shape) + (50.0 if k == worst else off)
        predicted[trace.measurement.file] = trace.data - trace.sigma * noise
    whitened = tuple((t.data - predicted[t.measurement.file]) / t.sigma for t in traces)
    score = rows(traces, [predicted[t.measurement.file] for t in traces])
    return replace(result, problem=problem, holdout=None, predicted=predicted, whitened=whitened, score_fit=score,
                   score_holdout=())  # fmt: skip
