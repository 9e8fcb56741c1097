"""A whole run folder: what `write_run` leaves behind."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from matplotlib.image import imread

import results
from etcfit.reporting import write_run
from etcfit.run_folder import read_state


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    said: list[tuple[str, float]] = []
    result = results.result(results.rig(tmp_path_factory.mktemp("rig")))
    run = tmp_path_factory.mktemp("run") / "new"
    write_run(run, result, lambda text, share: said.append((text, share)))
    assert len(said) == len(list((run / "pictures").rglob("*.png")))
    assert [share for _, share in said] == sorted(share for _, share in said)
    return run


def test_every_file_is_there(run: Path) -> None:
    pictures = {p.relative_to(run / "pictures").as_posix() for p in (run / "pictures").rglob("*")}
    tests = ("back_emf", "inductance", "resistance", "response")
    assert {"parameters.png", *(f"tests/{t}.png" for t in tests)} <= pictures
    assert {*(f"traces/{t}__1.png" for t in tests), "traces/response__2.png"} <= pictures
    assert not [p for p in run.rglob(".*")], "scratch files are left behind"


def test_pictures_show_something(run: Path) -> None:
    for path in run.rglob("*.png"):
        pixels = imread(path)
        assert pixels[..., :3].std() > 0.02, path
        assert min(pixels.shape[:2]) > 150, path


def test_fit_and_state_can_be_read_again(run: Path) -> None:
    fit = json.loads((run / "fit.json").read_text(encoding="utf-8"))
    assert fit["schema"] == "etcfit.fit/1"
    assert set(read_state(run).symbols) <= set(fit["parameters"])
