"""Every format gives back the names, units and values that another program's library wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import foreign
from etcfit.errors import MeasurementError
from etcfit.importing.formats import FORMATS, read_sheets
from etcfit.importing.formats.base import Source
from etcfit.importing.sheet import Sheet

TIME = -0.01 + 0.001 * np.arange(60)
VOLTS = 6.0 + 2.0 * np.sin(TIME / 0.03)
AMPERES = 1.5 + np.cos(TIME / 0.04)
COLUMNS = {"t": ("s", TIME), "CH1": ("V", VOLTS), "CH2": ("A", AMPERES)}


def read(*paths: Path) -> list[Sheet]:
    return [sheet for path in paths for sheet in read_sheets(Source(path, path.name))]


def check(sheet: Sheet, *, digits: float = 1e-9, time: tuple[str, float] = ("s", 1.0)) -> None:
    """Time first, then the two channels, their units told."""
    clock, volts, amperes = sheet.columns
    assert (clock.unit, volts.unit, amperes.unit) == (time[0], "V", "A")
    assert clock.values * time[1] == pytest.approx(TIME, abs=max(digits, 1e-9))
    assert volts.values == pytest.approx(VOLTS, abs=digits)
    assert amperes.values == pytest.approx(AMPERES, abs=digits)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", ",")])
def test_picoscope(tmp_path: Path, separator: str, decimal: str) -> None:
    columns = {"Time": ("ms", 1e3 * TIME), "Channel A": ("V", VOLTS), "Channel B": ("A", AMPERES)}
    (sheet,) = read(foreign.picoscope(tmp_path / "a.csv", columns, separator, decimal))
    assert [column.label for column in sheet.columns] == ["Time", "Channel A", "Channel B"]
    check(sheet, digits=1e-8, time=("ms", 1e-3))


def test_what_picoscope_could_not_measure_is_a_gap_and_said(tmp_path: Path) -> None:
    path = foreign.picoscope(tmp_path / "a.csv", {"Time": ("ms", TIME), "Channel A": ("V", VOLTS)})
    lines = path.read_text(encoding="utf-8").split("\n")
    lines[10] = lines[10].partition(",")[0] + ",∞"
    path.write_text("\n".join(lines), encoding="utf-8")
    (sheet,) = read(path)
    assert np.flatnonzero(np.isnan(sheet.columns[1].values)).tolist() == [7]
    assert sheet.remarks == ("column 'Channel A': 1 samples beyond the range ('∞') are gaps",)


def test_saleae(tmp_path: Path) -> None:
    columns = {"Time": ("s", TIME), "Channel 0": ("V", VOLTS), "Channel 1": ("V", AMPERES)}
    (sheet,) = read(foreign.saleae(tmp_path / "analog.csv", columns))
    assert [(c.name, c.unit) for c in sheet.columns] == [("Time", "s"), ("Channel 0", ""), ("Channel 1", "")]
    assert sheet.columns[1].values == pytest.approx(VOLTS, abs=1e-6)


@pytest.mark.parametrize("write", [foreign.rigol_ds1000z, foreign.rigol_mso5000])
def test_rigol(tmp_path: Path, write) -> None:
    (sheet,) = read(write(tmp_path / "RigolDS0.csv", COLUMNS))
    check(sheet, digits=1e-5)


def test_rigol_leaves_out_logic_channels(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(
        "X,CH1,D7-D0,Start,Increment,\nSequence,Volt,,-1.0e-03,2.0e-06\n0,4.0e-02,0x00,\n1,-1.2e-01,0x01,\n"
    )
    (sheet,) = read(path)
    assert [column.label for column in sheet.columns] == ["time", "CH1"]
    assert sheet.columns[0].values == pytest.approx([-1e-3, -0.998e-3])


def test_tektronix_with_a_file_for_each_channel(tmp_path: Path) -> None:
    volts, amperes = read(*foreign.tektronix_tds(tmp_path, 1, COLUMNS))
    assert (volts.columns[1].label, volts.columns[1].unit) == ("CH1", "V")
    check(Sheet("", "", (*volts.columns, amperes.columns[1])), digits=1e-5)


def test_tektronix_with_all_channels_below_the_settings(tmp_path: Path) -> None:
    (sheet,) = read(foreign.tektronix_mso(tmp_path / "tek.csv", COLUMNS))
    assert [column.label for column in sheet.columns] == ["TIME", "CH1", "CH2"]
    check(sheet, digits=1e-8)


@pytest.mark.parametrize("x_columns", ["No", "One", "Multi"])
@pytest.mark.parametrize("decimal", [".", ","])
def test_labview(tmp_path: Path, x_columns: str, decimal: str) -> None:
    (sheet,) = read(foreign.labview(tmp_path / "a.lvm", COLUMNS, x_columns, decimal))
    assert [column.label for column in sheet.columns] == ["time", "CH1", "CH2"]
    check(sheet, digits=1e-6)


def test_labview_with_two_segments(tmp_path: Path) -> None:
    import lvmio

    segments = [lvmio.Segment([lvmio.Channel("U", values.tolist(), unit="V", delta_x=0.1)])
                for values in (VOLTS[:10], VOLTS[10:30])]  # fmt: skip
    path = tmp_path / "a.lvm"
    path.write_text(lvmio.format_lvm(lvmio.LvmFile(segments), precision=9), encoding="utf-8", newline="")
    first, second = read(path)
    assert (first.part, second.part) == ("segment 1", "segment 2")
    assert first.columns[1].values == pytest.approx(VOLTS[:10], abs=1e-8)
    assert second.columns[1].values == pytest.approx(VOLTS[10:30], abs=1e-8)


def test_a_german_spreadsheet(tmp_path: Path) -> None:
    columns = {"Zeit": ("s", TIME), "Spannung": ("V", VOLTS), "Strom": ("A", AMPERES)}
    (sheet,) = read(foreign.semicolons(tmp_path / "a.csv", columns))
    assert [column.name for column in sheet.columns] == ["Zeit", "Spannung", "Strom"]
    check(sheet, digits=1e-6)


@pytest.mark.parametrize("day", ["", "2026-11-23 ", "23.11.2026 ", "2026-11-23T"])
def test_instants_become_seconds_over_midnight_too(tmp_path: Path, day: str) -> None:
    path = tmp_path / "a.csv"
    clocks = ["23:59:59,990", "00:00:00,000", "00:00:00,010", "00:00:00,020"]
    path.write_text("\n".join(["Zeitstempel;U;I", *(f"{day}{clock};1,5;0,25" for clock in clocks), ""]))
    (sheet,) = read(path)
    assert sheet.columns[0].unit == "s"
    assert sheet.columns[0].values == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert sheet.remarks == ("column 1: instants made seconds since the first",)


def test_a_last_row_that_was_cut_off_is_left_out_and_said(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,u\n" + "".join(f"0.0{k},{k}\n" for k in range(5)) + "0.0")
    (sheet,) = read(tmp_path / "a.csv")
    assert sheet.columns[1].values.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert sheet.losses == ("the last line has no end: it may be cut off, and is left out",)
    with (tmp_path / "a.csv").open("a") as file:
        file.write("\n")
    (sheet,) = read(tmp_path / "a.csv")
    assert sheet.columns[1].values.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert sheet.losses == ("the last row is cut off and left out",)


@pytest.mark.parametrize("line", [1, 2, 3, 6])
def test_a_spoilt_row_is_never_left_out_unsaid(tmp_path: Path, line: int) -> None:
    rows = ["t,u", *(f"0.0{k},{k}" for k in range(9))]
    rows[line] = rows[line].partition(",")[0] + ",x"
    (tmp_path / "a.csv").write_text("\n".join([*rows, ""]))
    with pytest.raises(MeasurementError, match=rf"a\.csv:{line + 1}: 'x'"):
        read(tmp_path / "a.csv")


@pytest.mark.parametrize("structure", ["", "run"])
@pytest.mark.parametrize("write", [foreign.matlab_5, foreign.matlab_73])
def test_matlab(tmp_path: Path, write, structure: str) -> None:
    sheets = [sheet for sheet in read(write(tmp_path / "a.mat", COLUMNS, structure)) if sheet.columns]
    assert [sheet.part for sheet in sheets] == [structure]
    by_name = {column.name: column for column in sheets[0].columns}
    check(Sheet("", "", tuple(by_name[name] for name in COLUMNS)))


def test_a_time_base_that_a_mat_file_gives_as_numbers(tmp_path: Path) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "pico.mat", {"A": VOLTS, "B": AMPERES, "Tstart": -0.01, "Tinterval": 0.001})
    (sheet,) = read(tmp_path / "pico.mat")
    assert [column.label for column in sheet.columns] == ["time", "A", "B"]
    assert sheet.columns[0].values == pytest.approx(TIME)


def test_a_simulink_structure_with_time(tmp_path: Path) -> None:
    import scipy.io

    signals = {"values": VOLTS[:, None], "label": "U_motor"}
    scipy.io.savemat(tmp_path / "log.mat", {"log": {"time": TIME, "signals": signals}})
    (sheet,) = read(tmp_path / "log.mat")
    assert (sheet.part, [column.label for column in sheet.columns]) == ("log", ["time", "U_motor"])


def test_time_series_of_equal_times_that_were_saved_as_structures_are_one_sheet(tmp_path: Path) -> None:
    import scipy.io

    series = {"u_motor": {"Time": TIME, "Data": VOLTS[:, None], "DataInfo": {"Units": "V"}},
              "i_motor": {"Time": TIME, "Data": AMPERES[:, None], "DataInfo": {"Units": "A"}}}  # fmt: skip
    scipy.io.savemat(tmp_path / "log.mat", series)
    (sheet,) = read(tmp_path / "log.mat")
    assert [(column.name, column.unit) for column in sheet.columns] == [
        ("time", ""),
        ("u_motor", "V"),
        ("i_motor", "A"),
    ]
    assert sheet.columns[2].values == pytest.approx(AMPERES)


@pytest.mark.parametrize(("write", "name", "start"), [(foreign.mdf4, "a.mf4", 0.0), (foreign.mcap, "a.mcap", TIME[0])])
def test_two_rates_leave_gaps_where_nothing_was_sampled(tmp_path: Path, write, name: str, start: float) -> None:
    (sheet,) = read(write(tmp_path / name, COLUMNS, slower=5))
    clock, volts, amperes = sheet.columns
    assert (clock.unit, volts.unit, amperes.unit) == ("s", "V", "A")
    assert clock.values == pytest.approx(TIME - start, abs=1e-6)
    assert volts.values == pytest.approx(VOLTS)
    assert amperes.values[::5] == pytest.approx(AMPERES[::5])
    assert np.isnan(np.delete(amperes.values, np.arange(0, 60, 5))).all()


def test_a_bus_log_is_decoded_by_its_dbc(tmp_path: Path) -> None:
    log = foreign.bus_log(tmp_path / "bus.mf4", tmp_path / "bus.dbc", COLUMNS)
    (sheet,) = read_sheets(Source(log, "bus.mf4", (tmp_path / "bus.dbc",)))
    with pytest.raises(MeasurementError, match=r"a bus log: .*Name the \.dbc among the files"):
        read(log)
    found = {column.name: column for column in sheet.columns}
    assert (found["CH1"].unit, found["CH2"].unit) == ("V", "A")
    assert found["CH1"].values == pytest.approx(VOLTS, abs=0.0006)
    assert np.diff(sheet.columns[0].values) == pytest.approx(0.001, abs=2e-6)


@pytest.mark.parametrize(("write", "name"), [(foreign.tdms, "a.tdms"), (foreign.parquet, "a.parquet")])
def test_tables_of_columns(tmp_path: Path, write, name: str) -> None:
    (sheet,) = read(write(tmp_path / name, COLUMNS))
    check(sheet)


def messages(path: Path, topic: str, rows: list[tuple[int, int, bytes]], unit: str = "") -> Path:
    """One channel without a schema: log time and publish time in ms, what the message holds."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(topic, "json", 0, {"unit": unit} if unit else {})
        for logged, published, data in rows:
            writer.add_message(channel, logged * 1_000_000, data, published * 1_000_000)
        writer.finish()
    return path


