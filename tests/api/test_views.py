"""A result in a few lines, and as a table in which nothing that a user wrote is markup."""

from __future__ import annotations

from etcfit.api import views
from etcfit.reporting.table import Cell, Column, Table
from etcfit.rig.base import RigConfig


def test_a_block_is_a_dozen_lines_at_most_and_says_that_it_was_cut() -> None:
    short = views.block("one", "", "two")
    assert short == "one\ntwo"
    long = views.block(*(f"line {k} " + "word " * 40 for k in range(20))).split("\n")
    assert len(long) == 12
    assert long[-1].strip() == "..."
    assert max(map(len, long)) <= 110


def test_a_name_is_shortened_and_made_up_data_are_called_so() -> None:
    assert views.name_of(RigConfig("bench", synthetic=True)) == "bench, SYNTHETIC DATA"
    assert len(views.name_of(RigConfig("a very long name " * 20))) <= 60
    assert views.name_of(RigConfig("   ")) == "a rig"


def test_nothing_that_a_user_wrote_is_markup() -> None:
    table = views.table(Table("t", (Column("x<", 0),), [("<td>",)]))
    shown = views.html_card(RigConfig("<b>rig</b>"), "a & b", views.paragraph("<i>"), table,
                       views.folded("more <", ["<script>"]), alarm="<u>")  # fmt: skip
    for tag in ("<b>rig", "<i>", "<script>", "<u>", "<td><td>", "x<<"):
        assert tag not in shown
    for text in ("&lt;b&gt;rig", "a &amp; b", "&lt;i&gt;", "&lt;script&gt;", "&lt;u&gt;", "x&lt;"):
        assert text in shown
    assert views.paragraph("") == views.folded("none", []) == ""


def test_columns_of_words_begin_on_the_left_and_alarms_are_red() -> None:
    columns = (Column("test", 0, "word"), Column("n", 1))
    shown = views.table(Table("t", columns, [("response", "12"), (Cell("sine", "bad"), "3")]))
    assert 'text-align: left">response' in shown
    assert 'text-align: right">12' in shown
    assert 'color: #c00000">sine' in shown


def test_warnings_are_counted() -> None:
    assert [views.count_of(["w"] * n) for n in (0, 1, 2)] == [
        "",
        "1 warning, see .warnings",
        "2 warnings, see .warnings",
    ]
