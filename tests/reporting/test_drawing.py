"""Pictures shared out between this process and a helper: each drawn once, whatever becomes of the helper."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from subprocess import PIPE

import pytest

import sketches
from etcfit.reporting import drawing
from etcfit.reporting.drawing import Helper, Job, begin_helper, draw_shared


def nobody(text: str, share: float) -> None:
    """Watches."""


@pytest.fixture
def helper(monkeypatch: pytest.MonkeyPatch) -> Iterator[Helper]:
    monkeypatch.setattr(drawing, "CORES", 2)
    monkeypatch.setattr(drawing, "at_hand", None)
    begin_helper()
    assert isinstance(drawing.at_hand, Helper)
    until = time.monotonic() + 60.0
    while not drawing.at_hand.is_free() and time.monotonic() < until:
        time.sleep(0.05)
    yield drawing.at_hand
    for process in active_children():
        process.kill()
        process.join()


def jobs(note: Path, count: int = 6) -> list[Job]:
    return [(Path("some") / f"{k}.png", partial(sketches.signed, note)) for k in range(count)]


@pytest.mark.slow
def test_both_draw_and_every_picture_is_drawn_once(helper: Helper, tmp_path: Path) -> None:
    note, said = tmp_path / "note", list[str]()
    draw_shared(tmp_path, jobs(note), lambda text, share: said.append(text))
    drawn_by = note.read_text(encoding="utf-8").split()
    assert len(drawn_by) == 6
    assert len(set(drawn_by)) == 2
    assert str(os.getpid()) in drawn_by
    assert sorted(p.name for p in (tmp_path / "some").iterdir()) == [f"{k}.png" for k in range(6)]
    assert said == [f"drawing some/{k}.png" for k in range(6)]


@pytest.mark.slow
def test_what_a_picture_raises_there_is_raised_here_and_says_where(helper: Helper, tmp_path: Path) -> None:
    wrong: Job = (Path("wrong.png"), sketches.impossible)
    with pytest.raises(ValueError, match="nothing to draw") as caught:
        draw_shared(tmp_path, [wrong, *jobs(tmp_path / "note", 2)], nobody)
    assert "sketches.py" in caught.value.__notes__[0]
    assert not (tmp_path / "wrong.png").exists()


@pytest.mark.slow
def test_where_the_helper_dies_its_pictures_are_drawn_here(helper: Helper, tmp_path: Path) -> None:
    note = tmp_path / "note"
    deadly: Job = (Path("deadly.png"), partial(sketches.deadly, os.getpid(), note))
    draw_shared(tmp_path, [deadly, *jobs(note)], nobody)
    assert set(note.read_text(encoding="utf-8").split()) == {str(os.getpid())}
    assert len([*tmp_path.rglob("*.png")]) == 7
    draw_shared(tmp_path / "again", jobs(note), nobody)
    assert len([*(tmp_path / "again").rglob("*.png")]) == 6


@pytest.mark.slow
def test_a_helper_whose_principal_is_gone_ends_without_a_word() -> None:
    """Killed while the helper loads, and while it waits. Its stderr ends only when nobody holds it any more."""
    begin = "from etcfit.reporting import drawing; drawing.CORES = 2; drawing.begin_helper(); import time; "
    ready = "[time.sleep(0.05) for _ in range(1200) if not drawing.at_hand.is_free()]; "
    for until in ("", ready):
        code = f"if __name__ == '__main__': {begin}{until}print(flush=True); time.sleep(60)"
        with subprocess.Popen([sys.executable, "-c", code], stdout=PIPE, stderr=PIPE, text=True) as process:
            assert process.stdout is not None
            process.stdout.readline()
            process.kill()
            assert process.communicate(timeout=50)[1] == ""


def test_on_one_core_nobody_helps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "CORES", 1)
    monkeypatch.setattr(drawing, "at_hand", None)
    begin_helper()
    assert drawing.at_hand is None
