"""A new rig's folder explains every key, and is read without change once its numbers are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from etcfit.cli import app
from etcfit.errors import MeasurementError, UsageError
from etcfit.importing.new import NAMEPLATES, RECORD, UNKNOWN, how_to_record, new_folder
from etcfit.rig import TESTS
from etcfit.rig.config import RIG_KEYS, TABLES, TPS_KEYS, read_config
from etcfit.rig.ecu import KEYS

NUMBERS = {"gear_ratio": "20.68", "closed_V": "0.45", "open_V": "4.73"}


def filled_in(path: Path) -> Path:
    text = path.read_text(encoding="utf-8")
    for key, number in NUMBERS.items():
        text = text.replace(f"{key} = {UNKNOWN}", f"{key} = {number}")
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("like", [None, *NAMEPLATES])
def test_it_is_read_once_the_numbers_are_filled_in(tmp_path: Path, like: str | None) -> None:
    config = read_config(filled_in(new_folder(tmp_path / "rig", like) / "rig.toml"))
    assert config.tps is not None
    assert config.series_ohm == {"inductance": None}


def test_a_known_nameplate_needs_nothing_filled_in_that_is_known(tmp_path: Path) -> None:
    config = read_config(new_folder(tmp_path / "rig", "bosch-0280750148") / "rig.toml")
    assert (config.gear_ratio, config.supply_V) == (20.68, 12.0)


def test_what_nobody_filled_in_is_no_number_and_its_line_is_named(tmp_path: Path) -> None:
    path = new_folder(tmp_path / "rig") / "rig.toml"
    line = 1 + next(k for k, text in enumerate(path.read_text().split("\n")) if text.startswith("gear_ratio"))
    with pytest.raises(MeasurementError, match=rf"rig\.toml:{line}"):
        read_config(path)


def test_every_table_and_key_of_a_rig_toml_is_explained(tmp_path: Path) -> None:
    text = (new_folder(tmp_path / "rig") / "rig.toml").read_text(encoding="utf-8")
    for table in TABLES:
        assert re.search(rf"^(# )?\[{table}(\.inductance)?\]$", text, re.MULTILINE), table
    for key in (*RIG_KEYS, *TPS_KEYS, *KEYS, "series_ohm", "effects", "files"):
        assert re.search(rf"^(# )?{key} = ", text, re.MULTILINE), key


def test_every_example_behind_a_hash_is_taken_by_the_reader(tmp_path: Path) -> None:
    path = filled_in(new_folder(tmp_path / "rig") / "rig.toml")
    text = re.sub(r"^# (?=(\[ecu\]|[\w\"() ]+ = ))", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    path.write_text(text, encoding="utf-8")
    config = read_config(path)
    assert config.ecu is not None
    assert config.effects == ("limp_home_spring",)
    assert set(config.noise) >= {"voltage", "current", "position"}
    assert set(config.accuracy) == {"current", "gear", "sensor_end_points"}
    assert config.columns == {"TP (Main) (V)": "tps [V]", "Comment": "ignore"}


def test_every_rig_test_has_a_folder_that_says_what_to_record(tmp_path: Path) -> None:
    made = new_folder(tmp_path / "rig")
    assert set(RECORD) <= {test.name for test in TESTS}
    assert len(RECORD) >= 10
    for test in TESTS:
        assert (made / test.name / "README.txt").read_text(encoding="utf-8") == how_to_record(test)
        assert RECORD.get(test.name, "") in how_to_record(test)


def test_it_leaves_alone_what_is_there_and_knows_its_nameplates(tmp_path: Path) -> None:
    new_folder(tmp_path / "rig")
    with pytest.raises(UsageError, match="already there"):
        new_folder(tmp_path / "rig")
    with pytest.raises(UsageError, match=r"no such nameplate\. Did you mean 'kassel'"):
        new_folder(tmp_path / "other", "kasel")
    assert not (tmp_path / "other").exists()


def test_the_command_says_which_file_is_to_be_filled_in(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["new", str(tmp_path / "rig"), "--like", "kassel"])
    assert done.exit_code == 0
    assert f"Look:   {tmp_path / 'rig' / 'rig.toml'}\n" in done.stdout
    quiet = CliRunner().invoke(app, ["new", str(tmp_path / "quiet"), "--like", "kassel", "--quiet"])
    assert (quiet.exit_code, quiet.stderr) == (0, "")
    assert quiet.stdout.replace("quiet", "rig") == done.stdout
    again = CliRunner().invoke(app, ["new", str(tmp_path / "rig")])
    assert (again.exit_code, again.stdout) == (2, "")


def test_the_command_names_every_known_nameplate() -> None:
    helped = " ".join(CliRunner().invoke(app, ["new", "--help"], env={"TERM": "dumb", "COLUMNS": "200"}).stdout.split())
    assert all(name in helped for name in NAMEPLATES)
