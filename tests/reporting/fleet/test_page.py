"""RUN/fleet.html: one file that asks for nothing, every unit in it, what a file says stays text; the schema."""

from __future__ import annotations

import re
from copy import deepcopy

import numpy as np
import pytest

import fleet_pages as made
from etcfit.files import plain
from etcfit.reporting.fleet.page import NAME, SCRIPTS, part, render, write_fleet_page
from golden import check_view
from pages import Reader, assert_asks_for_nothing, unpacked
from schemas import assert_refused, validator


@pytest.fixture(scope="module")
def fleet() -> made.Made:
    return made.fleet()


@pytest.fixture(scope="module")
def text(fleet: made.Made, tmp_path_factory: pytest.TempPathFactory) -> str:
    run = tmp_path_factory.mktemp("run")
    path = write_fleet_page(run, fleet.content, fleet.units)
    assert path == run / NAME
    assert [each.name for each in run.iterdir()] == [NAME]
    return path.read_text(encoding="utf-8")


def test_what_the_tests_draw_is_a_fleet_by_the_schema(fleet: made.Made) -> None:
    content = plain(fleet.content)
    validator("fleet").validate(content)
    validator("fleet").validate(content | {"gauge": None, "odd": [], "name": None, "a_key_of_tomorrow": 1})
    lost = deepcopy(content)
    del lost["population"]["K_s"]["sd"]
    other = content | {"schema": "etcfit.fleet/2"}
    assert_refused("fleet", lost, content | {"odd": [{"unit": "x"}]}, other, content | {"units": {}})


def test_it_is_one_file_that_asks_for_nothing(text: str) -> None:
    page, scripts = Reader(text), "".join(map(part, SCRIPTS))
    assert_asks_for_nothing(page, scripts, "units/")
    assert "innerHTML" not in scripts
    assert set(re.findall(r"https?://[^\s\"')]+", text)) == {"https://github.com/leeoniya/uPlot"}
    assert "Permission is hereby granted" in text


def test_every_number_of_every_unit_is_there(fleet: made.Made, text: str) -> None:
    data = Reader(text).data
    assert data["units"] == fleet.content["units"]
    for each in data["symbols"]:
        rows = fleet.units[fleet.units["symbol"] == each["symbol"]]
        for column in ("value", "low", "high", "shrunk_value", "shrunk_stderr"):
            assert np.allclose(unpacked(each[column]), rows[column], rtol=1e-6, atol=0.0, equal_nan=True)
    lost = next(each for each in data["symbols"] if each["symbol"] == "B_m")
    assert lost["status"] == {str(k): "not identifiable" for k in range(0, 60, 17)}
    for each in data["charts"]:
        chart = fleet.content["charts"][each["symbol"]]
        assert np.allclose(unpacked(each["value"]), chart["value"], rtol=1e-6)
        for sums in ("cusum_high", "cusum_low"):
            assert np.allclose(unpacked(each[sums]), chart[sums], atol=1e-4 * (1e-9 + np.ptp(chart[sums])))
        order = unpacked(data["orders"][each["order"]])
        assert [data["units"][k] for k in order] == chart["order"]
    assert len(data["orders"]) == 1  # all charts go by one, which stands there once
    (change,) = next(each for each in data["charts"] if each["symbol"] == "K_s")["since"]
    assert data["units"][change["at"]] == fleet.content["drift"][0]["since"]
    batches = data["groups"]["batch"]
    assert [batches["names"][k] for k in unpacked(batches["of"])] == [
        m["batch"] for m in fleet.content["members"].values()
    ]
    assert unpacked(data["groups"]["operator"]["of"])[0] == -1  # who measured it is not known
    figure = next(each for each in data["figures"] if each["name"] == "opening_time")
    assert np.isnan(unpacked(figure["value"])[-1])


def test_a_chart_of_another_order_keeps_it(fleet: made.Made) -> None:
    content = deepcopy(fleet.content)
    chart = content["charts"]["R_a"]
    chart["order"] = [*chart["order"][::-1][:-1], "unit_of_nobody"]  # a unit that failed later
    data = Reader(render(content, fleet.units)).data
    assert len(data["orders"]) == 2
    carried = next(each for each in data["charts"] if each["symbol"] == "R_a")
    assert unpacked(carried["value"]).size == unpacked(data["orders"][carried["order"]]).size == 59


def test_words_and_tables_stand_there_without_scripts(fleet: made.Made, text: str) -> None:
    page = Reader(text)
    check_view("pages/fleet.txt", page.lines)
    links = {a["href"] for tag, a in page.tags if tag == "a"}
    assert {fleet.content["members"][name]["page"] for name in fleet.odd} <= links
    rows = [a["data-row"] for _, a in page.tags if a.get("data-row")]
    assert rows == [each["unit"] for each in fleet.content["odd"]]


def test_synthetic_data_are_called_so_and_measured_ones_are_not(fleet: made.Made, text: str) -> None:
    assert "SYNTHETIC DATA" in text
    assert "SYNTHETIC" not in render(fleet.content | {"synthetic": False}, fleet.units)


def test_what_a_file_says_stays_text(fleet: made.Made) -> None:
    content = deepcopy(fleet.content)
    bad = "</script><script>alert(1)</script>"
    content["name"] = content["failed"][0]["why"] = content["odd"][0]["why"] = bad
    content["members"][fleet.odd[0]]["page"] = "units/a b#1/report.html"
    page = render(content, fleet.units)
    assert "<script>alert" not in page
    assert Reader(page).data["name"] == bad
    assert 'href="units/a%20b%231/report.html"' in page


def test_sections_without_content_say_so_or_are_left_out(fleet: made.Made) -> None:
    bare = {"units": fleet.content["units"], "synthetic": True, "gauge": None, "odd": []}
    page = " ".join(Reader(render(bare, fleet.units)).words)
    assert "No population was worked out" in page
    assert "No unit stands out" in page
    for gone in ("Gauge R&R", "Control charts", "Failed", "Hot and cold", "Which parameters go together"):
        assert gone not in page
    empty = Reader(render({"units": [], "synthetic": False}, fleet.units.iloc[:0]))
    assert empty.data["units"] == []
    assert "0 units" in " ".join(empty.words)


def test_ten_thousand_units_take_less_than_ten_megabytes() -> None:
    fleet = made.fleet(10_000, 40)
    assert len(render(fleet.content, fleet.units).encode()) < 10_000_000
