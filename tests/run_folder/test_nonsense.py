"""A run folder with nonsense in it is answered in words, with the command that makes it anew: never a traceback."""

from __future__ import annotations

import json
import re
import shutil
import sys
import zipfile
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import diagnoses
import results
import runs
from etcfit.cli import app
from etcfit.errors import UsageError
from etcfit.files import digest
from etcfit.run_folder.manifest import MANIFEST, read_records, replacing
from etcfit.run_folder.reading import read_design, read_draws
from etcfit.run_folder.state import load_diagnosis, load_fit, save_diagnosis
from etcfit.stages import STAGES, run_all


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """RUN with a diagnosis, gains and what passes for a posterior, beside its measurements."""
    folder = tmp_path_factory.mktemp("whole")
    save_diagnosis(folder / "run", diagnoses.diagnosis(results.rig(folder / "rig")))
    runs.written(folder / "run", "design", json.dumps({"schema": "etcfit.pid/1", **runs.pid()}))
    return folder


@pytest.fixture
def run(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of it, to be spoilt."""
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return Path("run")


def manifest(run: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads((run / MANIFEST).read_text("utf-8"))
    change(content)
    (run / MANIFEST).write_text(json.dumps(content), "utf-8")


def _in_fit(key: str, value: Any) -> Callable[[dict[str, Any]], object]:
    return lambda content: content["stages"]["fit"].update({key: value})


CHANGES: dict[str, Callable[[dict[str, Any]], object]] = {
    "stages null": lambda content: content.update(stages=None),
    "stages a list": lambda content: content.update(stages=[1]),
    "a stage null": lambda content: content["stages"].update(fit=None),
    "a stage a number": lambda content: content["stages"].update(fit=3),
    "aside null": lambda content: content.update(aside=None),
    "aside of numbers": lambda content: content.update(aside={"fit": 3}),
    **{f"{key} {json.dumps(value)}": _in_fit(key, value) for key, value in (
        ("settings", None), ("settings", [1]), ("inputs", None), ("inputs", {"a": [1]}), ("outputs", 3),
        ("outputs", []), ("outputs", {"fit.json": {"a": 1}}), ("exit", None), ("exit", "0"),
        ("folder", [1]), ("folder", {}),
        ("seconds", "a"), ("seconds", [1]), ("seconds", -1), ("seconds", 1e300), ("at", None))},
}  # fmt: skip
TEXTS = {
    "null": "null", "a list": "[]", "a number": "3", "empty": "", "cut off": '{"schema": "etcfit.run/1", "sta',
    "nested": "[" * 100_000, "nested objects": '{"stages":' * 100_000, "no UTF-8": "\udcff\udcfe",
}  # fmt: skip
COMMANDS = (["fit", "rig", "--out", "run"], ["run", "rig", "--out", "run"], ["diagnose", "run"], ["sample", "run"],
            ["reduce", "run"], ["design", "run"], ["report", "run"], ["report", "run", "--interactive"],
            ["export", "run", "--to", "c"], ["check", "rig", "--advise", "--at", "run"],
            ["plan", "run", "--out", "next"])  # fmt: skip


def said(words: list[str]) -> str:
    """What a command that must be refused says."""
    done = CliRunner().invoke(app, [*words, "--quiet"])
    assert done.exit_code == 2, (done.exit_code, done.exception, done.stderr)
    assert isinstance(done.exception, SystemExit)
    return done.stderr


@pytest.mark.parametrize("name", [*CHANGES, *TEXTS])
def test_a_manifest_of_nonsense_is_said_to_be_with_a_way_on(run: Path, name: str) -> None:
    if name in CHANGES:
        manifest(run, CHANGES[name])
    else:
        (run / MANIFEST).write_text(TEXTS[name], "utf-8", errors="surrogateescape")
    with pytest.raises(UsageError, match=r"run\.json cannot be read .* `etcfit fit FOLDER --out OTHER`"):
        read_records(run)


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
def test_every_command_says_so(run: Path, words: list[str]) -> None:
    manifest(run, CHANGES["a stage null"])
    assert "run/run.json cannot be read as the manifest of a run" in said(words)


OPTIONS = [("rule", 3), ("adc_bits", None), ("adc_bits", 1.5), ("ecu", [1]), ("limits", None), ("profile", {}),
           ("log", 7), ("anyway", "yes")]  # fmt: skip


@pytest.mark.parametrize(("option", "value"), OPTIONS)
def test_options_of_nonsense_on_the_manifest_are_said_to_be(run: Path, option: str, value: Any) -> None:
    """Told by `etcfit run` where it comes to that stage."""
    manifest(run, lambda content: content["stages"].update(
        design=content["stages"]["design"] | {"outputs": {"pid.json": "0"}, "settings": {option: value}}))  # fmt: skip
    design = next(stage for stage in STAGES if stage.name == "design")
    words = re.escape(f"`etcfit design` last ran with {option} {json.dumps(value)}")
    with pytest.raises(UsageError, match=words):
        run_all(Path("rig"), run, lambda _: nullcontext(lambda *_: None), lambda *_: None, (design,))


def forged(run: Path, name: str, content: bytes) -> None:
    """A file of other content, which the manifest says to be the one that was written."""
    (run / name).write_bytes(content)
    sha = digest(run / name)

    def change(manifest: dict[str, Any]) -> None:
        for stage in manifest["stages"].values():
            for kind in ("inputs", "outputs"):
                stage[kind].update({name: sha} if name in stage[kind] else {})

    manifest(run, change)


@pytest.mark.parametrize("name", ["fit_state.npz", "diagnosis_state.npz"])
@pytest.mark.parametrize("damage", ["cut off", "a bit flipped", "the other's", "no zip", "nothing"])
def test_a_corrupt_state_is_answered_with_the_command_that_makes_it_anew(run: Path, name: str, damage: str) -> None:
    was = (run / name).read_bytes()
    other = {"fit_state.npz": "diagnosis_state.npz", "diagnosis_state.npz": "fit_state.npz"}[name]
    flipped = bytearray(was)
    with zipfile.ZipFile(run / name) as state:  # amid the longest array: the hour of a header, say, tells nothing
        longest = max(state.infolist(), key=lambda each: each.compress_size)
    flipped[longest.header_offset + longest.compress_size // 2] ^= 1
    forged(run, name, {"cut off": was[: len(was) // 2], "a bit flipped": bytes(flipped), "no zip": b"no zip",
                       "nothing": b"", "the other's": (run / other).read_bytes()}[damage])  # fmt: skip
    again = "etcfit fit rig --out run" if name == "fit_state.npz" else "etcfit diagnose run"
    load = load_fit if name == "fit_state.npz" else load_diagnosis
    with pytest.raises(UsageError, match=rf"{name} was not written by this version .* Run `{again}` again"):
        load(run)


@pytest.mark.parametrize("content", ["{}", "[]", "null", "3", "", '{"schema": "etcfit.pid/1"}', '{"schema": [1]}',
                                     '{"schema": "etcfit.pid/1", "rule": "optimal", "gains": null}',
                                     '{"schema": "etcfit.pid/1", "rule": "optimal", "gains": {"Kp": 1}}', "[" * 100_000,
                                     ])  # fmt: skip
def test_gains_of_nonsense_are_not_exported(run: Path, content: str) -> None:
    forged(run, "pid.json", content.encode())
    assert "Run `etcfit design run` again" in said(["export", "run", "--to", "c"])
    assert not (run / "export").exists()


@pytest.mark.parametrize("to", ["c", "python", "msq"])
def test_gains_that_were_edited_are_not_exported(run: Path, to: str) -> None:
    text = (run / "pid.json").read_text("utf-8")
    (run / "pid.json").write_text(text.replace("6.017", "60.17"), "utf-8")
    assert "run/pid.json is not the file that `etcfit design` wrote there" in said(["export", "run", "--to", to])
    assert not (run / "export").exists()


def test_gains_that_nobody_designed_are_not_taken_for_a_designs(run: Path) -> None:
    manifest(run, lambda content: content["stages"].pop("design"))
    with pytest.raises(UsageError, match="holds no finished `etcfit design`"):
        read_design(run)


def test_a_posterior_that_was_changed_is_not_passed_over(run: Path) -> None:
    with replacing(run, "sample", 0, {}) as draft:
        (draft / "posterior.json").write_text("{}", "utf-8")
        (draft / "posterior.nc").write_bytes(b"no netCDF")
    fitted = load_fit(run).fitted()
    with pytest.raises(UsageError, match=r"posterior\.nc cannot be read .* Run `etcfit sample run` again"):
        read_draws(run, fitted, 10, 0)
    (run / "posterior.nc").write_bytes(b"changed")
    with pytest.raises(UsageError, match=r"posterior\.nc is not the file .* Run `etcfit sample run` again"):
        read_draws(run, fitted, 10, 0)


FLEET_COMMANDS = (["fleet", "report", "fleet"], ["design", "fleet", "--fleet"], ["design", "run", "--parts", "fleet"])


@pytest.mark.parametrize("words", FLEET_COMMANDS, ids=lambda words: " ".join(words[:2]))
@pytest.mark.parametrize("content", ["{", "{}", "[]", "null", '{"schema": "etcfit.fleet/1", "version": null}'])
def test_half_a_fleet_is_said_to_be(run: Path, words: list[str], content: str) -> None:
    Path("fleet").mkdir()
    Path("fleet/fleet.json").write_text(content, "utf-8")
    Path("fleet/units.parquet").write_bytes(b"PAR1")
    assert "Run `etcfit fleet FLEET --out fleet` again" in said(words)


@pytest.mark.parametrize("words", FLEET_COMMANDS, ids=lambda words: " ".join(words[:2]))
def test_a_library_that_is_missing_is_said_with_how_to_install_it(
    run: Path, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("fleet").mkdir()
    for name in ("fleet.json", "units.parquet"):
        Path("fleet", name).write_text("{}", "utf-8")
    for name in [name for name in sys.modules if name.partition(".")[0] == "pyarrow"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    text = said(words)
    assert "needs the library pyarrow, which is not installed" in text
    assert "pip install" in text


@pytest.mark.parametrize("out", ["line", "line/u1", "line/u1/run", "line/runs", "line/../line"])
def test_a_run_folder_in_the_fleet_is_refused(run: Path, out: str) -> None:
    Path("line/u1").mkdir(parents=True)
    shutil.copytree("rig", "line/u2")
    assert f"{out} is inside the fleet line" in said(["fleet", "line", "--out", out])
    assert sorted(path.name for path in Path("line").iterdir()) == ["u1", "u2"]


@pytest.mark.parametrize("steps", [10**400, 10**30], ids=["401 digits", "31 digits"])
def test_steps_beyond_all_reason_are_a_usage_error(run: Path, steps: int) -> None:
    assert "steps" in said(["sample", "run", "--steps", str(steps)])
