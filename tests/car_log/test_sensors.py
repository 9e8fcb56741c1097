"""Two sensors of one plate swept once: ends, a second one that stops half way, turned and exchanged ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etcfit.car_log import study
from etcfit.car_log.log import Series
from etcfit.car_log.read import read_logs
from etcfit.car_log.sensors import Sensors, two_sensors

RESTS = 0.12  # of the travel, where springs hold the plate


def sweep(dwell: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Time (s) and share of the travel: from rest to closed, to open, to rest."""
    corners = np.cumsum([0.0, 1.0, 1.0, dwell, 3.0, dwell, 3.0, 1.0])
    time = np.arange(0.0, corners[-1], 0.01)
    return time, np.interp(time, corners, [RESTS, RESTS, 0.0, 0.0, 1.0, 1.0, RESTS, RESTS])


def of(first: np.ndarray, second: np.ndarray, opens: float = 0.0, tps: tuple[float, float] | None = None) -> Sensors:
    time, _ = sweep()
    rng = np.random.default_rng(0)
    one, two = (Series(time, each + 0.004 * rng.standard_normal(time.size)) for each in (first, second))
    found = two_sensors(one, two, "V", opens, tps)
    assert found is not None
    return found


X = sweep()[1]


def test_two_that_rise_together() -> None:
    found = of(0.65 + 3.7 * X, 0.4 + 1.9 * X)
    assert (found.first.closed, found.first.opened) == pytest.approx((0.65, 4.35), abs=0.01)
    assert (found.second.closed, found.second.opened) == pytest.approx((0.4, 2.3), abs=0.01)
    assert (found.stops, found.late, found.crossed, found.findings) == (100.0, 0.0, "", ())
    assert found.apart < 1.0
    table = {setting.name: setting.value for setting in found.table}
    assert table["tpsMin"] == pytest.approx(130, abs=2)
    assert table["tps1SecondaryMax"] == pytest.approx(460, abs=2)
    assert table["tpsSecondaryMaximum"] == 0


@pytest.mark.parametrize("stops", [0.45, 0.53, 0.65, 0.85])
@pytest.mark.parametrize("falls", [False, True])
def test_a_second_one_that_stops_half_way(stops: float, falls: bool) -> None:
    bent = np.minimum(X / stops, 1.0)
    found = of(0.65 + 3.7 * X, 4.5 - 4.0 * bent if falls else 0.5 + 4.0 * bent)
    assert found.stops == pytest.approx(100.0 * stops, abs=1.0)
    assert found.second.opened == pytest.approx(0.5 if falls else 4.5, abs=0.03)
    assert found.crossed == ""
    assert any("stops at" in text for text in found.findings)
    assert any("second sensor is turned" in text for text in found.findings) == falls
    assert found.apart < 1.5
    assert {s.name: s.value for s in found.table}["tpsSecondaryMaximum"] == pytest.approx(100.0 * stops, abs=1.0)


def test_a_turned_first_one_is_named_for_no_plate_rests_wide_open() -> None:
    found = of(4.35 - 3.7 * X, 0.5 + 4.0 * X)
    assert (found.first.closed, found.first.opened) == pytest.approx((4.35, 0.65), abs=0.01)
    assert (found.second.closed, found.second.opened) == pytest.approx((0.5, 4.5), abs=0.02)
    assert any("first sensor is turned" in text for text in found.findings)


def test_exchanged_ones_are_named() -> None:
    found = of(0.5 + 4.0 * np.minimum(X / 0.53, 1.0), 0.65 + 3.7 * X)
    assert "first one stops half way" in found.crossed
    assert found.stops == pytest.approx(53.0, abs=1.5)
    by_toml = of(0.4 + 1.9 * X, 0.65 + 3.7 * X, tps=(0.65, 4.35))
    assert "[tps] of rig.toml" in by_toml.crossed
    assert of(0.65 + 3.7 * X, 0.4 + 1.9 * X, tps=(0.65, 4.35)).crossed == ""


def test_ends_that_the_plate_does_not_rest_at_are_doubtful() -> None:
    time, x = sweep(dwell=0.0)
    noise = np.random.default_rng(0).standard_normal((2, time.size)) * 0.004
    found = two_sensors(Series(time, 0.65 + 3.7 * x + noise[0]), Series(time, 0.4 + 1.9 * x + noise[1]), "V", 0.0)
    assert found is not None
    assert found.dwelt == (False, False)
    assert sum("does not rest at" in text for text in found.findings) == 2


def test_a_worn_track_shows_as_a_difference() -> None:
    worn = 1.9 * X + 0.19 * np.exp(-(((X - 0.4) / 0.05) ** 2))
    # of 10 % what lasts 0.1 s at this speed is 9 %, and the best line takes some of it
    assert 7.5 < of(0.65 + 3.7 * X, 0.4 + worn).apart < 9.1


def test_a_log_of_volts_alone_is_read_and_calibrated(tmp_path: Path) -> None:
    time, x = sweep()
    noise = 0.004 * np.random.default_rng(1).standard_normal((2, time.size))
    rows = np.stack([time, 0.65 + 3.7 * x + noise[0], 4.5 - 4.0 * np.minimum(x / 0.55, 1.0) + noise[1]], axis=1)
    np.savetxt(
        tmp_path / "sweep.csv", rows, delimiter=",", header="Time (s),TPS1 [V],TPS2 [V]", comments="", fmt="%.4f"
    )
    (log,) = read_logs(tmp_path)[1]
    found = study(log)
    assert found.sensors is not None
    assert found.sensors.stops == pytest.approx(55.0, abs=1.0)
    assert found.verdict.word == "cannot be said"
    assert log.columns == {"sensor 1": "TPS1 [V]", "sensor 2": "TPS2 [V]"}


def test_two_columns_in_per_cent_are_held_against_each_other(tmp_path: Path) -> None:
    time = np.arange(0.0, 20.0, 0.01)
    asked = np.where(time % 4.0 < 2.0, 20.0, 60.0)
    rows = np.stack([time, asked, asked, asked + 7.0 * (time > 10.0)], axis=1)
    np.savetxt(
        tmp_path / "drive.csv", rows, delimiter=",", header="Time (s),TPS Target,TPS1,TPS2", comments="", fmt="%.3f"
    )
    found = study(read_logs(tmp_path)[1][0])
    assert found.sensors is not None
    assert found.sensors.apart == pytest.approx(7.0)
    assert [j.word for j in found.verdict.judgements if j.name == "sensors apart"] == ["not good"]
