"""A thousand units, eight of them odd, by `etcfit fleet`: how long, how much memory, and which odd units it finds.

    python -m benchmarks.fleet.thousand [--units 1000] [--workers 2] [--seed 8000] [--keep FOLDER]

Each unit has two ramps, two responses and a release (2,300 samples). Memory is that of all processes of the command
together, sampled twice a second. Without `--cache` the compiled models are made anew, as on a machine that never ran
a fleet. A table of one row, and a line for every odd unit that was missed and every one that is none.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from independent.fleet import FleetTruth, make_fleet, with_odd
from independent.line import Drift, Line

from ..runs import Failed
from .found import Found, fleet_json, judged
from .watched import Ended, fleet

KINDS = ("limp_home_spring", "stribeck_friction", "cogging_torque", "presliding_friction",
         "current_gain", "gear_ratio", "series_resistance", "sensor_end_points")  # fmt: skip
FINE = (0, 3)  # exit statuses: done; a unit did not converge


def line(units: int, seed: int, drift: float) -> Line:
    """Of batches, with one odd unit of each kind; K_s drifts by so much of its mean after three fifths, if at all."""
    moved = Drift("K_s", 3 * units // 5, drift) if drift else None
    return with_odd(Line(drift=moved), KINDS[:units], units, seed)


def row(ended: Ended, found: Found, workers: int) -> str:
    of = len(found.right) + len(found.missed)
    cells = (f"{found.units + len(found.failed)}", f"{workers}", f"{ended.wall:.0f}",
             f"{ended.wall / max(found.units, 1):.3f}", f"{ended.cpu:.0f}", f"{ended.peak.pss:.0f}",
             f"{ended.peak.rss:.0f}", f"{ended.client:.0f}", f"{ended.load:.1f}", f"{len(found.right)} of {of}",
             f"{len(found.false)}", f"{len(found.failed)}", f"{len(found.not_converged)}")  # fmt: skip
    return "| " + " | ".join(cells) + " |"


HEAD = ("| units | workers | s | s a unit | s cpu | peak PSS MiB | peak RSS MiB | client MiB | load before | odd found "
        "| false odd | failed | not converged |\n" + "|---" * 13 + "|")  # fmt: skip


def report(ended: Ended, run: Path, truth: FleetTruth, workers: int) -> str:
    """The table, and what it does not say."""
    found = judged(run, truth)
    lines = [HEAD, row(ended, found, workers), ""]
    lines += [f"missed: {unit}, {kind}" for unit, kind in found.missed.items()]
    lines += [f"odd, and as all others: {unit}" for unit in found.false]
    lines += [f"failed: {each['unit']}: {each['why']}" for each in fleet_json(run)["failed"]]
    lines += [f"drift: {each['symbol']} since {each['since']}" for each in fleet_json(run)["drift"]]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--units", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=8000)
    parser.add_argument("--drift", type=float, default=0.0, help="of K_s after three fifths, relative")
    parser.add_argument("--keep", type=Path, help="leave fleet, truth and run in this folder")
    parser.add_argument("--cache", type=Path, help="compiled models of earlier runs")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        place = asked.keep or Path(scratch)
        truth = make_fleet(place / "fleet", line(asked.units, asked.seed, asked.drift), asked.units, asked.seed,
                           processes=asked.workers)  # fmt: skip
        truth.write(place / "truth.json")
        print(f"{asked.units} units are written", flush=True)
        ended = fleet(place / "fleet", place / "run", asked.workers, asked.cache or Path(scratch) / "cache").end()
        if ended.status not in FINE:
            raise Failed(f"status {ended.status} after {ended.wall:.0f} s: {ended.stderr}")
        print(report(ended, place / "run", truth, asked.workers))


if __name__ == "__main__":
    main()
