"""Machine code: what it computes where numbers are small, large or none, and what it keeps on disk."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from etcfit import backend
from etcfit.kernels import machine
from etcfit.kernels.graph import Graph
from etcfit.kernels.loop import Across, Loop
from etcfit.kernels.machine import LANES, POINTS, Kernel, available


def kernel(make: Callable[[Graph, int], int], across: Across = Across.LANES) -> Kernel:
    """One number of each entry, and what becomes of it."""
    graph = Graph()
    a = graph.input("a")
    width = LANES if across is Across.LANES else POINTS
    return Kernel.made(Loop(graph, across, ((a,),), (), (), stored=(make(graph, a),)), width)


def of(make: Callable[[Graph, int], int], values: np.ndarray) -> np.ndarray:
    """A function of numbers, shape (n,)."""
    record = np.repeat(values[:, None, None], LANES, axis=2)
    out = np.empty((values.size, 1, LANES))
    kernel(make).run(values.size, LANES, [record.ctypes.data], np.zeros(1), np.zeros((0, LANES)), out)
    assert_array_equal(out[:, 0, 0], out[:, 0, -1])
    return out[:, 0, 0]


def test_the_exponential_is_right_to_its_last_digits_and_ends_as_it_must() -> None:
    x = np.concatenate((np.linspace(-700.0, 700.0, 2001), np.linspace(-1e-3, 1e-3, 101)))
    assert_allclose(of(lambda g, a: g.make("exp", a), x), np.exp(x), rtol=1e-15)
    ends = of(lambda g, a: g.make("exp", a), np.array([-np.inf, -800.0, 800.0, np.inf, np.nan]))
    assert_array_equal(ends, [0.0, 0.0, np.inf, np.inf, np.nan])


def far_and_near(name: str) -> np.ndarray:
    """Numbers of every size at which a logarithm is asked for, and some close to where it is 0."""
    rng = np.random.default_rng(0)
    sizes, near = 10.0 ** rng.uniform(-300.0, 300.0, 2000), 10.0 ** rng.uniform(-17.0, 0.0, 1000)
    if name == "log":
        return np.concatenate((sizes, 1.0 + near, 1.0 - 0.9 * near, rng.uniform(0.5, 2.0, 2000)))
    return np.concatenate((sizes, near, -0.9 * near, near[near > 1e-15] - 1.0, rng.uniform(0.0, 2.0, 2000)))


@pytest.mark.parametrize("name", ["log", "log1p"])
def test_logarithms_are_right_to_their_last_digit(name: str) -> None:
    x = far_and_near(name)
    found, known = of(lambda g, a: g.make(name, a), x), getattr(np, name)(x)
    assert np.max(np.abs(found - known) / np.spacing(np.abs(known))) <= 1.0


@pytest.mark.parametrize(("name", "at_zero"), [("log", 0.0), ("log1p", -1.0)])
def test_logarithms_end_as_they_must(name: str, at_zero: float) -> None:
    ends = np.array([at_zero, at_zero - 1.0, -np.inf, np.inf, np.nan, at_zero + 1.0])
    assert_array_equal(of(lambda g, a: g.make(name, a), ends), [-np.inf, np.nan, np.nan, np.inf, np.nan, 0.0])


def divided(across: Across) -> np.ndarray:
    """x / (p q), x / p + 1 / p of entries x at parameters p and q: one number of each entry, from a vector's end."""
    graph = Graph()
    x, p, q = graph.input("x"), graph.input("p"), graph.input("q")
    often = graph.make("add", graph.make("div", x, p), graph.make("div", graph.constant(1.0), p))
    results = graph.make("div", x, graph.make("mul", p, q)), often
    width = LANES if across is Across.LANES else POINTS
    made = Kernel.made(Loop(graph, across, ((x,),), (p, q), (), stored=results), width)
    record, out = np.repeat(np.array([[[1.0]], [[3.0]]]), width, axis=2), np.empty((2, 2, width))
    fixed = np.array([3.0, 7.0]) if across is Across.LANES else np.repeat([3.0, 7.0], width)
    made.run(2, width, [record.ctypes.data], fixed, np.zeros((0, width)), out)
    return out[:, :, -1]


@pytest.mark.parametrize("across", [Across.LANES, Across.POINTS])
def test_what_is_divided_by_a_number_that_no_entry_changes_is_a_product(across: Across) -> None:
    assert_allclose(divided(across), [[1.0 / 21.0, 2.0 / 3.0], [3.0 / 21.0, 4.0 / 3.0]], rtol=3e-16)


@pytest.mark.parametrize("name", ["max", "min"])
@pytest.mark.parametrize("first", [True, False])
def test_the_larger_of_a_number_and_of_none_is_none(name: str, first: bool) -> None:
    def make(graph: Graph, a: int) -> int:
        other = graph.constant(1.0)
        return graph.make(name, a, other) if first else graph.make(name, other, a)

    found = of(make, np.array([-2.0, 3.0, np.nan]))
    assert_array_equal(found, [*getattr(np, f"{name}imum")([-2.0, 3.0], 1.0), np.nan])


