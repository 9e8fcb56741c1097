"""The same drive comes out of a CSV, an .msl and an .mlg."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import car_logs
from etcfit.car_log import DriveLog, study
from etcfit.car_log.read import read_logs
from etcfit.errors import MeasurementError
from etcfit.importing.formats import require_readable
from etcfit.importing.formats.base import Source
from etcfit.reporting.blocks import render
from etcfit.reporting.car_log import drive_table
from etcfit.rig.base import RigConfig
from etcfit.rig.layout import read_msl
from etcfit.rig.mlg import read_mlg

LOG = car_logs.drive(5.0)
COLUMNS = [("TPS", "%", "S16", 0.01, 0.0), ("Fan", "", "U08_BITS", 1.0, 0.0), ("RPM", "RPM", "U16", 1.0, 0.0),
           ("ETB position target", "%", "F32", 1.0, 0.0), ("CLT", "C", "U08", 1.0, -40.0)]  # fmt: skip
TIMED = [("Time", "sec", "U32", 0.001, 0.0), *COLUMNS]
TICKS = 300 + np.round(1e5 * LOG["time"])
VALUES = {"Time": LOG["time"], "TPS": LOG["position"], "ETB position target": LOG["setpoint"], "Fan": 0 * LOG["time"],
          "RPM": 3000 + 0 * LOG["time"], "CLT": 60 + 0 * LOG["time"]}  # fmt: skip


def written(folder: Path, **files: str | bytes) -> Path:
    for name, content in files.items():
        path = folder / name.replace("__", ".")
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def check(folder: Path, within: float) -> None:
    """The one log of the folder is LOG, as far as its format resolves."""
    (log,) = read_logs(folder)[1]
    assert log.setpoint is not None
    for series, name in ((log.position, "position"), (log.setpoint, "setpoint")):
        assert series.time - series.time[0] == pytest.approx(LOG["time"], abs=6e-4)
        assert series.value == pytest.approx(LOG[name], abs=within)


def test_csv(tmp_path: Path) -> None:
    check(
        written(
            tmp_path,
            a__csv=car_logs.csv(LOG, {"time": "time [s]", "position": "position [%]", "setpoint": "setpoint [%]"}),
        ),
        1e-4,
    )


def test_msl_with_marks_and_a_switch_in_words(tmp_path: Path) -> None:
    check(written(tmp_path, a__msl=car_logs.msl(LOG, [0, 7, 200])), 1e-4)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("columns", [TIMED, COLUMNS], ids=["own time", "time of the blocks"])
def test_mlg(tmp_path: Path, version: int, columns: list[car_logs.Column]) -> None:
    # the blocks' clock starts anew every 0.66 s
    check(written(tmp_path, a__mlg=car_logs.mlg(VALUES, columns, TICKS, version, markers=[3, 100])), 0.006)


def test_columns_of_rig_toml_come_first(tmp_path: Path) -> None:
    toml = '[rig]\nname = "car"\ntravel_deg = [0.0, 90.0]\n[columns]\n"Blade (main)" = "position [deg]"\n'
    log = LOG | {"other": np.zeros(LOG["time"].size), "position": 0.9 * LOG["position"]}
    headers = {"time": "Time", "other": "TPS", "position": "Blade (main)", "setpoint": "ETB Target"}
    check(
        written(
            tmp_path,
            rig__toml=toml.replace("[columns]", '[columns]\n"TPS" = "ignore"'),
            a__csv=car_logs.csv(log, headers),
        ),
        1e-3,
    )


def test_channels_with_a_time_base_of_their_own(tmp_path: Path) -> None:
    """Position every 10 ms, setpoint every 50 ms in rows between: neither is made up where it was not logged."""
    late = LOG["time"] + 0.003
    time = np.sort(np.concatenate((LOG["time"], late[::5])))
    merged = {"time": time}
    for name, own, every in (("position", LOG["time"], 1), ("setpoint", late, 5)):
        column = np.full(time.size, np.nan)
        column[np.searchsorted(time, own[::every])] = LOG[name][::every]
        merged[name] = column
    written(tmp_path, a__csv=car_logs.csv(merged, {"time": "time [s]", "position": "TPS", "setpoint": "ETB Target"}))
    (log,) = read_logs(tmp_path)[1]
    assert log.setpoint is not None
    assert log.position.time == pytest.approx(LOG["time"])
    assert log.setpoint.time == pytest.approx(late[::5])
    assert log.setpoint.value == pytest.approx(LOG["setpoint"][::5], abs=1e-4)


def test_the_logs_of_a_measurement_folder_lie_in_drive(tmp_path: Path) -> None:
    (tmp_path / "drive").mkdir()
    written(tmp_path / "drive", b__msl=car_logs.msl(LOG), a__msl=car_logs.msl(LOG))
    assert [log.name for log in read_logs(tmp_path)[1]] == ["a.msl", "b.msl"]


def test_an_ecu_that_writes_faster_than_its_clock_ticks(tmp_path: Path) -> None:
    log = LOG | {"time": np.round(LOG["time"] / 0.02) * 0.02}
    written(tmp_path, a__msl=car_logs.msl(log))
    assert np.all(np.diff(read_logs(tmp_path)[1][0].position.time) > 0.0)


@pytest.mark.parametrize(
    ("raw", "said"),
    [
        (b"", "does not begin with MLVLG"),
        (b"MLVLG\0\0\7" + bytes(40), "version 7"),
        (car_logs.mlg(VALUES, TIMED, TICKS)[:60], "ends within its header"),
        (car_logs.mlg(VALUES, TIMED, TICKS[:1]), "sound records in the file: 1"),
        (car_logs.mlg(VALUES, TIMED, TICKS[:9]) + b"\5" + bytes(80), "unknown type 5"),
    ],
)
def test_an_mlg_that_cannot_be_read_says_why(raw: bytes, said: str) -> None:
    with pytest.raises(MeasurementError, match=said):
        read_mlg(raw, "a.mlg")


@pytest.mark.parametrize("text", ["", "Time,TPS\n0,1\n", "Time\tTPS\ns\t%\n", "Time\tTPS\ns\t%\nOn\tOff\n"])
def test_an_msl_that_is_none_says_so(text: str) -> None:
    with pytest.raises(MeasurementError, match=r"a\.msl"):
        read_msl(text, "a.msl")


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ({"time": "time [s]", "position": "hatch"}, r"its columns 'hatch', 'time \[s\]'.*\[columns\] \"hatch\" ="),
        # all columns of a short log, those of the plate first
        ({"time": "time [s]", "position": "Wheel velocity [m/s]", "setpoint": "Motor voltage [V]"},
         r"'Motor voltage \[V\]', 'Wheel velocity \[m/s\]', 'time \[s\]'\."),
        ({"position": "TPS [%]"}, r"let `etcfit import` give it one: --period"),
    ],
)  # fmt: skip
def test_a_log_without_a_position_or_a_time_says_what_to_do(tmp_path: Path, names: dict[str, str], said: str) -> None:
    with pytest.raises(MeasurementError, match=said):
        read_logs(written(tmp_path, a__csv=car_logs.csv(LOG, names)))


def test_an_empty_folder_says_what_it_may_hold(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"\.csv, .*\.msl, .*\.mlg"):
        read_logs(tmp_path)


def one(folder: Path) -> DriveLog:
    (log,) = read_logs(folder)[1]
    return log


@pytest.mark.parametrize(
    "target",
    ["TP Target", "DBW Throttle Target Position", "E-Throttle Target", "E-Throttle Target [%]", "TP Target (%)",
     "Throttle Position Target", "etb target"],
)  # fmt: skip
def test_setpoints_as_ecus_call_them(tmp_path: Path, target: str) -> None:
    headers = {"time": "Time (s)", "position": "Throttle Position (%)", "setpoint": target}
    check(written(tmp_path, a__csv=car_logs.csv(LOG, headers)), 1e-4)
    assert one(tmp_path).columns == {"time": "Time (s)", "position": "Throttle Position (%)", "setpoint": target}
    assert one(tmp_path).hint == ""


def lined(text: str) -> list[str]:
    return text.splitlines()


def test_a_csv_of_motec_without_its_quotes(tmp_path: Path) -> None:
    head, *rows = lined(car_logs.csv(LOG, {"time": "Time", "position": "Throttle Position", "setpoint": "TP Target"}))
    top = ["Format,MoTeC CSV File,,,Workbook,", "Venue,Bira,,,Worksheet,", "Sample Rate,100.000,Hz,,Duration,5.000,s",
           "Range,entire outing", "", ""]  # fmt: skip
    check(written(tmp_path, a__csv="\n".join((*top, head, "s,%,%", "", *rows, ""))), 1e-4)


def test_units_below_the_header_count(tmp_path: Path) -> None:
    head, *rows = lined(car_logs.csv(LOG | {"time": 1e3 * LOG["time"], "position": 0.9 * LOG["position"]},
                                     {"time": "Time", "position": "TPS", "setpoint": "ETB Target"}))  # fmt: skip
    toml = '[rig]\nname = "car"\ntravel_deg = [0.0, 90.0]\n'
    check(written(tmp_path, rig__toml=toml, a__csv="\n".join((head, "ms,deg,%", *rows, ""))), 1e-3)


def test_a_message_names_the_line_of_the_file(tmp_path: Path) -> None:
    """A preamble of two lines, a header, units, two rows, and a word in the seventh line."""
    text = "a,b\nc,d\nTime,TPS\ns,%\n0,1\n1,2\n2,wide\n"
    with pytest.raises(MeasurementError, match=r"a\.csv:7"):
        read_logs(written(tmp_path, a__csv=text))


STUCK = np.full(LOG["time"].size, 3.0)


@pytest.mark.parametrize(
    ("other", "values", "position", "setpoint"),
    [
        ("Throttle Position", 0.8 * LOG["setpoint"] + 5.0, "Drive By Wire Throttle 1 Position",
         "Drive By Wire Throttle 1 Target Position"),
        ("TPS", STUCK, "E-Throttle Position", "E-Throttle Target"),  # the pedal's
        ("TPS", 0.8 * LOG["setpoint"], "ETB pos actual", "ETB target"),  # a name that no maker writes
        ("E-Throttle Position", STUCK, "TPS", "E-Throttle Target"),  # what does not move with the setpoint is no plate
    ],
)  # fmt: skip
def test_of_two_positions_the_plates_own_is_taken(
    tmp_path: Path, other: str, values: np.ndarray, position: str, setpoint: str
) -> None:
    headers = {"time": "Time", "other": other, "position": position, "setpoint": setpoint}
    check(written(tmp_path, a__csv=car_logs.csv(LOG | {"other": values}, headers)), 1e-4)


def test_a_target_is_no_other_plate(tmp_path: Path) -> None:
    headers = {"time": "Time", "position": "TPS", "setpoint": "DBW Throttle Target Position"}
    assert one(written(tmp_path, a__csv=car_logs.csv(LOG, headers))).hint == ""


def test_a_setpoint_by_an_unknown_name_is_asked_for(tmp_path: Path) -> None:
    headers = {"time": "Time", "position": "TP", "setpoint": "Demand main"}
    log = one(written(tmp_path, a__csv=car_logs.csv(LOG, headers)))
    assert log.setpoint is None
    assert '"Demand main" = "setpoint [%]"' in log.hint
    shown = render(drive_table(RigConfig("car"), [study(log)]))
    assert "Demand main" in " ".join(shown.split())
    assert "position 'TP'" in " ".join(shown.split())


def test_a_log_of_link_is_refused_with_the_way_out(tmp_path: Path) -> None:
    written(tmp_path, b__llg=b"\0\0\0\0lf3\0")
    with pytest.raises(MeasurementError, match=r"b\.llg: a log of PCLink.*export it as CSV and put b\.csv there"):
        read_logs(tmp_path)
    with pytest.raises(MeasurementError, match=r"b\.llg: a log of PCLink.*export it as CSV and give b\.csv"):
        require_readable(Source(tmp_path / "b.llg", "b.llg"))
    names = {"time": "time [s]", "position": "position [%]", "setpoint": "setpoint [%]"}
    check(written(tmp_path, b__csv=car_logs.csv(LOG, names)), 1e-4)
