"""What tracing found, kept on disk: which values have a text, which texts are believed, what makes one out of date."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from etcfit import backend
from etcfit.kernels import kept as room
from etcfit.kernels.graph import Graph
from etcfit.kernels.kept import NotWrittenError, kept, read, trace_always, written
from etcfit.kernels.loop import Across, Loop
from etcfit.kernels.machine import LANES, Kernel, available
from etcfit.model.effects import EFFECTS, Backlash, State
from etcfit.model.rig_effects import FAMILY_BY_KIND, Place
from etcfit.problem import filter_kernels, lanes
from etcfit.problem.traced_entry import Column
from held_plate import held_plate, problem_of

pytestmark = pytest.mark.skipif(not available(), reason="no llvmlite here")


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """That of the texts; other tests trace always (conftest)."""
    before = backend.compiled_folder()
    backend.keep_compiled_in(tmp_path / "compiled")
    trace_always(False)
    yield tmp_path / "compiled" / "traces"
    trace_always()
    backend.keep_compiled_in(before)


def product(factor: float) -> Kernel:
    """Of each entry and a factor."""
    graph = Graph()
    a = graph.input("a")
    result = graph.make("mul", a, graph.constant(factor))
    return Kernel.made(Loop(graph, Across.LANES, ((a,),), (), (), stored=(result,)), LANES)


def applied(kernel: Kernel, value: float) -> float:
    record, out = np.full((1, 1, LANES), value), np.empty((1, 1, LANES))
    kernel.run(1, LANES, [record.ctypes.data], np.zeros(1), np.zeros((0, LANES)), out)
    return float(out[0, 0, 0])


class Counted:
    """Makes a kernel, and counts how often."""

    def __init__(self, factor: float = 3.0) -> None:
        self.factor, self.times = factor, 0

    def __call__(self) -> Any:
        self.times += 1
        return (1, 2), product(self.factor)


# ---- texts


@pytest.mark.parametrize("value", [
    None, True, 3, "text", (), (1, (2, None)), {"a": (1,), 2: "b"}, Column(4, (0, 1)),
    jax.tree.structure((State(0.0, 0.0, 0.0), {"b": 1.0, "a": (1.0, None)}, ())),
])  # fmt: skip
def test_what_is_written_is_read(value: Any) -> None:
    found = read(written(value))
    assert found == value
    assert type(found) is type(value)


def test_different_values_are_written_differently() -> None:
    values: list[Any] = [
        1, 1.0, True, "1", (1,), [1], {1: 1}, None, (), [], {}, ((1,), 2), (1, (2,)), Column(0, (1,)), (0, (1,)),
        0.0, -0.0, np.nextafter(1.0, 2.0), float("nan"), float("inf"), Across.LANES, "lanes", State, State(1, 2, 3),
        product, jax.tree.structure(0), jax.tree.structure((0,)), jax.tree.structure(State(0, 0, 0)),
        jax.tree.structure((0, 0, 0)), *EFFECTS,
        *(FAMILY_BY_KIND["channel_gain"].at(Place(test, channel))
          for test in ("response", "static") for channel in ("current", "position")),
    ]  # fmt: skip
    texts = [repr(written(value)) for value in values if value is not product]
    assert len({*texts}) == len(texts)


def test_what_has_no_name_in_etcfit_is_not_written() -> None:
    class Elsewhere(NamedTuple):
        a: int

    class OfANotebook(Backlash):
        pass

    nameless: list[Any] = [Elsewhere(1), OfANotebook, product, lambda: 1, object(), np.zeros(2), {1, 2}, Path]
    for value in nameless:
        for held in (value, (1, (value,))):
            with pytest.raises(NotWrittenError):
                written(held)


@pytest.mark.parametrize("text", [
    {"new": "os:system", "of": ["true"]}, {"new": "etcfit.model.effects:Nobody", "of": []}, {"kernel": []},
    {"kernel": ["0" * 64, 4, 1, 0, 0, 1]}, {"float": "0x1p0"}, {"class": "etcfit.model.effects:Backlash"}, [1], 1.5,
])  # fmt: skip
def test_a_text_that_names_anything_else_is_not_believed(text: Any, folder: Path) -> None:
    with pytest.raises((LookupError, ValueError, TypeError)):
        read(text)


# ---- files


def test_what_was_made_once_is_found(folder: Path) -> None:
    first, second = Counted(), Counted()
    assert applied(kept(first, "of", 3.0)[1], 2.0) == 6.0
    leaves, kernel = kept(second, "of", 3.0)
    assert (first.times, second.times) == (1, 0)
    assert leaves == (1, 2)
    assert applied(kernel, 2.0) == 6.0
    assert len([*folder.iterdir()]) == 1


def test_what_is_known_of_another_is_another(folder: Path) -> None:
    kept(Counted(3.0), "of", 3.0)
    assert applied(kept(Counted(5.0), "of", 5.0)[1], 2.0) == 10.0


def test_of_other_sources_everything_is_made_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept(Counted(), "of")
    monkeypatch.setattr(room, "program", lambda: "changed")
    again = Counted()
    kept(again, "of")
    assert again.times == 1


def test_a_source_file_that_changes_changes_the_program(tmp_path: Path) -> None:
    found = set()
    for file, text in (("a.py", "a = 1\n"), ("a.py", "a = 2\n"), ("room/b.py", ""), ("readme.md", "no source")):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)
        room.program.cache_clear()
        found.add(room.program(tmp_path, time.time() + 60.0))
    assert len(found) == 3


def test_sources_that_changed_since_they_were_imported_are_not_those_that_run(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("a = 1\n")
    os.utime(tmp_path / "a.py", (0.0, 0.0))  # as a copy that keeps the time of its original
    with pytest.raises(NotWrittenError, match=r"a\.py"):
        room.program(tmp_path, time.time() - 60.0)


def torn(path: Path) -> None:
    path.write_text(path.read_text()[:20])


def without_object_file(path: Path) -> None:
    for each in (path.parents[1] / "kernels").iterdir():
        each.unlink()


def of_another_time(path: Path) -> None:
    path.write_text('{"tuple": [1, {"kernel": [1, 2]}]}')


@pytest.mark.parametrize("spoil", [torn, without_object_file, of_another_time])
def test_what_is_spoilt_is_made_anew(spoil: Callable[[Path], None], folder: Path) -> None:
    kept(Counted(), "of")
    (path,) = folder.iterdir()
    spoil(path)
    again = Counted()
    assert applied(kept(again, "of")[1], 2.0) == 6.0
    assert again.times == 1
    third = Counted()
    kept(third, "of")
    assert third.times == 0


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="files have no owner here")
def test_a_folder_that_others_can_write_is_not_used(folder: Path) -> None:
    kept(Counted(), "of")
    folder.chmod(0o777)
    again = Counted()
    with pytest.warns(UserWarning, match=r"others can write .*traces"):
        kept(again, "of")
    assert again.times == 1


# ---- kernels of a model


def shown(given: filter_kernels.Given) -> Any:
    """As if it stood in `filter_kernels`: a tree with a leaf that is 0 at every entry."""
    return given.after[0], {"nothing": 0.0, "dt": (given.batch.steps.dt, None)}


shown.__module__ = filter_kernels.__name__


def test_of_a_model_met_before_nothing_is_traced(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = problem_of(held_plate(tmp_path / "rig"))
    x = problem.layout.coordinates({"R_a": 1.5, "T_f": 0.2})
    monkeypatch.setattr(filter_kernels, "shown", shown, raising=False)

    def along() -> Any:
        """By a kernel that this process has not made."""
        found = filter_kernels.along(filter_kernels.along_path(shown), *problem.here(x, problem.arrays()))
        return jax.tree.map(np.asarray, found)

    traced = along()
    (text,) = folder.iterdir()

    def refuse(*_: Any) -> Any:
        raise AssertionError("traced again")

    monkeypatch.setattr(lanes, "TracedEntry", refuse)
    again = along()
    assert jax.tree.structure(again) == jax.tree.structure(traced)
    for before, after in zip(jax.tree.leaves(traced), jax.tree.leaves(again), strict=True):
        assert_array_equal(after, before)
    text.unlink()
    with pytest.raises(AssertionError, match="traced again"):
        along()
