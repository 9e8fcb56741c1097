"""What is wrong in a rig.toml is said with its line; one laid over tables that many rigs share is read as one file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.base import Rig
from etcfit.rig.config import parse_config
from etcfit.rig.reader import digests_of, read_folder
from etcfit.rig.toml import Toml, closest, parse, place_of, shown, written
from folders import TOML, response

TEXT = '[rig]\nname = "bench"\ngear_ratio = "20"\n\n[tests.inductance]\nseries_ohm = 1\n\n[holdout]\nfiles = 3\n'
FILE = Toml("rig.toml", TEXT, parse(TEXT, "rig.toml"))


@pytest.mark.parametrize(
    ("key", "place"),
    [
        ("rig.gear_ratio", "rig.toml:3"),
        ("tests.inductance.series_ohm", "rig.toml:6"),
        ("tests.inductance", "rig.toml:5"),
        ("holdout.files", "rig.toml:9"),
        ("rig.nowhere", "rig.toml:1"),  # its table
        ("nowhere.at_all", "rig.toml"),
    ],
)
def test_a_key_is_found_by_its_line(key: str, place: str) -> None:
    assert place_of("rig.toml", TEXT, key) == place


def test_a_number_may_be_of_any_size_and_what_is_absent_is_empty() -> None:
    assert FILE.number("rig.x", 3) == 3.0
    assert FILE.number("rig.x", 10**400) == float("inf")
    assert FILE.table("absent") == {}
    assert FILE.strings("absent", "files") == ()


def test_a_name_is_guessed_only_where_one_is_near() -> None:
    assert closest("Suply_v", ("supply_V", "name"), "Delete it.") == "Did you mean 'supply_V'?"
    assert closest("zzz", ("supply_V", "name"), "Delete it.") == "Delete it."
    assert shown("x" * 100).endswith("...")
    assert len(shown("x" * 100)) == 60


@pytest.mark.parametrize("dots", ["...", "…", "[...]", "...   # V, at the closed stop"])
def test_dots_left_in_a_value_are_said_to_stand_for_it(dots: str) -> None:
    text = f"[rig]\nname = 'bench'\n\n[tps]\nclosed_V = {dots}\nopen_V = {dots}\n"
    with pytest.raises(MeasurementError) as caught:
        parse(text, "mine/rig.toml")
    said = caught.value
    assert said.where == "mine/rig.toml:5"
    assert "the dots stand for a value that only you know" in said.found
    assert "as in closed_V = 0.45" in said.mend
    assert "put a # before the line" in said.mend
    assert "The same in line 6." in said.mend
    assert "valid TOML" not in str(said)


@pytest.mark.parametrize(
    ("text", "where", "key"),
    [
        ('[rig]\nname = "..."\n', "rig.toml:2", "rig.name"),
        ('[holdout]\nfiles = ["a.csv", "…"]\n', "rig.toml:2", "holdout.files"),
        ('[rig]\n[accuracy]\ncurrent = { sd = "..." }\n', "rig.toml:3", "accuracy.current.sd"),
    ],
)
def test_dots_in_quotes_stand_for_a_value_too(text: str, where: str, key: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        parse(text, "rig.toml")
    assert caught.value.where == where
    assert caught.value.found.startswith(f"{key}: the dots stand for")


@pytest.mark.parametrize("text", ['name = "a drive ... and back"', "name = 'bench' # ...", '"a ... b" = "ignore"'])
def test_dots_among_words_are_words(text: str) -> None:
    assert parse(text, "rig.toml")


@pytest.mark.parametrize(
    ("text", "line", "found", "mend"),
    [
        ("gear_ratio = 20,68", 1, "decimal comma", "Write gear_ratio = 20.68."),
        ("[rig]\nsupply_V = 12 V", 2, "a unit behind the number", "Write supply_V = 12:"),
        ("supply_V = 12V # the driver", 1, "a unit behind the number", "Write supply_V = 12:"),
        ("[accuracy]\ncurrent = 1 % + 5 mA", 2, "text without quotes", 'Write current = "1 % + 5 mA".'),
        ("name = bench\n", 1, "bench is a text without quotes", 'Write name = "bench".'),
        ("name = bench two", 1, "text without quotes", 'Write name = "bench two".'),
        ('[columns]\n"TP" = tps [V]', 2, "text without quotes", 'Write "TP" = "tps [V]".'),
        ("synthetic = True", 1, "found True", "Write synthetic = true,"),
        ("synthetic = no", 1, "found no", "Write synthetic = false,"),
        ("travel_deg = [-inf, inf]\nx = Inf", 2, "found Inf", "Write x = inf,"),
        ("a = 1\nsupply_V =\nb = 2", 2, "supply_V has no value", "put a # before the line"),
        ("supply_V = NaN", 1, "supply_V has no value", "put a # before the line"),
        ("R_a = .5", 1, "found .5", "Write R_a = 0.5:"),
        ("R_a = 5.", 1, "found 5.", "Write R_a = 5.0:"),
        ("R_a = 05", 1, "found 05", "Write R_a = 5.0:"),
        ("[rig\nname = 'a'", 1, "a bracket is missing", "Write [rig]."),
        ("rig]\n", 1, "a bracket is missing", "Write [rig]."),
        ("gear_ratio: 20.68", 1, "has no = in it", "Write gear_ratio = 20.68."),
        ("gear_ratio 20.68", 1, "has no = in it", "Write gear_ratio = 20.68."),
        ("gear_ratio == 20.68", 1, "found ==", "Write gear_ratio = 20.68."),
        ("gear ratio = 20.68", 1, "a space in it", "Write gear_ratio = 20.68."),
        ('[columns]\nTP main = "tps [V]"', 2, "a space in it", 'Write "TP main" = "tps [V]".'),
        (
            '[columns]\nStröm = "current [A]"',
            2,
            "a letter that TOML takes in quotes only",
            'Write "Ström" = "current [A]".',
        ),
        ("name = “bench”", 1, "quotes are those of a word processor", 'name = "bench"'),
        ('name = "bench', 1, "no closing quote", 'Put " at both ends'),
        ('name = "bench\nx = 1', 1, "no closing quote", 'Put " at both ends'),
        ('name = "D:\\logs"', 1, "a \\ in a text", 'Write name = "D:/logs"'),
        ("a = 1 // V", 1, "// begins no comment", "Write # instead of //."),
        ("; a remark\na = 1", 1, "; begins no comment", "Write # instead of ;."),
        ("a\u00a0= 1", 1, "no ordinary space", "Type the line again"),
        ("travel_deg = [0.0, 90.0\nsupply_V = 12.0", 1, "the closing ] is missing", "Put ] behind its last entry."),
        ("travel_deg = [0.0 90.0]", 1, "a comma is missing", "Put a comma"),
        ("J_L = { value = 1.0 sd = 0.1 }", 1, "a comma is missing", "Put a comma"),
        ("J_L = { value = 1.0,\nsd = 0.1 }", 1, "continues in the next line", "in one line"),
        ("[rig]\na = 1\n[tps]\n[rig]\nb = 2", 4, "[rig] is here and in line 1", "below one of the two"),
        ("[rig]\na = 1\nb = 2\na = 3", 4, "a is here and in line 2", "Delete one of the two lines."),
    ],
)
def test_slips_of_the_hand_are_named_with_line_and_cure(text: str, line: int, found: str, mend: str) -> None:
    with pytest.raises(MeasurementError) as caught:
        parse(text, "mine/rig.toml")
    assert caught.value.where == f"mine/rig.toml:{line}"
    assert found in caught.value.found
    assert mend in caught.value.mend
    assert caught.value.required == "rig.toml must be valid TOML."


def test_what_no_slip_explains_is_said_in_the_words_of_the_parser() -> None:
    with pytest.raises(MeasurementError, match=r"mine/fleet\.toml:2: Expected .* fleet\.toml must be valid TOML"):
        parse("a = 1\nb = 1.2.3\n", "mine/fleet.toml")


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
