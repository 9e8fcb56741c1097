"""What is saved comes back bit for bit, shared parts shared, and nothing else of the package is called."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

import results
from equality import equal
from etcfit.estimation.intervals import intervals
from etcfit.estimation.result import FitResult
from etcfit.model.effects import EFFECTS
from etcfit.model.rig_effects import RIG_EFFECTS, Place
from etcfit.rig.base import Boundary, Channel, RigConfig
from etcfit.run_folder import codec


@pytest.fixture
def there_and_back(tmp_path: Path) -> Callable[[Any], Any]:
    def turn(value: Any) -> Any:
        codec.save(tmp_path / "a.npz", value)
        return codec.load(tmp_path / "a.npz")

    return turn


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    return results.result(results.rig(tmp_path_factory.mktemp("rig")), lost=("J_m",))


VALUES = {
    "numbers": (0.1 + 0.2, math.nan, -math.inf, -0.0, 5e-324, 3, True, None, "Ω"),
    "arrays": (np.arange(6.0).reshape(2, 3)[:, ::2], np.array([], int), np.array(["a", "bc"]), np.float64(0.1)),
    "a jax array": jnp.linspace(0.0, 1.0, 5),
    "mappings": {"b": {1: (2,)}, "a": [frozenset({"x", "y"}), {3}]},
    "families": (*EFFECTS, *RIG_EFFECTS),
    "effects of a test": tuple(family.at(Place("inductance")) for family in RIG_EFFECTS),
    "effects of a channel": tuple(family.at(Place("", "current")) for family in RIG_EFFECTS),
    "effects of a trace": tuple(family.at(Place.named("response/1.csv")) for family in RIG_EFFECTS),
    "effects of a channel of a trace": tuple(
        family.at(Place.named("response/1.csv.current")) for family in RIG_EFFECTS
    ),
    "effects of the whole rig": tuple(family.at(Place()) for family in RIG_EFFECTS),
    "objects": (RigConfig("a", columns={"x": "y"}), Boundary(plate_held=True)),
}


@pytest.mark.parametrize("value", VALUES.values(), ids=VALUES)
def test_it_comes_back_bit_for_bit(value: Any, there_and_back: Callable[[Any], Any]) -> None:
    assert equal(there_and_back(value), value)


def test_a_number_repeated_takes_the_room_of_one_on_disk_and_in_memory(
    there_and_back: Callable[[Any], Any], tmp_path: Path
) -> None:
    column = np.broadcast_to(np.arange(3.0)[:, None, None], (3, 500, 400))
    found = there_and_back((column, np.broadcast_to(2.5, (1000, 1000))))
    assert equal(found, (column, np.full((1000, 1000), 2.5)))
    assert found[0].strides[1:] == (0, 0)
    assert found[1].strides == (0, 0)
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert all(each.file_size < 1000 for each in archive.infolist())


def test_a_fit_comes_back_bit_for_bit(fit: FitResult, there_and_back: Callable[[Any], Any]) -> None:
    again = there_and_back(fit)
    assert equal(again, fit)
    assert again is not fit
    assert intervals(again) == intervals(fit)
    assert again.problem.chi2(fit.x, again.weighted) == fit.problem.chi2(fit.x, fit.weighted)


def test_any_field_that_differs_would_be_seen(fit: FitResult) -> None:
    # or the test above could not fail
    assert not equal(fit.problem.batch.steps._replace(dt=fit.problem.batch.steps.dt + 1e-16), fit.problem.batch.steps)
    assert not equal(fit.x.astype(np.float32), fit.x)


def test_what_stands_in_two_places_is_one_object_again(fit: FitResult, there_and_back: Callable[[Any], Any]) -> None:
    again = there_and_back(fit)
    assert again.problem.batch.traces[0].measurement is again.rig.measurements[0]
    array = np.arange(3.0)
    one, other = there_and_back((array, array))
    assert one is other


def test_the_same_object_makes_the_same_file(fit: FitResult, tmp_path: Path) -> None:
    for name in ("a", "b"):
        codec.save(tmp_path / name, fit)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert codec.same(tmp_path / "a", fit)
    assert not codec.same(tmp_path / "a", fit.x)


def test_what_is_saved_elsewhere_is_named(fit: FitResult, tmp_path: Path) -> None:
    codec.save(tmp_path / "a", (fit, 3), {"fit": fit})
    assert (tmp_path / "a").stat().st_size < 1000
    again, three = codec.load(tmp_path / "a", {"fit": fit})
    assert (again is fit, three) == (True, 3)


@dataclass(frozen=True)
class Foreign:
    """Not of the package."""

    value: float


@pytest.mark.parametrize("value", [Foreign(1.0), len, object(), Path("a")])
def test_what_cannot_be_told_apart_from_code_is_not_saved(value: Any, tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="cannot be saved"):
        codec.save(tmp_path / "a", value)
    assert not (tmp_path / "a").exists()


def _with_tree(path: Path, tree: Any) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("tree.json", json.dumps(tree))


SPOILT = {
    "no zip": lambda path: path.write_bytes(b"PK no zip"),
    "not there": lambda path: None,
    "another format": lambda path: _with_tree(path, {"format": 99, "value": 1}),
    "a class of another package": lambda path: _with_tree(path, {"format": 1, "value": ["class", "os:PathLike"]}),
    "a function": lambda path: _with_tree(path, {"format": 1, "value": ["class", "etcfit.files:write_json"]}),
    "another field": lambda path: _with_tree(
        path, {"format": 1, "value": ["object", "etcfit.rig.base:Fixed", {"value": 1.0, "sd": 2.0}]}
    ),
    "no such kind": lambda path: _with_tree(path, {"format": 1, "value": ["pickle", "gASVAAAA"]}),
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_what_this_version_did_not_write_is_refused(spoil: Callable[[Path], Any], tmp_path: Path) -> None:
    spoil(tmp_path / "a")
    with pytest.raises(codec.Unreadable):
        codec.load(tmp_path / "a")


def test_an_object_is_not_computed_again_on_the_way_in(there_and_back: Callable[[Any], Any]) -> None:
    time = np.arange(3.0)
    channel = Channel(time, time, 0.1, True, "x [V]", "V", 1.0)
    assert there_and_back(channel).value.tobytes() == channel.value.tobytes()
