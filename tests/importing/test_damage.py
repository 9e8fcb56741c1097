"""Recordings that are cut off, damaged, odd or far too large: refused with a cure, or read with what they lack said."""

from __future__ import annotations

import decimal
import os
import re
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import car_logs
import folders
import foreign
from etcfit.cli import app
from etcfit.errors import MeasurementError, UsageError
from etcfit.importing import Answers, Imported, import_files
from etcfit.importing.answers import accept_all, refuse
from etcfit.importing.formats import read_sheets
from etcfit.importing.formats.base import Source
from etcfit.importing.sheet import Sheet

ROWS = 600
TIME = 0.001 * np.arange(ROWS)


def driven() -> dict[str, tuple[str, np.ndarray]]:
    """A plate that a voltage drives, with the noise of a bench, so that its rig test is sure."""
    noise = np.random.default_rng(3).normal(size=(3, ROWS))
    volts = 4.0 + 3.0 * np.sin(TIME / 0.02)
    sensor = 2.5 + 1.2 * np.sin(TIME / 0.02 - 1.0)
    amperes = (volts - 0.02 * np.gradient(sensor, TIME)) / 1.9
    return {
        "t": ("s", TIME),
        "MotorVoltage": ("V", volts + 0.01 * noise[0]),
        "MotorCurrent": ("A", amperes + 0.01 * noise[1]),
        "ThrottlePos": ("V", sensor + 0.002 * noise[2]),
    }


def megalog(path: Path, columns: foreign.Columns) -> Path:
    """MegaLogViewer's binary log."""
    values = {("Time" if name == "t" else name): array for name, (_, array) in columns.items()}
    fields = [("Time" if name == "t" else name, unit, "F32", 1.0, 0.0) for name, (unit, _) in columns.items()]
    path.write_bytes(car_logs.mlg(values, fields, 100 * np.arange(ROWS)))
    return path


def megalog_text(path: Path, columns: foreign.Columns) -> Path:
    """MegaLogViewer's text log."""
    names = ["Time" if name == "t" else name for name in columns]
    rows = ["\t".join(f"{x:.6f}" for x in row) for row in np.column_stack([array for _, array in columns.values()])]
    head = ['"rusEFI"', "\t".join(names), "\t".join(unit for unit, _ in columns.values())]
    path.write_text("\n".join([*head, *rows, ""]))
    return path


def tektronix(path: Path, columns: foreign.Columns) -> Path:
    """With the record length among its settings, as the scopes write it."""
    foreign.tektronix_mso(path, columns)
    text = path.read_bytes().replace(b"Waveform Type", b"Record Length,%d\r\nWaveform Type" % ROWS, 1)
    path.write_bytes(text)
    return path


