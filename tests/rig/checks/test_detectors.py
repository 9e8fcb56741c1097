"""Every detector over folders of the independent generator: silent on clean ones, right on those with one mistake."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from benchmarks.bank import case
from etcfit.errors import MeasurementError
from etcfit.rig.checks import DETECTORS, AbstractDetector, findings, refuse
from etcfit.rig.checks.base import Records
from etcfit.rig.checks.series_resistance import SeriesResistance
from etcfit.rig.finding import Finding
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, draw_truth, make_folder
from independent.mistakes import MISTAKES, ONLY_BY_A_FIT, Sheet, edited, make_mistaken

# one folder each here; rates over many are `python -m benchmarks.rig_checks`
SEEDS = {mistake: 7100 for mistake in MISTAKES if mistake not in ("duplicate", *ONLY_BY_A_FIT)}


@pytest.fixture(scope="module", params=[7100, 7101])
def clean(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clean")
    make_folder(folder, draw_truth(np.random.default_rng(request.param), CONSISTENT), request.param, size="small")
    return folder


def mistaken(folder: Path, mistake: str, seed: int):
    return make_mistaken(folder, draw_truth(np.random.default_rng(seed), CONSISTENT), seed, mistake, "diagnose")


def test_a_clean_folder_gives_no_alarm(clean: Path) -> None:
    rig = read_folder(clean)
    assert rig.findings == ()
    assert rig.warnings == ()


@pytest.mark.parametrize("detector", DETECTORS, ids=lambda d: d.kind)
def test_the_contract(detector: AbstractDetector) -> None:
    assert dataclasses.is_dataclass(detector)
    assert type(detector)() == detector  # thresholds have defaults
    with pytest.raises(dataclasses.FrozenInstanceError):
        detector.kind = "other"  # pyright: ignore[reportAttributeAccessIssue]
    assert re.fullmatch(r"[a-z_]+", detector.kind)


def test_kinds_are_unique() -> None:
    assert len({detector.kind for detector in DETECTORS}) == len(DETECTORS)


@pytest.mark.slow
@pytest.mark.parametrize(("mistake", "seed"), SEEDS.items(), ids=SEEDS.keys())
def test_each_mistake_is_named_where_it_is_and_nothing_else(tmp_path: Path, mistake: str, seed: int) -> None:
    done = mistaken(tmp_path / "rig", mistake, seed)
    rig = read_folder(tmp_path / "rig")
    assert {(f.kind, f.test) for f in rig.findings} == {(done.kind, done.test)}, done
    for finding in rig.findings:
        assert finding.mend
        assert finding.found.endswith(".")
        assert str(finding) in rig.warnings
        assert json.loads(json.dumps(dataclasses.asdict(finding)))["kind"] == done.kind


SIZES = {"series_resistance": 0.05, "gear_ratio": 0.05, "time_scale": 0.006, "channel_offset": 0.15, "hum": 0.3}


@pytest.mark.slow
@pytest.mark.parametrize(("mistake", "near"), SIZES.items(), ids=SIZES.keys())
def test_its_size_is_that_of_the_mistake(tmp_path: Path, mistake: str, near: float) -> None:
    done = mistaken(tmp_path / "rig", mistake, 7100)
    found = next(f for f in read_folder(tmp_path / "rig").findings if f.kind == done.kind)
    size = found.size * (1e-3 if found.unit.startswith("m") else 1.0)
    assert size == pytest.approx(1.0 / done.size if mistake == "gear_ratio" else done.size, rel=near)


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
    for path in folder.glob("*.csv"):
        path.write_text(path.read_text(encoding="utf-8").replace(header, new, 1), encoding="utf-8")


def test_the_mend_of_a_series_resistance_mends_it(tmp_path: Path) -> None:
    mistaken(tmp_path, "series_resistance", 7100)
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


def test_thresholds_are_fields(clean: Path) -> None:
    rig = read_folder(clean)
    assert findings(rig.config, rig.measurements, [SeriesResistance(share=1e-4, errors=1e-3)])


def test_what_physics_rules_out_is_refused() -> None:
    sure = Finding("channel_sign", -1.0, "", 0.0, "It is turned.", "Turn it back.", "viscous", sure=True)
    with pytest.raises(MeasurementError, match=r"rig/viscous: channel_sign: It is turned\..*Turn it back\.") as caught:
        refuse("rig", [sure, sure])
    assert "1 more" in str(caught.value)
    refuse("rig", [dataclasses.replace(sure, sure=False)])


@pytest.mark.parametrize(("factor", "sure"), [(np.pi / 30.0, True), (1.12 * np.pi / 30.0, False)])
def test_a_speed_under_the_wrong_head_is_refused_where_its_factor_is_a_units(
    clean: Path, factor: float, sure: bool
) -> None:
    """A gear ratio miscounted by as much would look the same; one that is nearly a unit's factor alone may be."""
    edited(clean, "viscous", lambda sheet: sheet.scaled("motor_speed", factor))
    try:
        found = [f for f in read_folder(clean).findings if f.channel == "motor_speed"]
        assert [(f.kind, f.sure) for f in found] == [("unit_scale", sure)]
        assert found[0].mend == (
            "Head the column 'motor_speed [rad/s]' there. If the unit is right, gear_ratio in rig.toml is wrong."
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
