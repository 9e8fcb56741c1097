"""Stages hand over whole: what was saved is loaded, and nothing that was made from something else is mixed in."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import diagnoses
import results
from equality import equal
from etcfit.api.progress import Expected
from etcfit.cli import app
from etcfit.diagnosis.findings import Diagnosis
from etcfit.errors import UsageError
from etcfit.estimation.intervals import intervals
from etcfit.estimation.result import FitResult
from etcfit.files import digest as sha256
from etcfit.files import write_json
from etcfit.problem import weights
from etcfit.reporting.page import write_page
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.manifest import MANIFEST, SUPERSEDED, note_seconds, read_records, replacing
from etcfit.run_folder.state import fitted_to, is_done, load_diagnosis, load_final, load_fit, save_diagnosis, save_fit
from etcfit.stages import STAGES, Done, Report, Stage, run_all
from runs import pid, written


def test_a_fit_that_did_not_converge_far_from_its_data_stays_one_with_its_weights(fit: FitResult, run: Path) -> None:
    problem = replace(fit.problem, jitter=0.07, sigma=1.3 * fit.problem.sigma, guide_stiffness=0.0)
    weighted = problem.weighted(weights.forgiving(problem, 0.004))
    reason = "points about the end still lower chi2"
    odd = replace(fit, problem=problem, weighted=weighted, converged=False, reason=reason, far=True)
    save_fit(run, odd)
    assert equal(load_fit(run), odd)
    assert equal(load_final(run), odd)
    assert read_records(run)["fit"].exit == 3


def test_a_diagnosis_is_loaded_as_it_was_saved(found: Diagnosis, run: Path) -> None:
    after = replace(found.after, formulas=(diagnoses.FOUND,), exact_covariance=0.5 * found.after.covariance)
    found = replace(found, after=after)
    save_diagnosis(run, found)  # its fit with it
    again = load_diagnosis(run)
    assert equal(again, found)
    assert equal(load_final(run), found.after)
    assert equal(load_fit(run), found.before)
    assert equal(fitted_to(run, found.before.rig), found.after)
    exact = again.after.taken_as_exact()
    assert (exact.formulas, exact.covariance[0, 0]) == ((), 0.5 * after.covariance[0, 0])


def test_where_nothing_was_added_the_final_model_is_the_fit_itself(tmp_path: Path, run: Path) -> None:
    save_diagnosis(run, diagnoses.explained(results.rig(tmp_path / "rig")))
    again = load_diagnosis(run)
    assert again.after is again.before
    assert intervals(again.after) == intervals(load_fit(run))


def test_within_a_process_nothing_is_loaded(found: Diagnosis, run: Path) -> None:
    folder = RunFolder(run)
    folder.keep_fit(found.before)
    assert folder.fit() is folder.final() is found.before
    folder.keep_diagnosis(found)
    assert folder.final() is found.after
    other = replace(found.before, chi2_per_dof=7.0)
    folder.keep_fit(other)
    assert folder.final() is other


def test_a_new_fit_leaves_nothing_of_the_old_one_in_the_way(found: Diagnosis, run: Path) -> None:
    save_fit(run, found.before)
    save_diagnosis(run, found)
    write_page(run)
    assert diagnoses.FOUND in (run / "report.html").read_text("utf-8")
    save_fit(run, replace(found.before, chi2_per_dof=7.0))
    for name in ("diagnosis.json", "diagnosis_state.npz", "report.html"):
        assert not (run / name).exists()
        assert (run / SUPERSEDED / name).is_file(), "nothing is lost"
    assert set(read_records(run)) == {"fit"}
    assert load_final(run).chi2_per_dof == 7.0
    write_page(run)
    assert f"+ {diagnoses.FOUND}" not in (run / "report.html").read_text("utf-8")


def test_the_same_fit_made_again_keeps_what_was_made_from_it(found: Diagnosis, run: Path) -> None:
    save_diagnosis(run, found)
    save_fit(run, found.before)
    assert equal(load_diagnosis(run), found)


def test_a_diagnosis_sets_aside_what_was_made_from_the_fit_alone(found: Diagnosis, run: Path) -> None:
    save_fit(run, found.before)
    written(run, "design", "{}")
    save_diagnosis(run, found)
    assert not (run / "pid.json").exists()
    assert (run / SUPERSEDED / "pid.json").is_file()


def test_files_of_another_run_are_refused(found: Diagnosis, run: Path, tmp_path: Path) -> None:
    save_diagnosis(run, found)
    other = tmp_path / "other"
    save_fit(other, replace(found.before, chi2_per_dof=7.0))
    for name in ("diagnosis.json", "diagnosis_state.npz"):
        (other / name).write_bytes((run / name).read_bytes())
    with pytest.raises(UsageError, match=r"holds no finished .*diagnose"):
        load_final(other)
    with pytest.raises(UsageError, match=r"holds no finished .*diagnose"):
        write_page(other)
    (run / "fit_state.npz").write_bytes((other / "fit_state.npz").read_bytes())
    with pytest.raises(UsageError, match=r"another model|not the file that"):
        load_final(run)


def test_a_file_that_was_edited_is_refused(fit: FitResult, run: Path) -> None:
    save_fit(run, fit)
    (run / "fit.json").write_text((run / "fit.json").read_text("utf-8").replace("1.02", "1.03"), "utf-8")
    with pytest.raises(UsageError, match=r"fit\.json is not the file that .* Run `etcfit fit .*rig --out .*run` again"):
        write_page(run)


def test_measurements_that_changed_since_are_named(fit: FitResult, run: Path, tmp_path: Path) -> None:
    save_fit(run, fit)
    toml = tmp_path / "rig" / "rig.toml"
    was = toml.read_text("utf-8")
    toml.write_text(was + "\n# warmer today\n", "utf-8")
    with pytest.raises(UsageError, match=r"has changed since .*rig\.toml.* Run `etcfit fit"):
        load_fit(run)
    toml.write_text(was, "utf-8")
    assert equal(load_fit(run), fit)  # a touched file has not changed
    (tmp_path / "rig" / "response" / "1.csv").rename(tmp_path / "rig" / "response" / "3.csv")
    with pytest.raises(UsageError, match=r"response/1\.csv, response/3\.csv"):
        load_fit(run)


def test_where_the_measurements_were_taken_away_what_was_saved_will_do(
    fit: FitResult, run: Path, tmp_path: Path
) -> None:
    save_fit(run, fit)
    (tmp_path / "rig").rename(tmp_path / "elsewhere")
    assert equal(load_fit(run), fit)


def test_a_run_of_other_measurements_is_refused(fit: FitResult, run: Path, tmp_path: Path) -> None:
    save_fit(run, fit)
    assert equal(fitted_to(run, fit.rig), fit)
    with pytest.raises(UsageError, match=r"was made from .*rig, not from .*other"):
        fitted_to(run, results.rig(tmp_path / "other"))


@pytest.mark.parametrize(
    ("place", "why"),
    [
        ("rig", "is the measurement folder itself"),
        ("rig/../rig", "is the measurement folder itself"),
        ("rig/response", "lies in .*response, the folder of a rig test"),
        ("rig/response/runs/a", "lies in .*response, the folder of a rig test"),
    ],
)
def test_a_run_among_the_measurements_is_refused(fit: FitResult, tmp_path: Path, place: str, why: str) -> None:
    with pytest.raises(UsageError, match=f"{why}.* Name a run folder outside of it: --out runs/rig"):
        save_fit(tmp_path / place, fit)


@pytest.mark.parametrize("place", ["run", "rig/run", "rig_2", "rig/.runs/response", "."])
def test_a_run_beside_the_rig_tests_is_none_of_them(fit: FitResult, tmp_path: Path, place: str) -> None:
    save_fit(tmp_path / place, fit)
    assert equal(load_fit(tmp_path / place), fit)


def _older(run: Path) -> dict[str, bytes]:
    """What version 0.1.0 left in its run folders; its files by name."""
    run.mkdir()
    np.savez(run / "fit_state.npz", x=np.zeros(3), covariance=np.eye(3))
    (run / "fit.json").write_text('{"schema": "etcfit.fit/1", "converged": true, "reason": ""}', "utf-8")
    return {path.name: path.read_bytes() for path in run.iterdir()}


COMMANDS = [("fit", "rig", "--out", "run"), ("run", "rig", "--out", "run"),
            *((name, "run") for name in ("diagnose", "sample", "reduce", "design", "report"))]  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: words[0])
@pytest.mark.parametrize("version", ["none", "0.9.1"])
def test_a_run_of_another_version_is_left_alone(
    words: tuple[str, ...], version: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    results.rig(tmp_path / "rig")
    run = tmp_path / "run"
    _older(run)
    if version != "none":
        (run / MANIFEST).write_text(json.dumps({"schema": "etcfit.run/1", "version": version, "stages": {}}), "utf-8")
    there = {path.name: path.read_bytes() for path in run.iterdir()}
    done = CliRunner().invoke(app, [*words, "--quiet"])
    assert (done.exit_code, done.stdout) == (2, "")
    assert "version of etcfit (0.1)" in done.stderr or f"etcfit {version}" in done.stderr
    assert "Nothing in it was changed" in done.stderr
    assert {path.name: path.read_bytes() for path in run.iterdir()} == there


def test_the_manifest_is_the_contract(fit: FitResult, run: Path) -> None:
    save_fit(run, fit)
    content = json.loads((run / MANIFEST).read_text("utf-8"))
    assert set(content) == {"schema", "version", "stages", "aside"}
    stage = content["stages"]["fit"]
    assert {"at", "settings", "inputs", "outputs", "exit"} <= set(stage)
    assert set(stage["outputs"]) == {"fit.json", "fit_state.npz"}
    assert {"rig.toml", "response/1.csv", "response/2.csv"} <= set(stage["inputs"])


class Interrupted(Exception):
    """Somebody pulled the plug."""


class Runs:
    """`etcfit run` over models made by hand; `ran` names the stages that were run."""

    def __init__(self, tmp_path: Path) -> None:
        self.folder, self.run = tmp_path / "rig", tmp_path / "run"
        self.found = diagnoses.diagnosis(results.rig(self.folder))
        self.ran: list[str] = []
        self.interrupt = ""
        page = Stage("report", self.report)
        self.stages = (
            Stage("fit", self.fit),
            Stage("diagnose", self.diagnose),
            page,
            Stage("design", self.design, {"rule": "str"}),
            page,
        )
        self.said: dict[str, str | None] = {}
        self.expected: list[Expected | None] = []

    def beside(self, name: str) -> None:
        self.ran.append(name)
        if self.interrupt == name:
            raise Interrupted

    def fit(self, folder: Path, run: RunFolder, report: Report) -> Done:
        self.found = diagnoses.diagnosis(results.read_folder(folder))
        run.keep_fit(self.found.before)
        self.beside("fit")
        return Done("a fit")

    def diagnose(self, folder: Path, run: RunFolder, report: Report) -> Done:
        run.keep_diagnosis(replace(self.found, before=run.fit()))
        self.beside("diagnose")
        return Done("a diagnosis")

    def design(
        self,
        folder: Path,
        run: RunFolder,
        report: Report,
        rule: str = "optimal",
        draws: int = 200,
        outside: tuple[Path, ...] = (),
    ) -> Done:
        """What `save_design` does, of gains that say with which options they were made."""
        with replacing(run.path, "design", 0, {"rule": rule, "draws": draws}, outside=outside) as draft:
            write_json(draft / "pid.json", "pid", pid(rule))
            self.beside("design")
        return Done("gains")

    def report(self, folder: Path, run: RunFolder, report: Report) -> Done:
        self.beside("report")
        return Done(str(write_page(run.path).path))

    def go(self, **asked: Any) -> list[str]:
        """`etcfit run`, with options asked for of `etcfit design`."""
        self.ran, self.said, self.expected = [], {}, []

        def show(name: str, done: Done | None) -> None:
            self.said[name] = None if done is None else done.remark

        run_all(self.folder, self.run, self.waited, show, self.stages, {"design": asked})
        return self.ran

    def waited(self, expected: Expected | None) -> AbstractContextManager[Report]:
        """Progress, which is told how long the stage took before."""
        self.expected.append(expected)
        return _silently()

    def by_hand(self, **options: Any) -> None:
        """`etcfit design RUN` with options."""
        self.design(self.folder, RunFolder(self.run), lambda text, share: None, **options)

    @property
    def rule(self) -> str:
        return json.loads((self.run / "pid.json").read_text("utf-8"))["rule"]


@contextmanager
def _silently(expected: Expected | None = None) -> Iterator[Report]:
    yield lambda text, share: None


@pytest.fixture
def runs(tmp_path: Path) -> Runs:
    return Runs(tmp_path)


def test_a_second_time_there_is_nothing_to_do(runs: Runs) -> None:
    assert runs.go() == ALL
    assert runs.go() == []
    assert runs.said == dict.fromkeys(ALL)


def test_a_stage_that_is_made_again_says_how_long_it_took(runs: Runs) -> None:
    runs.go()
    assert runs.expected == [None] * len(ALL)
    note_seconds(runs.run, "fit", 12.34)
    _append(runs.folder / "rig.toml")
    runs.go()
    assert runs.expected[0] == (12.3, "as last time")
    assert runs.expected[1] == (2.5 * 12.3, "2.5 times as long as the fit, as a rule")


ALL = ["fit", "diagnose", "report", "design", "report"]
CHANGES = {
    "a trace is measured again": (lambda r: _append(r.folder / "response/1.csv"), ALL),
    "rig.toml is edited": (lambda r: _append(r.folder / "rig.toml"), ALL),
    "a file is touched": (lambda r: (r.folder / "rig.toml").touch(), []),
    "the page is gone": (lambda r: (r.run / "report.html").unlink(), ["report"]),
    "a result is gone": (lambda r: (r.run / "diagnosis.json").unlink(), ["diagnose"]),
    "a posterior came later": (lambda r: (r.run / "posterior.nc").write_bytes(b"chain"), []),
    "another fit was made by hand": (
        lambda r: save_fit(r.run, replace(r.found.before, chi2_per_dof=7.0)), ALL[1:],
    ),
    "somebody left a note": (lambda r: (r.run / "other.txt").write_text(""), []),
}  # fmt: skip


def _append(path: Path) -> None:
    path.write_text(path.read_text("utf-8") + "\n# again\n", "utf-8")


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_not_made_from_what_lies_there_is_made_again(runs: Runs, name: str) -> None:
    change, again = CHANGES[name]
    runs.go()
    change(runs)
    assert runs.go() == again
    assert runs.go() == []


AFTER = [("fit", ALL[1:]), ("diagnose", ALL[2:]), ("design", ALL[3:])]


@pytest.mark.parametrize(("stage", "again"), AFTER)
def test_a_run_that_was_interrupted_while_pictures_were_drawn_keeps_its_models(
    runs: Runs, stage: str, again: list[str]
) -> None:
    runs.interrupt = stage  # models are there, gains once they are drawn
    with pytest.raises(Interrupted):
        runs.go()
    runs.interrupt = ""
    assert runs.go() == again
    assert runs.go() == []


def test_the_page_comes_before_a_stage_that_is_made_again_and_without_its_files(runs: Runs) -> None:
    runs.go()
    AFRESH["its file was edited"](runs)
    (runs.run / "report.html").unlink()
    runs.interrupt = "design"
    with pytest.raises(Interrupted):
        runs.go()
    assert runs.ran == ["report", "design"]
    assert (runs.run / SUPERSEDED / "pid.json").is_file()


def test_gains_made_with_options_are_kept_while_nothing_else_changes(runs: Runs) -> None:
    runs.go()
    runs.by_hand(rule="simc")
    assert runs.go() == ["report"]
    assert (runs.rule, runs.said["design"]) == ("simc", None)


AFRESH: dict[str, Callable[[Runs], object]] = {
    "the posterior that they were made with is another": lambda r: _sampled_before(r),
    "the measurements changed": lambda r: _append(r.folder / "rig.toml"),
    "the fit was made again by hand": lambda r: save_fit(r.run, replace(r.found.before, chi2_per_dof=7.0)),
    "its file was edited": lambda r: _append(r.run / "pid.json"),
}


def _sampled_before(runs: Runs) -> None:
    for chain in ("chain", "a longer chain"):
        with replacing(runs.run, "sample", 0, {}) as draft:
            (draft / "posterior.nc").write_text(chain, "utf-8")
        if chain == "chain":
            runs.by_hand(rule="simc")


@pytest.mark.parametrize("name", AFRESH)
def test_gains_made_anew_are_made_with_the_options_that_they_had_and_said_to_be(runs: Runs, name: str) -> None:
    runs.go()
    runs.by_hand(rule="simc")
    AFRESH[name](runs)
    assert "design" in runs.go()
    assert (runs.rule, runs.said["design"]) == ("simc", 'made anew, with rule "simc" as before')
    assert runs.go() == []


@pytest.mark.parametrize("name", ["fleet.json", "drive.csv"])
def test_gains_are_made_anew_where_a_fleet_or_a_log_that_they_were_made_from_has_changed(runs: Runs, name: str) -> None:
    outside = runs.run.parent / "elsewhere" / name
    outside.parent.mkdir()
    outside.write_text("as it was", "utf-8")
    runs.go()
    runs.by_hand(rule="simc", outside=(outside,))
    recorded = json.loads((runs.run / MANIFEST).read_text("utf-8"))["stages"]["design"]["inputs"]
    assert recorded[f"../elsewhere/{name}"] == sha256(outside)
    assert runs.go() == ["report"]
    outside.write_text("measured again", "utf-8")
    assert "design" in runs.go()
    runs.by_hand(rule="simc", outside=(outside,))
    runs.go()
    outside.unlink()  # nothing newer can be made without it
    assert runs.go() == []


def test_gains_that_are_asked_for_otherwise_are_made_anew_and_kept_where_nobody_asks(runs: Runs) -> None:
    assert runs.go(rule="simc") == ALL
    assert (runs.rule, runs.said["design"]) == ("simc", "")
    assert runs.go(rule="simc") == runs.go() == []
    assert runs.go(rule="amigo") == ["design", "report"]
    assert (runs.rule, runs.said["design"]) == ("amigo", 'made anew; other than before: rule "amigo"')
    assert runs.go() == []


def test_what_no_option_of_a_command_says_is_not_replaced_without_a_word(runs: Runs) -> None:
    runs.go()
    runs.by_hand(rule="simc", draws=50)  # as Python may
    AFRESH["its file was edited"](runs)
    runs.go()
    assert runs.said["design"] == 'made anew, with rule "simc" as before; other than before: draws 200'


def test_a_model_that_did_not_converge_is_told_also_where_it_was_skipped(runs: Runs) -> None:
    runs.go()
    odd = replace(runs.found.after, converged=False, reason="too rough")
    save_diagnosis(runs.run, replace(runs.found, after=odd))
    assert write_page(runs.run).failure == "the fit of the model that is shown did not converge: too rough"
    assert read_records(runs.run)["report"].exit == 3
    failure = run_all(runs.folder, runs.run, _silently, lambda name, done: None, ())
    assert failure == "the fit of the model that is shown did not converge: too rough"


def test_a_run_of_other_measurements_is_not_overwritten(runs: Runs, tmp_path: Path) -> None:
    runs.go()
    results.rig(tmp_path / "other")
    with pytest.raises(UsageError, match="not from"):
        run_all(tmp_path / "other", runs.run, _silently, lambda name, done: None, runs.stages)


def test_without_files_nothing_is_done(runs: Runs) -> None:
    assert not any(is_done(runs.run, stage.name, runs.folder) for stage in STAGES)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("fit rig --out rig", "is the measurement folder itself"),
        ("run rig --out rig/response/runs/a", "the folder of a rig test"),
        ("drive rig --out rig", "is the measurement folder itself"),
        ("drive logs --out logs", "is the measurement folder itself"),
        ("drive logs/lap.csv --out rig/response", "the folder of a rig test"),
        ("check rig --advise --out rig", "is the measurement folder itself"),
        ("export run --to c --out rig", "is the measurement folder itself"),
        ("export run --to c --out rig/drive/c", "the folder of a rig test"),
    ],
)
def test_a_command_refuses_it_before_it_begins(
    fit: FitResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, why: str
) -> None:
    monkeypatch.setattr("etcfit.estimation.joint_fit.fit", lambda *_: pytest.fail("it was fitted"))
    save_fit(tmp_path / "run", fit)
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "lap.csv").write_text("time [s],position [%]\n" + "".join(f"{k},{k}\n" for k in range(9)))
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    done = CliRunner().invoke(app, [*words.split(), "--quiet"])
    assert (done.exit_code, done.stdout) == (2, "")
    assert why in done.stderr
    assert "Name a run folder outside of it" in done.stderr
    assert sorted(tmp_path.rglob("*")) == before
