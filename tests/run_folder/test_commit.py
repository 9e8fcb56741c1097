"""A stage replaces its files and its record together, whenever it is stopped; one process writes at a time."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from equality import equal
from etcfit.cli import app
from etcfit.diagnosis.findings import Diagnosis
from etcfit.errors import UsageError
from etcfit.estimation.result import FitResult
from etcfit.files import Busy, held, whole
from etcfit.run_folder.manifest import SUPERSEDED, read_records, replacing
from etcfit.run_folder.state import load_final, load_fit, save_diagnosis, save_fit


class Killed(BaseException):
    """The process ends here."""


def below(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def stop() -> None:
    raise Killed


def killed_at(step: int, monkeypatch: pytest.MonkeyPatch, work: Callable[[], object]) -> bool:
    """Whether the work was ended, in place of its so manieth change of the disk: a move, or something deleted."""
    left = [step]

    def counted(plain: Callable[..., Any]) -> Callable[..., Any]:
        def change(*args: Any, **kwargs: Any) -> Any:
            left[0] -= 1
            return stop() if left[0] < 0 else plain(*args, **kwargs)

        return change

    with monkeypatch.context() as patch:
        for owner, name in ((Path, "replace"), (Path, "unlink"), (os, "replace"), (shutil, "rmtree")):
            patch.setattr(owner, name, counted(getattr(owner, name)))
        try:
            work()
        except Killed:
            return True
    return False


def test_what_a_stage_leaves_is_the_old_or_the_new_whatever_the_step_at_which_it_is_killed(
    found: Diagnosis, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_diagnosis(run, found)
    other = replace(found.before, chi2_per_dof=7.0)
    ends = set()
    for step in range(200):
        here = tmp_path / f"run {step}"
        shutil.copytree(run, here)
        if not killed_at(step, monkeypatch, lambda here=here: save_fit(here, other)):
            break
        stages, chi2 = set(read_records(here)), load_fit(here).chi2_per_dof
        ends.add((chi2, load_final(here).chi2_per_dof))
        assert stages == ({"fit"} if chi2 == 7.0 else {"fit", "diagnose"})
        if chi2 == 7.0:
            assert (here / SUPERSEDED / "diagnosis.json").read_bytes() == (run / "diagnosis.json").read_bytes()
            assert not (here / "diagnosis.json").exists()
        save_fit(here, other)
        assert not [path.name for path in here.iterdir() if path.name.startswith(".")]
    else:
        raise AssertionError("it never came to its end")
    assert ends == {(found.before.chi2_per_dof, found.after.chi2_per_dof), (7.0, 7.0)}


STAGES = ["fit", "diagnose", "reduce", "design", "sample", "report"]


@pytest.mark.parametrize("stage", STAGES)
def test_the_old_record_of_a_stage_stands_where_the_new_result_fails(found: Diagnosis, run: Path, stage: str) -> None:
    save_diagnosis(run, found)
    if stage not in ("fit", "diagnose"):
        with replacing(run, stage, 0, {"rule": "old"}) as draft:
            for name in ("transfer_function.json", "frequency_response.json", "pid.json", "posterior.json",
                         "posterior.nc", "report.html"):  # fmt: skip
                (draft / name).write_text("old", "utf-8")
    before = below(run)
    with pytest.raises(OSError, match="No space") as caught:
        _full_disk(run, stage)
    assert caught.value.filename == str(run / "fit.json")
    assert below(run) == before
    assert stage in read_records(run)


def _full_disk(run: Path, stage: str) -> None:
    with replacing(run, stage, 0, {}) as draft:
        (draft / "fit.json").write_text("half", "utf-8")
        raise OSError(28, "No space left on device", str(draft / "fit.json"))


def test_a_fit_that_is_killed_before_its_first_file_leaves_the_old_one(fit: FitResult, run: Path) -> None:
    save_fit(run, fit)
    with pytest.raises(Killed):
        save_fit(run, replace(fit, chi2_per_dof=7.0), lambda draft: stop())
    assert equal(load_fit(run), fit)


def test_the_manifest_has_the_hashes_of_what_was_written_not_of_what_lies_there(fit: FitResult, run: Path) -> None:
    save_fit(run, fit)
    with pytest.raises(UsageError, match=r"fit\.json is not the file"):
        _spoilt_before_the_record(run, replace(fit, chi2_per_dof=7.0))


def _spoilt_before_the_record(run: Path, fit: FitResult) -> None:
    """Another program writes fit.json the moment it is there."""
    plain = Path.replace

    def spoils(self: Path, target: Path) -> Path:
        there = plain(self, target)
        if Path(target) == run / "fit.json":
            Path(target).write_text("{}", "utf-8")
        return there

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "replace", spoils)
        save_fit(run, fit)
    load_fit(run)


HOLDS = """
import sys, time
from pathlib import Path
from etcfit.files import held
with held(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(300)
"""


@pytest.fixture
def holder(run: Path) -> Iterator[subprocess.Popen[str]]:
    """Another process that writes into RUN."""
    root = str(Path(__file__).resolve().parents[2])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-c", HOLDS, str(run)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_writer_is_refused_and_let_in_once_the_first_was_killed(
    fit: FitResult, run: Path, holder: subprocess.Popen[str]
) -> None:
    with pytest.raises(Busy, match=rf"another etcfit \(process {holder.pid}\) works on it"):
        save_fit(run, fit)
    assert read_records(run) == {}
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    save_fit(run, fit)
    assert equal(load_fit(run), fit)


def test_every_command_says_so_before_any_work(
    fit: FitResult, run: Path, holder: subprocess.Popen[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    monkeypatch.setattr("etcfit.rig.reader.read_folder", lambda *_: pytest.fail("it has begun to work"))
    monkeypatch.setattr("etcfit.run_folder.state.load_fit", lambda *_: pytest.fail("it has begun to work"))
    for words in ("fit rig --out run", "run rig --out run", "diagnose run", "sample run", "reduce run", "design run",
                  "report run"):  # fmt: skip
        done = CliRunner().invoke(app, [*words.split(), "--quiet"])
        assert (done.exit_code, done.stdout) == (2, ""), words
        assert f"run: another etcfit (process {holder.pid}) works on it" in done.stderr, words


def test_one_process_holds_a_folder_as_often_as_it_likes_and_leaves_nothing_behind(tmp_path: Path) -> None:
    deep = tmp_path / "a" / "b"
    with held(deep), held(tmp_path / "a" / ".." / "a" / "b"):
        assert deep.is_dir()
    assert not (tmp_path / "a").exists()
    with held(deep):
        (deep / "kept").write_text("", "utf-8")
    assert [path.name for path in deep.iterdir()] == ["kept"]


def test_what_a_killed_writer_left_half_written_is_deleted_by_the_next(run: Path) -> None:
    (run / "pictures").mkdir(parents=True)
    with pytest.MonkeyPatch.context() as patch, suppress(Killed), whole(run / "pictures" / "a.png"):
        patch.setattr(Path, "unlink", lambda *_, **__: None)
        stop()
    assert len(below(run)) == 1
    with held(run):
        assert set(below(run)) == {".lock"}


def test_an_error_names_the_file_that_was_meant_and_no_scratch_one(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space") as caught, whole(tmp_path / "fit.json"):
        raise OSError(28, "No space left on device")
    assert caught.value.filename == str(tmp_path / "fit.json")
