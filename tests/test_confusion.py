"""The confusion benchmark: rates of records worked by hand, and the figures of the README from the records kept."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from numpy.testing import assert_allclose

from benchmarks.confusion.cases import case
from benchmarks.confusion.picture import picture
from benchmarks.confusion.records import saved
from benchmarks.confusion.tables import ASKED, asked, calibration, confusion
from benchmarks.confusion.verdicts import is_first, is_found, is_open, is_silent, least_left, over_least, stated

ROOT = Path(__file__).resolve().parents[1]
PARTS = sorted((ROOT / "benchmarks" / "confusion" / "test_set").glob("part_*.jsonl"))
SECOND = ROOT / "benchmarks" / "confusion" / "test_set_2" / "seeds_20000.jsonl"
JUDGED = {words: judged for words, _, judged in ASKED}


def interval(low: float | None, high: float | None) -> dict[str, Any]:
    return {"truth": 1.0, "value": 1.0, "stderr": 0.1, "low": low, "high": high, "status": "estimated"}


def record(kind: str, names: list[str], strength: list[str], added: list[str], **changes: Any) -> dict[str, Any]:
    """Two of three stated intervals hold the truth; position 1.5 times its noise, of which the body leaves 1.25."""
    model = {
        "holdout_position": 1.5,
        "holdout_rows": [["a.csv", "position", 100, 1.2], ["b.csv", "position", 300, 1.6], ["a.csv", "current", 9, 9]],
        "parameters": {s: interval(*ends) for s, ends in (("R_a", (0.9, 1.1)), ("K_b", (0.5, 1.0)), ("J_m", (1.1, 2.0)),
                                                          ("J_L", (None, None)))},
    }  # fmt: skip
    return {
        "seed": 1, "kind": kind, "names": names, "strength": strength, "added": added, "ties": [], "unexplained": None,
        "by_itself": [["a.csv", "position", 0.5], ["b.csv", "position", 1.41421356], ["a.csv", "current", 7.0]],
        "before": model, "after": model,
    } | changes  # fmt: skip


def test_a_tie_counts_for_each_of_its_names() -> None:
    tied = record("single", ["gravity_load"], ["high"], ["airflow_torque"], ties=[["airflow_torque", "gravity_load"]])
    assert is_first(tied)
    assert is_found(tied, "gravity_load")
    assert not is_found(tied | {"ties": []}, "gravity_load")
    assert not is_first(tied | {"added": ["backlash", "airflow_torque"]})


def test_errors_are_pooled_over_samples_and_set_beside_what_the_body_leaves() -> None:
    one = record("single", ["backlash"], ["high"], [])
    assert_allclose(least_left(one, ("position",)), 1.25, rtol=1e-5)
    assert_allclose(over_least(one), 1.5 / 1.25, rtol=1e-5)


def test_what_is_left_without_a_curve_is_called_unexplained_where_that_is_likely() -> None:
    said = record("outside", ["sensor_dead_spot"], ["high"], [], probabilities={"nothing": 0.1, "unexplained": 0.9})
    quiet = record("outside", ["sensor_dead_spot"], ["high"], [], probabilities={"nothing": 0.9, "unexplained": 0.1})
    assert [is_open(said), is_silent(said)] == [True, False]
    assert [is_open(quiet), is_silent(quiet)] == [False, True]


def test_a_stiffening_spring_is_one_effect_of_the_catalogue_in_what_is_run_since() -> None:
    places = [seed for seed in range(9000, 9200) if case(seed).names == ("stiffening_spring",)]
    kinds = {(case(seed).kind, case(seed + 11000).kind) for seed in places}
    assert places
    assert kinds == {("outside", "single")}


def test_stated_probabilities_beside_how_often_they_were_right() -> None:
    said = {"backlash": 0.92, "gravity_load": 0.3, "unexplained": 0.1, "nothing": 0.01}
    right = record("single", ["backlash"], ["high"], ["backlash"], probabilities=said)
    wrong = record("outside", ["stiffening_spring"], ["high"], ["backlash"], probabilities=said)
    rows = [[cell.strip() for cell in line.strip("| ").split("|")] for line in calibration([right, wrong]).splitlines()]
    assert rows[2:] == [["0.05 to 0.2", "2", "10 %", "50 %"], ["0.2 to 0.5", "2", "30 %", "0 %"],
                        ["0.9 to 1.01", "2", "92 %", "50 %"]]  # fmt: skip


def test_a_parameter_without_an_interval_is_not_asked() -> None:
    assert stated([record("clean", [], [], [])], "after") == [True, True, False]


def test_each_rate_is_of_the_folders_it_is_asked_of() -> None:
    every = [
        record("clean", [], [], []),
        record("clean", [], [], ["backlash"]),
        record("single", ["backlash"], ["high"], ["backlash"]),
        record("single", ["backlash"], ["medium"], ["gravity_load", "backlash"]),
        record("single", ["backlash"], ["low"], []),
        record("pair", ["backlash", "gravity_load"], ["high", "high"], ["gravity_load"]),
        record("outside", ["friction_spot"], ["low"], []),
        record("outside", ["friction_spot"], ["high"], [], unexplained={"enters": "friction", "depends_on": "angle"}),
    ]
    rate = {words: judged(every) for words, judged in JUDGED.items()}
    assert rate["clean: nothing added"] == [True, False]
    assert rate["one effect, medium or high: found first"] == [True, False]
    assert rate["... found at all"] == [True, True]
    assert rate["one effect, low: found"] == [False]
    assert rate["pairs: both found"] == [False]
    assert rate["outside the catalogue: no wrong name"] == [True, True]
    assert rate["outside, medium or high: no name, called unexplained"] == [True]
    assert "| clean: nothing added | 97 % | 1 of 2 (50 %), 9 to 91 % |" in asked({"all": every})
    assert "| clean | 1 | 1 |" in confusion(every)


def test_every_row_has_words_of_its_own() -> None:
    assert len(JUDGED) == len(ASKED)


@pytest.mark.parametrize("file", [*PARTS, SECOND], ids=lambda file: file.stem)
def test_the_records_kept_are_of_the_cases_that_their_seeds_draw(file: Path) -> None:
    for each in saved(file):
        drawn = case(each["seed"])
        assert (each["kind"], tuple(each["names"]), tuple(each["strength"])) == (
            drawn.kind,
            drawn.names,
            drawn.strength,
        )


def test_every_seed_of_the_test_set_was_run_once() -> None:
    seeds = [each["seed"] for file in PARTS for each in saved(file)]
    assert sorted(seeds) == list(range(9000, 9200))


def test_the_readme_has_the_figures_of_the_records_kept() -> None:
    parts = {file.stem.replace("_", " "): saved(file) for file in PARTS}
    parts["all"] = [each for part in parts.values() for each in part]
    assert asked(parts) in (ROOT / "docs" / "validation" / "confusion.md").read_text(encoding="utf-8")


def test_the_second_test_set_has_each_of_its_seeds_and_its_figures_in_the_docs() -> None:
    records = saved(SECOND)
    assert sorted(each["seed"] for each in records) == list(range(20000, 20080))
    text = (ROOT / "docs" / "validation" / "confusion.md").read_text(encoding="utf-8")
    assert asked({"seeds 20000": records}) in text
    assert calibration(records) in text


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    picture([each for file in PARTS for each in saved(file)], tmp_path / "confusion.png")
    assert (tmp_path / "confusion.png").stat().st_size > 30_000
