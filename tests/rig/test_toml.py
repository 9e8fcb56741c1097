"""What is wrong in a rig.toml is said with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from etcfit.errors import MeasurementError
from etcfit.rig.toml import Toml, closest, parse, place_of, read_text, shown

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


def test_values_of_the_wrong_kind_are_refused_with_place_and_cure() -> None:
    for read, said in (
        (lambda: FILE.number("rig.gear_ratio", "20"), "rig.toml:3: rig.gear_ratio: found '20'. It must be a number"),
        (lambda: FILE.strings("holdout", "files"), "rig.toml:9: holdout.files: found 3. It must be a list of texts"),
        (lambda: FILE.string("rig.name", 5), "rig.toml:2: rig.name: found 5. It must be a text"),
        (lambda: FILE.positive("rig.gear_ratio", 0.0), "It must be above 0"),
        (lambda: FILE.finite("rig.gear_ratio", float("inf")), "It must be finite"),
        (lambda: FILE.table("rig", ("name", "gear_ratios")), "rig.gear_ratio: unknown key.*Did you mean 'gear_ratios'"),
    ):
        with pytest.raises(MeasurementError, match=said):
            read()
    assert FILE.number("rig.x", 3) == 3.0
    assert FILE.number("rig.x", 10**400) == float("inf")
    assert FILE.table("absent") == {}
    assert FILE.strings("absent", "files") == ()


@pytest.mark.parametrize(("text", "place"), [("[rig]\nname = bench\n", "a.toml:2"), ("[rig", "a.toml:1")])
def test_text_that_is_no_toml_is_refused_with_its_line(text: str, place: str) -> None:
    with pytest.raises(MeasurementError, match=f"{place}: .*must be valid TOML"):
        parse(text, "a.toml")


def test_any_unicode_is_read(tmp_path: Path) -> None:
    for encoding in ("utf-8", "utf-8-sig", "utf-16"):
        (tmp_path / "rig.toml").write_text('name = "größe"', encoding=encoding)
        assert read_text(tmp_path / "rig.toml") == 'name = "größe"'
    with pytest.raises(MeasurementError, match=r"no rig\.toml can be read here"):
        read_text(tmp_path / "absent.toml")


def test_a_name_is_guessed_only_where_one_is_near() -> None:
    assert closest("Suply_v", ("supply_V", "name"), "Delete it.") == "Did you mean 'supply_V'?"
    assert closest("zzz", ("supply_V", "name"), "Delete it.") == "Delete it."
    assert shown("x" * 100).endswith("...")
    assert len(shown("x" * 100)) == 60
