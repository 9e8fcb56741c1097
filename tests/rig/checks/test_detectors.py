"""Every detector over folders of the independent generator: silent on clean ones, right on those with one mistake.

Then instruments that lie and logs that are too slow: each is found with its figure, and none where there is none.
"""

from __future__ import annotations

import ast
import dataclasses
import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bank import case, cases
from etcfit.errors import MeasurementError
from etcfit.rig import checks
from etcfit.rig.base import Finding
from etcfit.rig.checks import DETECTORS, refuse
from etcfit.rig.checks.base import Records
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, MEDIUM, NONE, Bench, Truth, draw_truth, lying, make_folder
from independent.control import Computer
from independent.folder import rig_toml, write_folder
from independent.mistakes import MISTAKES, ONLY_BY_A_FIT, Sheet, edited, make_mistaken
from independent.protocols import Series
from independent.under_ecu import Log, add_coarse_logs

# one folder each here; rates over many are `python -m benchmarks.rig_checks`
SEED = 7100
NAMED = [mistake for mistake in MISTAKES if mistake not in ("duplicate", *ONLY_BY_A_FIT)]
# how near the size that is found is to the one that was made, where a finding has one
NEAR = {"series_resistance": 0.05, "gear_ratio": 0.05, "time_scale": 0.006, "channel_offset": 0.15, "hum": 0.3}


