"""What the kill tests count, on run folders that were spoilt by hand."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import diagnoses
import results
from benchmarks.kill import Case, Tally, compare, contents, look
from etcfit.run_folder.state import load_fit, save_diagnosis, save_fit


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Before a new fit, and after it."""
    place = tmp_path_factory.mktemp("runs")
    found = diagnoses.diagnosis(results.rig(place / "rig"))
    save_diagnosis(place / "old", found)
    shutil.copytree(place / "old", place / "new")
    save_fit(place / "new", replace(found.before, chi2_per_dof=7.0))
    return place / "old", place / "new"


def seen(folders: tuple[Path, Path], run: Path) -> set[str]:
    """Kinds of faults found in a run folder after its fit was stopped."""
    tally = Tally(1.0)
    look(Case("fit", lambda run: (), folders[0]), run, folders[1], tally, "a moment")
    return {kind for kind, faults in tally.faults.items() if faults}


@pytest.mark.parametrize("which", [0, 1], ids=["the old one", "the new one"])
def test_the_old_result_and_the_new_one_are_no_fault(folders: tuple[Path, Path], which: int) -> None:
    assert seen(folders, folders[which]) == set()


def test_each_kind_of_fault_is_seen(folders: tuple[Path, Path], tmp_path: Path) -> None:
    old, new = folders
    spoilt = shutil.copytree(old, tmp_path / "mixed")
    shutil.copy(new / "fit.json", spoilt)
    assert seen(folders, spoilt) == {"stale"}
    spoilt = shutil.copytree(old, tmp_path / "neither")
    save_fit(spoilt, replace(load_fit(old), chi2_per_dof=8.0))
    assert seen(folders, spoilt) == {"mixed"}
    spoilt = shutil.copytree(new, tmp_path / "lost")
    shutil.rmtree(spoilt / "superseded")
    assert seen(folders, spoilt) == {"lost"}
    spoilt = shutil.copytree(new, tmp_path / "nonsense")
    (spoilt / "run.json").write_text("{", "utf-8")
    assert seen(folders, spoilt) == {"mixed"}


def test_what_differs_and_what_is_left_behind_is_named(folders: tuple[Path, Path], tmp_path: Path) -> None:
    _, new = folders
    again = shutil.copytree(new, tmp_path / "again")
    (again / "fit.json").write_text("{}", "utf-8")
    (again / ".draft-x").mkdir()
    (again / ".draft-x" / "fit.json").write_text("{}", "utf-8")
    tally = Tally(1.0)
    compare(contents(new), contents(new), tally, "a moment")
    assert not any(tally.faults.values())
    compare(contents(again), contents(new), tally, "a moment")
    assert tally.faults["differs"] == ["a moment: fit.json"]
    assert tally.faults["left behind"] == ["a moment: .draft-x/fit.json"]
