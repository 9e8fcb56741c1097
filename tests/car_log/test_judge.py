"""Logs held against the thresholds, in words; the same thresholds for log, bench and design."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import etcfit
from etcfit.car_log import DriveLog, Series, Study, study
from etcfit.car_log.criteria import OVERSHOOT, SETTLING
from etcfit.car_log.duty import duty_use
from etcfit.car_log.study import verdict
from etcfit.cli import app
from etcfit.control.loop_figures import Requirements
from etcfit.reporting.car_log import in_a_word
from independent import hunting
from schemas import read_valid
from second_order import log as second_order


def of(zeta: float, wn: float, rate: float = 200.0, held: float = 1.0) -> Study:
    levels = [20.0, 60.0, 35.0, 40.0, 15.0, 50.0, 42.0, 70.0, 30.0]
    position, wanted = second_order(levels, zeta, wn, rate, held=held)
    return study(DriveLog("a.csv", position, wanted))


def words(found: Study) -> dict[str, str]:
    return {each.name: each.word for each in found.verdict.judgements}


def test_a_good_loop_is_good_and_each_fault_is_named() -> None:
    good = of(0.8, 40.0)
    assert good.verdict.word == "good", good.verdict.says
    assert good.verdict.says.startswith("Good enough in overshoot")
    swings = of(0.3, 40.0)
    assert words(swings)["overshoot"] == "not good"
    assert "Overshoot: 37" in swings.verdict.says
    assert "the paper, section 4.1" in swings.verdict.says
    slow = of(0.8, 12.0)
    assert {name for name, word in words(slow).items() if word == "not good"} >= {"settling", "lag", "tracking error"}


def test_what_a_log_does_not_hold_is_not_judged() -> None:
    time = np.arange(0.0, 20.0, 0.01)
    bare = study(DriveLog("a.csv", Series(time, 30.0 + np.sin(time)), None))
    assert bare.verdict.word == "cannot be said"
    assert set(words(bare).values()) == {"cannot be said"}
    slow = of(0.8, 40.0, rate=20.0)
    assert in_a_word(slow.verdict) == (
        "Good enough in what this log shows; not known: overshoot, settling, error at rest, oscillation at rest."
    )
    assert in_a_word(of(0.8, 40.0, held=2.0).verdict) == "Good enough."
    assert words(slow)["settling"] == "cannot be said"
    assert "20 Hz is too slow" in next(j.where for j in slow.verdict.judgements if j.name == "settling")


def test_a_coarse_sensor_hides_an_oscillation() -> None:
    position, wanted = second_order([20.0, 60.0] * 4, 0.8, 40.0, 200.0, held=2.0)
    fine, coarse = (DriveLog("a", Series(position.time, q * np.round(position.value / q)), wanted) for q in (0.1, 1.0))
    assert words(study(fine))["oscillation at rest"] == "good"
    assert words(study(coarse))["oscillation at rest"] == "cannot be said"


def test_one_step_of_ten_may_be_spoilt() -> None:
    position, wanted = second_order([20.0, 60.0] * 6, 0.8, 40.0, 200.0)
    spoilt = np.where(np.abs(position.time - 5.2) < 0.05, position.value + 30.0, position.value)
    assert words(study(DriveLog("a", Series(position.time, spoilt), wanted)))["overshoot"] == "good"


def test_a_harder_drive_may_have_a_larger_error() -> None:
    """A loop that just settles in time passes on any setpoint, one that is half as fast on none."""
    for held in (0.5, 2.0):
        assert words(of(0.99, 35.0, held=held))["tracking error"] == "good"
        assert words(of(0.99, 12.0, held=held))["tracking error"] == "not good"


def test_what_new_gains_have_made_good_is_said() -> None:
    before, after = of(0.3, 40.0), of(0.8, 40.0)
    assert "Now good: overshoot" in verdict(before, after)
    assert "No longer good: overshoot" in verdict(after, before)
    assert "Still not good: settling, tracking error, lag." in verdict(of(0.8, 12.0), of(0.8, 13.0))


def test_thresholds_are_those_of_design() -> None:
    assert Requirements().overshoot_pct == OVERSHOOT.limit == 20.0
    assert Requirements().settling_s == SETTLING.limit == 0.2


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_a_duty_at_its_limit(share: float) -> None:
    time = np.arange(0.0, 20.0, 0.01)
    restless = np.random.default_rng(0).standard_normal(time.size)
    at = time % 1.0 < share
    found = duty_use(Series(time, np.where(at, 85.0, 20.0 + 3.0 * restless)), Series(time, np.full(time.size, 40.0)))
    assert found.limit == pytest.approx(85.0)
    assert found.saturated == pytest.approx(share, abs=0.01)
    assert found.saturated_at_rest == pytest.approx(share, abs=0.01)
    assert found.longest == pytest.approx(share, abs=0.02)
    calm = duty_use(Series(time, 20.0 + 3.0 * restless), Series(time, np.full(time.size, 40.0)))
    assert calm.limit is None
    assert calm.activity == pytest.approx(3.0, rel=0.05)
    assert calm.jitter == pytest.approx(3.0, rel=0.05)


def test_the_error_by_parts_of_the_travel() -> None:
    time = np.arange(0.0, 40.0, 0.01)
    wanted = np.where(time % 4.0 < 2.0, 30.0, 70.0)
    found = study(
        DriveLog("a", Series(time, wanted + np.where(wanted < 50.0, 0.5, -2.0)), Series(time, wanted))
    ).tracking
    assert found is not None
    assert [(r.low, r.high) for r in found.ranges] == [(20.0, 40.0), (60.0, 80.0)]
    assert [r.mean for r in found.ranges] == pytest.approx([0.5, -2.0])
    assert [r.seconds for r in found.ranges] == pytest.approx([20.0, 20.0], abs=0.1)


def written(folder: Path) -> Path:
    """A hunting log with its duty, as an ECU writes it."""
    rng = np.random.default_rng([2, 1])
    plate, pid = hunting.drawn("stick-slip", rng)
    wanted = hunting.staircase(rng, 16.0, 8.0)
    found = hunting.logged(rng, wanted, *hunting.run(plate, pid, wanted, 0.02, rng), 200.0, 0.05, 0.1)
    rows = np.stack([found[name] for name in ("time", "setpoint", "position", "duty")], axis=1)
    folder.mkdir()
    np.savetxt(
        folder / "a.csv", rows, delimiter=",", header="Time (s),TPS Target,TPS,ETB Duty (%)", comments="", fmt="%.4f"
    )
    return folder


def test_command_page_json_and_notebook_say_the_same(tmp_path: Path) -> None:
    logs, run = written(tmp_path / "car"), tmp_path / "run"
    done = CliRunner().invoke(app, ["drive", str(logs / "a.csv"), "--out", str(run), "--quiet"])
    assert done.exit_code == 0, done.output
    content = read_valid(run / "drive.json")
    (found,) = content["logs"]
    assert found["cycle"]["kind"] == "stick-slip"
    page = (run / "drive.html").read_text(encoding="utf-8")
    driven = etcfit.drive(logs, quiet=True)
    for said in (found["cycle_says"], "Not good enough: "):
        plain = " ".join(said.split())
        assert plain in " ".join(page.split())
        assert plain[:60] in " ".join(driven.summary().split())
    assert driven.good_enough["a.csv"] == found["verdict"]["says"]
    assert driven.judgements.loc[("a.csv", "oscillation at rest"), "word"] == "not good"
    assert len(driven.steps) == len(found["steps"]) == 1
    assert "NOT GOOD" in done.stdout
    assert "<script" not in page