@pytest.fixture(scope="module", params=[7100, 7101])
def clean(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clean")
    make_folder(folder, draw_truth(np.random.default_rng(request.param), CONSISTENT), request.param, size="small")
    return folder


def mistaken(folder: Path, mistake: str):
    return make_mistaken(folder, draw_truth(np.random.default_rng(SEED), CONSISTENT), SEED, mistake, "diagnose")


def test_a_clean_folder_gives_no_alarm(clean: Path) -> None:
    rig = read_folder(clean)
    assert rig.findings == ()
    assert rig.warnings == ()


def test_every_detector_is_registered_once() -> None:
    """A detector is a public function from records to findings."""
    files = Path(checks.__file__).parent.glob("*.py")
    functions = [node for file in files for node in ast.parse(file.read_text(encoding="utf-8")).body
                 if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]  # fmt: skip
    found = [f.name for f in functions if ast.unparse(f.args) == "records: Records"]
    assert len(found) > 10
    assert sorted(found) == sorted(detector.kind for detector in DETECTORS)


@pytest.mark.slow
@pytest.mark.parametrize("mistake", NAMED)
def test_each_mistake_is_named_where_it_is_with_its_size_and_nothing_else(tmp_path: Path, mistake: str) -> None:
    done = mistaken(tmp_path / "rig", mistake)
    rig = read_folder(tmp_path / "rig")
    assert {(f.kind, f.test) for f in rig.findings} == {(done.kind, done.test)}, done
    for finding in rig.findings:
        assert finding.mend
        assert finding.found.endswith(".")
        assert str(finding) in rig.warnings
        assert json.loads(json.dumps(dataclasses.asdict(finding)))["kind"] == done.kind
    if mistake in NEAR:
        size = rig.findings[0].size * (1e-3 if rig.findings[0].unit.startswith("m") else 1.0)
        assert size == pytest.approx(1.0 / done.size if mistake == "gear_ratio" else done.size, rel=NEAR[mistake])


def test_every_size_that_is_held_against_the_mistake_is_of_one() -> None:
    assert set(NEAR) <= set(NAMED)


def test_the_mend_of_a_sign_mends_it(clean: Path, tmp_path: Path) -> None:
    edited(clean, "viscous", lambda sheet: sheet.scaled("current", -1.0))
    try:
        found = next(f for f in read_folder(clean).findings if f.kind == "channel_sign")
        header = re.search(r"'(.+?)'", found.mend)
        assert header is not None
        assert header[1] == "current [-1 A]"
        rename(clean / "viscous", "current [A]", header[1])
        assert read_folder(clean).findings == ()
    finally:
        rename(clean / "viscous", "current [-1 A]", "current [A]")
        edited(clean, "viscous", lambda sheet: sheet.scaled("current", -1.0))


def rename(folder: Path, header: str, new: str) -> None:
    for path in folder.rglob("*.csv"):
        path.write_text(path.read_text(encoding="utf-8").replace(header, new, 1), encoding="utf-8")


def test_the_mend_of_a_series_resistance_mends_it(tmp_path: Path) -> None:
    mistaken(tmp_path, "series_resistance")
    toml = tmp_path / "rig.toml"
    mend = next(f.mend for f in read_folder(tmp_path).findings)
    assert mend == 'Write [tests.inductance] series_ohm = "free" in rig.toml.'
    toml.write_text(toml.read_text(encoding="utf-8") + '\n[tests.inductance]\nseries_ohm = "free"\n', encoding="utf-8")
    assert read_folder(tmp_path).findings == ()


def test_one_file_of_a_test_is_named_alone(tmp_path: Path) -> None:
    make_folder(tmp_path, CONSISTENT, 7100, size="small")
    path = tmp_path / "resistance" / "volts_2.csv"
    Sheet.read(path).scaled("current", -1.0).write(path)
    found = read_folder(tmp_path).findings
    assert [(f.kind, f.file, f.channel) for f in found] == [("channel_sign", "resistance/volts_2.csv", "current")]


def test_what_physics_rules_out_is_refused() -> None:
    sure = Finding("channel_sign", -1.0, "", 0.0, "It is turned.", "Turn it back.", "viscous", sure=True)
    with pytest.raises(MeasurementError, match=r"rig/viscous: channel_sign: It is turned\..*Turn it back\.") as caught:
        refuse("rig", [sure, sure])
    assert "1 more" in str(caught.value)
    refuse("rig", [dataclasses.replace(sure, sure=False)])


@pytest.mark.parametrize(
    ("factor", "sure"), [(np.pi / 30.0, True), (0.97 * np.pi / 30.0, True), (1.12 * np.pi / 30.0, False)]
)
def test_a_speed_under_the_wrong_head_is_refused_where_its_factor_is_a_units(
    clean: Path, factor: float, sure: bool
) -> None:
    """A gear ratio miscounted by as much would look the same; one that is nearly a unit's factor alone may be."""
    edited(clean, "viscous", lambda sheet: sheet.scaled("motor_speed", factor))
    try:
        found = [f for f in read_folder(clean).findings if f.channel == "motor_speed"]
        assert [(f.kind, f.sure) for f in found] == [("unit_scale", sure)]
        assert found[0].mend == (
            "Name the column 'motor_speed [rad/s]' there. If the unit is right, gear_ratio in rig.toml is wrong."
        )
    finally:
        edited(clean, "viscous", lambda sheet: sheet.scaled("motor_speed", 1.0 / factor))


def test_one_trace_in_which_little_is_told_apart_is_not_believed_against_its_test(tmp_path: Path) -> None:
    """The motor alone at 2 V: brushes, resistance and EMF look alike in it, and its own k comes out negative."""
    seed = 5220
    chosen = case(seed)
    make_folder(tmp_path, chosen.truth, seed, chosen.effects, "small")
    rig = read_folder(tmp_path)
    own = Records(rig.config, rig.measurements).circuit_of["viscous/volts_1.csv"].k
    assert own is not None
    assert own.sign(5.0) < 0  # the case is what it is said to be
    assert rig.findings == ()


# static_load and response alone: currents, levels, motion, both signs
WITH_CURRENT = {
    "resistance": Series(3, 0.2, 1000),
    "inductance": Series(2, 0.01, 20_000),
    "static_load": Series(1, 8.0, 100),
    "response": Series(3, 1.5, 1000),
}


def body(seed: int) -> Truth:
    return draw_truth(np.random.default_rng(seed), CONSISTENT)


@pytest.fixture(scope="module", params=[7800, 7801])
def honest(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Truth]:
    seed = request.param
    return made(tmp_path_factory.mktemp("honest") / str(seed), seed), body(seed)


def made(path: Path, seed: int) -> Path:
    write_folder(path, "rig", body(seed), seed, NONE, WITH_CURRENT, Bench(), holdout=False, noise=seed % 2 == 0)
    return path


def lied(honest: Path, to: Path, lie: Callable[[Path], None]) -> tuple[Finding, ...]:
    shutil.copytree(honest, to)
    lie(to)
    return read_folder(to).findings


def test_few_tests_by_honest_instruments_give_no_alarm(honest: tuple[Path, Truth]) -> None:
    assert read_folder(honest[0]).findings == ()


def test_a_current_of_the_supply_is_found_with_the_resistance_behind_it(
    honest: tuple[Path, Truth], tmp_path: Path
) -> None:
    (found,) = lied(honest[0], tmp_path / "rig", lying.supply_current)
    assert (found.kind, found.test, found.channel, found.unit) == ("supply_current", None, "current", "ohm")
    assert found.size == pytest.approx(honest[1].R_a, rel=0.02)
    assert "'supply_current [" in found.mend


def test_its_header_mends_it(honest: tuple[Path, Truth], tmp_path: Path) -> None:
    lying.supply_current(shutil.copytree(honest[0], tmp_path / "rig"))
    rename(tmp_path / "rig", "current [", "supply_current [")
    mended, was = read_folder(tmp_path / "rig"), read_folder(honest[0])
    assert mended.findings == ()
    for trace, true in zip(mended.measurements, was.measurements, strict=True):
        current, logged = trace.channels["current"], true.channels["current"]
        there = np.isin(logged.time, current.time)
        near = 6.0 * np.max(np.abs(logged.value)) * 1e-2 + 6.0 * logged.sigma
        assert np.max(np.abs(current.value - logged.value[there]), initial=0.0) < near


def test_a_supply_current_needs_a_duty(honest: tuple[Path, Truth], tmp_path: Path) -> None:
    shutil.copytree(honest[0], tmp_path / "rig")
    rename(tmp_path / "rig", "current [", "supply_current [")
    toml = tmp_path / "rig" / "rig.toml"
    toml.write_text(toml.read_text(encoding="utf-8").replace("supply_V = 12.0", ""), encoding="utf-8")
    with pytest.raises(MeasurementError, match="without a duty"):
        read_folder(tmp_path / "rig")


def test_a_current_without_its_sign_is_found_where_it_lost_one(tmp_path: Path) -> None:
    for seed in (7801, 7802):
        lying.binary_drive(tmp_path / str(seed), body(seed), seed, 40, (-6.0, 6.0), 1000.0)
        found = lied(
            tmp_path / str(seed), tmp_path / f"lied_{seed}", lambda to: lying.unsigned_current(to, ["response"])
        )
        unsigned = [f for f in found if f.kind == "unsigned_current"]
        assert [(f.test, f.channel) for f in unsigned] == [("response", "current")]
        assert 0.2 < unsigned[0].size < 0.8  # share of the stretches that the voltage drives backwards
        with pytest.raises(MeasurementError, match="lost its sign"):
            refuse("rig", found)


@pytest.mark.parametrize("seed", [6892, 6972])
def test_a_dead_zone_of_the_driver_is_no_mistake_of_the_current(seed: int, tmp_path: Path) -> None:
    """Two of the training bank, which were taken for a current of the supply, and for one without its sign: in a motor
    that runs alone at two voltages."""
    (dead_zone,) = cases.chosen("single:driver_dead_zone", seed, 1)
    cases.made(dead_zone, tmp_path)
    assert read_folder(tmp_path).findings == ()


def test_a_voltage_that_shows_the_pwm_is_refused(honest: tuple[Path, Truth], tmp_path: Path) -> None:
    found = lied(honest[0], tmp_path / "rig", lambda to: lying.switched_voltage(to, np.random.default_rng(7810)))
    assert [(f.kind, f.test, f.channel) for f in found] == [("switched_voltage", "response", "voltage")]
    with pytest.raises(MeasurementError, match=r"jumps \d+ times, and the current does not follow"):
        refuse("rig", found)


@pytest.mark.parametrize(
    ("hold", "levels", "rate"), [(1, (0.0, 12.0), 1000), (3, (-6.0, 6.0), 1000), (1, (0.0, 8.0), 200)]
)
def test_a_binary_signal_that_really_drives_is_none(tmp_path: Path, hold: int, levels: tuple, rate: int) -> None:
    lying.binary_drive(tmp_path, body(7811), 7811, hold, levels, rate)
    assert {f.kind for f in read_folder(tmp_path).findings} <= {"synchronous_edges"}


def test_two_lags_of_a_current_are_told_apart_from_one(tmp_path: Path) -> None:
    seed = 7800
    write_folder(tmp_path, "rig", body(seed), seed, NONE, STEPS, Bench(), holdout=False, noise=True)
    assert read_folder(tmp_path).findings == ()
    lying.slow_current(tmp_path, 2e-3, np.random.default_rng(seed), tests=["inductance"])
    (slow,) = read_folder(tmp_path).findings
    assert (slow.kind, slow.test, slow.channel, slow.unit) == ("slow_current", "inductance", "current", "s")
    assert slow.size == pytest.approx(2e-3, rel=0.1)
    named = re.search(r"of ([\d.]+) and ([\d.]+) ms", slow.found)
    assert named is not None
    winding = body(seed).L_a / (body(seed).R_a + Bench().series_ohm)
    assert 1e-3 * float(named[2]) == pytest.approx(winding, rel=0.3)


STEPS = {"inductance": Series(4, 0.02, 20_000)}


def test_a_lag_that_no_winding_has_makes_the_inductance_an_upper_bound(
    honest: tuple[Path, Truth], tmp_path: Path
) -> None:
    found = lied(honest[0], tmp_path / "rig", lambda to: lying.slow_current(to, 0.02, np.random.default_rng(7813)))
    (slow,) = [f for f in found if f.kind == "slow_current"]
    assert slow.size == pytest.approx(0.02 + honest[1].L_a / honest[1].R_a, rel=0.1)
    assert "upper bound of L_a" in slow.found


def test_a_log_slower_than_its_controller_is_found_and_a_log_of_every_tick_is_not(tmp_path: Path) -> None:
    for every in (1, 5):
        lying.duty_log(tmp_path / str(every), body(7820), 7820, rate=500.0, every=every)
    assert read_folder(tmp_path / "1").findings == ()
    (found,) = read_folder(tmp_path / "5").findings
    assert (found.kind, found.test, found.channel, found.unit) == ("slow_log", "response", "duty", "Hz")
    assert found.size == pytest.approx(100.0)
    assert "[ecu]" in found.mend


@pytest.mark.parametrize("seed", [7840, 7841, 7842])
def test_a_log_is_too_slow_where_the_plate_moves_before_the_jumps_of_its_input(tmp_path: Path, seed: int) -> None:
    for rate in (100.0, 500.0):
        folder, how = tmp_path / f"{rate:.0f}", Log(rate=rate)
        add_coarse_logs(folder, body(seed), Computer(6.0, 40.0, 0.12, period=2e-3), seed, ("steps",) * 4, how)
        toml = rig_toml("synthetic", body(seed).N, Bench(), [], noise=True)
        (folder / "rig.toml").write_text(
            toml.replace('[tests.inductance]\nseries_ohm = "free"\n', ""), encoding="utf-8"
        )
    assert read_folder(tmp_path / "500").findings == ()
    (found,) = read_folder(tmp_path / "100").findings
    assert (found.kind, found.size) == ("slow_log", pytest.approx(100.0))
    moved = re.search(r"has moved before (\d+) of its jumps, (\d+) times in their direction", found.found)
    assert moved is None or 2 * int(moved[2]) > int(moved[1])


def test_a_controller_as_slow_as_the_log_is_no_find(tmp_path: Path) -> None:
    lying.duty_log(tmp_path, body(7822), 7822, rate=100.0, every=1)
    assert read_folder(tmp_path).findings == ()


def test_the_current_of_a_ramp_that_begins_with_the_record_is_no_offset(tmp_path: Path) -> None:
    """v/R of the first samples lies below the noise of the voltage: 0.014 A, ten standard errors, at this seed."""
    seed = 7802
    sizes = {"static_load": Series(1, 20.0, 500)}
    write_folder(tmp_path, "rig", body(seed), seed, NONE, sizes, Bench(), holdout=False, noise=True)
    path = tmp_path / "static_load" / "ramp_1.csv"
    sheet = Sheet.read(path)
    volts = np.convolve(sheet.rows[:, sheet.at("voltage")], np.ones(20) / 20.0, "same")
    rows = sheet.rows[int(np.argmax(volts > 0.01)) :].copy()
    rows[:, 0] -= rows[0, 0]
    replace(sheet, rows=rows).write(path)
    assert read_folder(tmp_path).findings == ()


def test_a_bridge_that_coasts_is_found_by_speeds_that_hardly_grow(tmp_path: Path) -> None:
    lying.coasting_log(tmp_path, body(7830), 7830)
    (found,) = [f for f in read_folder(tmp_path).findings if f.kind == "coasting_bridge"]
    assert (found.test, found.unit) == ("response", "")
    assert 0.0 < found.size < 0.4
    assert "duty x supply" in found.found


def test_a_motor_alone_on_a_bridge_that_does_not_coast_is_none(tmp_path: Path) -> None:
    seed = 7802
    sizes = {"viscous": Series(6, 0.6, 1000)}
    write_folder(tmp_path, "rig", body(seed), seed, MEDIUM["quadratic_drag"], sizes, Bench(), holdout=False, noise=True)
    assert read_folder(tmp_path).findings == ()