def test_mcap_fields_that_are_missing_or_no_numbers_are_gaps(tmp_path: Path) -> None:
    rows = [b'{"data": 1.5}', b'{"data": null}', b"{}", b'{"data": 2}']
    path = messages(tmp_path / "a.mcap", "/motor/voltage", [(k, k, row) for k, row in enumerate(rows)], "mV")
    (sheet,) = read(path)
    assert [(c.label, c.name, c.unit) for c in sheet.columns[1:]] == [
        ("/motor/voltage.data", "/motor/voltage.data", "mV")
    ]
    assert sheet.columns[1].values == pytest.approx([1.5, np.nan, np.nan, 2.0], nan_ok=True)


def test_mcap_messages_that_were_logged_at_once_take_the_time_of_publishing_and_say_so(tmp_path: Path) -> None:
    rows = [(10 * (k // 2), 3 * k, b'{"volts": %d}' % k) for k in range(6)]
    (sheet,) = read(messages(tmp_path / "a.mcap", "/u", rows))
    assert sheet.columns[0].values == pytest.approx(0.003 * np.arange(6))
    assert sheet.columns[1].values.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert sheet.remarks == ("messages share a log time: the publish time is taken",)
    (sheet,) = read(messages(tmp_path / "b.mcap", "/u", [(logged, logged, data) for logged, _, data in rows]))
    assert sheet.columns[1].values.tolist() == [1.0, 3.0, 5.0]
    assert sheet.remarks == ("'/u': of messages at one instant the last counts; 3 left out",)


def test_mcap_of_an_encoding_that_is_not_supported_names_channel_and_encoding(tmp_path: Path) -> None:
    told = r"a\.mcap: no channel .*'/bench/0' \(cdr\), '/bench/1' \(cdr\)\..*Record these topics as JSON, or export"
    with pytest.raises(MeasurementError, match=told):
        read(foreign.mcap(tmp_path / "a.mcap", COLUMNS, encoding="cdr"))
    (sheet,) = read(foreign.mcap(tmp_path / "b.mcap", COLUMNS, last_encoding="protobuf"))
    assert [column.label for column in sheet.columns] == ["time", "/bench/0.probe.CH1"]
    assert sheet.missing == ("channels cannot be read, of an encoding other than json: '/bench/1' (protobuf)",)


@pytest.mark.parametrize("kept", [8, 12, 300, -1])
def test_an_mcap_that_is_truncated_says_how_to_recover_it(tmp_path: Path, kept: int) -> None:
    path = foreign.mcap(tmp_path / "a.mcap", COLUMNS)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(MeasurementError, match=r"a\.mcap: it is truncated: .*mcap recover"):
        read(path)


def test_an_mcap_that_is_damaged_inside_says_so(tmp_path: Path) -> None:
    path = foreign.mcap(tmp_path / "a.mcap", COLUMNS)
    content = bytearray(path.read_bytes())
    content[200:260] = bytes(60)
    path.write_bytes(content)
    with pytest.raises(MeasurementError, match=r"a\.mcap: it cannot be read"):
        read(path)
    with pytest.raises(MeasurementError, match=r"b\.mcap: it cannot be read"):
        read(messages(tmp_path / "b.mcap", "/u", [(0, 0, b"no json")]))


@pytest.mark.parametrize("suffix", sorted({suffix for each in FORMATS for suffix in each.suffixes}))
def test_a_file_of_another_kind_says_so(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"odd{suffix}"
    path.write_bytes(b"no recording at all\n" * 30)
    with pytest.raises(MeasurementError) as caught:
        read(path)
    assert caught.value.where.startswith(path.name)
    assert caught.value.mend


def test_an_unknown_format_and_a_missing_file_say_so(tmp_path: Path) -> None:
    (tmp_path / "a.xyz").write_text("1")
    with pytest.raises(MeasurementError, match=r"a\.xyz: no format is known for '\.xyz'"):
        read(tmp_path / "a.xyz")
    with pytest.raises(MeasurementError, match="it is a folder"):
        read(tmp_path)
    with pytest.raises(MeasurementError, match="no such file"):
        read(tmp_path / "b.csv")
