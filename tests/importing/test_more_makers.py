"""Layouts of more makers, small files written here: VCDS, Torque, RaceChrono, BlueDriver; logs of a bus are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from etcfit.car_log.read import read_logs
from etcfit.car_log.study import study
from etcfit.errors import MeasurementError
from etcfit.importing import import_files
from etcfit.importing.answers import Answers, accept_all
from etcfit.importing.formats import read_sheets
from etcfit.importing.formats.base import Source
from etcfit.rig.reader import read_folder

HEAD = "Piątek,05,Lipiec,2024,16:22:12:40001-VCID:AA06-80FE,Wersja VCDS: 24.7.1\n06A 906 032 HN,,1.8L R4/5VT\n\n"
BLOCKS = (
    HEAD + ",Grupa A:,'062,,Grupa B:,'001,\n,,Throttle Valve,Throttle Valve,,Obroty silnika,Temperatura\n"
    ",CZAS,Angle,Angle Specified,CZAS,,\nZnacznik,ZAPISU, %, %,ZAPISU, /min,*C\n"
)
VALUES = (
    "Friday,05,July,2024,16:22:12:40001-VCID:AA06-80FE,VCDS Version: 24.7.1\n06A 906 032 HN,ADVMB,1.8L\n"
    ",,G004,F0,G008,F0,\n\nMarker,TIME,Loc. IDE00021,TIME,Loc. IDE00075,\n"
    ",STAMP,Throttle valve angle,STAMP,Throttle valve angle specified,\n,, %,, %,\n"
)


def written(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_a_measuring_block_of_vcds_keeps_the_clock_of_its_group(tmp_path: Path) -> None:
    rows = [f",{0.9 * k + 0.3:.2f},{10 + k}.5,{11 + k}.0,{0.9 * k + 0.6:.2f},{1500 + k},84.0" for k in range(8)]
    path = written(tmp_path / "in", "a.csv", BLOCKS + "\n".join(rows) + "\n")
    (log,) = read_logs(path.parent)[1]
    assert log.columns["position"] == "Throttle Valve Angle [%]"
    assert log.columns["setpoint"] == "Throttle Valve Angle Specified [%]"
    assert log.position.time == pytest.approx(0.9 * np.arange(8) + 0.3)
    assert log.position.value == pytest.approx(np.arange(8) + 10.5)
    assert log.setpoint is not None
    assert log.setpoint.value == pytest.approx(np.arange(8) + 11.0)
    (sheet,) = read_sheets(Source(path, "a.csv"))
    speed, temperature = sheet.columns[3:5]
    assert (speed.unit, temperature.unit) == ("rpm", "°C")
    assert sheet.columns[0].values[np.isfinite(speed.values)] == pytest.approx(0.9 * np.arange(8) + 0.6)


def test_measured_values_of_vcds_have_a_clock_each(tmp_path: Path) -> None:
    rows = [f",{0.4 * k + 0.1:.2f},{10 + k}.5,{0.4 * k + 0.3:.2f},{'N/A' if k == 2 else 11 + k}," for k in range(8)]
    path = written(tmp_path / "in", "a.csv", VALUES + "\n".join(rows) + "\n")
    (log,) = read_logs(path.parent)[1]
    assert log.setpoint is not None
    assert log.position.time == pytest.approx(0.4 * np.arange(8) + 0.1)
    kept = np.delete(np.arange(8), 2)
    assert log.setpoint.time == pytest.approx(0.4 * kept + 0.3)
    assert log.setpoint.value == pytest.approx(kept + 11.0)


@pytest.mark.parametrize(
    ("text", "told"),
    [(BLOCKS + ",0.9,1,2,0.95,3,4\n,0.3,1,2,0.35,3,4\n", "a clock falls"),
     (HEAD + "1.0,2.0,3.0\n2.0,3.0,4.0\n", "no row of names with a clock")],
)  # fmt: skip
def test_a_log_of_vcds_that_is_damaged_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(MeasurementError, match=told):
        read_sheets(Source(written(tmp_path, "a.csv", text), "a.csv"))


def test_torque_has_months_by_name_and_a_dash_where_nothing_was_read(tmp_path: Path) -> None:
    head = "GPS Time, Device Time, Longitude,Engine RPM(rpm),O2 Sensor1 Voltage(V),Throttle Position(Manifold)(%)\n"
    rows = [
        f"Thu Dec 19 23:59:44 EST 2013,{19 + k // 4}-Dec-2013 {'23:59:5' if k < 4 else '00:00:0'}{k % 4}.250,-79.9,"
        f"{'-' if k == 2 else 1500 + k},0.5,{'-' if k == 0 else 17.5 + k}"
        for k in range(8)
    ]
    path = written(tmp_path / "in", "trackLog.csv", head + "\n".join(rows) + "\n")
    (log,) = read_logs(path.parent)[1]
    assert log.columns["position"] == "Throttle Position(Manifold)(%)"
    assert log.position.time == pytest.approx([1, 2, 3, 10, 11, 12, 13])
    assert log.position.value == pytest.approx(17.5 + np.arange(1, 8))
    (trace,) = read_folder(import_files([path], tmp_path / "rig", Answers(), accept_all).folder).measurements
    assert set(trace.channels) == {"position"}


def test_unix_time_is_a_time_in_seconds(tmp_path: Path) -> None:
    head = "This file is created using RaceChrono Pro v9.1.3\nFormat,3\n\ntimestamp,lap_number,speed,rpm,throttle_pos\n"
    rows = [f"{1676148521 + 0.1 * k:.3f},5,25.2,{5500 + k},{30 + k}" for k in range(8)]
    text = head + "unix time,,m/s,rpm,%\n,,100: gps,200: obd,200: obd\n" + "\n".join(rows) + "\n"
    path = written(tmp_path / "in", "session.csv", text)
    (trace,) = read_folder(import_files([path], tmp_path / "rig", Answers(), accept_all).folder).measurements
    assert trace.time == pytest.approx(0.1 * np.arange(8) + trace.time[0], abs=1e-6)
    assert np.degrees(trace.channels["position"].value) / 0.9 == pytest.approx(30.0 + np.arange(8))


def test_the_voltage_of_an_oxygen_sensor_is_no_motors(tmp_path: Path) -> None:
    names = [
        "Time(s)",
        "O2 Bank 1 - Sensor 2 - Oxygen Sensor Voltage (V)",
        "Long Term Secondary Oxygen Sensor Trim Bank 1 (%)",
        "O2 Bank 2 - Sensor 2 Oxygen Sensor Voltage (V)",
    ]
    rows = [f"{0.4 * k:.2f},0.{170 + k},0.0,0.5{k}" for k in range(8)]
    path = written(tmp_path / "in", "a.csv", "\n".join([",".join(names), *rows]) + "\n")
    with pytest.raises(MeasurementError, match=r"nothing says what 'O2 Bank 1 - Sensor 2.*'O2 Bank 2"):
        import_files([path], tmp_path / "rig", Answers(), accept_all)
    with pytest.raises(MeasurementError, match=r"'O2 Bank 1.*'O2 Bank 2.*'Time\(s\)'\. .*\[columns\] \"O2 Bank 1"):
        read_logs(path.parent)


@pytest.mark.parametrize(
    ("name", "text", "program"),
    [("a.log", "(1436509052.249713) can0 044#2A366C2BBA\n(1436509052.449847) can0 0F6#7ADFE07BD2\n", "candump"),
     ("a.csv", "Time Stamp,ID,Extended,Bus,LEN,D1\n166064000,0000021A,false,0,1,FE,\n", "SavvyCAN"),
     ("a.log", "***BUSMASTER Ver 3.2.2***\n***PROTOCOL CAN***\n23:59:58:5000 Rx 1 0x023 s 2 0C D3\n", "BUSMASTER"),
     ("a.asc", "date Sam Sep 30 15:06:13 2017\nbase hex  timestamps absolute\n 2.5 2 C8 Tx d 2 09 08\n", "Vector")],
)  # fmt: skip
def test_frames_of_a_bus_are_called_so_and_the_cure_is_their_dbc(
    tmp_path: Path, name: str, text: str, program: str
) -> None:
    with pytest.raises(MeasurementError, match=f"frames of a bus as bytes, as {program}.*DBC"):
        read_sheets(Source(written(tmp_path, name, text), name))


def test_a_position_without_a_unit_is_said_to_be_taken_as_per_cent(tmp_path: Path) -> None:
    rows = [f"{0.002 * k:.3f},{0.1 * k:.3f},{0.5 - 0.01 * k:.3f}" for k in range(30)]
    path = written(tmp_path / "in", "a.csv", "time,position,velocity\n" + "\n".join(rows) + "\n")
    (log,) = read_logs(path.parent)[1]
    assert "'position' has no unit and is taken as per cent" in log.hint
    written(tmp_path / "in", "rig.toml", '[rig]\nname = "a"\n[columns]\nposition = "position [deg]"\n')
    (log,) = read_logs(path.parent)[1]
    assert "no unit" not in log.hint
    assert log.position.value[-1] == pytest.approx(2.9 / 0.9)


def test_a_log_of_a_sample_every_five_seconds_has_no_spectrum(tmp_path: Path) -> None:
    rows = [f"{5.0 * k:.1f},{1500 + k},{20 + 3 * (k % 2)}" for k in range(12)]
    path = written(tmp_path / "in", "a.csv", "Time,Engine RPM,Throttle position [%]\n" + "\n".join(rows) + "\n")
    (log,) = read_logs(path.parent)[1]
    assert study(log).spectrum is None
