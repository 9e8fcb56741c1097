"""What `check` notices of clocks and channels, and its verdict on what a folder can identify."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import etcfit
import folders
from etcfit.car_log import DriveLog, Series, study
from etcfit.cli import app
from etcfit.errors import MeasurementError
from etcfit.estimation.ready import ready
from etcfit.experiment.check import channel_check, check, clipped, clock
from etcfit.experiment.settings import CheckSettings
from etcfit.reporting.blocks import render
from etcfit.reporting.check_table import check_table
from etcfit.rig.base import Channel, Rig
from etcfit.rig.reader import read_folder
from independent import CONSISTENT, draw_truth, second_order
from independent.mistakes import make_mistaken


def channel(value: np.ndarray, **changes: object) -> Channel:
    plain = Channel(np.arange(value.size) * 1e-3, value, 0.01, True, "tps [V]", "V", 1.0)
    return replace(plain, **changes)  # pyright: ignore[reportArgumentType]


def test_clock_tells_jitter_from_gaps() -> None:
    steps = np.tile([0.9e-3, 1.0e-3, 1.1e-3], 30)
    steps[45] = 0.05
    found = clock(np.concatenate(([0.0], np.cumsum(steps))))
    assert found.samples == 91
    assert found.rate == pytest.approx(1000.0)
    assert found.jitter == pytest.approx(0.1 * np.sqrt(2 / 3), rel=0.01)
    assert (found.gaps, found.longest) == (1, pytest.approx(0.05))
    assert clock(np.concatenate(([0.0], np.cumsum(steps))), CheckSettings(gap=100.0)).gaps == 0


def test_saturation_is_seen_and_plateaus_are_not() -> None:
    rng = np.random.default_rng(0)
    wave = np.sin(np.linspace(0, 20, 2000)) + rng.normal(0, 0.01, 2000)
    assert clipped(wave) == 0
    cut = np.clip(wave, -2.0, 0.8)
    assert clipped(cut) == pytest.approx(np.sum(cut == 0.8), rel=0.05)
    assert clipped(np.repeat([0.0, 1.0, 2.0, 3.0], 500)) == 0  # commands
    assert clipped(np.round(np.linspace(0.0, 5.0, 2000), 1)) == 0  # a coarse, slow ramp
    assert clipped(np.zeros(100)) == 0
    assert clipped(cut, CheckSettings(run=1000)) == 0


def test_a_channel_is_reported_in_its_logged_unit() -> None:
    # sensor volts: theta = (V - 0.5) 0.4
    found = channel_check("position", channel(np.array([0.0, 0.4, 0.8]), scale=0.4, offset=-0.2, sigma=0.004), rows=5)
    assert (found.low, found.high) == (pytest.approx(0.5), pytest.approx(2.5))
    assert found.sigma == pytest.approx(0.01)
    assert (found.empty, found.frozen) == (2, False)
    assert channel_check("current", channel(np.ones(9)), rows=9).frozen


def test_check_says_why_nothing_can_be_fitted(tmp_path: Path) -> None:
    files = {
        "rig.toml": folders.TOML + '\n[holdout]\nfiles = ["response/1.csv"]\n',
        "response/1.csv": folders.response().text(),
    }
    found = check(read_folder(folders.write(tmp_path, files)))
    assert found.identifiability is None
    assert "no trace that can be fitted" in found.why_not
    assert [t.file for t in found.traces] == ["response/1.csv"]
    assert found.traces[0].held_out


@pytest.fixture(scope="module")
def verdict(tmp_path_factory: pytest.TempPathFactory):
    """A driven plate with current and position, nothing else: motor and plate are one."""
    files = {"rig.toml": folders.TOML, "response/1.csv": folders.response(200).text()}
    return check(read_folder(folders.write(tmp_path_factory.mktemp("rig"), files)))


def test_a_driven_plate_alone_cannot_tell_motor_from_load(verdict) -> None:
    assert verdict.why_not == ""
    assert "J_m" in {s for d in verdict.identifiability.directions for s in d.symbols}
    assert any("J_m" in text and "motor-alone" in text for text in verdict.directions)
    assert len(verdict.directions) == len(verdict.identifiability.directions) > 0
    assert (np.diff(verdict.identifiability.singular_values) <= 0).all()


def test_a_trace_with_a_setpoint_is_judged_as_a_log_of_a_car() -> None:
    """By the same thresholds and sentences; nothing else of this rig can be fitted."""
    log = second_order.log([20.0, 60.0, 35.0, 70.0, 40.0], 0.3, 40.0, 200.0)
    frame = pd.DataFrame({"time [s]": log["time"], "setpoint [%]": log["setpoint"], "position [%]": log["position"]})
    rig = Rig.from_frames({"closed_loop/steps": frame}, {"rig": {"name": "car", "travel_deg": [7.0, 90.0]}})
    result = check(rig)
    (found,) = result.follows
    position, setpoint = (Series(log["time"], log[name]) for name in ("position", "setpoint"))
    drive = study(DriveLog("steps", position, setpoint))
    assert [j.says for j in found.verdict.judgements] == [j.says for j in drive.verdict.judgements]
    assert "closed_loop/steps: good enough?" in (shown := render(check_table(result)))
    assert "NOT GOOD" in shown


def folder_of(path: Path, mistake: str) -> Path:
    make_mistaken(path, draw_truth(np.random.default_rng(7100), CONSISTENT), 7100, mistake, "small")
    return path


@pytest.fixture(scope="module")
def resistor(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("rig"), "series_resistance")


@pytest.fixture(scope="module")
def turned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return folder_of(tmp_path_factory.mktemp("rig"), "channel_sign")


@pytest.mark.slow
def test_check_shows_the_find_and_its_mend_once(resistor: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(resistor), "--quiet"])
    assert (done.exit_code, done.stderr) == (0, "")
    assert "inductance/" in done.stdout
    assert "What these traces can identify" in done.stdout
    assert "Mistakes and habits of the rig, and what mends them" in done.stdout
    tables, _, closing = done.stdout.partition("Answer: ")
    assert tables.count('[tests.inductance] series_ohm = "free"') == 1
    assert closing.count('[tests.inductance] series_ohm = "free"') == 1  # what to do next


def test_what_physics_rules_out_ends_check_with_1_but_shows_the_folder(turned: Path) -> None:
    done = CliRunner().invoke(app, ["check", str(turned), "--quiet"])
    assert done.exit_code == 1
    assert "Traces" in done.stdout
    assert "no fit takes it" in done.stdout
    assert "channel_sign" in done.stderr


def test_a_fit_refuses_it_and_warns_of_the_others(turned: Path, resistor: Path) -> None:
    with pytest.raises(MeasurementError, match="channel_sign"):
        ready(read_folder(turned))
    rig = read_folder(resistor)
    ready(rig)
    assert any("series_resistance" in warning for warning in rig.warnings)


@pytest.mark.slow
def test_the_api_has_them_as_a_frame(resistor: Path) -> None:
    found = etcfit.check(resistor, quiet=True).findings
    assert list(found.index) == ["series_resistance"]
    assert found.loc["series_resistance", "test"] == "inductance"
    assert found["size"].dtype == np.float64
    assert found["sure"].tolist() == [False]
