"""Directions in words: the parameters by name, and the measurement that would tell them apart."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import results
from etcfit.estimation.identifiability import EXCITED_BY, RULES, TOLD_BY, Cure, Direction, sentence, sentences
from etcfit.model.effects import PAPER
from etcfit.model.throttle import catalogue
from etcfit.rig import TEST_BY_NAME


def said(*symbols: str, sd: float = np.inf, made: tuple[str, ...] = ()) -> str:
    return sentence(Direction(symbols, (1.0,) * len(symbols), sd), made)


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


CURES: list[Cure] = [*(rule.cure for rule in RULES), *TOLD_BY.values()]


@pytest.mark.parametrize("cure", [cure for cure in CURES if cure.tests], ids=lambda cure: cure.words(()))
def test_a_test_that_was_made_is_not_advised_as_if_it_were_not(cure: Cure) -> None:
    absent = cure.words(())
    assert all(str(way) in absent for way in cure.tests)
    made = cure.words([way.test for way in cure.tests])
    assert not any(way.name in made for way in cure.tests)
    assert all(f"{way.test}/" in made for way in cure.tests)
    assert "there but tell" in made
    assert "etcfit check --advise" in made
    assert cure.besides in made


def test_of_two_tests_the_one_that_is_missing_is_advised() -> None:
    assert "a free fall of the plate (inertia/" in said("J_L")
    found = said("J_L", made=("inertia", "response"))
    assert found == (
        "J_L is hardly seen in these data: a motor-alone test (viscous/: gear apart, voltage steps to several speeds) "
        "tells J_L."
    )


def test_every_test_that_is_advised_is_one() -> None:
    assert {way.test for cure in CURES for way in cure.tests} <= set(TEST_BY_NAME)


def test_the_traces_that_were_fitted_are_known_to_be_there(tmp_path: Path) -> None:
    problem = results.result(results.rig(tmp_path)).problem
    (found,) = sentences([Direction(("L_a",), (1.0,), np.inf)], problem.batch.traces)
    assert found.startswith(
        "L_a is hardly seen in these data: inductance/ is there but tells too little: sampling faster"
    )


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
