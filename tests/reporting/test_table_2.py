"""The paper's Table 2 beside a rig's own parameters."""

from __future__ import annotations

import pytest

from etcfit.model.paper import TABLE_2
from etcfit.reporting.pictures import beside
from etcfit.rig.config import parse_config

PLATE = "[rig]\ngear_ratio = 15.0\n"


def table_2(toml: str) -> dict[str, float]:
    return beside(parse_config(toml, "rig.toml"))


def test_it_holds_what_is_printed_and_the_combinations_that_follow() -> None:
    found = table_2(PLATE)
    same = ("R_a", "L_a", "K_b", "K_m", "B_m", "B_L", "K_s", "T_PL", "T_f", "J_eq", "B_eq")
    assert {symbol: found[symbol] for symbol in same} == {symbol: TABLE_2[symbol] for symbol in same}
    assert found["V_PL"] == pytest.approx(0.362 * 1.513 / (20.68 * 0.0189))  # by its own gear ratio
    assert set(found) - set(same) == {"V_PL", "V_f", "V_s", "V_w"}


def test_what_contradicts_its_own_j_eq_is_left_out() -> None:
    n = TABLE_2["N"]
    assert n**2 * TABLE_2["J_m"] + TABLE_2["J_L"] > 30 * TABLE_2["J_eq"]
    assert n**2 * TABLE_2["B_m"] + TABLE_2["B_L"] == pytest.approx(TABLE_2["B_eq"], rel=0.01)
    assert {"J_m", "J_L"} & set(table_2(PLATE)) == set()


def test_without_a_gear_ratio_motors_are_compared_at_the_plate() -> None:
    found, known = table_2("[rig]\n"), table_2(PLATE)
    assert found["K_b"] == found["K_m"] == pytest.approx(0.391, rel=1e-3)  # the paper's 5.12 V at 13.10 rad/s
    assert found["B_m"] == pytest.approx(TABLE_2["B_eq"], rel=0.01)
    assert all(found[symbol] == known[symbol] for symbol in set(known) - {"K_b", "K_m", "B_m"})


def test_nothing_is_compared_with_what_is_no_plate_between_stops() -> None:
    assert table_2("[rig]\ntravel_deg = [-inf, inf]\n") == {}
