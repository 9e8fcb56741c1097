"""Do 95 % intervals of the population hold the truth, and are shrunk units closer to it than each by itself?

    python -m benchmarks.fleet.coverage [--fleets 40] [--units 20] [--first-seed 8000] [--save FILE]
    python -m benchmarks.fleet.coverage --weak            units of one short ramp and one short response, much noise
    python -m benchmarks.fleet.coverage --table FILE      fit nothing: the table of what was saved

Of each fleet: does `mean_ci95` hold the mean that the generator drew from, `sd_ci95` the spread? Of its units: the
error of `shrunk_value` over that of `value`, root mean squares over those units whose own fit states an error at all;
the others have no value of their own to compare with, and are counted.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from independent.fleet import BENCH, LINE_TESTS, WEAK_BENCH, WEAK_TESTS, FleetTruth, make_fleet
from independent.line import SYMBOLS, Line

from ..runs import Failed
from .found import fleet_json
from .thousand import FINE
from .watched import fleet

AIMS = "92 to 98 % held; error <= 0.8 on weak data, never above 1.02"


@dataclass(frozen=True)
class Symbol:
    """One parameter in one fleet.

    Args:
        mean_held, sd_held: whether the interval holds the truth; None where none is stated.
        mean_score: (mean - truth) over the half width of its interval; 1 is its edge.
        sd_ratio: estimated spread over the true one.
        own, shrunk: sums of squared errors over the population's variance, over `with_error` units.
        with_error, without_error: units whose own fit states an error, and the other units.
    """

    mean_held: bool | None
    sd_held: bool | None
    mean_score: float | None
    sd_ratio: float | None
    own: float
    shrunk: float
    with_error: int
    without_error: int


def symbol(name: str, said: dict[str, Any], rows: list[dict[str, Any]], truth: FleetTruth) -> Symbol:
    """What the run says of one parameter, against the truth."""
    true = {unit.name: unit.values[name] for unit in truth.units}
    mean, sd = truth.mean[name], truth.sd[name]
    pairs = [((row["value"] - true[row["unit"]]) / sd, (row["shrunk_value"] - true[row["unit"]]) / sd)
             for row in rows if row["symbol"] == name and row["stderr"] is not None
             and row["shrunk_value"] is not None]  # fmt: skip
    own, shrunk = np.array(pairs).reshape(-1, 2).T
    low, high = said["mean_ci95"] or (None, None)
    score = None if low is None or high is None else (said["mean"] - mean) / max((high - low) / 2, 1e-300)
    return Symbol(_holds(said["mean_ci95"], mean), _holds(said["sd_ci95"], sd), score,
                  None if said["sd"] is None else said["sd"] / sd, float(own @ own), float(shrunk @ shrunk),
                  len(pairs), len(truth.units) - len(pairs))  # fmt: skip


def _holds(interval: list[float | None] | None, true: float) -> bool | None:
    low, high = interval or (None, None)
    return None if low is None or high is None else low <= true <= high


def one(seed: int, units: int, weak: bool, workers: int, cache: Path) -> dict[str, Any]:
    """One fleet: made, fitted, compared."""
    import pyarrow.parquet as pq

    with tempfile.TemporaryDirectory() as scratch:
        folder, run = Path(scratch) / "fleet", Path(scratch) / "run"
        tests, bench = (WEAK_TESTS, WEAK_BENCH) if weak else (LINE_TESTS, BENCH)
        truth = make_fleet(folder, Line(), units, seed, tests=tests, bench=bench)
        ended = fleet(folder, run, workers, cache).end()
        if ended.status not in FINE:
            raise Failed(f"seed {seed}: status {ended.status}: {ended.stderr}")
        said, rows = fleet_json(run), pq.read_table(run / "units.parquet").to_pylist()
        population = {name: said["population"][name] for name in SYMBOLS if name in said["population"]}
        symbols = {name: symbol(name, each, rows, truth) for name, each in population.items()}
        return {
            "seed": seed, "weak": weak, "units": units, "seconds": ended.wall, "failed": len(said["failed"]),
            "not_converged": len(said["not_converged"]), "odd": len(said["odd"]),
            "symbols": {name: dataclasses.asdict(each) for name, each in symbols.items()},
        }  # fmt: skip


def table(records: list[dict[str, Any]]) -> str:
    """A row a parameter, and all of them."""
    heads = ("parameter", "mean held", "spread held", "worst mean, half widths", "spread, median of truth",
             "error, shrunk over own", "units with error", "without")  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|---" * len(heads) + "|"]
    by: dict[str, list[Symbol]] = {name: [] for name in SYMBOLS}
    for record in records:
        for name, each in record["symbols"].items():
            by[name].append(Symbol(**each))
    everything = [each for some in by.values() for each in some]
    for name, some in (*by.items(), ("all", everything)):
        if some:
            lines.append(f"| {name} | " + " | ".join(_cells(some)) + " |")
    units, failed, lost, odd = (sum(r[key] for r in records) for key in ("units", "failed", "not_converged", "odd"))
    seconds = np.median([r["seconds"] for r in records])
    lines += ["", f"{len(records)} fleets, {units} units; {failed} failed, {lost} did not converge, {odd} called odd, "
              f"of which none is; {seconds:.0f} s a fleet (median). Aims: {AIMS}."]  # fmt: skip
    return "\n".join(lines)


def _cells(some: list[Symbol]) -> list[str]:
    own, shrunk = sum(each.own for each in some), sum(each.shrunk for each in some)
    scores = [abs(each.mean_score) for each in some if each.mean_score is not None]
    ratios = [each.sd_ratio for each in some if each.sd_ratio is not None]
    return [
        _share([each.mean_held for each in some]),
        _share([each.sd_held for each in some]),
        f"{max(scores):.2f}" if scores else "-",
        f"{np.median(ratios):.2f}" if ratios else "-",
        f"{math.sqrt(shrunk / own):.3f}" if own else "-",
        f"{sum(each.with_error for each in some)}",
        f"{sum(each.without_error for each in some)}",
    ]


def _share(held: list[bool | None]) -> str:
    """Per cent of those stated, and its standard error if fleets and parameters were independent."""
    stated = [each for each in held if each is not None]
    if not stated:
        return "-"
    share = np.mean(stated)
    return f"{100 * share:.1f} ± {100 * math.sqrt(share * (1 - share) / len(stated)):.1f} % of {len(stated)}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=40)
    parser.add_argument("--units", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=8000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--weak", action="store_true", help="few samples a unit, much noise")
    parser.add_argument("--cache", type=Path, help="compiled models; one folder for all fleets in any case")
    parser.add_argument("--save", type=Path, help="a line of JSON a fleet; seeds that it holds are not run again")
    parser.add_argument("--table", type=Path)
    asked = parser.parse_args()
    if asked.table:
        print(table(_saved(asked.table)))
        return
    records = [] if asked.save is None else _saved(asked.save)
    done = {record["seed"] for record in records}
    with tempfile.TemporaryDirectory() as scratch:
        cache = asked.cache or Path(scratch)
        for seed in range(asked.first_seed, asked.first_seed + asked.fleets):
            if seed not in done:
                records.append(one(seed, asked.units, asked.weak, asked.workers, cache))
                print(f"seed {seed}: {records[-1]['seconds']:.0f} s", flush=True)
                _save(asked.save, records[-1])
    print(table(records))


def _saved(file: Path) -> list[dict[str, Any]]:
    return [json.loads(text) for text in file.read_text(encoding="utf-8").splitlines()] if file.is_file() else []


def _save(file: Path | None, record: dict[str, Any]) -> None:
    if file is not None:
        with file.open("a", encoding="utf-8") as out:
            out.write(json.dumps(record) + "\n")


if __name__ == "__main__":
    main()
