"""Programs are compiled once, and pieces run side by side."""

from __future__ import annotations

import sys
import threading
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from etcfit.problem import program
from etcfit.problem.program import (
    CORES,
    Program,
    compiled_so_far,
    concurrently,
    forget,
    memory_mappings,
    side_by_side,
)


def scaled(factor: float, kind: str, x: Any) -> Any:
    """factor x."""
    if kind == "wrong":
        raise ValueError("no such kind")
    return factor * jnp.asarray(x)


def test_it_is_compiled_for_each_model_and_each_shape_and_for_nothing_else() -> None:
    program = Program(scaled, static=2)
    assert program.__doc__ == "factor x."
    for factor, size, count in ((2.0, 3, 1), (2.0, 3, 1), (3.0, 3, 2), (3.0, 4, 3), (2.0, 3, 3)):
        assert np.all(np.asarray(program(factor, "right", np.ones(size))) == factor)
        assert program.compiled == count
        assert compiled_so_far()["test_program.scaled"] == count


def test_threads_that_ask_at_once_wait_for_the_one_that_compiles() -> None:
    traced, gate = [], threading.Barrier(4)

    def slow(name: str, x: Any) -> Any:
        traced.append(name)
        return x + 1.0

    program = Program(slow, static=1)

    def ask(_: int) -> float:
        gate.wait()
        return float(program("one", np.float64(1.0)))

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (traced, program.compiled) == (["one"], 1)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="/proc/self/maps is Linux's")
def test_what_is_forgotten_is_compiled_again_and_gives_its_mappings_of_memory_back() -> None:
    program = Program(scaled, static=2)
    forget()
    before = memory_mappings()
    for size in range(3, 43):
        program(2.0, "right", np.ones(size))
    kept, held = memory_mappings(), program(2.0, "right", np.ones(3))
    forget()
    assert program.compiled == 0
    assert np.all(np.asarray(held) == 2.0)
    assert memory_mappings() < kept - (kept - before) / 2
    assert np.all(np.asarray(program(2.0, "right", np.ones(3))) == 2.0)
    assert program.compiled == 1


def test_a_process_that_compiles_on_and_on_stays_below_the_mappings_it_may_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """How many a program holds depends on what lies beside it in memory: here ten each, and 200 are allowed."""
    many = Program(scaled, static=2)
    monkeypatch.setattr(program, "memory_mappings", lambda: 10 * many.compiled)
    monkeypatch.setattr(program, "most_mappings", lambda: 200 / program.CROWDED)
    counts = []
    for size in range(3, 83):
        assert np.all(np.asarray(many(2.0, "right", np.ones(size))) == 2.0)
        counts.append(many.compiled)
    assert counts[:20] == [*range(1, 21)], "forgotten without need"
    assert np.sum(np.diff(counts) < 0) >= 2, "forgotten once at most"
    assert max(counts) < 20 + 2 * 10, "looked too seldom"


def test_an_error_is_told_to_who_calls_and_not_kept() -> None:
    program = Program(scaled, static=2)
    program.ahead(1.0, "wrong", np.ones(2))
    for _ in range(2):
        with pytest.raises(ValueError, match="no such kind"):
            program(1.0, "wrong", np.ones(2))
    assert program.compiled == 0


def test_what_is_compiled_ahead_is_there_when_it_is_asked_for() -> None:
    program = Program(scaled, static=2)
    program.ahead(2.0, "right", np.ones(2))
    assert np.all(np.asarray(program(2.0, "right", np.ones(2))) == 2.0)
    assert program.compiled == 1


def test_pieces_come_back_in_their_order_and_an_error_of_one_is_raised() -> None:
    assert side_by_side(lambda k: k**2, range(3 * CORES)) == [k**2 for k in range(3 * CORES)]
    assert side_by_side(lambda k: k, []) == []
    with pytest.raises(ZeroDivisionError):
        side_by_side(lambda k: 1 / k, [1, 0])


def test_work_that_shares_out_its_own_pieces_comes_back_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    def summed(k: int) -> int:
        return sum(side_by_side(lambda piece: k * piece, range(5)))

    for cores in (1, 2):
        monkeypatch.setattr(program, "CORES", cores)
        assert concurrently(summed, range(7)) == [10 * k for k in range(7)]
        with pytest.raises(ZeroDivisionError):
            concurrently(lambda k: 1 / k, [1, 0])


@pytest.mark.skipif(CORES < 2, reason="one core: nothing is done at once")
def test_work_in_python_is_done_at_once() -> None:
    """Each waits for the other: one after the other they would break the barrier."""
    gate = threading.Barrier(2)
    assert sorted(concurrently(lambda k: gate.wait(30.0), range(2))) == [0, 1]
