"""The generator of fleets: what it draws, what it writes, and that the committed one is its own."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.rig.reader import read_folder
from independent import MEDIUM, line_fleet
from independent.effects import CATALOGUE
from independent.fleet import (
    BENCH,
    LINE_TESTS,
    FleetTruth,
    Limits,
    draw_fleet,
    make_fleet,
    odd_ones,
    with_odd,
    write_unit,
)
from independent.folder import Series
from independent.instruments import PERFECT
from independent.line import DESIGN, SYMBOLS, Drift, Line, Odd, Population, with_symbols
from independent.line_mistakes import LINE_MISTAKES, channel_late, current_gain, gear_ratio
from independent.protocols import Trace

SEED = 8000
BRIEF = {"response": Series(1, 0.2, 250)}  # the cheapest fleet there is


def values(truth: FleetTruth) -> np.ndarray:
    return np.array([[unit.values[symbol] for symbol in SYMBOLS] for unit in truth.units])


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "units.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def contents(folder: Path) -> dict[Path, bytes]:
    return {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


# ---- the population


def drawn_from(population: Population, units: int) -> np.ndarray:
    normal = np.random.default_rng(SEED).standard_normal((units, len(SYMBOLS)))
    return np.array([list(population.unit(row).values()) for row in normal])


@pytest.mark.parametrize("law", ["normal", "lognormal"])
def test_mean_spread_and_correlation_are_the_stated_ones(law: str) -> None:
    units = 4000
    population = Population(law=law)  # pyright: ignore[reportArgumentType]
    drawn = drawn_from(population, units)
    off = (drawn.mean(axis=0) - population.mean) / (population.sd / np.sqrt(units))
    assert np.all(np.abs(off) < 4.0)
    assert_allclose(drawn.std(axis=0, ddof=1), population.sd, rtol=4.5 / np.sqrt(2 * units))
    assert_allclose(np.corrcoef(drawn.T), population.matrix, atol=4.5 / np.sqrt(units))


def test_a_wide_lognormal_has_its_moments_too() -> None:
    population = Population(DESIGN, {"R_a": 0.5, "K_b": 0.5}, {("R_a", "K_b"): 0.6})
    drawn = drawn_from(population, 8000)[:, [0, 2]]
    assert_allclose(drawn.mean(axis=0), population.mean[[0, 2]], rtol=4 * 0.5 / np.sqrt(8000))
    assert_allclose(drawn.std(axis=0), population.sd[[0, 2]], rtol=0.08)  # of a skew law, whose sd scatters more
    assert np.corrcoef(drawn.T)[0, 1] == pytest.approx(0.6, abs=0.05)
    assert drawn.min() > 0.0


def test_units_are_drawn_one_by_one_from_the_population() -> None:
    units = 300
    scores = (values(draw_fleet(Line(), units, SEED)) - Population().mean) / Population().sd
    assert np.abs(scores.mean(axis=0)).max() < 4.0 / np.sqrt(units)
    assert_allclose(scores.std(axis=0), 1.0, rtol=4.5 / np.sqrt(2 * units))
    assert np.abs([np.corrcoef(column[1:], column[:-1])[0, 1] for column in scores.T]).max() < 4.0 / np.sqrt(units)


def test_what_has_no_spread_is_alike_in_all() -> None:
    drawn = values(draw_fleet(Line(Population(spread={"R_a": 0.05}, correlation={})), 50, SEED))
    assert_allclose(drawn[:, 1:], np.broadcast_to(Population().mean[1:], (50, 7)), rtol=1e-12)
    assert np.ptp(drawn[:, 0]) > 0.05


def test_impossible_correlations_are_refused() -> None:
    contradictory = {("R_a", "L_a"): 0.9, ("L_a", "K_b"): 0.9, ("R_a", "K_b"): -0.9}
    with pytest.raises(ValueError, match="positive definite"):
        draw_fleet(Line(Population(correlation=contradictory)), 1, SEED)


def test_lumped_parameters_keep_the_shares_of_motor_and_plate() -> None:
    truth = with_symbols(DESIGN, {"J_eq": 2 * DESIGN.J_eq, "B_eq": 3 * DESIGN.B_eq, "K_b": 0.02})
    assert (truth.J_eq, truth.B_eq) == pytest.approx((2 * DESIGN.J_eq, 3 * DESIGN.B_eq))
    assert truth.J_m / DESIGN.J_m == pytest.approx(truth.J_L / DESIGN.J_L)
    assert truth.K_m == truth.K_b == 0.02


def test_a_drift_moves_one_parameter_from_one_part_on() -> None:
    still, moved = (values(draw_fleet(Line(drift=drift), 20, SEED)) for drift in (None, Drift("K_s", 12, 0.05)))
    difference = np.zeros((20, len(SYMBOLS)))
    difference[12:, SYMBOLS.index("K_s")] = 0.05 * DESIGN.K_s
    assert_allclose(moved - still, difference, atol=1e-15)


def test_batches_share_a_part_of_the_spread_and_leave_the_whole() -> None:
    share, size, batches = 0.8, 5, 200
    drawn = values(draw_fleet(Line(batch=size, batch_share=share), size * batches, SEED))[:, 0]
    whole = Population().sd[0]
    within = drawn.reshape(batches, size).std(axis=1, ddof=1)
    assert drawn.std() == pytest.approx(
        whole, rel=4.5 * (share**2 / np.sqrt(2 * batches) + (1 - share**2) / np.sqrt(2 * size * batches))
    )
    assert np.sqrt(np.mean(within**2)) == pytest.approx(
        whole * np.sqrt(1 - share**2), rel=4.5 / np.sqrt(2 * (size - 1) * batches)
    )


def test_more_units_leave_the_first_as_they_were() -> None:
    few, many = (draw_fleet(Line(rigs=2), units, SEED) for units in (5, 9))
    assert few.units == many.units[:5]


# ---- who measures what


def test_every_operator_measures_each_part_on_every_rig_so_often() -> None:
    line = Line(rigs=2, operators=3, repeats=2, operator_spread={"T_f": 0.02}, mounting={"T_f": 0.005})
    truth = draw_fleet(line, 4 * 12, SEED)
    met = [(unit.part, unit.rig, unit.operator) for unit in truth.units]
    assert {who: met.count(who) for who in met} == {(p, r, o): 2 for p in range(4) for r in range(2) for o in range(3)}
    first = [unit for unit in truth.units if unit.part == 0]
    assert len({unit.truth.K_s for unit in first}) == 1
    assert len({unit.truth.T_f for unit in first}) == 12
    by_operator = [np.mean([u.truth.T_f for u in first if u.operator == o]) for o in range(3)]
    assert np.ptp(by_operator) / DESIGN.T_f > 0.01
    with pytest.raises(ValueError, match="whole parts"):
        draw_fleet(line, 13, SEED)


def test_a_warm_room_shows_in_the_winding_alone() -> None:
    cold, warm = (draw_fleet(Line(copper=copper, temperature_C=(22.0, 5.0)), 6, SEED) for copper in (0.0, 0.0039))
    ratio = values(warm) / values(cold)
    rooms = np.array([unit.temperature_C for unit in warm.units])
    assert_allclose(ratio[:, 0], 1.0 + 0.0039 * (rooms - 22.0))
    assert_allclose(ratio[:, 1:], 1.0)


# ---- what is odd


def test_kinds_are_those_that_exist() -> None:
    with pytest.raises(ValueError, match="no_such_thing"):
        draw_fleet(Line(odd=(Odd(0, "no_such_thing"),)), 1, SEED)
    assert not set(LINE_MISTAKES) & {*MEDIUM, *SYMBOLS}
    assert set(CATALOGUE) <= set(MEDIUM)


def test_one_odd_unit_of_each_kind() -> None:
    kinds = ("K_s", "current_gain", "backlash")
    line = with_odd(Line(), kinds, 40, SEED)
    truth = draw_fleet(line, 40, SEED)
    assert sorted(truth.odd.values()) == sorted(kinds)
    assert odd_ones(kinds, 40, SEED) != odd_ones(kinds, 40, SEED + 1)
    odd = next(odd.unit for odd in line.odd if odd.kind == "K_s")
    plain = draw_fleet(Line(), 40, SEED)
    assert_allclose(truth.units[odd].truth.K_s - plain.units[odd].truth.K_s, 8 * Population().sd[3])


def test_mistakes_change_what_they_say() -> None:
    columns = {"time [s]": np.arange(6.0), "current [mA]": 10.0 + np.arange(6.0), "tps [V]": np.arange(6.0)}
    trace = Trace("response/drive_1.csv", columns)
    assert_allclose(current_gain(trace, 1.06).columns["current [mA]"], 1.06 * columns["current [mA]"])
    late = channel_late(trace, 2.0).columns
    assert_allclose(late["current [mA]"], 10.0 + np.arange(4.0))
    assert_allclose(late["tps [V]"], np.arange(2.0, 6.0))
    assert_allclose(gear_ratio(DESIGN, 1.1).N, 1.1 * DESIGN.N)


@pytest.mark.parametrize("kind", LINE_MISTAKES)
def test_an_odd_unit_differs_from_the_plain_one_in_its_files_alone(tmp_path: Path, kind: str) -> None:
    make_fleet(tmp_path / "plain", Line(), 2, SEED, tests=BRIEF)
    make_fleet(tmp_path / "odd", Line(odd=(Odd(1, kind),)), 2, SEED, tests=BRIEF)
    plain, odd = contents(tmp_path / "plain"), contents(tmp_path / "odd")
    assert {file.parts[0] for file in plain if plain[file] != odd[file]} == {"SYN0002"}


# ---- the folder


def test_a_fleet_has_its_folders_its_table_and_its_common_rig(tmp_path: Path) -> None:
    truth = make_fleet(tmp_path, Line(batch=2, a_day=2, rigs=2), 5, SEED, tests=BRIEF, name="a synthetic line")
    rows = table(tmp_path)
    assert [row["unit"] for row in rows] == [unit.name for unit in truth.units]
    assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {unit.name for unit in truth.units}
    assert [row["batch"] for row in rows] == ["B01", "B01", "B02", "B02", "B03"]
    assert [row["rig"] for row in rows] == ["rig 1", "rig 2", "rig 1", "rig 2", "rig 1"]
    assert [row["date"] for row in rows] == sorted(row["date"] for row in rows)
    assert len({row["date"] for row in rows}) == 3
    common = tomllib.loads((tmp_path / "fleet.toml").read_text(encoding="utf-8"))
    assert common.keys() == {"fleet", "rig", "tps", "noise"}
    assert common["rig"]["synthetic"] is True
    assert not list(tmp_path.rglob("*.json"))
    assert not list(tmp_path.rglob("rig.toml"))
    assert all("SYNTHETIC" in csv.read_text(encoding="utf-8").splitlines()[0] for csv in tmp_path.glob("*/*/*.csv"))


def test_a_unit_with_a_rig_toml_of_its_own_is_a_measurement_folder(tmp_path: Path) -> None:
    make_fleet(tmp_path, Line(), 1, SEED, own_rig_toml=True)
    rig = read_folder(tmp_path / "SYN0001")
    assert rig.config.synthetic
    assert rig.config.gear_ratio == DESIGN.N
    kinds = [(trace.test, len(trace.time)) for trace in rig.measurements]
    assert sorted(kind for kind, _ in kinds) == ["inertia", "response", "response", "static_load", "static_load"]
    assert 2000 < sum(rows for _, rows in kinds) < 3000


def test_the_units_of_a_fleet_are_what_their_truth_says(tmp_path: Path) -> None:
    truth = make_fleet(tmp_path, Line(), 3, SEED, tests={"resistance": Series(2, 0.1, 200)}, bench=PERFECT)
    for unit in truth.units:
        rows = np.loadtxt(tmp_path / unit.name / "resistance" / "volts_2.csv", delimiter=",", skiprows=2)
        assert_allclose(rows[:, 1] / rows[:, 2], unit.truth.R_a, rtol=1e-4)


def test_a_rigs_gain_is_in_all_that_it_logs(tmp_path: Path) -> None:
    line = Line(rigs=2)
    make_fleet(tmp_path / "a", line, 2, SEED, tests=BRIEF)
    truth = make_fleet(tmp_path / "b", replace(line, rig_gain={"current": 0.05}), 2, SEED, tests=BRIEF)
    for unit in truth.units:
        name = Path(unit.name) / "response" / "drive_1.csv"
        a, b = (np.loadtxt(tmp_path / of / name, delimiter=",", skiprows=2)[:, 2] for of in "ab")
        assert_allclose(b, truth.gains[unit.rig]["current"] * a, atol=0.12)
    assert truth.gains[0] != truth.gains[1]


@pytest.mark.slow
def test_a_seed_is_a_fleet_however_many_write_it(tmp_path: Path) -> None:
    for name, seed, processes in (("a", 1, 1), ("b", 1, 2), ("c", 2, 1)):
        make_fleet(tmp_path / name, Line(), 3, seed, tests=BRIEF, processes=processes)
    a, b, c = (contents(tmp_path / name) for name in "abc")
    assert a == b
    assert a != c


def test_the_truth_is_written_where_it_is_asked_for(tmp_path: Path) -> None:
    truth = draw_fleet(Line(odd=(Odd(0, "K_s"),)), 2, SEED)
    truth.write(tmp_path / "truth.json")
    assert '"SYN0001": "K_s"' in (tmp_path / "truth.json").read_text(encoding="utf-8")


def test_limits_are_written_as_they_are_allowed(tmp_path: Path) -> None:
    limits = {"K_s": Limits(0.13, 0.16, "N*m/rad"), "T_f": Limits(None, 0.26, "N*m")}
    make_fleet(tmp_path, Line(), 1, SEED, tests=BRIEF, limits=limits)
    told = tomllib.loads((tmp_path / "fleet.toml").read_text(encoding="utf-8"))
    assert told["limits"] == {
        "K_s": {"low": 0.13, "high": 0.16, "unit": "N*m/rad"},
        "T_f": {"high": 0.26, "unit": "N*m"},
    }


COMMITTED = Path(__file__).parents[1] / "measurements" / "fleet_12"


def test_odd_and_even_of_the_committed_twelve_are_made_anew_byte_for_byte(tmp_path: Path) -> None:
    truth = draw_fleet(line_fleet.LINE, line_fleet.UNITS, line_fleet.SEED)
    for number in (1, 4, 9):  # the last two are odd
        write_unit(tmp_path, truth.gains, LINE_TESTS, BENCH, "", truth.units[number])
    made, kept = contents(tmp_path), contents(COMMITTED)
    assert len(made) == 15
    assert [file for file in made if made[file] != kept[file]] == []


def test_the_twelve_keep_their_secret_and_their_size() -> None:
    kept = contents(COMMITTED)
    assert len(kept) == 12 * 5 + 2
    assert sum(map(len, kept.values())) < 2_000_000
    words = b"".join(kept.values()).decode().lower()
    assert "synthetic" in words
    kinds = {*MEDIUM, *LINE_MISTAKES} - {"gear_ratio"}  # which is a key of fleet.toml
    assert not [kind for kind in kinds if kind in words or kind.replace("_", " ") in words]


@pytest.mark.slow
def test_all_twelve_are_made_anew_byte_for_byte(tmp_path: Path) -> None:
    truth = line_fleet.main(tmp_path)
    assert len(truth.odd) == 2
    assert contents(tmp_path) == contents(COMMITTED)
