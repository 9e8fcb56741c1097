"""Directions in words: the parameters by name, and the measurement that would tell them apart."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from etcfit.estimation.identifiability import Direction
from etcfit.estimation.remedies import EXCITED_BY, RULES, TOLD_BY, sentence
from etcfit.model.effects import PAPER
from etcfit.model.throttle import catalogue


def said(*symbols: str, sd: float = np.inf) -> str:
    return sentence(Direction(symbols, (1.0,) * len(symbols), sd))


@pytest.mark.parametrize(
    ("symbols", "words"),
    [
        (("K_m", "J_L", "B_L", "K_s", "T_PL", "T_f"), "K_m, J_L, B_L, K_s, T_PL and T_f share one scale"),
        (("K_m", "J_L", "B_L", "K_s", "T_PL", "T_f"), "only K_m = K_b, a torque sensor, or one known torque"),
        (("K_s", "T_f", "T_PL", "J_m", "R_a", "K_b"), "log the current"),
        (("J_m", "J_L"), "J_m and J_L are seen only as N^2 J_m + J_L: a motor-alone test"),
        (("B_L", "B_m"), "B_L and B_m are seen only as N^2 B_m + B_L: a motor-alone test"),
        (("R_a", "series_ohm.inductance"), "a resistance test"),
        (("R_a", "series_ohm.inductance"), "tests.inductance.series_ohm"),
        (("L_a",), "L_a is hardly seen in these data: an inductance test"),
        (("L_a",), "sampling faster"),
        (("T_PL", "T_f"), "static_load/"),
        (("K_b", "B_L"), "back_emf/"),
        (("odd", "even"), "odd and even are seen only in one combination: fix odd in rig.toml"),
    ],
)
def test_a_direction_names_its_parameters_and_its_cure(symbols: tuple[str, ...], words: str) -> None:
    assert words in said(*symbols)


def test_a_weak_direction_says_how_weak() -> None:
    assert "(known to 23 % only)" in said("J_m", "J_L", sd=0.23)
    assert "%" not in said("J_m", "J_L")


def test_every_parameter_of_the_paper_has_a_test_that_tells_it() -> None:
    assert set(TOLD_BY) == set(catalogue(PAPER))


def test_every_rule_can_speak() -> None:
    """For some symbols it is the first that fits: none stands behind another that always speaks before it."""
    known = (*TOLD_BY, *EXCITED_BY)
    every = (frozenset(some) for count in range(1, 5) for some in combinations(known, count))
    speaking = {next((rule.says for rule in RULES if rule.fits(symbols)), None) for symbols in every}
    assert {rule.says for rule in RULES} <= speaking
