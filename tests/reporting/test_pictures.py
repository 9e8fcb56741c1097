"""A whole run folder: what a fit leaves behind."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest
from matplotlib.image import imread

import results
from etcfit.api.work import keep_fit
from etcfit.reporting import clear_for_fit, draw_others, has_undrawn
from etcfit.reporting.pictures import briefly, jobs
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.state import load_fit


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    said: list[tuple[str, float]] = []
    result = results.result(results.rig(tmp_path_factory.mktemp("rig")))
    run = tmp_path_factory.mktemp("run") / "new"
    keep_fit(RunFolder(run), result)
    assert [p.name for p in run.rglob("*.png")] == ["parameters.png"]
    draw_others(RunFolder(run), lambda text, share: said.append((text, share)))
    assert 1 + len(said) == len(list((run / "pictures").rglob("*.png")))
    assert [share for _, share in said] == sorted(share for _, share in said)
    return run


def test_every_file_is_there(run: Path) -> None:
    pictures = {p.relative_to(run / "pictures").as_posix() for p in (run / "pictures").rglob("*")}
    tests = ("back_emf", "inductance", "resistance", "response")
    assert {"parameters.png", *(f"tests/{t}.png" for t in tests)} <= pictures
    assert {*(f"traces/{t}__1.png" for t in tests), "traces/response__2.png"} <= pictures
    assert not [p for p in run.rglob(".*")], "scratch files are left behind"


def test_another_process_can_be_handed_them(tmp_path: Path) -> None:
    handed = pickle.loads(pickle.dumps(jobs(results.result(results.rig(tmp_path)))))
    for path, draw in handed[:3]:
        assert draw().axes, path


def test_a_title_has_room_for_the_model(tmp_path: Path) -> None:
    rig = results.rig(tmp_path)  # an inductance test with a resistance of its own
    assert briefly(results.result(rig)) == "Eqs. 1-2"
    assert briefly(results.result(rig, added=("limp_home_spring",))) == "Eqs. 1-2 + limp_home_spring"
    many = results.result(rig, added=("limp_home_spring", "stribeck_friction", "gravity_load"))
    assert briefly(many) == "Eqs. 1-2 + 4 effects"


def test_pictures_show_something(run: Path) -> None:
    pictures = [*run.rglob("*.png")]
    assert pictures
    for path in pictures:
        pixels = imread(path)
        assert pixels[..., :3].std() > 0.02, path
        assert min(pixels.shape[:2]) > 150, path


def test_fit_and_state_can_be_read_again(run: Path) -> None:
    fit = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    assert fit["schema"] == "etcfit.fit/1"
    assert set(load_fit(run).free_parameters.layout.free) <= set(fit["parameters"])


@pytest.mark.slow
def test_pictures_of_another_fit_are_not_left_behind(run: Path, tmp_path: Path) -> None:
    stale = run / "pictures" / "traces" / "response__99.png"
    stale.write_bytes(b"a trace that is no longer there")
    (run / "pictures" / "notes.txt").write_text("somebody's own", "utf-8")
    clear_for_fit(run)
    assert not stale.exists()
    assert (run / "pictures" / "notes.txt").exists()


def test_a_fit_that_is_stopped_before_its_picture_leaves_none_of_another_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    run, first = tmp_path / "run", results.result(results.rig(tmp_path / "rig"))
    for place in (run / "pictures" / "parameters.png", run / "pictures" / "traces" / "response__1.png"):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"of another model")
    monkeypatch.setattr("etcfit.reporting.draw_fit", stopped)
    with pytest.raises(KeyboardInterrupt, match="All results are in"):
        keep_fit(RunFolder(run), first)
    assert not list(run.rglob("*.png"))
    assert has_undrawn(run)
