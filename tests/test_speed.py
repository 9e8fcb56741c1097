"""The table of `benchmarks.speed`: medians, ratios and verdicts worked by hand; what failed is said; pages are kept."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.runs import Failed, run
from benchmarks.speed.rows import ROWS, Aim, Lines, Row
from benchmarks.speed.table import PLACE, Outcome, table
from benchmarks.speed.versions import once


def nothing(_: object) -> Lines:
    """A command."""
    return {}


ROW = Row(nothing, {"cold": (Aim(5.0, "s"), Aim(600.0, "MiB")), "warm": (Aim(2.0, "x", at_least=True),)})


def repeats(*cold: float) -> list[Lines]:
    return [{"cold": {"s": seconds, "MiB": 500.0}, "warm": {"x": seconds}} for seconds in cold]


def test_versions_stand_side_by_side_as_medians() -> None:
    cold, warm = table([("a", ROW, Outcome(repeats(8.0, 12.0, 100.0)), Outcome(repeats(3.0)))]).splitlines()[2:]
    assert cold == "| a | A command | cold | 12 s, 500 MiB | 3 s, 500 MiB | 4 | 5 s, 600 MiB | met |"
    assert warm.endswith("| 12 x | 3 x | 4 | at least 2 x | met |")


def test_an_aim_is_missed_by_any_of_its_figures() -> None:
    heavy = Outcome([{"cold": {"s": 1.0, "MiB": 601.0}, "warm": {"x": 1.9}}])
    assert table([("a", ROW, Outcome(repeats(8.0)), heavy)]).count("**missed**") == 2


def test_what_failed_is_said_in_every_line_of_its_row() -> None:
    failed = Outcome(failure="**failed** in repeat 1: longer than 2 s")
    assert table([("a", ROW, failed, failed)]).count("longer than 2 s") == 4
    assert table([("a", ROW, failed, failed)]).count("not measured") == 2
    assert "12 s, 500 MiB; **failed**" in table([("a", ROW, Outcome(repeats(12.0), failed.failure), failed)])


def test_only_what_is_between_the_markers_is_replaced(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{PLACE.begin}\nold\n{PLACE.end}\nafter\n")
    for report in ("first", "second"):
        PLACE.put(page, report)
    assert page.read_text() == f"before\n{PLACE.begin}\n\nsecond\n\n{PLACE.end}\nafter\n"


def test_a_page_without_markers_is_refused_and_a_new_one_made(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    PLACE.must_be_in(page)
    PLACE.put(page, "table")
    PLACE.must_be_in(page)
    page.write_text(f"{PLACE.end}\n{PLACE.begin}\n")
    with pytest.raises(SystemExit, match="Write both"):
        PLACE.must_be_in(page)


def test_the_page_of_the_documentation_has_a_place_for_it() -> None:
    PLACE.must_be_in(Path(__file__).resolve().parents[1] / "docs" / "validation" / "speed.md")


def test_every_row_says_what_it_measures() -> None:
    for name, row in ROWS.items():
        assert row.what, name
        assert row.measure.__name__ == name


def test_a_run_tells_what_it_took_and_why_it_failed(tmp_path: Path) -> None:
    done = run(("-c", "import time; time.sleep(0.2); print('done')"), tmp_path)
    assert (done.stdout, done.wall >= 0.2, done.cpu < 0.2, done.peak > 1.0) == ("done\n", True, True, True)
    with pytest.raises(Failed, match="status 1: ValueError: so it is"):
        run(("-c", "raise ValueError('so it is')"), tmp_path)
    with pytest.raises(Failed, match=r"longer than 0\.3 s"):
        run(("-c", "import time; time.sleep(60)"), tmp_path, limit=0.3)


def test_a_folder_that_could_not_be_made_whole_is_none(tmp_path: Path) -> None:
    def half(path: Path) -> None:
        path.mkdir()
        raise Failed("no more")

    with pytest.raises(Failed):
        once(tmp_path / "folder", half)
    assert once(tmp_path / "folder", Path.mkdir).is_dir()
    once(tmp_path / "folder", half)  # it is there
