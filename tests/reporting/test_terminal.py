"""No name and no label of a file gives a terminal orders; what rich itself says in colour stays."""

from __future__ import annotations

import io
import re
from pathlib import Path

from rich.table import Table
from rich.text import Text
from typer.testing import CliRunner

import folders
from etcfit.cli import app
from etcfit.errors import visible
from etcfit.reporting.blocks import console

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