def mdf_with_its_data_at_the_end(path: Path, columns: foreign.Columns) -> Path:
    """As loggers write it while they record: each block of data moved behind everything else."""
    foreign.mdf4(path, columns)
    raw = path.read_bytes()
    for at in [match.start() for match in re.finditer(b"##DT", raw)]:
        (length,) = struct.unpack_from("<Q", raw, at + 8)
        block, end = raw[at : at + length], -(-len(raw) // 8) * 8
        left = raw[:at] + b"##XX" + raw[at + 4 :]
        raw = left.replace(struct.pack("<q", at), struct.pack("<q", end)).ljust(end, b"\0") + block
    path.write_bytes(raw)
    return path


Writer = Callable[[Path, foreign.Columns], Path]
WRITERS: Mapping[str, Writer] = {
    "pico.csv": foreign.picoscope, "tek.csv": tektronix, "rigol.csv": foreign.rigol_ds1000z, "one.lvm": foreign.labview,
    "multi.lvm": lambda path, columns: foreign.labview(path, columns, "Multi"), "five.mat": foreign.matlab_5,
    "seven.mat": foreign.matlab_73, "a.mf4": foreign.mdf4, "end.mf4": mdf_with_its_data_at_the_end,
    "a.tdms": foreign.tdms, "a.parquet": foreign.parquet, "a.mcap": foreign.mcap, "a.msl": megalog_text,
    "a.mlg": megalog,
}  # fmt: skip
COUNTED = ("tek.csv", "one.lvm", "multi.lvm", "a.tdms")  # these say how many rows there are


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same trace in each format."""
    folder = tmp_path_factory.mktemp("recordings")
    for name, write in WRITERS.items():
        write(folder / name, driven())
    (folder / "rig.toml").write_text(folders.TOML)
    return folder


def imported(file: Path, to: Path, resolve=refuse) -> Imported:
    rig = to.parent / "known.toml"
    rig.write_text(folders.TOML)
    return import_files([file], to, Answers(), resolve, rig=rig)


def shown(done: Imported) -> dict[str, dict[str, int]]:
    """Rig test -> column -> numbers in all its traces."""
    found: dict[str, dict[str, int]] = {}
    for file, _, _ in done.traces:
        lines = (done.folder / file).read_text().splitlines()
        header, *rows = [line for line in lines if not line.startswith("#")]
        counts = found.setdefault(file.partition("/")[0], {})
        cells = [row.split(",") for row in rows]
        for k, name in enumerate(header.split(",")[1:], start=1):
            counts[name] = counts.get(name, 0) + sum(bool(row[k]) for row in cells)
    return found


def read(path: Path, most: int = 10**9) -> list[Sheet]:
    return read_sheets(Source(path, path.name, most=most))


@pytest.mark.parametrize("name", WRITERS)
def test_a_whole_recording_is_read_without_a_word(recordings: Path, tmp_path: Path, name: str) -> None:
    done = imported(recordings / name, tmp_path / "rig")
    assert done.warnings == ()
    ((test, counts),) = shown(done).items()
    assert (test, set(counts.values())) == ("response", {ROWS})


@pytest.mark.parametrize("cut", [1, 40, 2000])
@pytest.mark.parametrize("name", WRITERS)
def test_a_recording_that_is_cut_off_is_refused_or_said_to_be(
    recordings: Path, tmp_path: Path, name: str, cut: int
) -> None:
    file = tmp_path / name
    file.write_bytes((recordings / name).read_bytes()[:-cut])
    done, told = None, ("", "")
    try:
        done = imported(file, tmp_path / "rig")
    except MeasurementError as error:
        told = error.where, error.mend
    if done is None:
        assert name in told[0]
        assert told[1]
        assert not (tmp_path / "rig").exists()
    else:
        assert name not in COUNTED or cut < 3  # all but the last line's end
        assert list(shown(done)) == ["response"]
        assert any("left out" in each for each in done.warnings) or shown(done)["response"]["voltage [V]"] == ROWS


@pytest.mark.parametrize("name", ["tek.csv", "one.lvm", "multi.lvm", "a.tdms"])
def test_what_is_left_of_a_cut_recording_is_taken_where_the_user_says_so(
    recordings: Path, tmp_path: Path, name: str
) -> None:
    file = tmp_path / name
    file.write_bytes((recordings / name).read_bytes()[:-40])
    with pytest.raises(MeasurementError, match=r"rows are missing|record length is 600.*--yes"):
        imported(file, tmp_path / "rig")
    done = imported(file, tmp_path / "rig", accept_all)
    ((test, counts),) = shown(done).items()
    assert test == "response"
    assert len(set(counts.values())) == 1  # no column goes on where another has ended
    assert ROWS - 6 < counts["voltage [V]"] < ROWS
    assert "missing" in done.warnings[0] or "cut off" in done.warnings[0]
    assert "missing" in (done.folder / "rig.toml").read_text() or "cut off" in (done.folder / "rig.toml").read_text()


# Text


def lvm(tmp_path: Path, change: Callable[[str], str], x_columns: str = "One") -> Path:
    path = foreign.labview(tmp_path / "a.lvm", driven(), x_columns)
    text = path.read_bytes().decode()
    assert change(text) != text
    path.write_bytes(change(text).encode())
    return path


def without(text: str, key: str) -> str:
    return "\n".join(line for line in text.split("\n") if not line.startswith(key))


def test_an_lvm_without_counts_whose_columns_end_apart(tmp_path: Path) -> None:
    def shortened(text: str) -> str:
        rows = without(text, "Samples").rstrip().rpartition("\t")[0]
        return f"{rows}\t\r\n"

    with pytest.raises(MeasurementError, match=r"'MotorVoltage' has 600 values, 'ThrottlePos' has 599"):
        imported(lvm(tmp_path, shortened), tmp_path / "rig")


def test_an_lvm_that_another_program_went_on_writing_has_more_rows_than_it_says(tmp_path: Path) -> None:
    path = lvm(tmp_path, lambda text: text.replace("600", "200"))
    assert [sheet.missing for sheet in read(path)] == [()]
    assert read(path)[0].rows == ROWS


def test_an_lvm_without_a_time_asks_for_its_period(tmp_path: Path) -> None:
    path = lvm(tmp_path, lambda text: without(text, "Delta_X"), "No")
    with pytest.raises(MeasurementError, match=r"a\.lvm: no time among its columns.*--period 1ms"):
        imported(path, tmp_path / "rig")
    path = lvm(tmp_path, lambda text: without(without(text, "Delta_X"), "X_Columns").replace("X_Value", ""))
    with pytest.raises(MeasurementError, match=r"a\.lvm: no time among its columns.*--period 1ms"):
        imported(path, tmp_path / "rig")


@pytest.mark.parametrize(
    "change", [lambda row: row.replace("\t", "\r\n", 2), lambda row: row.replace("\t", "\t9\t", 1)]
)
def test_an_lvm_whose_row_is_broken_is_refused_by_row(tmp_path: Path, change: Callable[[str], str]) -> None:
    def broken(text: str) -> str:
        lines = text.split("\n")
        return "\n".join([*lines[:-300], change(lines[-300]), *lines[-299:]])

    with pytest.raises(MeasurementError, match=r"a\.lvm: its rows cannot be read \(row \d+ has \d cells"):
        read(lvm(tmp_path, broken))


def test_one_damaged_time_of_an_lvm_makes_no_channel_a_trace_of_its_own(tmp_path: Path) -> None:
    def changed(text: str) -> str:
        head, mark, rows = text.rpartition("***End_of_Header***")
        lines = rows.split("\n")
        cells = lines[50].split("\t")
        cells[2] = "0.0485"
        return head + mark + "\n".join([*lines[:50], "\t".join(cells), *lines[51:]])

    with pytest.raises(MeasurementError, match=r"times of two channels differ in row \d+ alone"):
        read(lvm(tmp_path, changed, "Multi"))


def test_a_missing_line_of_a_rigol_does_not_shift_the_clock(recordings: Path, tmp_path: Path) -> None:
    lines = (recordings / "rigol.csv").read_text().split("\n")
    (tmp_path / "a.csv").write_text("\n".join([*lines[:100], *lines[101:]]))
    with pytest.raises(MeasurementError, match=r"row 99 is number 99"):
        read(tmp_path / "a.csv")


def test_rows_of_an_msl_that_lack_cells_are_said(recordings: Path, tmp_path: Path) -> None:
    lines = (recordings / "a.msl").read_text().split("\n")
    lines[9] = lines[9].rpartition("\t")[0]
    (tmp_path / "a.msl").write_text("\n".join(lines))
    (sheet,) = read(tmp_path / "a.msl")
    assert sheet.losses == ("rows with too few cells are left out: 1, in lines 10",)
    assert sheet.rows == ROWS - 1


# Binary formats


def test_a_tdms_with_one_byte_less_says_how_many_values_it_lacks(recordings: Path, tmp_path: Path, capfd) -> None:
    path = tmp_path / "a.tdms"
    path.write_bytes((recordings / "a.tdms").read_bytes()[:-1])
    (sheet,) = read(path)
    assert sheet.rows == ROWS - 1
    assert sheet.missing == ("it is cut off: 1 bytes of its last segment are missing",
                             "rows are missing: it says that 'ThrottlePos' has 600 values, and holds 599")  # fmt: skip
    assert capfd.readouterr().err == ""  # nptdms has a logger that prints by itself


def test_a_tdms_whose_counts_are_damaged_is_not_read_with_its_channels_mixed(recordings: Path, tmp_path: Path) -> None:
    raw = (recordings / "a.tdms").read_bytes()
    count = struct.pack("<Q", ROWS)
    (tmp_path / "a.tdms").write_bytes(raw.replace(count, struct.pack("<Q", 450), 1))
    with pytest.raises(MeasurementError, match="its counts do not fit its data"):
        read(tmp_path / "a.tdms")


def test_a_tdms_whose_second_segment_is_cut_within_its_head(recordings: Path, tmp_path: Path) -> None:
    (tmp_path / "a.tdms").write_bytes((recordings / "a.tdms").read_bytes() + b"TDSm\x0e\0\0")
    (sheet,) = read(tmp_path / "a.tdms")
    assert sheet.missing == ("it is cut off: its last 7 bytes are the beginning of a segment",)


def test_a_tdms_whose_channels_end_apart(tmp_path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(tmp_path / "a.tdms") as writer:
        values = {"u": np.arange(100.0), "i": np.arange(98.0), "slow": np.arange(10.0), "z": np.ones(100, complex)}
        writer.write_segment([ChannelObject("g", name, each) for name, each in values.items()])
    fast, slow = read(tmp_path / "a.tdms")
    assert (fast.rows, slow.rows) == (98, 10)
    assert fast.missing == ("'z' cannot be read: its type is complex128",
                            "rows are missing: 'u' has 100 values, 'i' has 98")  # fmt: skip


def test_an_mdf_that_is_cut_off_behind_its_data(recordings: Path, tmp_path: Path) -> None:
    (tmp_path / "a.mf4").write_bytes((recordings / "end.mf4").read_bytes()[:-1])
    with pytest.raises(MeasurementError, match=r"a\.mf4: it cannot be read .*Export it again"):
        read(tmp_path / "a.mf4")


def test_a_compressed_mdf_with_a_flipped_bit(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    path = tmp_path / "a.mf4"
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(values, TIME, unit=unit, name=name) for name, (unit, values) in driven().items()])
        mdf.save(path, compression=2, overwrite=True)
    raw = bytearray(path.read_bytes())
    raw[raw.find(b"##DZ") + 300] ^= 4
    path.write_bytes(raw)
    with pytest.raises(MeasurementError, match=r"a\.mf4: it cannot be read \(.*Export it again"):
        read(path)


def test_an_mdf_whose_time_falls_is_not_sorted_unsaid(tmp_path: Path) -> None:
    columns = driven()
    columns["t"] = ("s", np.where(np.arange(ROWS) == 300, 0.1, TIME))
    with pytest.raises(MeasurementError, match="the time of 'MotorVoltage' falls"):
        read(foreign.mdf4(tmp_path / "a.mf4", columns))


def test_an_mcap_that_says_another_number_of_messages(recordings: Path, tmp_path: Path) -> None:
    raw = bytearray((recordings / "a.mcap").read_bytes())
    at = 8
    while raw[at] != 0x0B:  # statistics, which begin with the number of messages
        at += 9 + struct.unpack_from("<Q", raw, at + 1)[0]
    raw[at + 9] ^= 1
    start = struct.unpack_from("<Q", raw, len(raw) - 8 - 20)[0]
    raw[-12:-8] = struct.pack("<I", zlib.crc32(raw[start : len(raw) - 12]))
    (tmp_path / "a.mcap").write_bytes(raw)
    with pytest.raises(MeasurementError, match=r"it says that it has \d+ messages, and holds \d+"):
        read(tmp_path / "a.mcap")


# Parquet


def table(path: Path, **columns: object) -> Path:
    import pyarrow
    import pyarrow.parquet

    pyarrow.parquet.write_table(pyarrow.table(columns), path)
    return path


@pytest.mark.parametrize("kind", ["decimal", "text"])
def test_a_parquet_column_of_decimals_or_of_numbers_as_texts_is_a_signal(tmp_path: Path, kind: str) -> None:
    numbers = {name: values for name, (_, values) in driven().items()}
    as_kind = {"decimal": lambda x: decimal.Decimal(f"{x:.6f}"), "text": lambda x: f"{x:.6f}"}[kind]
    odd = [as_kind(x) for x in numbers["ThrottlePos"]]
    path = table(tmp_path / "a.parquet", t_s=TIME, u_V=numbers["MotorVoltage"], i_A=numbers["MotorCurrent"], tps_V=odd)
    done = imported(path, tmp_path / "rig")
    assert shown(done) == {"response": {"voltage [V]": ROWS, "current [A]": ROWS, "tps [V]": ROWS}}


def test_a_parquet_column_that_cannot_be_read_is_a_doubt_and_others_are_said_to_be_left_out(tmp_path: Path) -> None:
    commas = [f"{x:.3f}".replace(".", ",") for x in TIME]
    path = table(tmp_path / "a.parquet", t=TIME, u_V=driven()["MotorVoltage"][1], i_A=driven()["MotorCurrent"][1],
                 pos=commas, runs=[[x] for x in TIME], on=TIME > 1.0, note=["a"] * ROWS)  # fmt: skip
    (sheet,) = read(path)
    assert sheet.missing == ("'pos' cannot be read: numbers with a comma, written as texts ('0,000')",
                             "'runs' cannot be read: its type is list<element: double>")  # fmt: skip
    assert sheet.remarks == ("'on' is left out: truth values", "'note' is left out: texts")
    with pytest.raises(MeasurementError, match=r"'pos' cannot be read.*--yes"):
        imported(path, tmp_path / "rig")


def test_a_parquet_without_rows_or_with_odd_metadata(tmp_path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    empty = table(tmp_path / "empty.parquet", t=pyarrow.array([], pyarrow.timestamp("us")), u=pyarrow.array([], "f8"))
    with pytest.raises(MeasurementError, match=r"empty\.parquet: 0 rows in it\. A trace needs two"):
        read(empty)
    unit = pyarrow.field("u", pyarrow.float64(), metadata={"unit": b"\xb0\xff"})
    schema = pyarrow.schema([pyarrow.field("t", pyarrow.timestamp("us")), unit])
    odd = pyarrow.Table.from_arrays([pyarrow.array([None, 2_000_000, 3_000_000], schema.field(0).type),
                                     pyarrow.array([1.0, 2.0, np.inf])], schema=schema)  # fmt: skip
    pyarrow.parquet.write_table(odd, tmp_path / "odd.parquet")
    (sheet,) = read(tmp_path / "odd.parquet")
    assert sheet.columns[0].values == pytest.approx([np.nan, 0.0, 1.0], nan_ok=True)
    assert sheet.columns[1].values == pytest.approx([1.0, 2.0, np.nan], nan_ok=True)


# MATLAB


def seven(path: Path, change: Callable[..., None]) -> Path:
    """A v7.3 file, changed by h5py."""
    import h5py

    foreign.matlab_73(path, driven())
    head = path.read_bytes()[:512]
    with h5py.File(path, "r+") as file:
        change(file, h5py)
    with path.open("r+b") as file:
        file.write(head)
    return path


def soft_link(file, h5py) -> None:
    file["x"] = h5py.SoftLink("/nowhere")


def external_link(file, h5py) -> None:
    file["x"] = h5py.ExternalLink("/etc/other.h5", "/x")


def loop(file, h5py) -> None:
    group = file.create_group("x")
    group["again"] = group


def external_data(file, h5py) -> None:
    file.create_dataset("x", (10,), "u1", external=[("/etc/passwd", 0, 10)])


@pytest.mark.parametrize(("change", "message"), [
    (soft_link, "'x' is a link, or holds itself"), (external_link, "'x' is a link"),
    (loop, "is a link, or holds itself"), (external_data, "'x' lies in another file"),
])  # fmt: skip
def test_a_mat_file_that_leads_out_of_itself_or_in_a_circle(tmp_path: Path, change, message: str) -> None:
    with pytest.raises(MeasurementError, match=rf"a\.mat: '?.*{message}.*Export it again"):
        read(seven(tmp_path / "a.mat", change))


def test_odd_codes_empty_arrays_and_objects_of_a_mat_file(tmp_path: Path) -> None:
    def odd(file, h5py) -> None:
        for name, values in (("text", np.array([70, 1 << 40, 55296])), ("signed", np.array([-5, 66]))):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("char")
        file["empty"] = np.array([0, 0, 0, 0], dtype="u8")
        file["empty"].attrs["MATLAB_empty"] = 1
        file["ts"] = np.array([1, 2, 3, 4, 5, 6], dtype="u4")
        file["ts"].attrs["MATLAB_object_decode"] = 3

    (sheet,) = read(seven(tmp_path / "a.mat", odd))
    assert len(sheet.columns) == 4
    assert sheet.missing == ("'ts' cannot be read: it is a MATLAB object",)


def test_a_cell_array_of_vectors_is_said_and_one_of_texts_is_not(tmp_path: Path) -> None:
    import scipy.io

    cells = {"runs": np.empty(2, object), "names": np.empty(2, object)}
    cells["runs"][:] = [TIME, TIME[:5]]
    cells["names"][:] = ["a", "b"]
    scipy.io.savemat(tmp_path / "five.mat", {"t": TIME, "u": np.sin(TIME), **cells})

    def with_cells(file, h5py) -> None:
        refs = file.create_group("#refs#")
        for name, values in (("runs", TIME), ("names", np.array([97, 98, 99], "u2"))):
            refs[name] = values
            refs[name].attrs["MATLAB_class"] = np.bytes_("double" if name == "runs" else "char")
            file.create_dataset(name, data=np.array([[refs[name].ref]], h5py.ref_dtype))
            file[name].attrs["MATLAB_class"] = np.bytes_("cell")

    for path in (tmp_path / "five.mat", seven(tmp_path / "seven.mat", with_cells)):
        (sheet,) = read(path)
        assert sheet.missing == ("'runs' cannot be read: it is a cell array of vectors",)


def test_vectors_of_a_mat_file_that_end_apart(tmp_path: Path) -> None:
    import scipy.io

    vectors = {name: values for name, (_, values) in driven().items()}
    scipy.io.savemat(tmp_path / "a.mat", {**vectors, "ThrottlePos": vectors["ThrottlePos"][:-2], "map": np.ones(20)})
    with pytest.raises(MeasurementError, match=r"rows are missing: 't' has 600 values, 'ThrottlePos' has 598"):
        imported(tmp_path / "a.mat", tmp_path / "rig")
    done = imported(tmp_path / "a.mat", tmp_path / "rig", accept_all)
    assert shown(done)["response"] == {"voltage [V]": 598, "current [A]": 598, "tps [V]": 598}


def test_two_runs_of_about_one_length_in_a_mat_file_are_two(tmp_path: Path) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "a.mat", {"t1": TIME, "u1": np.sin(TIME), "t2": TIME[:590], "u2": np.cos(TIME[:590])})
    assert [(sheet.rows, sheet.missing) for sheet in read(tmp_path / "a.mat")] == [(600, ()), (590, ())]


@pytest.mark.parametrize("content", [{"time": TIME, "signals": {"label": "u"}}, {"time": TIME, "signals": 3.0}])
def test_a_simulink_structure_that_is_none(tmp_path: Path, content: dict[str, object]) -> None:
    import scipy.io

    scipy.io.savemat(tmp_path / "a.mat", {"log": content})
    with pytest.raises(MeasurementError, match=r"a\.mat: it cannot be read"):
        read(tmp_path / "a.mat")


# Time that falls


def text(path: Path, time: np.ndarray) -> Path:
    columns = driven()
    columns["t"] = ("s", time)
    return foreign.picoscope(path, columns)


@pytest.mark.parametrize("time", [TIME[::-1], 0.0 * TIME, np.where(np.arange(ROWS) % 2, TIME, -TIME)])
def test_a_time_that_falls_is_refused_by_its_row(tmp_path: Path, time: np.ndarray) -> None:
    with pytest.raises(MeasurementError, match=r"a\.csv, row \d: time goes from .* at \d+ of 599 steps.*Sort the log"):
        imported(text(tmp_path / "a.csv", time), tmp_path / "rig")


def test_a_negative_period_of_the_file_and_of_the_user(tmp_path: Path) -> None:
    import scipy.io

    columns = {name: values for name, (_, values) in driven().items() if name != "t"}
    scipy.io.savemat(tmp_path / "a.mat", {**columns, "Ts": -0.001})
    with pytest.raises(MeasurementError, match=r"a\.mat, row 2: time goes from 0 to -0\.001 s"):
        imported(tmp_path / "a.mat", tmp_path / "rig")
    for period in (-0.001, 0.0, np.nan):
        with pytest.raises(UsageError, match=r"--period: .*longer than 0"):
            Answers(period=period)


def test_bursts_too_short_to_be_traces(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"a\.csv: its time falls or pauses before there are 10 rows in a row"):
        imported(text(tmp_path / "a.csv", TIME + 10.0 * (np.arange(ROWS) // 5)), tmp_path / "rig")


def test_rows_that_a_cut_leaves_out_are_counted(tmp_path: Path) -> None:
    time = TIME + 5.0 * (np.arange(ROWS) >= 300) + 5.0 * (np.arange(ROWS) >= 304)
    done = imported(text(tmp_path / "a.csv", time), tmp_path / "rig")
    assert [reason.rpartition("; ")[2] for _, _, reason in done.traces] == [
        "4 rows in pieces of fewer than 10 are left out"
    ] * 2


def test_a_rig_test_that_is_told_by_what_is_not_logged_is_unsure_beside_a_column_that_nothing_explains(
    tmp_path: Path,
) -> None:
    columns = driven()
    columns["Fred"] = ("kPa", 100.0 * columns.pop("ThrottlePos")[1])
    columns["MotorCurrent"] = ("A", columns["MotorVoltage"][1] / 1.9)
    with pytest.raises(MeasurementError, match=r"taken as resistance, .* it is not known what 'Fred' is"):
        imported(foreign.picoscope(tmp_path / "a.csv", columns), tmp_path / "rig")


# Size


@pytest.mark.parametrize("name", WRITERS)
def test_a_recording_above_the_limit_is_refused_and_the_limit_can_be_raised(recordings: Path, name: str) -> None:
    with pytest.raises(MeasurementError, match=r"its numbers take .* in memory\. At most .*--limit \d+MB"):
        read(recordings / name, 8 * ROWS)
    assert sum(sheet.rows for sheet in read(recordings / name, 10**6)) == ROWS


def compressed_mat(path: Path, values: int) -> Path:
    """A level 5 file of a vector of so many zeros, a few kilobytes."""
    inner = (
        struct.pack("<8I", 6, 8, 6, 0, 5, 8, values, 1)
        + struct.pack("<HH4s", 1, 1, b"u")
        + struct.pack("<II", 9, 8 * values)
    )
    packed = zlib.compress(struct.pack("<II", 14, len(inner) + 8 * values) + inner + bytes(8 * values))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(packed)) + packed)
    return path


def sparse_mat(path: Path) -> Path:
    import scipy.io
    import scipy.sparse

    scipy.io.savemat(path, {"t": TIME, "u": scipy.sparse.csc_matrix(([1.0], ([5], [0])), shape=(10**8, 1))})
    return path


def never_written_mat(path: Path) -> Path:
    return seven(path, lambda file, h5py: file.create_dataset("u", (1, 10**9), "f8", chunks=(1, 10**6)))


def repeated_parquet(path: Path) -> Path:
    return table(path, t=np.zeros(10**6), u=np.zeros(10**6))


def wide_mcap(path: Path) -> Path:
    """Each message has a number of its own name: as many columns as rows."""
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/u", "json", 0)
        for k in range(2000):
            writer.add_message(channel, 10**6 * k, b'{"x%d": 1.5}' % k, 10**6 * k)
        writer.finish()
    return path


@pytest.mark.parametrize(("make", "most"), [
    (lambda path: compressed_mat(path / "a.mat", 10**6), 7 * 10**6),
    (lambda path: sparse_mat(path / "a.mat"), 256 * 10**6),
    (lambda path: never_written_mat(path / "a.mat"), 256 * 10**6),
    (lambda path: repeated_parquet(path / "a.parquet"), 15 * 10**6),
    (lambda path: wide_mcap(path / "a.mcap"), 15 * 10**6),
])  # fmt: skip
def test_a_small_file_that_unpacks_to_a_large_one_is_refused_by_its_own_counts(tmp_path: Path, make, most: int) -> None:
    path = make(tmp_path)
    assert path.stat().st_size < 300_000
    with pytest.raises(MeasurementError, match=r"its numbers take .* in memory"):
        read(path, most)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_the_command_takes_a_limit_and_says_what_a_recording_lacks(recordings: Path, tmp_path: Path, run) -> None:
    rig, cut = recordings / "rig.toml", tmp_path / "a.csv"
    cut.write_bytes((recordings / "pico.csv").read_bytes()[:-5])
    refused = run("import", cut, "--to", "rig", "--rig", rig, "--limit", "20kB", "--quiet")
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "raise the limit: --limit 1MB" in " ".join(refused.stderr.split())
    assert run("import", cut, "--to", "rig", "--limit", "1", "--quiet").exit_code == 2
    done = run("import", cut, "--to", "rig", "--rig", rig, "--limit", "1MB", "--quiet")
    assert (
        done.exit_code,
        done.stderr.strip().endswith("a.csv: the last line has no end: it may be cut off, and is left out"),
    ) == (0, True)
    assert "with 1 warning" in done.stdout


@pytest.mark.parametrize(
    "words", [("a.csv", "--rig", "pipe"), ("pipe",), ("a.csv", "pipe.dbc"), ("a.csv", "--rig", "/dev/zero")]
)
def test_a_pipe_or_a_device_is_refused_before_it_is_read(
    recordings: Path, tmp_path: Path, run, words: tuple[str, ...]
) -> None:
    for name in ("pipe", "pipe.dbc"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "a.csv").write_bytes((recordings / "pico.csv").read_bytes())
    refused = run("import", *words, "--to", "rig", "--quiet")
    assert (refused.exit_code, refused.stdout) == (1, "")
    assert "it is a pipe or a device" in refused.stderr


# Anything


def mutations(raw: bytes, rng: np.random.Generator, count: int) -> list[tuple[str, bytes]]:
    """Cut ends, flipped bits and spoilt stretches, each said in words."""
    made = []
    for k in range(count):
        at = int(rng.integers(1, len(raw)))
        changed = bytearray(raw)
        if k % 4 == 0:
            made.append((f"cut at {at}", raw[:at]))
        elif k % 4 == 3:
            changed[at : at + 16] = rng.bytes(len(changed[at : at + 16]))
            made.append((f"16 bytes at {at}", bytes(changed)))
        else:
            changed[at] ^= 1 << int(rng.integers(8))
            made.append((f"bit at {at}", bytes(changed)))
    return made


def has_all_rows(found: Mapping[str, Mapping[str, int]]) -> bool:
    """One driven response with every column; damage may have made no number of one or two values."""
    counts = found.get("response", {})
    whole = {"voltage [V]", "current [A]", "tps [V]"}
    return len(found) == 1 and set(counts) == whole and max(counts.values()) == ROWS <= min(counts.values()) + 2


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_any_damage_is_refused_with_a_cure_or_said_or_leaves_all_rows(
    recordings: Path, tmp_path: Path, name: str
) -> None:
    raw = (recordings / name).read_bytes()
    outcomes = {"refused": 0, "said": 0, "same": 0}
    wrong = []
    for k, (damage, changed) in enumerate(mutations(raw, np.random.default_rng(36), 50)):
        if changed.endswith(b"\n") and len(changed) < len(raw) and name not in COUNTED:
            continue  # a text that says no count is as good without its last lines
        file = tmp_path / name
        file.write_bytes(changed)
        try:
            done = imported(file, tmp_path / str(k))
        except (MeasurementError, UsageError) as error:
            outcomes["refused"] += 1
            wrong += [] if name in str(error) and getattr(error, "mend", "a cure") else [f"{damage}: {error}"]
            continue
        if has_all_rows(shown(done)):
            outcomes["same"] += 1
        elif done.warnings or any("left out" in reason for _, _, reason in done.traces):
            outcomes["said"] += 1
        else:
            wrong.append(f"{damage}: {shown(done)}")
    print(name, outcomes)
    assert wrong == []
    assert outcomes["refused"] + outcomes["said"] >= 10
