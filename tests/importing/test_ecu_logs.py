"""Logs of many makers: the right columns and figures by `drive` and by `import`, or a refusal that lists candidates."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import ecu_files
from ecu_files import DRIVE, FILES, File
from etcfit.car_log import study
from etcfit.car_log.read import read_logs
from etcfit.errors import MeasurementError
from etcfit.importing import Answers, import_files
from etcfit.importing.answers import accept_all, refuse, target
from etcfit.rig.reader import read_folder


def written(folder: Path, file: File) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / file.name).write_bytes(file.raw)
    return folder / file.name


@pytest.mark.parametrize("make", FILES, ids=lambda make: make.__name__)
def test_drive_takes_the_plate_and_its_setpoint(tmp_path: Path, make: Callable[[], File]) -> None:
    file = make()
    written(tmp_path, file)
    (log,) = read_logs(tmp_path)[1]
    assert (log.columns["position"], log.columns.get("setpoint", "")) == (file.position, file.setpoint)
    for name, series in (("position", log.position), ("setpoint", log.setpoint)):
        if series is not None:
            there = np.round((series.time - series.time[0]) * ecu_files.RATE).astype(int)
            assert there.size >= DRIVE["time"].size // 2
            assert series.time - series.time[0] == pytest.approx(DRIVE["time"][there], abs=1.1e-3)
            assert series.value == pytest.approx(DRIVE[name][there], abs=file.digits)
    if file.setpoint:
        follows = study(log).tracking
        assert follows is not None
        assert follows.rmse == pytest.approx(ecu_files.rmse(), rel=0.02)


@pytest.mark.parametrize("make", FILES, ids=lambda make: make.__name__)
def test_import_takes_the_same_columns_and_nothing_of_the_engine(tmp_path: Path, make: Callable[[], File]) -> None:
    file = make()
    done = import_files([written(tmp_path / "in", file)], tmp_path / "rig", Answers(), accept_all)
    (trace,) = read_folder(done.folder).measurements
    assert trace.test == ("closed_loop" if file.setpoint else "drive")
    assert {"position", "setpoint"} & set(trace.channels) == {"position", *(["setpoint"] if file.setpoint else [])}
    assert set(trace.channels) <= {"position", "setpoint", "duty", "supply"}
    logged = trace.channels["position"]
    assert logged.unit == "%"
    places = np.round((logged.time - trace.time[0]) * ecu_files.RATE).astype(int)
    assert np.degrees(logged.value) / 0.9 == pytest.approx(DRIVE["position"][places], abs=file.digits)
    if "duty" in trace.channels:
        assert trace.channels["duty"].value == pytest.approx(0.01 * DRIVE["duty"][: trace.time.size], abs=1e-4)


def test_an_instant_that_is_damaged_is_named_by_its_line(tmp_path: Path) -> None:
    file = ecu_files.haltech()
    damaged = file.raw.replace(b"12:00:03.000", b"12:0x:03.000")
    written(tmp_path, file._replace(raw=damaged))
    line = 1 + damaged[: damaged.index(b"12:0x")].count(b"\n")
    with pytest.raises(MeasurementError, match=rf"haltech\.csv:{line}: '12:0x:03\.000' in column 'Time'"):
        read_logs(tmp_path)


def test_notes_beside_the_logs_are_no_log(tmp_path: Path) -> None:
    written(tmp_path, ecu_files.link())
    (tmp_path / "notes.txt").write_text("New throttle fitted on Monday.\nSecond run after lunch, 3 laps.\n")
    assert [log.name for log in read_logs(tmp_path)[1]] == ["link.csv"]
    (tmp_path / "link.csv").unlink()
    with pytest.raises(MeasurementError, match=r"notes\.txt: no rows of numbers"):
        read_logs(tmp_path)


def matrix(separator: str = " ") -> bytes:
    """MATLAB's `save -ascii`: numbers alone."""
    forms = dict.fromkeys(DRIVE, "%.7e")
    return ecu_files.text("   " + row for row in ecu_files.rows("time position setpoint", f"{separator}  ", forms))


