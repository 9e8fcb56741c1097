"""A rig.toml laid over tables that many rigs have in common: read as one file, blamed as two."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.base import Rig
from etcfit.rig.config import parse_config
from etcfit.rig.reader import digests_of, read_folder
from etcfit.rig.toml import Toml, parse
from etcfit.rig.toml_text import written
from folders import TOML, response


def toml(path: str, text: str) -> Toml:
    return Toml(path, text, parse(text, path))


def folder(tmp_path: Path, own: str | None) -> Path:
    unit = tmp_path / "u1"
    (unit / "response").mkdir(parents=True)
    (unit / "response/1.csv").write_text(response().text())
    if own is not None:
        (unit / "rig.toml").write_text(own)
    return unit


def same(left: Rig, right: Rig) -> bool:
    return left.config == right.config and all(
        a.channels[name].value.tobytes() == b.channels[name].value.tobytes()
        for a, b in zip(left.measurements, right.measurements, strict=True)
        for name in a.channels
    )


def test_a_folder_without_a_rig_toml_is_read_by_what_is_common(tmp_path: Path) -> None:
    whole = read_folder(folder(tmp_path, TOML))
    bare = folder(tmp_path / "bare", None)
    found = read_folder(bare, toml("fleet.toml", TOML.replace('name = "bench"\n', "")))
    assert found.config.name == "u1"
    assert same(whole, replace(found, config=replace(found.config, name="bench")))
    assert set(found.digests) == {"response/1.csv"}
    assert found.digests == digests_of(bare)
    with pytest.raises(MeasurementError, match=r"no rig.toml can be read here"):
        read_folder(bare)


def test_each_key_is_taken_from_the_upper_file_else_from_the_lower(tmp_path: Path) -> None:
    common = toml("fleet.toml", '[rig]\ngear_ratio = 20.68\nsupply_V = 14\n[tps]\nopen_V = 4.73\ntravel_deg = 90.0\n'
                                '[parameters]\nR_a = {fixed = 2.0}\n[fleet]\n')  # fmt: skip
    common = replace(common, tables={name: common.tables[name] for name in ("rig", "tps", "parameters")})
    unit = folder(tmp_path, '[rig]\nname = "bench"\nsupply_V = 12.0\n[tps]\nclosed_V = 0.45\n')
    found = read_folder(unit, common)
    whole = read_folder(folder(tmp_path / "whole", f"{TOML}[parameters]\nR_a = {{fixed = 2.0}}\n"))
    assert same(found, whole)
    assert set(found.digests) == {"rig.toml", "response/1.csv"}
    assert parse_config(found.toml, "x/rig.toml") == found.config  # the text that goes into a run folder says it all


@pytest.mark.parametrize(
    ("own", "common", "said"),
    [
        ("[rig]\n", "[rig]\n\ngear_ratio = 'x'\n", r"^fleet.toml:3: rig.gear_ratio: found 'x'"),
        ("[rig]\ngear_ratio = 'y'\n", "[rig]\n\ngear_ratio = 20.0\n", r"u1/rig.toml:2: rig.gear_ratio: found 'y'"),
        (None, "[rig]\ngear_ratio = 'x'\n", r"^fleet.toml:2: rig.gear_ratio: found 'x'"),
        ("[rig]\n", "[holdout]\nfiles = ['response/9.csv']\n", r"^fleet.toml:2: holdout.files names 'response/9.csv'"),
        ("[rig]\n", "[tests.respones]\nseries_ohm = 1.0\n", r"^fleet.toml:1: tests.respones: no such rig test"),
        ("[tps]\nclosed_V = 0.4\n", "[tps]\nopen_V = 4.5\n", r"tps.travel_deg: missing"),
    ],
)
def test_a_message_names_the_file_in_which_the_key_stands(
    tmp_path: Path, own: str | None, common: str, said: str
) -> None:
    with pytest.raises(MeasurementError, match=said):
        read_folder(folder(tmp_path, own), toml("fleet.toml", common))


def test_a_column_that_nobody_has_is_said_where_it_is_named(tmp_path: Path) -> None:
    common = toml("fleet.toml", '[columns]\n"Drossel" = "position [%]"\n')
    warnings = read_folder(folder(tmp_path, TOML), common).warnings
    assert any(w.startswith('fleet.toml:2: [columns] names "Drossel"') for w in warnings)


def test_tables_that_were_laid_together_are_written_as_one_text() -> None:
    upper = toml(
        "a", 'a = 1\n[x]\nk = "q\\"\\\\ö\\u007f"\nl = [1, 2.5, -inf]\n["y z"."b.c"]\nd = {e = true, "f g" = 1e-300}\n'
    )
    lower = toml("b", "[x]\nk = 3\nm = 0.1\n[w]\n")
    laid = upper.over(lower)
    text = written(laid)
    assert parse(text, "c") == laid.tables
    assert laid.tables["x"] == {"k": 'q"\\ö\x7f', "m": 0.1, "l": [1, 2.5, -math.inf]}
    assert written(upper) == upper.source
