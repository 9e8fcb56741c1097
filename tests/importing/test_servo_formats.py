"""Logs of robots and bus servos: WPILib's data log, SysId's JSON, registers of Feetech and DYNAMIXEL servos."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import foreign
from etcfit.errors import MeasurementError, UsageError
from etcfit.importing import Answers, import_files
from etcfit.importing.answers import accept_all
from etcfit.importing.formats import read_sheets
from etcfit.importing.formats.base import Source
from etcfit.importing.formats.servo import SERVOS
from etcfit.importing.sheet import Sheet
from etcfit.rig.reader import read_folder

TIMES = [1_000_000 + 5_000 * k for k in range(40)]  # us
VOLTS = [0.1 * k for k in range(40)]


def read(path: Path, motor: str | None = None, servo: str | None = None) -> list[Sheet]:
    return read_sheets(Source(path, path.name, motor=motor, servo=servo))


def entry(values: list[float], unit: str = "", kind: str = "double", late: int = 0) -> tuple[str, str, list]:
    return kind, unit, [(time + late, value) for time, value in zip(TIMES, values, strict=True)]


def sysid_log(path: Path, **more: tuple[str, str, list]) -> Path:
    """Two motors of one routine, two tests with a pause between, as SysIdRoutineLog names them."""
    state = [(time, "quasistatic-forward" if k < 18 else "none" if k < 20 else "dynamic-reverse")
             for k, time in enumerate(TIMES)]  # fmt: skip
    entries = {"systemTime": entry(VOLTS), "sysid-test-state-shooter": ("string", "", state)}
    for motor, scale in (("left", 1.0), ("right", -1.0)):
        entries[f"voltage-{motor}-shooter"] = entry([scale * v for v in VOLTS], "Volt")
        entries[f"position-{motor}-shooter"] = entry([0.01 * k * k for k in range(40)], "Rotation")
        entries[f"velocity-{motor}-shooter"] = entry([0.02 * k for k in range(40)], "Rotation per Second", late=3)
    return foreign.wpilog(path, entries | more, extra=b'{"robot": "x"}')


def test_sysid_of_a_data_log_is_one_sheet_a_test_in_the_units_of_its_metadata(tmp_path: Path) -> None:
    first, second = read(sysid_log(tmp_path / "robot.wpilog"), "right")
    assert (first.part, second.part) == ("right: slow-forward", "right: fast-reverse")
    assert [(c.name, c.unit) for c in first.columns] == [
        ("time", "s"), ("motor_voltage", "V"), ("position", "turn"), ("motor_speed", "turn/s")]  # fmt: skip
    assert first.columns[1].label == "voltage-right-shooter"
    volts = first.columns[1].values
    assert volts[np.isfinite(volts)] == pytest.approx([-v for v in VOLTS[:18]])
    # what was logged between the tests leads into the second one, and nothing of the first
    speed = second.columns[3].values
    assert speed[np.isfinite(speed)] == pytest.approx([0.02 * k for k in range(17, 39)])
    assert second.columns[0].values[0] == 0.0


def test_several_motors_are_a_question_with_their_names(tmp_path: Path) -> None:
    path = sysid_log(tmp_path / "robot.wpilog")
    with pytest.raises(MeasurementError, match=r"several motors in it: 'left', 'right'.*--motor 'left'"):
        read(path)
    with pytest.raises(MeasurementError, match=r"no motor 'middle' in it; there are: 'left', 'right'"):
        read(path, "middle")


def test_entries_of_network_tables_are_parted_by_their_path(tmp_path: Path) -> None:
    path = foreign.wpilog(tmp_path / "a.wpilog", {
        "NT:/Arm/Voltage": entry(VOLTS, '{"source":"NT","unit":"volts"}'),
        "NT:/Arm/Angle": entry([0.5 * v for v in VOLTS], "degrees", kind="float"),
        "NT:/Arm/Enabled": ("boolean", "", [(time, True) for time in TIMES]),
    })  # fmt: skip
    (sheet,) = read(path)
    assert sheet.part == "Arm"
    assert [(c.name, c.unit) for c in sheet.columns] == [("time", "s"), ("Voltage", "V"), ("Angle", "deg")]
    assert sheet.columns[2].values == pytest.approx([0.5 * v for v in VOLTS], rel=1e-6)
    assert "Enabled" in " ".join(sheet.remarks)


def test_a_data_log_that_is_cut_off_gives_its_whole_records_and_says_so(tmp_path: Path) -> None:
    path = foreign.wpilog(tmp_path / "a.wpilog", {"m/voltage": entry(VOLTS, "V")})
    whole = path.read_bytes()
    path.write_bytes(whole[:-5])
    (sheet,) = read(path)
    assert sheet.rows == 39
    assert "cut off" in sheet.losses[0]


NO_JSON = {
    "its units are 'Meters'": {"sysid": True, "units": "Meters", "slow-forward": [[0, 1, 2, 3]] * 3},
    "have 3 numbers": {"sysid": True, "units": "Rotations", "slow-forward": [[0, 1, 2]] * 3},
    "what is no number": {"sysid": True, "units": "Rotations", "slow-forward": [[0, 1, 2, "x"]] * 3},
    "no test in it": {"sysid": True, "units": "Rotations"},
    "no table in it": {"a": 1},
    "lists of 2, 3 numbers": {"m": {"t": [0, 1], "position": [0, 1, 2]}},
}


@pytest.mark.parametrize(("raw", "told"), [
    (b"MLVLG\0" + bytes(20), "does not begin as one"),
    (b"WPILOG\0", "does not begin as one"),
    (b"WPILOG\0\x02" + bytes(4), "of version 2.0"),
    (b"WPILOG\0\x01" + bytes(4), "no entry of numbers"),
    (b"WPILOG\0\x01" + bytes(4) + b"\0\0\x09\0" + b"\0\x01\0\0\0\xff\0\0\0", "control record of it is damaged"),
    (b'[{"t": 0.0, "position": 1}, {"t": 0.1, "pos', "no JSON, or cut off"),
    *((json.dumps(content).encode(), told) for told, content in NO_JSON.items()),
])  # fmt: skip
def test_what_is_no_log_is_refused_by_name(tmp_path: Path, raw: bytes, told: str) -> None:
    path = tmp_path / ("log.json" if raw[:1] in b"[{" else "robot.wpilog")
    path.write_bytes(raw)
    with pytest.raises(MeasurementError, match=f"{path.name}.*{told}"):
        read(path)


def test_sysid_json_of_a_mechanism_and_of_a_drivetrain(tmp_path: Path) -> None:
    rows = [[10.0 + 0.005 * k, 0.1 * k, 0.2 * k, 0.3 * k] for k in range(20)]
    path = tmp_path / "sysid.json"
    path.write_text(json.dumps({"sysid": True, "test": "Simple", "units": "Radians", "unitsPerRotation": 6.28,
                                "slow-forward": rows, "fast-backward": rows, "track-width": []}))  # fmt: skip
    slow, fast = read(path)
    assert (slow.part, fast.part) == ("mechanism: slow-forward", "mechanism: fast-backward")
    assert [(c.name, c.unit) for c in slow.columns] == [
        ("time", "s"), ("motor_voltage", "V"), ("position", "rad"), ("motor_speed", "rad/s")]  # fmt: skip
    assert slow.columns[3].values[-1] == pytest.approx(5.7)
    wide = [[0.01 * k, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0] for k in range(5)]
    path.write_text(json.dumps({"sysid": True, "units": "Rotations", "slow-forward": wide}))
    (right,) = read(path, "right")
    assert [c.values[0] for c in right.columns] == [0.0, 2.0, 4.0, 6.0]


def test_feetech_registers_have_their_sign_in_a_bit(tmp_path: Path) -> None:
    """1056 is 1024 + 32: -3.2 %; 33068 is 32768 + 300; two motors of a bus by what stands in brackets."""
    path = tmp_path / "sts.csv"
    path.write_text("timestamp,target pos (5),pos (5),speed (5),load (5),current (5),voltage (5),pos (6)\n"
                    "0.0,1947,2042,0,40,1,121,7\n0.1,1947,2017,33068,1056,32770,120,8\n"
                    "0.2,1947,32769,33118,1096,2,121,9\n")  # fmt: skip
    (sheet,) = read(path, "5", "feetech-sts")
    found = {c.name: (c.values.tolist(), c.unit) for c in sheet.columns}
    assert found["duty"] == ([40.0, -32.0, -72.0], "0.1 %")
    assert found["current"] == ([1.0, -2.0, 2.0], "6.5 mA")
    assert found["position"] == ([2042.0, 2017.0, -1.0], "0.087890625 deg")
    assert found["setpoint"][0] == [1947.0] * 3
    assert found["supply"] == ([121.0, 120.0, 121.0], "0.1 V")
    assert set(found) == {"timestamp", "duty", "current", "position", "setpoint", "supply"}
    with pytest.raises(MeasurementError, match=r"several motors in it: '5', '6'"):
        read(path, None, "feetech-sts")


def test_a_load_that_is_positive_downwards_is_turned_and_said(tmp_path: Path) -> None:
    """As recorded STS3215 servos have it: 76 while the position falls, 1100 (-76) while it rises."""
    path = tmp_path / "sts.csv"
    path.write_text(
        "t,pos,load\n"
        + "".join(
            f"{0.1 * k},{p},{d}\n"
            for k, (p, d) in enumerate(
                [(2042, 40), (2017, 76), (1978, 72), (1955, 48), (1953, 0), (1978, 1100), (2017, 1092), (2038, 1076)]
            )
        )
    )
    (sheet,) = read(path, None, "feetech-sts")
    assert next(c for c in sheet.columns if c.name == "duty").values.tolist() == [-40, -76, -72, -48, 0, 76, 68, 52]
    assert "its sign turned" in sheet.remarks[-1]


def test_dynamixel_registers_are_in_twos_complement(tmp_path: Path) -> None:
    path = tmp_path / "xm.json"
    records = [{"t": 0.01 * k, "id": motor, "Present_PWM": 65535 - k, "Present_Current": -3 if k else 65533,
                "Present_Position": (2048, 4294967295, 4294967290)[k], "Present_Input_Voltage": 121,
                "Goal_Position": 2050}
               for k in range(3) for motor in (1, 2)]  # fmt: skip
    path.write_text(json.dumps({"model": "xm430", "entries": records}))
    (sheet,) = read(path, "2", "dynamixel-xm")
    found = {c.name: (c.values.tolist(), c.unit) for c in sheet.columns}
    assert found["duty"] == ([-1.0, -2.0, -3.0], "0.113 %")
    assert found["current"] == ([-3.0, -3.0, -3.0], "2.69 mA")
    assert found["position"][0] == [2048.0, -1.0, -6.0]


def test_records_of_one_column_id_part_the_motors(tmp_path: Path) -> None:
    path = tmp_path / "ax.csv"
    path.write_text(
        "t,id,position,load\n0,1,512,10\n0,2,100,1034\n0.1,1,513,11\n0.1,2,99,1035\n0.2,1,514,12\n0.2,2,98,3\n"
    )
    (sheet,) = read(path, "2", "dynamixel-ax")
    assert next(c for c in sheet.columns if c.name == "duty").values.tolist() == [-10.0, -11.0, 3.0]


def test_what_a_register_cannot_be_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,pos,load\n0,1,40\n0.1,2,65000\n0.2,3,40\n")
    with pytest.raises(MeasurementError, match=r"'load' reaches .* counts\. load of Feetech STS/SMS stays within 1000"):
        read(path, None, "feetech-sts")
    path.write_text("t,pos,load\n0,1.5,40\n0.1,2,41\n0.2,3,40\n")
    with pytest.raises(MeasurementError, match=r"'pos' holds 1\.5"):
        read(path, None, "feetech-sts")
    path.write_text("t,a,b\n0,1,40\n0.1,2,41\n0.2,3,40\n")
    with pytest.raises(MeasurementError, match="no register of a servo"):
        read(path, None, "feetech-sts")
    with pytest.raises(UsageError, match="Known: feetech-sts"):
        read(path, None, "hitec")


def test_a_servo_becomes_a_rig_with_duty_and_supply(tmp_path: Path) -> None:
    t = 0.01 * np.arange(400)
    angle = 2048 + np.round(600 * np.sin(2.0 * t) + 120 * np.sin(9.0 * t))
    load = np.round(150 * np.cos(2.0 * t) + 135 * np.cos(9.0 * t))
    raw = np.where(load < 0, 1024 - load, load)
    lines = [
        "t,pos (3),load (3),voltage (3)",
        *(f"{a:.3f},{p:.0f},{d:.0f},120" for a, p, d in zip(t, angle, raw, strict=True)),
    ]
    path, folder = tmp_path / "sts.csv", tmp_path / "rig"
    path.write_text("\n".join(lines) + "\n")
    rig_toml = tmp_path / "rig.toml"
    rig_toml.write_text('[rig]\nname = "sts"\ngear_ratio = 345.0\nsupply_V = 12.0\ntravel_deg = [-inf, inf]\n')
    import_files([path], folder, Answers(), accept_all, rig=rig_toml, servo="feetech-sts")
    (measured,) = read_folder(folder).measurements
    assert measured.channels["duty"].value == pytest.approx(1e-3 * load)
    assert measured.channels["supply"].value == pytest.approx(12.0)
    assert measured.channels["position"].value == pytest.approx(angle * 2.0 * np.pi / 4096)


def test_every_family_says_its_counts(tmp_path: Path) -> None:
    for servo in SERVOS.values():
        assert {"position", "goal", "voltage"} <= set(servo.registers)
        assert sum(each.quantity == "duty" for each in servo.registers.values()) == 1
