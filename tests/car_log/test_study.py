"""Range, spectrum and tracking of drives whose answers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from typer.testing import CliRunner

import car_logs
from etcfit.car_log import DriveLog, Series, spectrum, study, tracking, usage
from etcfit.car_log.study import verdict
from etcfit.car_log.usage import shortest
from etcfit.cli import app
from etcfit.reporting.blocks import render
from etcfit.reporting.car_log import drive_table
from etcfit.reporting.car_log.writing import draw
from etcfit.rig.base import RigConfig


def log_of(name: str = "a.csv", **how: float) -> DriveLog:
    log = car_logs.drive(**how)
    return DriveLog(name, Series(log["time"], log["position"]), Series(log["time"], log["setpoint"]))


def shaken(seed: int) -> DriveLog:
    """A plate that follows the foot but for a slow wander of its own."""
    log = log_of(lag=0.0)
    assert log.setpoint is not None
    noise = np.convolve(
        np.random.default_rng(seed).standard_normal(log.position.time.size + 299), np.ones(300) / 10, "valid"
    )
    return DriveLog(log.name, Series(log.position.time, log.position.value + noise), log.setpoint)


def test_a_slow_logger_and_a_fast_one_see_the_same_range() -> None:
    """20 s at 10 %, logged at 100 Hz, then 60 s at 40 %, logged at 10 Hz: each sample counts for its time."""
    time = np.concatenate((np.arange(0.0, 20.0, 0.01), np.arange(20.0, 80.0, 0.1)))
    value = np.where(time < 20.0, 10.0, 40.0)
    assert usage(Series(time, value), (30.0, 50.0)).between == pytest.approx(0.75, abs=0.002)


def test_the_shares_are_of_the_time() -> None:
    time = np.arange(0.0, 100.0, 0.1)
    found = usage(Series(time, np.where(time < 77.0, 20.0 + 0.1 * time, 60.0 + time)), (20.0, 30.0))
    assert found.between == pytest.approx(0.77, abs=0.002)
    assert found.shares.sum() == pytest.approx(1.0)
    assert found.shares[(found.edges[:-1] >= 20.0) & (found.edges[:-1] < 30.0)].sum() == pytest.approx(0.77, abs=0.002)
    assert found.shortest == pytest.approx((20.0, 27.7), abs=0.2)


def test_a_gap_in_the_log_is_no_time_spent_there() -> None:
    time = np.concatenate((np.arange(0.0, 10.0, 0.1), np.arange(500.0, 510.0, 0.1)))
    assert usage(Series(time, np.where(time < 10.0, 10.0, 40.0)), (0.0, 20.0)).between == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.77, 1.0])
def test_the_shortest_interval_is_the_shortest(share: float) -> None:
    value = np.random.default_rng(1).gamma(2.0, 10.0, 200)
    low, high = shortest(value, np.full(200, 1 / 200), share)
    count = round(200 * share)
    rising = np.sort(value)
    assert high - low == pytest.approx(min(rising[count - 1 :] - rising[: 201 - count]))
    assert np.sum((value >= low) & (value <= high)) >= count


@pytest.mark.parametrize("hertz", [0.5, 1.0, 1.37, 3.0])
def test_the_dominant_frequency_is_that_of_the_foot(hertz: float) -> None:
    found = spectrum(log_of(hertz=hertz).position)
    assert found is not None
    assert found.dominant == pytest.approx(hertz, abs=0.01)
    assert found.half == pytest.approx(hertz, abs=0.1)
    assert found.amplitude.max() == pytest.approx(12.0 / np.sqrt(2.0), rel=0.1)


@pytest.mark.parametrize("hertz", [0.2, 0.22])
def test_the_dominant_frequency_of_a_slow_square_is_a_peak_and_not_the_lowest_bin(hertz: float) -> None:
    """A square wave holds 1, 3, 5 times its frequency; the first lies below what is asked for."""
    time = 0.05 * np.arange(800)
    value = 30.0 + 12.5 * np.sign(np.sin(2 * np.pi * hertz * time + 0.1))
    found = spectrum(Series(time, np.convolve(value, np.ones(5) / 5.0, "same")))
    assert found is not None
    assert found.dominant == pytest.approx(3.0 * hertz, abs=0.02)


def test_a_log_of_three_seconds_has_no_spectrum() -> None:
    assert spectrum(log_of(seconds=3.0).position) is None


@pytest.mark.parametrize("lag", [-0.03, 0.0, 0.0234, 0.08, 0.3])
def test_lag_and_rmse_of_a_delayed_sine(lag: float) -> None:
    log = log_of(lag=lag)
    assert log.setpoint is not None
    found = tracking(log.position, log.setpoint)
    assert found.lag == pytest.approx(lag, abs=5e-4)
    # two sines a phase apart: each leaves 2 A sin(w d / 2) / sqrt 2
    parts = [2.0 * a * np.sin(np.pi * f * lag) / np.sqrt(2.0) for a, f in ((12.0, 1.0), (4.0, 0.05))]
    assert found.rmse == pytest.approx(np.hypot(*parts), rel=2e-3, abs=1e-9)
    assert found.left == pytest.approx(0.0, abs=0.05)
    assert found.demand == pytest.approx(12.0 * 2.0 * np.pi / np.sqrt(2.0), rel=0.01)


def test_rmse_is_equation_9() -> None:
    time = np.arange(5) / 10.0
    position, setpoint = np.array([1.0, 2.0, 4.0, 4.0, 9.0]), np.array([1.0, 1.0, 2.0, 4.0, 5.0])
    assert tracking(Series(time, position), Series(time, setpoint)).rmse == pytest.approx(np.sqrt((1 + 4 + 16) / 5))


def test_the_error_of_the_rmse_is_what_it_scatters_by() -> None:
    rng = np.random.default_rng(3)
    time, found = np.arange(0.0, 60.0, 0.1), []
    for _ in range(200):
        noise = np.convolve(rng.standard_normal(time.size + 19), np.ones(20) / 20**0.5, "valid")
        found.append(tracking(Series(time, 30.0 + noise), Series(time, np.full(time.size, 30.0))))
    spread = np.std([each.rmse for each in found])
    assert np.mean([each.stderr for each in found if each.stderr]) == pytest.approx(spread, rel=0.25)
    assert found[0].lag is None  # a setpoint that stands still tells none


def test_what_changed_is_said_with_how_sure_it_is() -> None:
    said = verdict(study(log_of(lag=0.08)), study(log_of(lag=0.05)))
    assert "lag 80 -> 50 ms" in said
    assert "is clear" in said
    assert "about equally fast" in said
    assert "cannot be compared directly" in verdict(study(log_of()), study(log_of(hertz=0.5)))
    assert "within its variation by chance" in verdict(study(shaken(1)), study(shaken(2)))
    bare = study(DriveLog("b", log_of().position, None))
    assert "a log without a setpoint" in verdict(bare, bare)


def test_the_busiest_stretch() -> None:
    time = np.arange(0.0, 100.0, 0.05)
    value = 20.0 + np.where((time > 60.0) & (time < 68.0), 10.0 * np.sin(9.0 * time), 0.0)
    assert Series(time, value).busiest(8.0) == pytest.approx(60.0, abs=0.3)


_OFF = "longest time off by more than 10 %"


def test_the_command_prints_writes_and_compares(tmp_path: Path) -> None:
    for name, lag in (("old.msl", 0.08), ("new.msl", 0.05)):
        (tmp_path / name).write_text(car_logs.msl(car_logs.drive(lag=lag)), encoding="utf-8")
    words = ["drive", str(tmp_path), "--compare", "old.msl", "new.msl", "--out", str(tmp_path / "run"), "--quiet"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    first, *table = [
        line for line in done.stdout.partition("\nAnswer:")[0].splitlines() if "->" in line or "<=" in line
    ]
    assert first.startswith("old.msl -> new.msl: RMSE ")  # then a row a figure, and no tables of either log
    assert [line.split("  ")[0] for line in table] == ["tracking error", "lag", _OFF]
    assert len(done.stdout.splitlines()) < 25
    answer, look, further = done.stdout.splitlines()[-3:]
    assert answer.startswith("Answer: RMSE ")
    assert look == f"Look:   {tmp_path / 'run' / 'drive.html'}"
    assert further.startswith("Next:   log this and put it into ")
    assert (tmp_path / "run" / "drive.json").is_file()
    assert sorted(p.name for p in (tmp_path / "run" / "pictures" / "drive").iterdir()) == [
        "new.png", "new_answers.png", "old.png", "old_answers.png"]  # fmt: skip
    wrong = CliRunner().invoke(app, ["drive", str(tmp_path), "--compare", "old.msl", "newer.msl"])
    assert wrong.exit_code == 2
    assert "There are: new.msl, old.msl" in wrong.stderr


def test_a_log_without_setpoint_or_length_is_drawn_all_the_same() -> None:
    log = log_of(seconds=3.0)
    assert draw(study(DriveLog("a", log.position, None)), True).axes


@pytest.mark.parametrize("hertz", [0.7, 2.0])
def test_a_gap_of_half_a_minute_is_not_in_the_spectrum(hertz: float) -> None:
    """The plate rests elsewhere after it: across the gap a straight line would stand for half a minute of motion."""
    whole = car_logs.drive(seconds=60.0, hertz=hertz)
    late = whole["time"] >= 30.0
    gapped = Series(whole["time"] + 30.0 * late, whole["position"] + 40.0 * late)
    alone, found = spectrum(Series(whole["time"], whole["position"])), spectrum(gapped)
    assert alone is not None
    assert found is not None
    assert found.dominant == pytest.approx(hertz, abs=0.01)
    assert found.amplitude == pytest.approx(alone.amplitude, rel=0.1, abs=0.02)


def shaken_by(seed: int, lag: float, size: float = 1.0) -> DriveLog:
    """A plate that comes late and wanders by itself: an error of so many % that forgets itself within 0.3 s."""
    late, keeps = log_of(lag=lag), np.exp(-0.01 / 0.3)
    noise = np.sqrt(1.0 - keeps**2) * np.random.default_rng(seed).standard_normal(late.position.time.size)
    wander = np.asarray(lfilter([1.0], [1.0, -keeps], noise))
    return DriveLog("a", Series(late.position.time, late.position.value + size * wander), late.setpoint)


def test_the_error_of_the_lag_is_what_it_scatters_by() -> None:
    found = [study(shaken_by(seed, 0.04)).tracking for seed in range(60)]
    lags = [each.lag for each in found if each is not None and each.lag is not None]
    stated = [each.lag_stderr for each in found if each is not None and each.lag_stderr is not None]
    assert len(lags) == len(stated) == 60
    assert np.mean(lags) == pytest.approx(0.04, abs=5e-4)
    assert np.sqrt(np.mean(np.square(stated))) == pytest.approx(np.std(lags), rel=0.3)


def test_a_shorter_lag_is_told_though_the_rmse_is_within_what_it_varies() -> None:
    """45 -> 31 ms under a wander of its own that hides it in the RMSE."""
    said = verdict(study(shaken_by(1, 0.045, 3.0)), study(shaken_by(5, 0.031, 3.0)))
    assert "The difference in RMSE is within its variation by chance" in said
    assert "The difference in lag is clear" in said
    same = verdict(study(shaken_by(1, 0.045)), study(shaken_by(2, 0.045)))
    assert "The difference in lag is within its variation by chance" in same


def test_an_error_that_is_next_to_none_is_not_written_out() -> None:
    log = log_of(lag=0.0)
    shown = render(drive_table(RigConfig("car"), [study(log), study(log_of(lag=0.08))]))
    assert "e-1" not in shown
    assert "<0.01" in shown
    assert "more than 100 standard errors" in " ".join(shown.split())
