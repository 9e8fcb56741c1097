"""A command that a message names can be typed as it stands, whatever the folders are called."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import diagnoses
import results
import runs
from etcfit.api.fleet import Fleet
from etcfit.errors import UsageError
from etcfit.fleets.folder import refuse_inside
from etcfit.run_folder.diagnosis import KeptRounds
from etcfit.run_folder.manifest import require
from etcfit.run_folder.reading import read_design, read_draws
from etcfit.run_folder.state import load_fit, save_diagnosis
from etcfit.stages import STAGES, run_all

RUN, RIG = Path("runs of mine") / "a throttle's; $(run)", Path("the rig")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """RUN with a diagnosis and gains, beside its measurements."""
    monkeypatch.chdir(tmp_path)
    results.rig(tmp_path / RIG)
    save_diagnosis(RUN, diagnoses.diagnosis(replace(results.rig(RIG), folder=str(RIG))))
    runs.written(RUN, "design", '{"schema": "etcfit.pid/1"}', {"rule": 3})
    runs.written(RUN, "sample", "no posterior")
    return tmp_path


def _changed_state() -> None:
    (RUN / "fit_state.npz").write_bytes(b"")
    load_fit(RUN)


def _changed_measurements() -> None:
    (RIG / "rig.toml").write_text('[rig]\nname = "another"\n')
    load_fit(RUN)


def _made_anew() -> None:
    (RUN / "pid.json").unlink()
    (design,) = (stage for stage in STAGES if stage.name == "design")
    run_all(RIG, RUN, lambda _: pytest.fail("a stage began"), lambda *_: None, (design,))


MESSAGES: dict[str, tuple[Callable[[], object], list[str]]] = {
    "no stage": (lambda: require(RUN, "report"), ["report", str(RUN)]),
    "a measurement folder": (lambda: require(RIG, "fit"), ["fit", str(RIG), "--out", str(Path("runs") / RIG.name)]),
    "a changed state": (_changed_state, ["fit", str(RIG), "--out", str(RUN)]),
    "changed measurements": (_changed_measurements, ["fit", str(RIG), "--out", str(RUN)]),
    "no gains": (lambda: read_design(RUN), ["design", str(RUN)]),
    "no posterior": (lambda: read_draws(RUN, load_fit(RUN).fitted(), 1, 0), ["sample", str(RUN)]),
    "no fleet": (lambda: Fleet.in_run(RUN), ["fleet", "FLEET", "--out", str(RUN)]),
    "an option": (_made_anew, ["design", str(RUN)]),
}


@pytest.mark.parametrize("name", MESSAGES)
def test_a_refusal_names_a_command_that_a_shell_takes(folder: Path, name: str) -> None:
    work, words = MESSAGES[name]
    with pytest.raises(UsageError) as refusal:
        work()
    commands = [shlex.split(each) for each in re.findall(r"`(etcfit [^`]+)`", str(refusal.value))]
    assert ["etcfit", *words] in commands, str(refusal.value)


def test_so_does_a_diagnosis_that_is_interrupted(folder: Path) -> None:
    said = KeptRounds(RUN, load_fit(RUN)).when_interrupted()
    (again,) = re.findall(r"`([^`]+)`", said)
    assert shlex.split(again) == ["etcfit", "diagnose", str(RUN)]


def test_and_the_place_that_a_run_of_a_fleet_is_sent_to(tmp_path: Path) -> None:
    fleet = tmp_path / "a fleet"
    with pytest.raises(UsageError) as refusal:
        refuse_inside(fleet, fleet / "run")
    assert f"--out {shlex.quote(str(Path('runs') / fleet.name))}." in str(refusal.value)
