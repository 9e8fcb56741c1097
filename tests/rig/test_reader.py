"""A measurement folder read: what arrives in SI, what is accepted, and each mistake by its own message."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import folders
from etcfit.errors import MeasurementError
from etcfit.rig.base import Rig
from etcfit.rig.reader import read_folder
from folders import (
    TOML,
    Sheet,
    back_emf,
    changed,
    constant,
    good,
    inductance,
    only_response,
    resistance,
    response,
    scaled,
    write,
)
from mistakes import assert_refused

RESPONSE = R = response()
BACK_EMF, RESISTANCE, INDUCTANCE = back_emf(), resistance(), inductance()


def read(folder: Path, changes: Mapping[str, str | bytes]) -> Rig:
    return read_folder(changed(folder, changes))


def trace(rig: Rig, file: str = "response/1.csv"):
    return next(m for m in rig.measurements if m.file == file)


def test_columns_arrive_in_si(tmp_path: Path) -> None:
    m = trace(read(tmp_path, {}))
    np.testing.assert_allclose(m.time, RESPONSE.column(0) * 1e-3, rtol=1e-14)
    np.testing.assert_array_equal(m.channels["voltage"].value, RESPONSE.column(1))
    np.testing.assert_allclose(m.channels["current"].value, RESPONSE.column(2) * 1e-3, rtol=1e-14)
    angle = (RESPONSE.column(3) - 0.45) / (4.73 - 0.45) * np.pi / 2
    np.testing.assert_allclose(m.channels["position"].value, angle, rtol=1e-12)
    assert {name: c.unit for name, c in m.channels.items()} == {"voltage": "V", "current": "mA", "position": "V"}
    assert m.channels["position"].header == "tps [V]"
    assert m.channels["position"].scale == pytest.approx(np.pi / 2 / 4.28)
    with pytest.raises(ValueError, match="read-only"):
        m.time[0] = 3.0


def test_the_rig_holds_every_trace_in_order_and_its_toml(tmp_path: Path) -> None:
    text = TOML + '[holdout]\nfiles = ["response/2.csv"]\n'
    rig = read(tmp_path, {"rig.toml": text, "response/2.csv": response(seed=9).text()})
    files = ["back_emf/1.csv", "inductance/1.csv", "resistance/1.csv", "response/1.csv", "response/2.csv"]
    assert [m.file for m in rig.measurements] == files
    assert [m.file for m in rig.measurements if m.held_out] == ["response/2.csv"]
    assert (rig.folder, rig.toml, rig.warnings, rig.config.holdout) == (str(tmp_path), text, (), ("response/2.csv",))


UNITS = [
    ("position [rad]", 0.5, 0.5),
    *((f"position [{unit}]", 45.0, np.pi / 4) for unit in ("deg", "°")),
    ("position [%]", 50.0, np.pi / 4),
    ("tps [mV]", 450.0, 0.0),
    ("Position [degrees]", 90.0, np.pi / 2),
    *((f"motor_speed [{unit}]", 60.0, 2 * np.pi) for unit in ("rpm", "U/min")),
    ("Motor Speed [deg/s]", 180.0, np.pi),
    *((f"torque [{unit}]", 0.5, 0.5) for unit in ("N m", "N*m", "Nm", "N·m", "N-m")),
    *((f"torque [{unit}]", logged, 0.5) for unit, logged in (("mNm", 500.0), ("Ncm", 50.0))),
    *((f"duty [{unit}]", logged, si) for unit, logged, si in (("%", 30.0, 0.3), ("1", 0.3, 0.3), ("-", -0.3, -0.3))),
    *((f"temperature [{unit}]", 25.0, 25.0) for unit in ("degC", "°C")),
    *((f"temperature [{unit}]", logged, 25.0) for unit, logged in (("K", 298.15), ("degF", 77.0))),
    ("supply [V]", 13.5, 13.5),
    ("setpoint [%]", 50.0, np.pi / 4),
    ("setpoint [deg]", 45.0, np.pi / 4),
    ("emf [mV]", 500.0, 0.5),
]


@pytest.mark.parametrize(("header", "logged", "si"), UNITS)
def test_every_channel_in_usual_units(tmp_path: Path, header: str, logged: float, si: float) -> None:
    name = header.split(" [")[0].lower().replace(" ", "_").replace("tps", "position")
    plain = RESPONSE.without(3) if name == "position" else RESPONSE
    rows = tuple((*row, f"{logged * (1 - 1e-4 * (k % 7)):.6f}") for k, row in enumerate(plain.rows))
    m = trace(read(tmp_path, {"response/1.csv": Sheet((*plain.header, header), rows).text()}))
    assert m.channels[name].value[0] == pytest.approx(si, abs=1e-9)


def test_percent_runs_from_stop_to_stop(tmp_path: Path) -> None:
    sheet = RESPONSE.with_header(3, "position [%]").with_cell(0, 3, "0").with_cell(1, 3, "100")
    sheet = replace(sheet, rows=sheet.rows[:40])
    toml = TOML.replace("[tps]", "travel_deg = [9.0, 99.0]\n\n[tps]")
    rig = read_folder(write(tmp_path, {"rig.toml": toml, "response/1.csv": sheet.text()}))
    value = trace(rig).channels["position"].value
    assert value[:2] == pytest.approx(np.radians([9.0, 99.0]))


def test_gaps_leave_each_channel_its_own_time_base(tmp_path: Path) -> None:
    sheet = RESPONSE.with_cell(3, 2, "").with_cell(4, 2, " ").with_cell(7, 3, "")
    m = trace(read(tmp_path, {"response/1.csv": sheet.text()}))
    assert [len(m.channels[c].time) for c in ("voltage", "current", "position")] == [60, 58, 59]
    np.testing.assert_array_equal(m.channels["current"].time, np.delete(m.time, [3, 4]))
    np.testing.assert_allclose(m.channels["current"].value, np.delete(RESPONSE.column(2), [3, 4]) * 1e-3)


def test_foreign_headers(tmp_path: Path) -> None:
    sheet = RESPONSE.with_header(3, "TP (Main) (V)").with_header(1, "Lambda")
    sheet = Sheet((*sheet.header, '"U, motor"'), tuple((*row, row[1]) for row in sheet.rows))
    toml = (
        TOML
        + '[columns]\n"TP (Main) (V)" = "tps [V]"\n"Lambda" = "ignore"\n"U, motor" = "voltage [V]"\n"X" = "emf [V]"'
    )
    rig = read(tmp_path, {"rig.toml": toml, "response/1.csv": sheet.text()})
    m = trace(rig)
    assert {name: c.header for name, c in m.channels.items()} == {
        "current": "current [mA]",
        "position": "TP (Main) (V)",
        "voltage": "U, motor",
    }
    line = toml[: toml.index('"X"')].count("\n") + 1
    assert rig.warnings == (f'{tmp_path}/rig.toml:{line}: [columns] names "X", which no CSV has.',)


WRONG: dict[str, tuple[Mapping[str, str | bytes], str]] = {
    "time falls": (
        only_response(R.with_cell(9, 0, "0.1")),
        r"1\.csv:11: time falls from [\d.]+ to 0\.1 ms\. "
        r"Time must rise strictly; sort the log or split it\.",
    ),
    "time repeats": (only_response(R.with_cell(9, 0, R.rows[8][0])), r"1\.csv:11: time stays at"),
    "time missing": (only_response(R.with_cell(9, 0, "")), r"1\.csv:11: time is empty"),
    "one sample": (only_response(replace(R, rows=R.rows[:1])), r"1\.csv: 1 sample in the file"),
    "no drive": (only_response(R.without(1)), r"1\.csv: no voltage or duty or torque among current, position"),
    "no current": ({"resistance/1.csv": RESISTANCE.without(2).text()}, r"no current among voltage.*A resistance trace"),
    "duty alone": (
        {
            "rig.toml": TOML.replace("supply_V = 12.0", ""),
            **only_response(scaled(R, 1, 0.1).with_header(1, "duty [1]")),
        },
        r"duty without voltage or supply",
    ),
    "holdout": (
        {"rig.toml": TOML + "[holdout]\nfiles=['response/11.csv']"},
        r"rig\.toml:\d+: holdout\.files names 'response/11\.csv', which is not there.*Did you mean 'response/1\.csv'",
    ),
    "tests": ({"rig.toml": TOML + "[tests.inductence]\nseries_ohm='free'"}, r"no such rig test.*'inductance'"),
    # traces that cannot be, and the likely slip of units
    "tps outside": (
        only_response(R.with_cell(9, 3, "4.99")),
        r"1\.csv:11: column 'tps \[V\]' is 4\.99 V.*4\.944 V.*\[tps\]",
    ),
    "end points of the sensor": (
        only_response(scaled(R, 3, 2.5)),
        r"1\.csv:\d+: sensor_end_points: column 'tps \[V\]' is beyond.* of \d+ samples: .*4\.944 V.*plate at each stop",
    ),
    "degrees as radians": (only_response(scaled(R, 3, 10).with_header(3, "position [rad]")), r"really in deg or %"),
    "mA as A": (
        only_response(R.with_header(2, "current [A]")),
        r"current must lie between -500 A and 500 A.*really in mA",
    ),
    "mV as V": (only_response(scaled(R, 1, 1e3)), r"voltage must lie between.*really in mV"),
    "V as mV": (only_response(R.with_header(1, "voltage [mV]")), r"stays below .* mV in every trace.*really in V"),
    "s as ms": ({"back_emf/1.csv": BACK_EMF.with_header(0, "time [ms]").text()}, r"lasts 0\.000236 s.*really in s"),
    "ms as s": (only_response(R.with_header(0, "time [s]")), r"samples are [\d.]+ s apart.*really in ms"),
    "s as us": ({"resistance/1.csv": RESISTANCE.with_header(0, "time [us]").text()}, r"lasts 3\.9e-07 s"),
    "ms as days": (only_response(R.with_header(0, "time [day]")), r"to a day"),
    "A as mA, held": (
        {"resistance/1.csv": RESISTANCE.with_header(2, "current [mA]").text()},
        r"between 0\.02 and 1000 ohm",
    ),
    "mA as A, held": ({"inductance/1.csv": scaled(INDUCTANCE, 2, 1e3).text()}, r"between 0\.02 and 1000 ohm"),
    "radians as degrees": (
        {"back_emf/1.csv": scaled(BACK_EMF, 2, np.pi / 180).text()},
        r"sweeps 1\.\d+ % of the travel.*rad",
    ),
    "duty of percent": (
        only_response(scaled(R, 1, 10).with_header(1, "duty [1]")),
        r"duty must lie between.*really in %",
    ),
    "supply": (only_response(R.with_header(2, "supply [V]")), r"supply must lie between 1 V and 60 V.*really in mV"),
    "frozen position": (only_response(constant(R, 3)), r"'tps \[V\]' never changes from 2\.\d+ V.*response test needs"),
    "frozen release": ({"back_emf/1.csv": constant(BACK_EMF, 2).text()}, r"'position \[deg\]' never changes"),
    "frozen current": ({"inductance/1.csv": constant(INDUCTANCE, 2).text()}, r"'current \[A\]' never changes"),
}


@pytest.mark.parametrize(("changes", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_its_own_message(tmp_path: Path, changes: Mapping[str, str | bytes], message: str) -> None:
    assert_refused(tmp_path, changes, message)


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="no such folder"):
        read_folder(tmp_path / "nowhere")


@pytest.mark.parametrize("files", [{}, {"respons/1.csv": RESPONSE.text()}, {"response/1.txt": RESPONSE.text()}])
def test_no_known_test(tmp_path: Path, files: Mapping[str, str]) -> None:
    with pytest.raises(MeasurementError, match="no CSV of a known rig test") as caught:
        read_folder(write(tmp_path, {"rig.toml": TOML, **files}))
    assert ("Did you mean 'response'?" in str(caught.value)) == ("respons/1.csv" in files)


def test_a_folder_without_a_rig_toml_is_told_where_one_is(tmp_path: Path) -> None:
    below = folders.write(tmp_path / "throttle", folders.good())
    with pytest.raises(MeasurementError, match=rf"One level down there is one: {below}\. Name that folder\."):
        read_folder(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    with pytest.raises(MeasurementError, match="This is a run folder"):
        read_folder(tmp_path / "run")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MeasurementError, match=r"rig\.toml: no rig\.toml can be read here .*Create it with two lines"):
        read_folder(tmp_path / "empty")


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    empty = Sheet((*RESPONSE.header, "temperature [degC]"), tuple((*row, "") for row in RESPONSE.rows))
    changes = {"respons/1.csv": "x", "1.csv": "x", "sine/readme.txt": "x", "response/1.csv": empty.text()}
    rig = read(tmp_path, changes)
    said = "\n".join(rig.warnings)
    for name in (
        "respons: no known rig test",
        "/1.csv: not in a folder",
        "no CSV in sine",
        "temperature [degC]' holds no number",
    ):
        assert name in said
    assert len(rig.warnings) == 4
    assert "temperature" not in trace(rig).channels


def test_paths_are_named_as_the_user_gave_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "m" / "x", {**good(), **{"response/1.csv": RESPONSE.with_row(4, ("1", "2", "3")).text()}})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MeasurementError, match=r"^m/x/response/1\.csv:6: "):
        read_folder("m/x/")


def test_no_limits_on_an_endless_travel(tmp_path: Path) -> None:
    toml = TOML.replace("[tps]", "travel_deg = [-inf, inf]\n\n[tps]")
    sheet = scaled(RESPONSE, 3, 1e4).with_header(3, "position [deg]")
    assert (
        trace(read(tmp_path, {"rig.toml": toml, "response/1.csv": sheet.text()})).channels["position"].value.max() > 500
    )


def test_a_trace_at_zero_volts_is_fine_among_others(tmp_path: Path) -> None:
    zero = scaled(scaled(RESISTANCE, 1, 1e-4), 2, 1e-4)
    assert len(read(tmp_path, {"resistance/0.csv": zero.text()}).measurements) == 5


def test_given_noise_wins_and_missing_noise_is_estimated(tmp_path: Path) -> None:
    rig = read(
        tmp_path,
        {"rig.toml": TOML + "[noise]\ncurrent_A = 0.02\ntps_V = 0.01", "response/1.csv": response(2000).text()},
    )
    channels = trace(rig).channels
    assert (channels["current"].sigma, channels["current"].sigma_estimated) == (0.02, False)
    assert (channels["position"].sigma, channels["position"].sigma_estimated) == (pytest.approx(np.pi / 856), False)
    assert channels["voltage"].sigma == pytest.approx(0.02, rel=0.15)
    assert channels["voltage"].sigma_estimated


def test_noise_is_pooled_over_the_traces_of_a_sensor(tmp_path: Path) -> None:
    rig = read(tmp_path, {f"response/{k}.csv": response(300, seed=k).text() for k in range(1, 8)})
    sigmas = {m.channels["voltage"].sigma for m in rig.measurements if m.test == "response"}
    assert len(sigmas) == 1
    assert sigmas.pop() == pytest.approx(0.02, rel=0.15)


def test_the_resolution_of_the_logger_is_seen(tmp_path: Path) -> None:
    sheet = response(2000)
    coarse = replace(sheet, rows=tuple((*row[:3], f"{0.005 * round(float(row[3]) / 0.005):.3f}") for row in sheet.rows))
    position = trace(read(tmp_path, {"response/1.csv": coarse.text()})).channels["position"]
    assert position.quantum == pytest.approx(0.005 * position.scale, rel=1e-6)
    assert position.sigma == pytest.approx(position.scale * np.hypot(0.004, 0.005 / np.sqrt(12)), rel=0.15)


def test_a_last_number_that_lacks_digits_is_said_and_a_last_line_that_is_whole_is_not(tmp_path: Path) -> None:
    whole = good()["response/1.csv"]
    assert isinstance(whole, str)
    text = "\n".join(line + "123" if k else line for k, line in enumerate(whole.rstrip("\n").split("\n")))
    assert not [each for each in read(tmp_path / "a", {"response/1.csv": text}).warnings if "cut off" in each]
    (told,) = [each for each in read(tmp_path / "b", {"response/1.csv": text[:-3]}).warnings if "cut off" in each]
    assert told.startswith(f"{tmp_path}/b/response/1.csv: the last line has no end, and its last number")


@pytest.mark.parametrize("file", ["rig.toml", "response/1.csv"])
def test_a_pipe_in_a_folder_is_refused_before_it_is_read(tmp_path: Path, file: str) -> None:
    folder = write(tmp_path / "rig", good())
    (folder / file).unlink()
    os.mkfifo(folder / file)
    with pytest.raises(MeasurementError, match=rf"{file}: it is a pipe or a device"):
        read_folder(folder)
