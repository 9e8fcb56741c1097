"""Every verb on a model that another process saved, with an effect of each scope in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

import etcfit
import results
from etcfit.control.pid import RULES
from etcfit.estimation.result import FitResult
from etcfit.exporting import FORMATS
from etcfit.model.rig_effects import rig_effect
from etcfit.rig.base import Rig
from etcfit.run_folder.state import save_fit

OF_EACH_SCOPE = {
    "rig": ("gear_ratio", "sensor_end_points"),  # these lost their name: they have no place
    "test": ("channel_gain[response.current]", "series_resistance[response]"),
    "trace": (
        "trace_late[response/1.csv]",
        "warm_start[response/1.csv]",
        "channel_late[response/1.csv.current]",
        "channel_offset[response/1.csv.position]",
    ),
}
EFFECTS = tuple(name for names in OF_EACH_SCOPE.values() for name in names)
QUICK = {name: RULES[name] for name in ("manual", "damping_optimum")}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    """The gear ratio is given, so that it may be wrong."""
    rig = results.rig(tmp_path_factory.mktemp("measured"))
    return results.result(_with_effects(rig), starts=())


def _with_effects(rig: Rig) -> Rig:
    return replace(rig, config=replace(rig.config, effects=EFFECTS, gear_ratio_given=True))


@pytest.fixture(scope="module")
def run(fitted: FitResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder that nothing in this process knows."""
    path = tmp_path_factory.mktemp("run")
    save_fit(path, fitted)
    return path


def test_the_effects_are_of_every_scope() -> None:
    for scope, names in OF_EACH_SCOPE.items():
        for name in names:
            effect = rig_effect(name)
            assert effect is not None
            assert (effect.name, effect.scope) == (name, scope)


def test_the_model_comes_back_with_all_its_effects(run: Path) -> None:
    types = etcfit.load(run).result.free_parameters.layout.types  # pyright: ignore[reportAttributeAccessIssue]
    assert set(EFFECTS) <= {effect.name for effect in types}


def reduced(run: Path, out: Path) -> Any:
    return etcfit.reduce(run, quiet=True).transfer_function


def designed(run: Path, out: Path) -> Any:
    with results.limits_unsought(), mock.patch.dict(RULES, QUICK, clear=True):
        return etcfit.design(run, rule="manual", settings=results.BRIEF, quiet=True).gains


def advised(run: Path, out: Path) -> Any:
    return etcfit.advise(etcfit.load(run).result.rig, run, quiet=True)  # pyright: ignore[reportAttributeAccessIssue]


def printed(run: Path, out: Path) -> Any:
    return etcfit.report(run, out / "report.html", quiet=True).stat().st_size


def interactive(run: Path, out: Path) -> Any:
    return etcfit.report(run, out / "work.html", page="interactive", quiet=True).stat().st_size


@pytest.mark.slow
@pytest.mark.parametrize("verb", [reduced, designed, advised, printed, interactive], ids=lambda verb: verb.__name__)
def test_every_verb_takes_it(verb: Callable[[Path, Path], Any], run: Path, tmp_path: Path) -> None:
    assert verb(run, tmp_path) is not None


GAINS = ("msq", "mujoco-position")  # they hold a controller, which no design has made here


@pytest.mark.slow
@pytest.mark.parametrize("name", [each.name for each in FORMATS if each.name not in GAINS])
def test_every_export_takes_it(name: str, run: Path, tmp_path: Path) -> None:
    done = etcfit.export(run, name, tmp_path, quiet=True)
    assert done.files
    assert all(path.stat().st_size for path in done.files)
