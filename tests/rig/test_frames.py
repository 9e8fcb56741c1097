"""A rig from data frames is the rig that the same data make as CSV, in content and in what is refused."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import results
from etcfit.errors import MeasurementError, UsageError
from etcfit.rig.base import FRAMES, Rig, RigConfig
from etcfit.rig.reader import read_folder
from etcfit.run_folder.state import load_fit, must_belong, save_fit
from folders import TOML, Sheet, back_emf, inductance, resistance, response, write

SHEETS = {
    "response/1": response().with_cell(3, 2, "").with_cell(7, 3, "").with_cell(8, 3, ""),
    "response/2": response(80, seed=9),
    "back_emf/1": back_emf(),
    "resistance/1": resistance(),
    "inductance/1": inductance(),
}
MORE = '[noise]\ncurrent_A = 0.02\n[holdout]\nfiles = ["response/2{}"]\n[columns]\n"X" = "emf [V]"\n'


def frame(sheet: Sheet) -> pd.DataFrame:
    return pd.DataFrame({name: [float(row[k] or "nan") for row in sheet.rows] for k, name in enumerate(sheet.header)})


def config(text: str = TOML) -> dict[str, Any]:
    return tomllib.loads(text)


def frames(**changes: pd.DataFrame) -> dict[str, Any]:
    return {name: frame(sheet) for name, sheet in SHEETS.items()} | {f"response/{k}": v for k, v in changes.items()}


def assert_equal_content(one: Any, other: Any) -> None:
    assert {f.name for f in fields(one)} == {f.name for f in fields(other)}
    for name in (f.name for f in fields(one)):
        a, b = getattr(one, name), getattr(other, name)
        if name == "channels":
            assert list(a) == list(b)
            for channel in a:
                assert_equal_content(a[channel], b[channel])
        elif isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
            assert not a.flags.writeable
        elif name != "file":
            assert a == b, name


def folder_rig(folder: Path) -> Rig:
    files = {f"{name}.csv": sheet.text() for name, sheet in SHEETS.items()}
    return read_folder(write(folder, {"rig.toml": TOML + MORE.format(".csv"), **files}))


def test_the_rig_is_that_of_the_same_data_as_csv(tmp_path: Path) -> None:
    read, made = folder_rig(tmp_path), Rig.from_frames(frames(), config(TOML + MORE.format("")))
    assert [m.file for m in made.measurements] == [m.file.removesuffix(".csv") for m in read.measurements]
    assert [m.held_out for m in made.measurements] == [False, False, False, False, True]
    for m, n in zip(made.measurements, read.measurements, strict=True):
        assert_equal_content(m, n)
    assert replace(made.config, holdout=read.config.holdout) == read.config
    said = [re.sub(r"rig\.toml:\d+: ", "rig.toml: ", w) for w in read.warnings]  # a dictionary has no lines
    assert [w.replace("config: ", f"{tmp_path}/rig.toml: ") for w in made.warnings] == said
    assert len(read.warnings) == 1
    assert (made.folder, made.toml) == (FRAMES, "")


def test_what_pandas_reads_of_a_csv_makes_the_same_rig(tmp_path: Path) -> None:
    """By the way of a file written by pandas, every digit kept, keys with its suffix: the very same, names and all."""
    tables = {f"{name}.csv": sheet for name, sheet in frames().items()}
    for name, table in tables.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        table.to_csv(tmp_path / name, index=False)
    (tmp_path / "rig.toml").write_text(TOML)
    read, made = read_folder(tmp_path), Rig.from_frames(tables, config())
    assert [m.file for m in made.measurements] == [m.file for m in read.measurements]
    for m, n in zip(made.measurements, read.measurements, strict=True):
        assert_equal_content(m, n)


def test_a_config_that_was_read_serves_too(tmp_path: Path) -> None:
    read = replace(folder_rig(tmp_path).config, holdout=("response/2",))
    made = Rig.from_frames(frames(), read)
    assert made.config == read
    assert made.digests["rig.toml"] == Rig.from_frames(frames(), config(TOML + MORE.format(""))).digests["rig.toml"]


def test_numbers_of_numpy_and_tuples_serve_as_config() -> None:
    table = {"rig": {"name": "x", "gear_ratio": np.float32(20.5), "supply_V": np.int64(12), "travel_deg": (0, 90)}}
    found = Rig.from_frames({"response/1": frame(response()).drop(columns="tps [V]").assign(**{
        "position [deg]": np.linspace(10.0, 50.0, 60)})}, table).config  # fmt: skip
    assert (found.name, found.gear_ratio, found.supply_V, found.travel[1]) == ("x", 20.5, 12.0, np.pi / 2)


KINDS: dict[str, Callable[[Any], pd.Series]] = {
    "texts": lambda column: column.map(lambda x: "" if np.isnan(x) else repr(x)),
    "objects": lambda column: column.astype(object).where(column.notna(), None),
    "pandas' own": lambda column: column.astype("Float64"),
    "another index": lambda column: column.set_axis(np.arange(len(column))[::-1] * 10),
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS.keys())
def test_columns_of_any_type_hold_the_same_numbers(kind: Callable[[Any], pd.Series]) -> None:
    plain = frame(SHEETS["response/1"])
    other = pd.DataFrame({name: kind(plain[name]) for name in plain})
    made, same = (Rig.from_frames({"response/1": f}, config()) for f in (plain, other))
    assert_equal_content(made.measurements[0], same.measurements[0])
    assert made.digests == same.digests


def test_a_frame_changed_later_changes_no_rig() -> None:
    mine = frames()
    made = Rig.from_frames(mine, config())
    before = {m.file: m.channels["voltage"].value.copy() for m in made.measurements if "voltage" in m.channels}
    for each in mine.values():
        each.iloc[:, :] = 0.0
    for m in made.measurements:
        if "voltage" in m.channels:
            np.testing.assert_array_equal(m.channels["voltage"].value, before[m.file])


def spoilt(row: int, column: str, value: Any) -> pd.DataFrame:
    out = frame(response(200)).astype({column: object} if isinstance(value, str) else {})
    out.loc[row, column] = value
    return out


R = frame(response())
WRONG: dict[str, tuple[Any, str]] = {
    "time falls": (spoilt(118, "time [ms]", 0.1), r"^frame response/1, row 118: time falls from [\d.]+ to 0\.1 ms\. "
                                                  r"Time must rise strictly; sort the log or split it\."),
    "time missing": (spoilt(118, "time [ms]", np.nan), r"^frame response/1, row 118: time is empty"),
    "text": (spoilt(118, "voltage [V]", "n/a"), r"^frame response/1, row 118: 'n/a' in column 'voltage \[V\]'"),
    "inf": (spoilt(118, "voltage [V]", -np.inf), r"^frame response/1, row 118: '-inf' in column 'voltage \[V\]'"),
    "too high": (spoilt(118, "voltage [V]", 5e3), r"^frame response/1, row 118: column 'voltage \[V\]' is 5000 V"),
    "truth": (R.assign(**{"duty [1]": True}), r"^frame response/1, row 0: 'True' in column 'duty \[1\]'"),
    "date": (R.assign(**{"time [ms]": pd.date_range("2026-01-01", periods=60)}), r"row 0: '2026-01-01 00:00:00' in"),
    "no unit": (R.rename(columns={"current [mA]": "current"}), r"^frame response/1: column 'current' has no unit"),
    "no time": (R.drop(columns="time [ms]"), r"^frame response/1: no time column among 'voltage"),
    "no drive": (R.drop(columns="voltage [V]"), r"^frame response/1: no voltage or duty or torque among"),
    "nameless": (R.rename(columns={"current [mA]": " "}), r"^frame response/1, row 0: column 3 holds .*\. Name it, or"),
    "numbered": (R.rename(columns={"current [mA]": 3}), r"^frame response/1: column 3\. .*quantity \[unit\]"),
    "twice": (R.rename(columns={"current [mA]": "voltage [V]"}), r"^frame response/1: columns .* are both voltage"),
    "empty": (R.iloc[:0], r"^frame response/1: no row of numbers"),
    "one row": (R.iloc[:1], r"^frame response/1: 1 sample"),
    "no frame": ({"time [s]": [1, 2]}, r"^frame response/1: found a dict\. It must be a pandas DataFrame"),
}  # fmt: skip


@pytest.mark.parametrize(("table", "message"), WRONG.values(), ids=WRONG.keys())
def test_each_mistake_has_the_message_that_a_csv_has(table: Any, message: str) -> None:
    with pytest.raises(MeasurementError, match=message) as caught:
        Rig.from_frames({**frames(), "response/1": table}, config())
    assert all((caught.value.found, caught.value.required, caught.value.mend))


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        ({}, "none given"),
        ({"respons/1": R}, r"^frame respons/1: 'respons' is no known rig test.*Did you mean 'response'"),
        ({"response": R}, r"^frames: key 'response'\. "),
        ({"response/a/b": R}, r"^frames: key 'response/a/b'"),
        ({"/1": R}, r"^frame /1: '' is no known"),
        ({3: R}, r"^frames: key 3\. "),
        ({"response/\ud800\udce9": R}, r"^response/\\ud800\\udce9: the name is no UTF-8"),
    ],
)
def test_a_key_names_a_test_and_a_trace(frames: Any, message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        Rig.from_frames(frames, config())


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"rig": {"gear_ratio": 1e90}}, r"^config: rig\.gear_ratio: found 1e\+90"),
        ({"rigg": {}}, r"^config: rigg: unknown key.*Did you mean 'rig'"),
        ({"columns": {3: "tps [V]"}}, r"^columns: key 3\. Keys must be texts"),
        ({"holdout": {"files": ["response/3"]}}, r"^config: holdout\.files names 'response/3'.*Did you mean"),
        ({"tests": {"sines": {"series_ohm": 1.0}}}, r"^config: tests\.sines: no such rig test.*'sine'"),
        ("rig.toml", r"^config: found 'rig\.toml'\. The tables of a rig"),
        ({}, r"^frame response/1: column 'tps \[V\]': tps needs"),
    ],
)
def test_the_config_is_checked_as_a_rig_toml_is(table: Any, message: str) -> None:
    with pytest.raises(MeasurementError, match=message):
        Rig.from_frames({"response/1": R}, table)


def test_a_run_records_the_frames_by_their_hash() -> None:
    """One digit, one name, one order of columns: another hash; the same again: the same."""
    found = Rig.from_frames(frames(), config()).digests
    assert set(found) == {"rig.toml", *SHEETS}
    assert len(set(found.values())) == len(found)
    assert all(digest is not None and len(digest) == 64 for digest in found.values())
    assert Rig.from_frames(frames(), config()).digests == found
    others = R * (1 + 1e-15), R.rename(columns={"tps [V]": "TPS [V]"}), R.iloc[:, ::-1]
    for other in others:
        assert Rig.from_frames(frames(**{"1": other}), config()).digests["response/1"] != found["response/1"]
    changed = config(TOML.replace("20.68", "20.69"))
    assert Rig.from_frames(frames(), changed).digests["rig.toml"] != found["rig.toml"]


def test_a_fit_of_frames_is_saved_whole_though_no_folder_holds_them(tmp_path: Path) -> None:
    rig = Rig.from_frames(frames(), config())
    save_fit(tmp_path / "run", results.result(rig))
    again = load_fit(tmp_path / "run")
    assert again.rig.folder == FRAMES
    assert again.rig.digests == rig.digests
    with pytest.raises(UsageError, match="made from data frames"):
        must_belong(tmp_path / "run", tmp_path)


def test_a_bare_config_names_the_rig() -> None:
    table = {"response/1": R.drop(columns="tps [V]").assign(**{"position [deg]": np.linspace(1.0, 60.0, 60)})}
    made = Rig.from_frames(table, {})
    assert made.config == RigConfig(name="frames")


def test_a_rig_is_shown_in_a_line() -> None:
    shown = repr(Rig.from_frames(frames(), config()))
    assert len(shown) < 200
    assert "response" in shown