def test_numbers_without_a_name_are_listed_and_can_be_named(tmp_path: Path) -> None:
    path = written(tmp_path / "in", File("a.txt", matrix(), "", ""))
    with pytest.raises(MeasurementError, match=r"column 2.*column 3"):
        read_logs(tmp_path / "in")
    wanted = {1: "time [s]", 2: "position [%]", 3: "setpoint [%]"}
    said = Answers({("", f"column {k}"): target(each, "here") for k, each in wanted.items()})
    done = import_files([path], tmp_path / "rig", said, accept_all)
    (trace,) = read_folder(done.folder).measurements
    assert np.degrees(trace.channels["position"].value) / 0.9 == pytest.approx(DRIVE["position"], abs=1e-4)


def test_one_column_and_its_period_are_a_trace(tmp_path: Path) -> None:
    fall = 4.2 - 3.6 * np.clip((np.arange(300) - 60) / 40.0, 0.0, 1.0)
    path = written(tmp_path / "in", File("tps.csv", ecu_files.text(["tps [V]", *(f"{x:.4f}" for x in fall)]), "", ""))
    answers = Answers(tests={str(path): "inertia"}, period=0.002)
    done = import_files([path], tmp_path / "rig", answers, accept_all)
    (trace,) = read_folder(done.folder).measurements
    assert (trace.test, trace.time.size, trace.time[-1]) == ("inertia", 300, pytest.approx(0.598))


def test_a_column_of_counts_is_refused_with_what_one_count_may_be(tmp_path: Path) -> None:
    lines = ["time,pos,goal", *(f"{0.01 * k:.2f},{2000 + k},{2000 + k}" for k in range(50))]
    written(tmp_path, File("servo.csv", ecu_files.text(lines), "", ""))
    with pytest.raises(
        MeasurementError, match=r"'pos'.*whole numbers up to 20\d\d without a unit.*\[columns\] \"pos\" = "
    ):
        read_logs(tmp_path)


def test_a_unit_that_is_none_is_an_error_and_no_missing_unit(tmp_path: Path) -> None:
    lines = ["time [s],voltage [V],position [furlongs]", *(f"{0.01 * k:.2f},{k % 7},{k % 11}" for k in range(50))]
    path = written(tmp_path / "in", File("a.csv", ecu_files.text(lines), "", ""))
    with pytest.raises(MeasurementError, match=r"position, but in 'furlongs', which is no known unit.*--column"):
        import_files([path], tmp_path / "rig", Answers(), accept_all)


def test_a_log_without_a_plate_lists_its_columns(tmp_path: Path) -> None:
    lines = [
        "Time,RPM,AFR Target,Injector duty,Gear position",
        *ecu_files.rows("time rpm target_afr injector gear", ",", {"time": "%.2f"}),
    ]
    path = written(tmp_path / "in", File("a.csv", ecu_files.text(lines), "", ""))
    with pytest.raises(MeasurementError, match=r"'RPM', 'AFR Target', 'Injector duty', 'Gear position'"):
        read_logs(tmp_path / "in")
    with pytest.raises(MeasurementError, match=r"'RPM', 'AFR Target', 'Injector duty', 'Gear position'"):
        import_files([path], tmp_path / "rig", Answers(), accept_all)


