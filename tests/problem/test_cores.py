"""Pieces of work run side by side."""

from __future__ import annotations

import threading

import pytest

from etcfit.problem import cores
from etcfit.problem.cores import CORES, concurrently, side_by_side


def test_pieces_come_back_in_their_order_and_an_error_of_one_is_raised() -> None:
    assert side_by_side(lambda k: k**2, range(3 * CORES)) == [k**2 for k in range(3 * CORES)]
    assert side_by_side(lambda k: k, []) == []
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 / k, [1, 0])


def test_work_that_shares_out_its_own_pieces_comes_back_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def summed(k: int) -> int:
        return sum(side_by_side(lambda piece: k * piece, range(5)))

    for count in (1, 2):
        monkeypatch.setattr(cores, "CORES", count)
        assert concurrently(summed, range(7)) == [10 * k for k in range(7)]
        with pytest.raises(ZeroDivisionError):
            concurrently(lambda k: 1 / k, [1, 0])


@pytest.mark.skipif(CORES < 2, reason="one core: nothing is done at once")
def test_work_in_python_is_done_at_once() -> None:
    """Each waits for the other: one after the other they would break the barrier."""
    gate = threading.Barrier(2)
    assert sorted(concurrently(lambda k: gate.wait(30.0), range(2))) == [0, 1]
