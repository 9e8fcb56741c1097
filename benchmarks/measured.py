"""What `etcfit diagnose` makes of other people's rigs.

    ETCFIT_DATA=../shared/measured python -m benchmarks.measured kassel-throttle wintec-throttle emps bam-xl330

For each public data set: the fit of Eqs. 1-2, the rounds, and the ledger; the free-running errors of the position also
as mean absolute ones, which others state. For EMPS also the relative force error of the inverse model, the figure that
its authors publish: 4.08 and 5.98 %, and with friction told apart by direction 3.11 and 5.39 %; and both models in
EMPS's own closed loop.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import RenderableType

from benchmarks.emps_loop import closed_loop
from etcfit.backend import use_compilation_cache
from etcfit.datasets import fetch
from etcfit.diagnosis import Diagnosis, diagnose
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.problem.prediction_error import logged_unit
from etcfit.reporting.blocks import PlainTable, headed, render
from etcfit.reporting.diagnosis import diagnosis_table
from etcfit.reporting.table import of_texts
from etcfit.rig.base import Measurement, Rig
from etcfit.rig.inverse_model import equations
from etcfit.rig.reader import read_folder

# unit in which the position's error is stated, and how many of it make the unit logged
MILLIVOLTS = ("mV", 1e3)
UNITS = {"kassel-throttle": MILLIVOLTS, "wintec-throttle": MILLIVOLTS, "emps": ("mm", 1e3),
         "bam-xl330": ("deg", 180.0 / np.pi)}  # fmt: skip


def diagnosed(name: str, folder: Path) -> None:
    """Fit, diagnose, print."""
    rig = read_folder(fetch(name, folder / name))
    begin = time.perf_counter()
    result = fit(rig)
    fitted = time.perf_counter()
    diagnosis = diagnose(result)
    print(render(diagnosis_table(diagnosis)))
    print(f"{name}: fit {fitted - begin:.0f} s, diagnosis {time.perf_counter() - fitted:.0f} s")
    print(render(headed("Free-running error of the position, rms and mean absolute", free_run_errors(name, diagnosis))))
    if name == "emps":
        print(force_errors(rig))
        models = {
            "Eqs. 1-2": diagnosis.before.values,
            " + ".join(["Eqs. 1-2", *diagnosis.final]): diagnosis.after.values,
        }
        print(render(headed("EMPS in closed loop", closed_loop(models))))


def free_run_errors(name: str, diagnosis: Diagnosis) -> RenderableType:
    """Before and after, fitted and held out, each test's traces pooled."""
    unit, size = UNITS[name]
    before, after = (_misses(result) for result in (diagnosis.before, diagnosis.after))
    heads, texts = ("test", "", "traces", "rms before", "after", "mean absolute before", "after", "unit"), []
    for test, which in before:
        was, now = (size * np.concatenate(each[test, which]) for each in (before, after))
        figures = (np.sqrt(np.mean(was**2)), np.sqrt(np.mean(now**2)), np.mean(np.abs(was)), np.mean(np.abs(now)))
        texts.append((test, which, f"{len(before[test, which])}", *(f"{v:.3f}" for v in figures), unit))
    return PlainTable(of_texts("", heads, texts, 2))


def _misses(result: FitResult) -> dict[tuple[str, str], list[np.ndarray]]:
    """Measured - simulated position, free-running, in the unit logged; by test, and fitted or held out."""
    out: dict[tuple[str, str], list[np.ndarray]] = {}
    for problem in filter(None, (result.problem, result.holdout)):
        for trace in problem.batch.traces:
            at = trace.channels.index("position")
            error = trace.data[:, at] - result.predicted[trace.measurement.file][:, at]
            which = "held out" if trace.measurement.held_out else "fitted"
            seen = error[np.isfinite(error)] / logged_unit(trace, "position")[1]
            out.setdefault((trace.test.name, which), []).append(seen)
    return out


def force_errors(rig: Rig) -> str:
    """Relative force error of the inverse model fitted to the training file, with friction alike and told apart."""
    training, pulses = (next(m for m in rig.measurements if m.held_out is held) for held in (False, True))
    lines = []
    for name in ("alike", "told apart by direction"):
        apart = name != "alike"
        rows, right = _system(training, apart)
        found = np.linalg.lstsq(rows, right, rcond=None)[0]
        errors = []
        for trace in (training, pulses):
            r, y = _system(trace, apart)
            errors.append(100.0 * np.linalg.norm(y - r @ found) / np.linalg.norm(y))
        values = ", ".join(f"{v:.4g}" for v in found)
        lines.append(f"friction {name}: training {errors[0]:.2f} %, pulses {errors[1]:.2f} % ({values})")
    return "\n".join(lines)


def _system(trace: Measurement, apart: bool) -> tuple[np.ndarray, np.ndarray]:
    """Regressors: mass, viscous and dry friction, an offset (dry friction by direction); told apart, |speed| too."""
    e = equations(trace, trace.channels["torque"])
    acceleration, speed, sign = e.rows[:, 0], e.rows[:, 1], e.rows[:, 4]
    columns = [acceleration, speed, sign, np.ones_like(speed), *([np.abs(speed)] if apart else [])]
    return np.column_stack(columns), e.right


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", metavar="NAME")
    names = parser.parse_args().names
    use_compilation_cache()
    with tempfile.TemporaryDirectory() as scratch:
        for name in names:
            diagnosed(name, Path(scratch))


if __name__ == "__main__":
    main()