def step(seconds: float = 0.8) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, 3 V from 0.05 s on, and a plate that runs towards its stop; a little noise."""
    time = np.arange(0.0, seconds, 0.002)
    noise = np.random.default_rng(3).normal(size=(2, time.size))
    gone = np.maximum(time - 0.05, 0.0)
    angle = 2.35 * gone * (1.0 - 0.29 * gone) + 5e-4 * noise[0]
    return time, 3.0 * (time > 0.05) + 0.005 * noise[1], angle


def test_a_step_of_voltage_is_a_response_and_no_back_emf(tmp_path: Path) -> None:
    lines = [
        "time [s],voltage [V],position [rad]",
        *(",".join(f"{x:.6g}" for x in row) for row in zip(*step(), strict=True)),
    ]
    path = written(tmp_path / "in", File("m1.csv", ecu_files.text(lines), "", ""))
    done = import_files([path], tmp_path / "rig", Answers(), accept_all)
    (trace,) = read_folder(done.folder).measurements
    assert trace.test == "response"
    assert trace.channels["voltage"].value.max() > 2.9
    assert trace.channels["position"].value[-1] == pytest.approx(1.38, abs=0.01)


def signed(raw: np.ndarray, bit: int) -> np.ndarray:
    return np.where(raw < 0, 2**bit - raw, raw)


def register_file() -> tuple[bytes, np.ndarray]:
    time = 0.1 * np.arange(60)
    load = np.round(300.0 * np.sin(time))
    position = 90.0 + 40.0 * np.sin(time - 0.3)
    body = [f"{t:.1f},{a:.2f},{r:.0f}" for t, a, r in zip(time, position, signed(load, 10), strict=True)]
    return ecu_files.text(["time [s],pos [deg],load", *body]), load


def test_a_sign_in_a_bit_of_a_register_is_read(tmp_path: Path) -> None:
    raw, load = register_file()
    path = written(tmp_path / "in", File("sts.csv", raw, "", ""))
    toml = tmp_path / "rig.toml"
    toml.write_text('[rig]\nname = "sts"\ngear_ratio = 345.0\nsupply_V = 12.0\ntravel_deg = [-inf, inf]\n')
    answers = Answers({("", "load"): target("duty [0.1 %]", "here")})
    done = import_files([path], tmp_path / "rig", answers, accept_all, rig=toml)
    (trace,) = read_folder(done.folder).measurements
    assert trace.channels["duty"].value == pytest.approx(1e-3 * load)


def test_check_names_the_bit_that_makes_a_duty_more_than_one(tmp_path: Path) -> None:
    raw, _ = register_file()
    text = raw.decode().replace("pos [deg]", "position [deg]").replace("load", "duty [0.1 %]")
    (tmp_path / "response").mkdir()
    (tmp_path / "response" / "1.csv").write_text(text)
    (tmp_path / "rig.toml").write_text(
        '[rig]\nname = "a"\ngear_ratio = 20.0\nsupply_V = 12.0\ntravel_deg = [0.0, 180.0]\n'
    )
    with pytest.raises(MeasurementError, match=r"duty must lie between.*keeps its sign in bit 10.*etcfit import"):
        read_folder(tmp_path)


def test_the_folders_reader_takes_lines_above_the_header_and_units_below(tmp_path: Path) -> None:
    time = 0.01 * np.arange(60)
    body = [f"{1e3 * t:.0f},{3 * (k % 20 > 9)},{20.0 + k % 20}" for k, t in enumerate(time)]
    (tmp_path / "response").mkdir()
    (tmp_path / "response" / "1.csv").write_bytes(
        ecu_files.text(["Logger 7", "Rig,bench", "", "Time,Voltage,Position", "ms,V,deg", *body])
    )
    (tmp_path / "rig.toml").write_text('[rig]\nname = "a"\ngear_ratio = 20.0\n')
    (trace,) = read_folder(tmp_path).measurements
    assert trace.time == pytest.approx(time)
    assert trace.channels["position"].value == pytest.approx(np.radians(20.0 + np.arange(60) % 20))


def test_rows_at_one_tick_of_the_clock_are_one_row(tmp_path: Path) -> None:
    time = np.repeat(0.04 * np.arange(500), 2)
    lines = ["Time,RPM,TPS,DBW Target"]
    for k, t in enumerate(time):  # position and setpoint in rows of their own
        lines.append(
            f"{t:.2f},900,{DRIVE['position'][k]:.3f}," if k % 2 else f"{t:.2f},900,,{DRIVE['setpoint'][k]:.3f}"
        )
    path = written(tmp_path / "in", File("a.csv", ecu_files.text(lines), "", ""))
    done = import_files([path], tmp_path / "rig", Answers(), accept_all)
    (trace,) = read_folder(done.folder).measurements
    assert trace.time == pytest.approx(time[::2])
    assert np.degrees(trace.channels["position"].value) / 0.9 == pytest.approx(DRIVE["position"][1::2], abs=1e-3)


def test_a_duty_without_a_supply_is_no_dead_end(tmp_path: Path) -> None:
    path = written(tmp_path / "in", ecu_files.link())
    done = import_files([path], tmp_path / "rig", Answers(), accept_all)
    assert read_folder(done.folder).config.supply_V == 13.8
    with pytest.raises(MeasurementError, match=r"supply_V = 13\.8.*in a car"):
        import_files([path], tmp_path / "other", Answers(), refuse)
