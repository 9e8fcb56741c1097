"""What `etcfit diagnose` makes of other people's rigs.

    ETCFIT_DATA=../shared/measured python -m benchmarks.measured kassel-throttle emps bam-xl330

For each public data set: the fit of Eqs. 1-2, the rounds, and the ledger; for EMPS also the relative force error of the
inverse model, the figure that its authors publish: 4.08 and 5.98 %, and with friction told apart by direction 3.11 and
5.39 %.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from etcfit.backend import use_compilation_cache
from etcfit.diagnose import diagnose
from etcfit.fetch import fetch
from etcfit.fit import fit
from etcfit.report.blocks import render
from etcfit.report.diagnosis.table import diagnosis_table
from etcfit.rig.base import Measurement, Rig
from etcfit.rig.inverse_model import equations
from etcfit.rig.reader import read_folder


def diagnosed(name: str, folder: Path) -> None:
    """Fit, diagnose, print."""
    rig = read_folder(fetch(name, folder / name))
    begin = time.perf_counter()
    result = fit(rig)
    fitted = time.perf_counter()
    diagnosis = diagnose(result)
    print(render(diagnosis_table(diagnosis)))
    print(f"{name}: fit {fitted - begin:.0f} s, diagnosis {time.perf_counter() - fitted:.0f} s")
    if name == "emps":
        print(force_errors(rig))


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