def test_of_two_that_vary_one_that_is_none_is_seen() -> None:
    def make(graph: Graph, a: int) -> int:
        return graph.make("max", graph.make("mul", a, a), graph.make("sqrt", a))

    assert_array_equal(of(make, np.array([4.0, -1.0])), [16.0, np.nan])


def test_a_clamped_number_that_is_none_stays_none() -> None:
    found = of(lambda g, a: g.make("clamp", g.constant(-1.0), a, g.constant(1.0)), np.array([-3.0, 0.5, 7.0, np.nan]))
    assert_array_equal(found, [-1.0, 0.5, 1.0, np.nan])


X86 = platform.machine().lower() in ("x86_64", "amd64")


@pytest.mark.skipif(not X86, reason="only x86 is told to take denormal numbers for zero")
def test_denormal_numbers_are_zero_inside_and_what_they_were_outside() -> None:
    assert_array_equal(of(lambda g, a: g.make("mul", a, g.constant(1e-10)), np.array([1e-300, 1.0])), [0.0, 1e-10])
    assert np.float64(1e-300) * np.float64(1e-10) > 0.0


@pytest.mark.parametrize("name", ["tanh", "sin", "asinh", "erf", "expm1"])
def test_functions_of_the_library_are_called_with_each_number(name: str) -> None:
    x = np.array([0.1, 0.5, 2.0])
    assert_allclose(of(lambda g, a: g.make(name, a), x), [getattr(math, name)(v) for v in x], rtol=1e-15)


def test_a_loop_carries_adds_and_stores_lane_by_lane_and_point_by_point() -> None:
    rng = np.random.default_rng(0)
    record, factor = rng.standard_normal((7, 1, LANES)), rng.standard_normal(POINTS)
    graph = Graph()
    a, p, c = graph.input("a"), graph.input("p"), graph.input("c")
    after = graph.make("add", graph.make("mul", c, graph.constant(0.5)), graph.make("mul", a, p))

    def loop(across: Across) -> Loop:
        return Loop(graph, across, ((a,),), (p,), ((c, after),), (((after, after), (a, p)),), (after,))

    def wanted(values: np.ndarray, by: float) -> tuple[np.ndarray, float]:
        states, state = [], 1.0
        for each in values:
            states.append(state := 0.5 * state + each * by)
        return np.array(states), float(np.sum(np.square(states)) + np.sum(values) * by)

    out = np.empty((7, 1, LANES))
    lanes = Kernel.made(loop(Across.LANES), LANES)
    total = lanes.run(7, LANES, [record.ctypes.data], factor[:1], np.ones((1, LANES)), out)
    for k in range(LANES):
        states, added = wanted(record[:, 0, k], factor[0])
        assert_allclose(out[:, 0, k], states, rtol=1e-14)
        assert total[0, k] == pytest.approx(added, rel=1e-13)
    many, out = Kernel.made(loop(Across.POINTS), POINTS), np.empty((7, 1, POINTS))
    total = many.run(7, LANES, [record.ctypes.data + 8], factor, np.ones((1, POINTS)), out)
    for k in range(POINTS):
        states, added = wanted(record[:, 0, 1], factor[k])
        assert_allclose(out[:, 0, k], states, rtol=1e-14)
        assert total[0, k] == pytest.approx(added, rel=1e-13)


# ---- on disk


@pytest.fixture
def kept(tmp_path: Path) -> Iterator[Path]:
    before = backend.compiled_folder()
    backend.keep_compiled_in(tmp_path)
    yield tmp_path / "kernels"
    backend.keep_compiled_in(before)


def square(graph: Graph, a: int) -> int:
    return graph.make("mul", a, a)


def test_a_kernel_is_found_on_disk_and_a_torn_one_made_anew(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_array_equal(of(square, np.array([3.0])), [9.0])
    (file,) = kept.iterdir()
    whole = file.read_bytes()

    def refuse(text: str) -> Any:
        raise AssertionError("compiled again")

    with monkeypatch.context() as found:
        found.setattr(machine, "compiled", refuse)
        assert_array_equal(of(square, np.array([4.0])), [16.0])
    file.write_bytes(whole[: len(whole) // 2])
    assert_array_equal(of(square, np.array([5.0])), [25.0])
    assert file.read_bytes() == whole


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owner here")
def test_a_folder_that_others_can_write_is_not_used_and_said_so(kept: Path) -> None:
    kept.mkdir()
    kept.chmod(0o777)
    with pytest.warns(UserWarning, match=r"others can write .*chmod go-w"):
        assert_array_equal(of(square, np.array([3.0])), [9.0])
    assert list(kept.iterdir()) == []


def test_kernels_can_be_put_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    available.cache_clear()
    monkeypatch.setenv("ETCFIT_KERNELS", "jax")
    assert not available()
    available.cache_clear()
    monkeypatch.delenv("ETCFIT_KERNELS")
    assert available()
