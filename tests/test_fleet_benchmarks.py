"""What the benchmarks of a fleet count, on run folders written by hand."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.fleet import chaos, coverage, power
from benchmarks.fleet.broken import BROKEN
from benchmarks.fleet.found import judged
from benchmarks.fleet.thousand import KINDS, line
from benchmarks.fleet.watched import family, held
from benchmarks.fleet.workers import table as workers_table
from etcfit.errors import MeasurementError
from etcfit.rig.reader import read_folder
from independent.drives import steps
from independent.effects import NONE
from independent.fleet import WEAK_TESTS, FleetTruth, draw_fleet, make_fleet
from independent.line import DESIGN, Line, Odd, Population, with_symbols
from independent.line_mistakes import ON_THE_BENCH
from independent.simulate import simulate, throttle

SEED = 8000


def written(run: Path, **told: Any) -> Path:
    run.mkdir(exist_ok=True)
    nothing = {"units": [], "failed": [], "not_converged": [], "odd": [], "drift": []}
    (run / "fleet.json").write_text(json.dumps(nothing | told), encoding="utf-8")
    return run


def truth(units: int, *odd: Odd) -> FleetTruth:
    return draw_fleet(Line(odd=odd), units, SEED)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    make_fleet(folder, Line(), 1, SEED, tests=WEAK_TESTS, own_rig_toml=True)
    return folder / "SYN0001"


@pytest.mark.parametrize("way", BROKEN)
def test_a_broken_folder_is_refused(sound: Path, tmp_path: Path, way: str) -> None:
    unit = tmp_path / "unit"
    shutil.copytree(sound, unit)
    assert len(read_folder(unit).measurements) == 2
    BROKEN[way](unit)
    with pytest.raises(MeasurementError):
        read_folder(unit)


def test_found_odd_ones_are_told_from_missed_and_false(tmp_path: Path) -> None:
    true = truth(6, Odd(0, "K_s"), Odd(2, "current_gain"), Odd(3, "channel_sign"))
    said = [{"unit": "SYN0001"}, {"unit": "SYN0006"}]
    found = judged(written(tmp_path, odd=said, failed=[{"unit": "SYN0004", "why": "no"}], units=list("abcde")), true)
    assert found.right == {"SYN0001": "K_s", "SYN0004": "channel_sign"}
    assert found.missed == {"SYN0003": "current_gain"}
    assert (found.false, found.failed, found.units) == (["SYN0006"], ["SYN0004"], 5)


def test_the_thousand_have_one_odd_unit_of_each_kind() -> None:
    drawn = draw_fleet(line(1000, SEED, 0.0), 1000, SEED)
    assert sorted(drawn.odd.values()) == sorted(KINDS)
    moved = draw_fleet(line(50, SEED, 0.1), 50, SEED)
    assert moved.line.drift is not None
    assert moved.line.drift.since == 30


def test_coverage_counts_what_intervals_hold_and_how_far_units_are_off() -> None:
    true = truth(3)
    sd, values = true.sd["R_a"], [unit.values["R_a"] for unit in true.units]
    mean = true.mean["R_a"]
    said = {"mean": mean + sd, "sd": 2 * sd, "mean_ci95": [mean - sd, mean + 3 * sd], "sd_ci95": [1.5 * sd, 3 * sd]}
    rows = [{"unit": unit.name, "symbol": "R_a", "value": value + 2 * sd, "stderr": sd, "shrunk_value": value - sd}
            for unit, value in zip(true.units, values, strict=True)]  # fmt: skip
    rows[0]["stderr"] = None
    each = coverage.symbol("R_a", said, [*rows, {"unit": "SYN0001", "symbol": "K_s"}], true)
    assert (each.mean_held, each.sd_held, each.with_error, each.without_error) == (True, False, 2, 1)
    figures = np.array([each.mean_score, each.sd_ratio, each.own, each.shrunk], dtype=float)
    np.testing.assert_allclose(figures, [0.5, 2.0, 8.0, 2.0])
    record = {"units": 3, "failed": 0, "not_converged": 0, "odd": 0, "seconds": 1.0, "symbols": {"R_a": asdict(each)}}
    row = next(text for text in coverage.table([record, record]).splitlines() if text.startswith("| R_a"))
    assert [cell.strip() for cell in row.strip("|").split("|")] == [
        "R_a", "100.0 ± 0.0 % of 2", "0.0 ± 0.0 % of 2", "0.50", "2.00", "0.500", "4", "2",
    ]  # fmt: skip


def test_an_interval_that_is_not_stated_is_not_counted() -> None:
    said = {"mean": None, "sd": None, "mean_ci95": None, "sd_ci95": [None, 1.0]}
    each = coverage.symbol("L_a", said, [], truth(2))
    assert [each.mean_held, each.sd_held, each.mean_score, each.sd_ratio, each.without_error] == [None] * 4 + [2]
    record = {"units": 2, "failed": 0, "not_converged": 0, "odd": 0, "seconds": 1.0, "symbols": {"L_a": asdict(each)}}
    assert "| L_a | - | - | - | - | - | 0 | 2 |" in coverage.table([record])


def held_by(run: Path, before: dict[str, float | None]) -> list[bool]:
    checks = chaos.whole(run, ["a", "b", "c"], {"c": "torn"}, before, 0, "")
    return [check.holds for check in checks]


def test_chaos_sees_what_is_lost_or_done_twice_or_not_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chaos, "stored", lambda run: {"a": 1.0, "b": 2.0, "c": None})
    bad = {"unit": "c", "why": "c/response/drive_1.csv:51: one field"}
    assert held_by(written(tmp_path, units=["a", "b"], failed=[bad]), {"a": 1.0, "c": None}) == [True] * 5
    assert held_by(written(tmp_path, units=["a"], failed=[bad]), {}) == [True, False, True, True, True]
    assert held_by(written(tmp_path, units=["a", "b"], failed=[bad]), {"a": 1.5}) == [True, True, False, True, True]
    sound = {"unit": "b", "why": "b: killed"}
    assert held_by(written(tmp_path, units=["a"], failed=[bad, sound]), {}) == [True, True, True, False, True]
    mute = {"unit": "c", "why": "something"}
    assert held_by(written(tmp_path, units=["a", "b"], failed=[mute]), {}) == [True, True, True, True, False]


def test_a_child_belongs_to_the_family_and_holds_memory() -> None:
    script = "import time; x = bytearray(80 * 2**20); print(len(x), flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert child.pid in family(os.getpid())
        assert family(child.pid) == [child.pid]
        memory = held([child.pid])
        child.kill()
    assert memory.processes == 1
    assert 80.0 < memory.pss <= memory.rss < 160.0
    assert held([child.pid]).processes == 0


def test_two_workers_over_one() -> None:
    rows = workers_table(60, {1: [110.0, 130.0, 120.0], 2: [70.0]}, {1: [20.0], 2: [20.0]}).splitlines()
    assert rows[2].endswith("| 120.0 | 70.0 | 1.71 | 1.8 |")
    assert rows[3].endswith("| 100.0 | 50.0 | 2.00 | 1.8 |")


def test_a_distance_in_one_parameter_counts_its_standard_deviations() -> None:
    alone = Population(correlation={})
    assert power.distance({"R_a": 3 * alone.relative[0]}, alone) == pytest.approx(9.0)
    assert power.distance({"R_a": 3 * alone.relative[0]}, Population()) > 9.0  # K_b says that the ohms are unlikely
    assert power.power(0.0, 0.01) == pytest.approx(0.01)
    assert power.power(60.0, 4e-4) > 0.99


@pytest.mark.parametrize("kind", power.FITTING)
def test_a_mistake_that_fits_is_the_throttle_that_it_is_taken_for(kind: str) -> None:
    """No noise: the spoilt record of one throttle against that of another, whose parameters `power` says."""
    size = 1.1
    taken = with_symbols(DESIGN, {symbol: getattr(DESIGN, symbol) * (1.0 + by)
                                  for symbol, by in power.FITTING[kind](size).items()})  # fmt: skip
    seen = ON_THE_BENCH[kind][0](DESIGN, size) if kind in ON_THE_BENCH else DESIGN
    if kind == "current_gain":
        taken = replace(taken, L_a=DESIGN.L_a / size)
    drive = steps(np.full(6, 0.05), np.array([0.0, 7.0, 4.0, 8.0, 3.0, 1.0])).after(0.01, 0.31)
    instants = np.arange(0.001, 0.3, 0.001)
    spoilt, other = (simulate(throttle(each, NONE), drive, instants, angle=0.0) for each in (seen, taken))
    gain = size if kind == "current_gain" else 1.0
    np.testing.assert_allclose(gain * spoilt.current, other.current, atol=2e-3)
    np.testing.assert_allclose(spoilt.angle, other.angle, atol=2e-4)
    assert np.ptp(spoilt.angle) > 0.3
