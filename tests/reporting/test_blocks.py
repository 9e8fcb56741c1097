"""A table for a terminal cuts no name and no figure, and no text of a user gives the terminal orders."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from rich.table import Table
from rich.text import Text
from typer.testing import CliRunner

import folders
from etcfit.cli import app
from etcfit.errors import visible
from etcfit.reporting.blocks import PlainTable, console, render
from etcfit.reporting.table import of_texts

NAMES = ("channel_gain[response.current]", "series_ohm.inductance", "R_a")
SPANS = ("0.00141823 ... 0.00153412", "-12.5 ... 3.0", "1.45 ... 1.57")
MEANING = "resistance in the circuit of the inductance test alone, harness and shunt"


def table(rows: int = 3) -> PlainTable:
    every = [
        (name, MEANING, "12.345", span, "N*m*s/rad") for name, span in zip(NAMES[:rows], SPANS[:rows], strict=True)
    ]
    heads = ("parameter", "meaning", "reading", "95 % interval", "unit")
    return PlainTable(of_texts("", heads, every, 1, {"meaning": "prose", "unit": "word"}, ("meaning", "reading"),
                               file="RUN/fit.json"))  # fmt: skip


def lines(part: PlainTable, width: int) -> list[str]:
    return render(part, width).splitlines()


@pytest.mark.parametrize("width", [20, 40, 60, 80, 100, 120, 160, 240])
def test_no_line_is_wider_than_the_terminal_and_names_figures_and_units_stand_whole_on_one(width: int) -> None:
    shown = lines(table(), width)
    assert max(map(len, shown)) <= width
    if width > 20:
        assert [each for each in (*NAMES, *SPANS, "N*m*s/rad") if not any(each in line for line in shown)] == []
        assert not any("…" in line for line in shown)


def test_meaning_goes_first_and_a_line_says_how_to_see_it() -> None:
    wide = lines(table(), 160)
    assert MEANING in wide[1]
    assert "Left out" not in " ".join(wide)
    folded = render(table(), 110)
    assert all(word in folded for word in MEANING.split())
    assert "Left out" not in folded
    said = " ".join(lines(table(), 90)[-2:])
    assert "Left out at a width of 90: meaning." in said
    assert "RUN/fit.json" in said
    assert "12.345" in " ".join(lines(table(), 90))
    assert "meaning, reading." in " ".join(lines(table(), 75))


def test_the_width_that_is_advised_shows_everything() -> None:
    said = " ".join(render(table(), 80).split())
    advised = int(said.partition("A width of ")[2].split()[0])
    assert "Left out" not in render(table(), advised)
    assert "Left out" in render(table(), advised - 1)


def test_columns_that_cannot_be_spared_go_on_below_beside_their_names() -> None:
    rows = [(name, *(f"{k}.12345" for k in range(12))) for name in NAMES]
    made = PlainTable(of_texts("", ("parameter", *(f"trace {k}" for k in range(12))), rows))
    shown = lines(made, 80)
    assert len([line for line in shown if line.startswith("R_a ")]) == 2
    together = " ".join(" ".join(shown).split())
    assert all(f"{k}.12345" in together for k in range(12))
    assert max(map(len, shown)) <= 80


def test_file_names_fold_at_a_slash_and_only_where_they_must() -> None:
    row = ("a_folder_with_a_long_name/response/drive_of_the_second_day.csv", "1000")
    made = PlainTable(of_texts("", ("file", "rate Hz"), [row], 1, {"file": "path"}))
    assert "a_folder_with_a_long_name/response/drive_of_the_second_day.csv" in render(made, 80)
    assert [line.split()[0] for line in lines(made, 50)[-2:]] == [
        "a_folder_with_a_long_name/response/",
        "drive_of_the_second_day.csv",
    ]


@pytest.mark.parametrize("width", [40, 80, 160])
def test_a_header_in_two_lines_stands_above_its_own_column(width: int) -> None:
    made = PlainTable(of_texts("", ("rule", "Kp\nV/rad", "\ndrawn"), [("ziegler_nichols", "135.2", "8")]))
    name, unit, row = lines(made, width)
    assert len(name) <= len(row)
    assert name.index("Kp") + 2 == unit.index("V/rad") + 5 == row.index("135.2") + 5
    assert unit.endswith("drawn")


CLEAR = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202e"


def test_a_table_shows_what_nobody_sees_and_keeps_its_colours() -> None:
    out = io.StringIO()
    made = console(file=out, force_terminal=True, color_system="standard", width=100)
    table = Table(title=CLEAR)
    table.add_column("name")
    table.add_row(Text(CLEAR, style="red"))
    made.print(table)
    made.print(Text(CLEAR))
    colours = re.compile(r"\x1b\[[0-9;]*m")
    assert colours.search(out.getvalue())
    plain = colours.sub("", out.getvalue())
    assert visible(plain) == plain
    assert plain.count("(U+202E)") == 3


def test_lines_tabs_and_any_language_stay() -> None:
    text = "Drosselklappe\t試験台  \u00a0Ω\n"
    assert visible(text) == text


def test_a_label_of_a_recording_gives_no_orders(tmp_path: Path) -> None:
    content = "time [s],volt\x9b2Jage\u202e [V],current [A]\n0,1,2\n1,2,3\n2,1,2\n"
    folder = folders.write(tmp_path / "rig", {"rig.toml": folders.TOML, "response/1.csv": content})
    done = CliRunner().invoke(app, ["check", str(folder)])
    assert done.exit_code == 1
    assert visible(done.output) == done.output
    assert "volt(U+009B)2Jage(U+202E)" in done.output
