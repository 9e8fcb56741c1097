"""What `etcfit fleet` prints: every unit counted, what is bad named, nothing invented where fleet.json has nothing."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import pytest

import fleet_pages as made
from etcfit.reporting import fleet
from etcfit.reporting.blocks import render
from etcfit.reporting.fleet import fleet_table, verdict

EMPTY: dict[str, Any] = {
    **{key: [] for key in ("units", "failed", "not_converged", "odd", "drift", "predictions")},
    **{key: {} for key in ("members", "population", "effects", "charts", "capability", "figures", "settings")},
    "versions": {},
    "schema": "etcfit.fleet/1",
    "version": "0",
    "name": None,
    "synthetic": False,
    "correlation": {"symbols": [], "matrix": []},
    "gauge": None,
}


@pytest.fixture(scope="module")
def content() -> dict[str, Any]:
    return made.fleet().content


def text(content: dict[str, Any]) -> str:
    return render(fleet_table(content), width=200)


def test_numbers_have_the_digits_that_their_intervals_warrant(content: dict[str, Any]) -> None:
    known = {"mean": 0.1332174, "sd": 0.00861234, "mean_ci95": [0.131038, 0.135397], "sd_ci95": [0.00707, 0.010153],
             "unit": "N*m/rad", "cpk": 0.65412, "shared": False, "informed": 60}  # fmt: skip
    row = next(line for line in text(content | {"population": {"K_s": known}}).splitlines() if line.startswith("K_s "))
    assert " ".join(row.split()) == "K_s 0.1332 0.1310 ... 0.1354 0.0086 0.0071 ... 0.0102 0.654 60 N*m/rad"


def test_an_empty_fleet_says_so_and_no_more() -> None:
    assert text(EMPTY).split("\n", 1)[0].strip() == "Fleet without a name"
    assert "0 units have a result" in text(EMPTY)
    assert "odd" not in text(EMPTY)
    assert "Population" not in text(EMPTY)


def test_a_verdict_follows_what_counts_as_bad(content: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def bad() -> str:
        return " ".join(each.text for each in verdict(content) if each.bad)

    assert "Cpk below 1.33: K_s" in bad()
    assert "T_f (35.0 %)" in bad()
    monkeypatch.setattr(fleet, "CAPABLE", 0.1)
    monkeypatch.setattr(fleet, "GAUGE", 50.0)
    easy = bad()
    assert "Cpk" not in easy
    assert "T_f (35.0 %)" not in easy


def test_one_way_down_is_called_lower_and_many_odd_ones_are_counted(content: dict[str, Any]) -> None:
    other = deepcopy(content)
    other["drift"][0]["size"] *= -1.0
    other["odd"] = other["odd"] * 10
    said = " ".join(each.text for each in verdict(other))
    assert "lower (1.2 standard deviations" in said
    assert "30 units are odd (50 %)" in said
    assert "and 26 more" in said
    assert "20 of 30" in text(other)
    calm = " ".join(each.text for each in verdict(other | {"drift": [], "odd": []}))
    assert "Nothing drifts. " in calm
    assert "No unit is odd." in calm
