"""`etcfit tune` on cars of the independent generator: better on the true plant, worse on none?

    python -m benchmarks.cars --cars 20 --first-seed 9000 --out cars.json --page docs/validation/tune.md

Each car is a throttle body, an ECU of 500 Hz with poor gains, and its own log of 100 to 1000 Hz (`independent/cars.py`,
which shares no code with the model). `tune` sees the log, the make of ECU and the present gains. Its gains, and the
half-way ones, are put into the generator's own ECU on the generator's own plant, which follows another setpoint than
that of the log: mean absolute and rms tracking error, before and after. Where `tune` gives no gains, what it withholds
is tried all the same (`--anyway`), and counted apart.

A figure within 2 % of the one before is neither better nor worse. Cars that `--out` holds are not run again.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from etcfit.api.tuned import TuneRequest, tune_logs
from etcfit.backend import use_compilation_cache
from etcfit.run_folder.folder import RunFolder
from independent.cars import Car, draw_car, log_of, tracking_errors, write_log

from .page import Between
from .processes import resumed

TABLE = Between.named("cars")
SAME = 0.02  # share of a figure within which it is neither better nor worse
WITHHELD = "not from this log"


def run(seed: int) -> dict[str, Any]:
    """One car."""
    use_compilation_cache()
    begun, worked = time.perf_counter(), time.process_time()
    car = draw_car(seed)
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "log.csv"
        write_log(log, log_of(car, seed))
        asked = TuneRequest("rusefi", (car.gains,), anyway=True)
        found = tune_logs([log], RunFolder(Path(scratch) / "run"), asked)
    row: dict[str, Any] = {
        "rate": car.rate,
        "in_step": car.in_step,
        "model": found.input.model,
        "stopped": found.why_not,
        "compromise": bool(found.result is not None and found.result.state.cautions),
        "withheld": list(found.doubts),
        "chi2": None if found.result is None else found.result.state.chi2_per_dof,
        "borne": [each.worst for each in found.borne],
        "explained": found.explained[0],
        "held_out_rms": found.held_out_error,
        "present": _errors(car, car.gains, seed),
    }
    for step in found.steps[1:]:
        gains = found.written(step.gains)
        row[step.name] = _errors(car, (float(gains.P), float(gains.I), float(gains.D)), seed)
        row[f"promised_{step.name}"] = step.better
    return row | {"seconds": time.perf_counter() - begun, "processor": time.process_time() - worked}


def _errors(car: Car, gains: tuple[float, float, float], seed: int) -> dict[str, Any]:
    mean, rms = tracking_errors(car, gains, seed)
    return {"gains": list(gains), "mean": mean, "rms": rms}


def outcome(row: Mapping[str, Any], step: str) -> str:
    """Better, same or worse on the true plant; nothing where there are no gains."""
    if step not in row:
        return "none"
    change = row[step]["mean"] / row["present"]["mean"] - 1.0
    return "better" if change < -SAME else "worse" if change > SAME else "same"


def table(cars: Mapping[int, Mapping[str, Any]]) -> str:
    """A row a car, and the sums."""
    head = ("car", "rows/s", "input", "verdict", "χ²/dof", "\\|ΔT\\|, proposed", "held out: explained %",
            "mean error %, now", "half way", "proposed", "RMSE %, now", "proposed", "processor s",
            "wall s")  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for seed, row in sorted(cars.items()):
        verdict = "stopped" if row["stopped"] else WITHHELD if row["withheld"] else "gains"
        means = [_cell(row.get(step), "mean") for step in ("present", "half_way", "proposed")]
        squares = [_cell(row.get(step), "rms") for step in ("present", "proposed")]
        explained = "-" if row["explained"] is None else f"{100.0 * row['explained']:.1f}"
        step = " in step" if row["in_step"] else ""
        lines.append(f"| {seed} | {row['rate']:.0f}{step} | {row['model']} | {verdict} | {_number(row['chi2'])} | "
                     f"{_number(row['borne'][-1] if row['borne'] else None)} | {explained} | "
                     f"{' | '.join(means)} | {' | '.join(squares)} | {row['processor']:.0f} | "
                     f"{row['seconds']:.0f} |")  # fmt: skip
    given = [row for row in cars.values() if not row["stopped"] and not row["withheld"]]
    held = [row for row in cars.values() if row["withheld"]]
    lines += ["", f"{len(cars)} cars. Gains given on {len(given)}: proposed {_count(given, 'proposed')}; half way "
              f"{_count(given, 'half_way')}. Withheld on {len(held)}: with `--anyway` proposed "
              f"{_count(held, 'proposed')}; half way {_count(held, 'half_way')}. Stopped before a fit: "
              f"{len(cars) - len(given) - len(held)}."]  # fmt: skip
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{value:.2f}"


def _cell(found: Mapping[str, Any] | None, key: str) -> str:
    return "-" if found is None else f"{found[key]:.2f}"


def _count(rows: list[Mapping[str, Any]], step: str) -> str:
    each = [outcome(row, step) for row in rows]
    return ", ".join(f"{word} on {each.count(word)}" for word in ("better", "same", "worse"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cars", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=9000)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, help="every figure, JSON; cars already there are not run again")
    parser.add_argument("--page", type=Path, help="whose table is replaced")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.cars)
    if given.page is not None:
        TABLE.must_be_in(given.page)
    said = table(resumed(run, seeds, given.processes, 4, given.out))
    print(said)
    if given.page is not None:
        TABLE.put(given.page, said)


if __name__ == "__main__":
    main()
