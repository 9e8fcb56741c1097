"""Leaving a test out, in one step, against the least squares of the others."""

from __future__ import annotations

import numpy as np
import pytest

import linear_parts as parts
from etcfit.estimation.agreement import Influence, influence

SYMBOLS = ("a", "b", "c")


def asked(blind: bool = False, reach: float = 1.0) -> tuple[Influence, dict, dict, np.ndarray]:
    """With coordinates so many times as large."""
    rng = np.random.default_rng(3)
    every = {key: J / reach for key, J in parts.jacobians(rng).items()}
    if blind:
        for key, J in every.items():
            if key[0] != "beta":
                J[:, 1] = 0.0
    r = parts.residuals(rng, every)
    x = parts.optimum(every, r)
    traces = parts.said(parts.pieces(every, r, x))
    return influence(SYMBOLS, traces, parts.nothing_believed(), np.full(parts.P, reach), 0.3), every, r, x


def test_every_pull_is_what_a_refit_without_that_part_moves() -> None:
    found, every, r, x = asked()
    assert len(found.pulls) == (3 + 9) * parts.P
    J = np.vstack(list(every.values()))
    sd = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    for pull in found.pulls:
        k = SYMBOLS.index(pull.parameter)
        moved = parts.optimum(parts.without(every, pull.test, pull.file), r)[k] - x[k]
        assert pull.moved == pytest.approx(moved, rel=1e-6, abs=1e-10)
        assert pull.pull == pytest.approx(moved / sd[k], rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("reach", [1e-3, 1e3])
def test_what_is_known_does_not_depend_on_the_size_of_a_coordinate(reach: float) -> None:
    for blind in (False, True):
        plain, scaled = asked(blind)[0], asked(blind, reach)[0]
        assert scaled.alone == plain.alone
        assert {(p.test, p.file, p.parameter) for p in scaled.pulls} == {
            (p.test, p.file, p.parameter) for p in plain.pulls
        }
        assert [p.pull for p in scaled.pulls] == pytest.approx([p.pull for p in plain.pulls], rel=1e-5, abs=1e-6)


def test_the_largest_come_first_and_small_ones_are_not_written() -> None:
    found, *_ = asked()
    sizes = [abs(each.pull) for each in found.pulls]
    assert sizes == sorted(sizes, reverse=True)
    kept = found.largest(0.5, 4)
    assert 0 < len(kept) <= 4
    assert all(abs(each.pull) >= 0.5 for each in kept)
    assert found.largest(100.0, 4) == ()


def test_what_one_test_alone_tells_has_no_pull_for_it() -> None:
    found, *_ = asked(blind=True)
    assert found.alone == {"b": "beta"}
    assert not any(each.parameter == "b" and each.test == "beta" and each.file is None for each in found.pulls)
    assert any(each.parameter == "b" and each.file for each in found.pulls)  # two traces of it check each other
