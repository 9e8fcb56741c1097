"""Do the population's intervals hold, and does shrinking help, over many small fleets fitted as one large one?

    python -m benchmarks.fleet.partition [--fleets 40] [--units 12] [--seed 8300] [--weak] [--run RUN [--thousand]]

Units are drawn one by one from one population: any twelve in a row are a fleet of their own. All are fitted by one
`etcfit fleet`; then mean and spread are estimated of each twelve alone, from what the run has stored of its units:
`coverage` at a tenth of the price, for the command's start and end are paid once. --thousand: those of `thousand`.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from etcfit.fleets.engine.store import Store
from etcfit.fleets.settings import FleetSettings
from etcfit.fleets.statistics.population import shrink
from etcfit.fleets.statistics.stack import MOST_WIDENED, MOST_WIDENED_TO_SHRINK, robust, stacked
from etcfit.fleets.study import without_odd
from etcfit.fleets.unit import UnitResult
from independent.fleet import BENCH, LINE_TESTS, WEAK_BENCH, WEAK_TESTS, FleetTruth, draw_fleet, make_fleet
from independent.line import SYMBOLS, Line

from ..runs import Failed
from .thousand import FINE, line
from .watched import fleet


def held(units: list[UnitResult], truth: FleetTruth, rows: dict[str, list[tuple[float, ...]]]) -> None:
    """One fleet: whether its intervals hold the truth, and squared errors of its units."""
    stack = stacked(robust(units, MOST_WIDENED))
    found, _ = without_odd(stack, tuple(units), (), FleetSettings())
    shrunk = shrink(stacked(robust(units, MOST_WIDENED_TO_SHRINK)), found)
    true = {unit.name: unit.values for unit in truth.units}
    ordinary = np.array([unit.unit not in truth.odd for unit in units])
    for k, symbol in enumerate(found.symbols):
        own = np.array([unit.own.estimate[unit.own.symbols.index(symbol)] if symbol in unit.own.symbols else np.nan
                        for unit in units])  # fmt: skip
        values = np.array([true[unit.unit][symbol] for unit in units])
        estimated = np.isfinite(own) & ordinary
        (low, high), (least, most) = found.mean_interval[k], found.sd_interval[k]
        mean, sd = truth.mean[symbol], truth.sd[symbol]
        scale = sd**2 * max(int(estimated.sum()), 1)
        rows[symbol].append((low <= mean <= high, least <= sd <= most, found.sd[k] / sd,
                             float(np.sum((own - values)[estimated] ** 2) / scale),
                             float(np.sum((shrunk.estimate[:, k] - values)[estimated] ** 2) / scale)))  # fmt: skip


def table(rows: dict[str, list[tuple[float, ...]]]) -> str:
    lines = ["| parameter | fleets | mean held | spread held | spread, median of truth | error, shrunk over own |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    every = np.array([row for each in rows.values() for row in each])
    for name, each in (*rows.items(), ("all", every)):
        if len(each):
            a = np.array(each, dtype=float)
            ratio = float(np.sqrt(a[:, 4].sum() / a[:, 3].sum()))
            cells = f"{a[:, 0].mean():.1%} | {a[:, 1].mean():.1%} | {np.median(a[:, 2]):.2f} | {ratio:.3f}"
            lines.append(f"| {name} | {len(a)} | {cells} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fleets", type=int, default=40)
    parser.add_argument("--units", type=int, default=12)
    parser.add_argument("--seed", type=int, default=8300)
    parser.add_argument("--weak", action="store_true")
    parser.add_argument("--run", type=Path, help="of such a fleet, fitted before: only the table")
    parser.add_argument("--thousand", action="store_true", help="that run is of `thousand`, with its odd units")
    asked = parser.parse_args()
    count = asked.fleets * asked.units
    with tempfile.TemporaryDirectory() as scratch:
        drawn = line(count, asked.seed, 0.0) if asked.thousand else Line()
        run, truth = asked.run, draw_fleet(drawn, count, asked.seed)
        if run is None:
            run = Path(scratch) / "run"
            tests, bench = (WEAK_TESTS, WEAK_BENCH) if asked.weak else (LINE_TESTS, BENCH)
            make_fleet(Path(scratch) / "fleet", Line(), count, asked.seed, tests=tests, bench=bench)
            ended = fleet(Path(scratch) / "fleet", run, 2, Path(scratch) / "cache").end()
            if ended.status not in FINE:
                raise Failed(f"status {ended.status}: {ended.stderr}")
        with Store(run / "parts") as store:
            known = {end.unit: end for end in store.ends() if isinstance(end, UnitResult)}
        rows: dict[str, list[tuple[float, ...]]] = {symbol: [] for symbol in SYMBOLS}
        for k in range(asked.fleets):
            names = [unit.name for unit in truth.units[k * asked.units : (k + 1) * asked.units]]
            held([known[name] for name in names if name in known], truth, rows)
        print(f"{len(known)} of {count} units have a result\n\n{table(rows)}")


if __name__ == "__main__":
    main()
