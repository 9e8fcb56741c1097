"""One record under two names is refused; records that repeat each other by right are not."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import folders
from etcfit.errors import MeasurementError
from etcfit.rig.columns import Column, Log
from etcfit.rig.duplicates import refuse_duplicates
from etcfit.rig.reader import read_folder
from etcfit.rig.units import Conversion
from folders import Sheet
from independent import CONSISTENT, make_folder
from independent.instruments import PERFECT

R = folders.response(400)


def other_unit(sheet: Sheet) -> Sheet:
    """Current in A instead of mA, columns in another order."""
    rows = tuple((row[0], row[1], f"{float(row[2]) / 1000:.8f}", row[3]) for row in sheet.rows)
    return replace(sheet, rows=rows).with_header(2, "current [A]").in_order([3, 0, 2, 1])


def cut(sheet: Sheet, first: int, last: int, earlier: float = 0.0) -> Sheet:
    rows = tuple((f"{float(row[0]) - earlier:.5f}", *row[1:]) for row in sheet.rows[first:last])
    return replace(sheet, rows=rows)


COPIES: dict[str, tuple[Sheet, str]] = {
    "renamed": (R, r"response/copy\.csv: it holds the same numbers as response/1\.csv, row by row"),
    "other unit, other order": (other_unit(R), r"the same numbers as response/1\.csv, row by row"),
    "a column less": (R.without(2), r"the same numbers as response/1\.csv"),
    "a cut": (cut(R, 100, 250), r"lines 2 to 151 hold the same numbers as lines 102 to 251 .* at the same times"),
    "a cut, time from zero": (cut(R, 100, 250, 500.0), r"lines 2 to 151 .* lines 102 to 251 .* with 0\.5 s taken off"),
    "the tail of one, the head of the other": (
        Sheet(R.header, (*cut(R, 300, 400, 1500.0).rows, *cut(folders.response(300, seed=9), 100, 300).rows)),
        r"lines 2 to 101 hold the same numbers as lines 302 to 401 .* with 1\.5 s taken off",
    ),
}


@pytest.mark.parametrize(("copy", "message"), COPIES.values(), ids=COPIES.keys())
def test_one_record_twice_is_refused(tmp_path: Path, copy: Sheet, message: str) -> None:
    changes = {"response/1.csv": R.text(), "response/copy.csv": copy.text()}
    with pytest.raises(MeasurementError, match=message) as caught:
        read_folder(folders.changed(tmp_path, changes))
    assert caught.value.where.startswith(str(tmp_path))
    assert "Delete one of them" in caught.value.mend


def test_comments_and_the_folder_of_another_test_hide_no_copy(tmp_path: Path) -> None:
    changes = {"inertia/1.csv": "# made on Monday\n" + folders.back_emf().text()}
    with pytest.raises(MeasurementError, match=r"inertia/1\.csv: it holds the same numbers as back_emf/1\.csv"):
        read_folder(folders.changed(tmp_path, changes))


def test_five_copies_are_named_in_one_message(tmp_path: Path) -> None:
    copies = {f"resistance/copy_{k}.csv": folders.resistance().text() for k in range(5)}
    with pytest.raises(MeasurementError, match=r"; so do resistance/copy_\d\.csv") as caught:
        read_folder(folders.changed(tmp_path, copies))
    assert str(caught.value).count("copy_") == 5


def rounded(sheet: Sheet, step: float) -> Sheet:
    rows = tuple((row[0], *(f"{step * round(float(cell) / step):.5f}" for cell in row[1:])) for row in sheet.rows)
    return replace(sheet, rows=rows)


def held_volts(seed: int, noise: float = 0.01) -> Sheet:
    rng = np.random.default_rng(seed)
    volts, amperes = (level + noise * rng.standard_normal(400) for level in (2.0, 2.0 / 1.513))
    return folders.sheet("time [s]", "voltage [V]", "current [A]", columns=(0.001 * np.arange(400), volts, amperes))


def played_twice(seed: int) -> Sheet:
    """One binary command, that flips at random, logged without noise; the plate's sensor has its own."""
    volts = 6.0 + np.random.default_rng(7).choice([-1.0, 1.0], 600)
    angle = 40.0 + 2.0 * np.convolve(volts - 6.0, np.ones(20) / 20)[:600]
    angle += 0.05 * np.random.default_rng(seed).standard_normal(600)
    return folders.sheet("time [s]", "voltage [V]", "position [deg]", columns=(0.001 * np.arange(600), volts, angle))


def smooth(rate: float = 1000.0) -> Sheet:
    t = np.arange(800) / rate
    volts, angle = 6.0 + np.sin(30 * t), 45.0 + 20.0 * np.sin(30 * t - 1.0)
    return folders.sheet("time [s]", "voltage [V]", "position [deg]", columns=(t, volts, angle))


@pytest.mark.slow
def test_two_hundred_long_traces_take_seconds() -> None:
    logs = [made_log(k, 20_000) for k in range(200)]
    began = time.process_time()
    assert refuse_duplicates(logs) == []
    assert time.process_time() - began < 10.0  # 1 s on an idle core


def made_log(k: int, rows: int) -> Log:
    rng, instants = np.random.default_rng(k), 1e-3 * np.arange(rows)
    channels = {"voltage": 6.0 + 0.01 * rng.standard_normal(rows), "current": 2.0 + 0.01 * rng.standard_normal(rows)}
    columns = {name: Column(name, name, "", Conversion(1.0), value) for name, value in channels.items()}
    columns["time"] = Column("time", "time", "s", Conversion(1.0), instants)
    return Log(f"rig/response/{k}.csv", f"response/{k}.csv", "response", np.arange(rows) + 2, columns)


RIGHTLY: dict[str, tuple[str, Callable[[int], Sheet]]] = {
    "repeats, each with its own noise": ("resistance", held_volts),
    "at rest, coarse steps": ("resistance", lambda seed: rounded(held_volts(seed), 0.05)),
    "at rest, a level that flickers": ("resistance", lambda seed: rounded(held_volts(seed, 0.02), 0.05)),
    "constant to the last digit": ("resistance", lambda _: held_volts(0, 0.0)),
    "a command played twice": ("response", played_twice),
}


@pytest.mark.parametrize(("test", "made"), RIGHTLY.values(), ids=RIGHTLY.keys())
def test_what_repeats_by_right_is_read(tmp_path: Path, test: str, made: Callable[[int], Sheet]) -> None:
    rig = read_folder(folders.changed(tmp_path, {f"{test}/{k}.csv": made(100 + k).text() for k in range(2, 12)}))
    assert not [warning for warning in rig.warnings if "same numbers" in warning]


def test_noiseless_files_that_agree_are_named_in_a_warning(tmp_path: Path) -> None:
    changes = {"response/2.csv": smooth().text(), "response/3.csv": rounded(smooth(), 0.01).text()}
    rig = read_folder(folders.changed(tmp_path, changes | {"response/4.csv": smooth().text()}))
    found = [warning for warning in rig.warnings if "same numbers" in warning]
    assert len(found) == 1
    assert "response/4.csv: the same numbers as response/2.csv" in found[0]


def test_a_noiseless_bench_is_read(tmp_path: Path) -> None:
    make_folder(tmp_path / "rig", CONSISTENT, 7100, size="small", bench=PERFECT, declare_noise=False)
    assert not [warning for warning in read_folder(tmp_path / "rig").warnings if "same numbers" in warning]
