"""The list of stages and the files of a run folder go together."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import diagnoses
import etcfit
import results
import runs
from equality import equal
from etcfit.api.explanation import Diagnosed
from etcfit.api.work import design_of, keep_diagnosis, keep_fit
from etcfit.control.pid import Requirements
from etcfit.control.request import DesignRequest
from etcfit.diagnosis.findings import Diagnosis
from etcfit.diagnosis.refit import start
from etcfit.diagnosis.rounds import Progress
from etcfit.diagnosis.settings import DEFAULT
from etcfit.errors import UsageError
from etcfit.estimation.result import FitResult
from etcfit.reporting import draw_others, drawing, has_undrawn
from etcfit.reporting.blocks import render
from etcfit.reporting.diagnosis.pictures import jobs as jobs_of_diagnosis
from etcfit.reporting.pictures import jobs
from etcfit.run_folder.folder import RunFolder
from etcfit.run_folder.manifest import STAGE_FILES, read_records
from etcfit.run_folder.state import has_diagnosis, save_diagnosis
from etcfit.stages import (
    REPORT,
    STAGES,
    Done,
    Stage,
    design_run,
    diagnose_run,
    expected,
    fit_folder,
    opened,
    reduce_run,
    sample_run,
    stages_until,
    write_report,
)


def test_every_stage_has_its_files_in_the_same_order() -> None:
    assert [*(stage.name for stage in STAGES if stage is not REPORT), REPORT.name] == list(STAGE_FILES)


def test_a_stage_is_made_from_what_those_before_it_make() -> None:
    made: set[str] = set()
    for files in STAGE_FILES.values():
        assert {*files.needs, *files.uses} <= made
        assert not {*files.may_use} & made, "what comes before is `uses`"
        made |= set(files.makes)
    assert {name for files in STAGE_FILES.values() for name in files.may_use} <= made


def test_the_page_follows_every_stage_that_somebody_waits_for() -> None:
    names = [stage.name for stage in STAGES]
    assert names == ["fit", "diagnose", "report", "reduce", "design", "report", "sample", "report"]


@pytest.mark.parametrize(
    ("last", "names"),
    [("fit", ["fit", "report"]), ("diagnose", ["fit", "diagnose", "report"]),
     ("reduce", ["fit", "diagnose", "report", "reduce", "report"]),
     ("design", ["fit", "diagnose", "report", "reduce", "design", "report"]),
     ("sample", ["fit", "diagnose", "report", "reduce", "design", "report", "sample", "report"])],
)  # fmt: skip
def test_a_run_ends_with_the_stage_that_is_named_and_the_page(last: str, names: list[str]) -> None:
    assert [stage.name for stage in stages_until(last)] == names


def test_a_run_cannot_end_with_a_stage_that_there_is_not() -> None:
    with pytest.raises(UsageError, match=r"no stage report to end with\. There are fit, diagnose, reduce, design, "):
        stages_until("report")


def test_the_report_shows_every_result() -> None:
    results = {name for files in STAGE_FILES.values() for name in files.makes if name.endswith(".json")}
    assert results == set(STAGE_FILES["report"].uses)


def test_no_two_stages_make_one_file() -> None:
    made = [name for files in STAGE_FILES.values() for name in (*files.makes, *files.beside)]
    assert len(made) == len(set(made))


class Enough(Exception):
    """What was to be seen was seen."""


def silent(text: str, share: float) -> None:
    """No progress."""


def pictures_of(run: RunFolder) -> set[str]:
    """Paths below RUN/pictures."""
    base = run.path / "pictures"
    return {path.relative_to(base).as_posix() for path in base.rglob("*.png")}


ONLY_LATER = {"tests/resistance.png", "traces/response__2.png"}  # among the pictures that a fit leaves undrawn


@pytest.fixture
def found(tmp_path: Path) -> Diagnosis:
    return diagnoses.diagnosis(results.rig(tmp_path / "rig"))


@pytest.mark.slow
def test_the_fit_of_a_folder_is_kept_drawn_and_shown(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("etcfit.estimation.joint_fit.fit", lambda rig, report: found.before)
    run = opened(tmp_path / "run")
    done = fit_folder(tmp_path / "rig", run, silent)
    assert done.failure == ""
    assert run.fit() is found.before
    assert pictures_of(run) == {"parameters.png"}
    assert read_records(run.path)["fit"].exit == 0
    took = read_records(run.path)["fit"].seconds
    assert took is not None
    assert expected(run.path, "fit") == (took, "as last time")
    assert expected(run.path, "reduce") is None
    assert done.closing is not None
    assert done.closing.next.startswith("etcfit ")


@pytest.fixture
def kept(found: Diagnosis, tmp_path: Path, drawn_quickly: None) -> RunFolder:
    """A run folder with a fit and a diagnosis, as their commands leave it."""
    run = opened(tmp_path / "run")
    keep_fit(run, found.before)
    keep_diagnosis(run, found)
    return run


def test_a_model_leaves_the_picture_that_sums_it_up_and_the_page_draws_the_others(
    kept: RunFolder, found: Diagnosis
) -> None:
    assert pictures_of(kept) == {"parameters.png", "diagnosis/ledger.png", "before/parameters.png"}
    note = kept.path / "pictures" / "undrawn.txt"
    assert f"etcfit report {kept.path}" in note.read_text(encoding="utf-8")
    write_report(opened(kept.path), silent)  # as another process would
    drawn = pictures_of(kept)
    of_model = {path.as_posix() for path, _ in jobs(found.after)}
    assert drawn == {
        *of_model, *(f"before/{name}" for name in of_model),
        *(f"diagnosis/{path.as_posix()}" for path, _ in jobs_of_diagnosis(found)),
    }  # fmt: skip
    assert of_model > ONLY_LATER
    assert not note.exists()
    page = (kept.path / "report.html").read_text(encoding="utf-8")
    assert page.count("<img ") == len(drawn)


def test_drawing_goes_on_where_it_was_interrupted_and_no_result_is_lost(
    kept: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = list[Path]()

    def draw(path: Path, figure: Any) -> None:
        if len(drawn) == 3:
            raise KeyboardInterrupt
        drawn.append(path)
        runs.picture(path)

    monkeypatch.setattr(drawing, "draw_one", draw)
    with pytest.raises(KeyboardInterrupt, match=r"All results are in .*`etcfit report .*` draws"):
        write_report(kept, silent)
    first = list(drawn)
    assert all(path.is_file() for path in first)
    assert {"fit", "diagnose"} <= set(read_records(kept.path))
    drawn[:] = [Path()] * 4  # never 3 again
    write_report(kept, silent)
    assert not set(drawn[4:]) & set(first)
    assert not has_undrawn(kept.path)


@pytest.mark.usefixtures("drawn_quickly")
def test_a_fit_whose_picture_was_interrupted_is_kept(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    run = opened(tmp_path / "run")
    with monkeypatch.context() as patched:
        patched.setattr("etcfit.reporting.drawing.draw_one", interrupted)
        with pytest.raises(KeyboardInterrupt, match="All results are in"):
            keep_fit(run, found.before)
    assert equal(opened(run.path).fit(), found.before)
    draw_others(run, silent)
    assert pictures_of(run) > {"parameters.png", *ONLY_LATER}


def test_a_page_is_written_without_pictures_that_cannot_be_drawn_any_more(
    kept: RunFolder, found: Diagnosis, tmp_path: Path
) -> None:
    with (tmp_path / "rig" / "rig.toml").open("a", encoding="utf-8") as toml:
        toml.write("\n# edited since\n")
    done = write_report(opened(kept.path), silent)
    assert "has changed since" in done.remark
    assert (kept.path / "report.html").is_file()
    assert not pictures_of(kept) & ONLY_LATER
    with pytest.warns(UserWarning, match="has changed since"):
        etcfit.report(kept.path, quiet=True)


def test_a_diagnosis_starts_from_the_fit_as_it_was(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[FitResult] = []

    def diagnose(result: FitResult, report: Any, begun: Any, keep: Any) -> Diagnosis:
        taken.append(result)
        raise Enough

    monkeypatch.setattr("etcfit.diagnosis.diagnose", diagnose)
    opened(tmp_path / "run").keep_fit(found.before)
    with pytest.raises(Enough):
        diagnose_run(opened(tmp_path / "run"), silent)  # as another process would
    assert equal(taken[0], found.before)


def test_an_interrupted_diagnosis_tells_what_it_found_and_goes_on_from_there(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = results.result(found.before.rig, far=True)
    first = Progress(start(far, DEFAULT), rounds=found.rounds[:1])
    taken: list[Progress | None] = []

    def diagnose(result: FitResult, report: Any, begun: Progress | None, keep: Any) -> Diagnosis:
        taken.append(begun)
        if begun is None:
            keep(first)
            raise KeyboardInterrupt
        return replace(found, before=result)

    monkeypatch.setattr("etcfit.diagnosis.diagnose", diagnose)
    monkeypatch.setattr("etcfit.reporting.draw_diagnosis", lambda *_: None)
    opened(tmp_path / "run").keep_fit(far)
    with pytest.raises(KeyboardInterrupt, match=r"after round 1\..*etcfit diagnose .*goes on"):
        diagnose_run(opened(tmp_path / "run"), silent)
    assert not has_diagnosis(tmp_path / "run")
    diagnose_run(opened(tmp_path / "run"), silent)
    assert taken[0] is None
    assert equal(taken[1], first)
    assert has_diagnosis(tmp_path / "run")
    assert not (tmp_path / "run" / "diagnosis_rounds.npz").exists()


def test_the_posterior_is_that_of_the_final_model_with_its_formulas_taken_as_exact(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Any, ...]] = []

    def sample(*words: Any) -> None:
        asked.append(words)
        raise Enough

    monkeypatch.setattr("etcfit.posterior.sampling.sample", sample)
    wide = replace(found.after, formulas=(diagnoses.FOUND,), exact_covariance=0.5 * found.after.covariance)
    save_diagnosis(tmp_path / "run", replace(found, after=wide))
    with pytest.raises(Enough):
        sample_run(opened(tmp_path / "run"), silent, 700)
    (result, folder, steps, _, exact) = asked[0]
    assert (folder, steps, exact) == (tmp_path / "run", 700, (diagnoses.FOUND,))
    assert equal(result, wide.taken_as_exact())
    assert result.covariance[0, 0] < wide.covariance[0, 0]


def options_of(name: str) -> Mapping[str, str]:
    return next(stage for stage in STAGES if stage.name == name).options


def test_a_reduction_is_written_and_made_anew_from_what_the_manifest_has(found: Diagnosis, tmp_path: Path) -> None:
    asked = {"input": "%", "output": "deg", "at": 0.5, "pade_order": 2}
    run = opened(tmp_path / "run")
    run.keep_fit(found.before)
    done = reduce_run(run, silent, **asked)
    settings = read_records(run.path)["reduce"].settings
    assert {name: settings[name] for name in options_of("reduce")} == asked
    written = json.loads((run.path / "transfer_function.json").read_text(encoding="utf-8"))
    assert (written["schema"], written["output"]["unit"]) == ("etcfit.transfer_function/1", "deg")
    assert (run.path / "pictures" / "control" / "bode.png").stat().st_size > 10_000
    assert "SYNTHETIC DATA" in render(done.shown)


def test_gains_are_made_anew_from_what_the_manifest_has_of_them(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[DesignRequest] = []
    kept: list[dict[str, Any]] = []
    monkeypatch.setattr("etcfit.api.work.design_of", lambda fitted, request, *_: asked.append(request))
    monkeypatch.setattr("etcfit.api.work.keep_design", lambda run, result, design, settings, _: kept.append(settings))
    monkeypatch.setattr("etcfit.api.controller.design_table", lambda design: "a table")
    monkeypatch.setattr("etcfit.reporting.closing.control.of_design", lambda *_: None)
    run = opened(tmp_path / "run")
    run.keep_fit(found.before)
    wanted = DesignRequest("simc", 10, True, {"overshoot_pct": 10.0}, {"period": 2e-3}, "link", "a.csv", Path("line"))
    design_run(run, silent, wanted)
    again = json.loads(json.dumps(kept[0]))
    assert set(again) == set(options_of("design"))
    (design,) = (stage for stage in STAGES if stage.name == "design")
    design.work(tmp_path, run, silent, **again)
    assert asked == [wanted, replace(wanted, parts="line")]  # as the manifest has it


def test_what_is_asked_for_reaches_the_design(found: Diagnosis, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[Any, ...]] = []
    monkeypatch.setattr("etcfit.control.design.design", lambda *args, parts: given.append(args))
    wanted = DesignRequest("simc", 10, True, {"overshoot_pct": 10.0}, {"period": 2e-3}, "link")
    design_of(found.before.fitted(), wanted, None, silent)
    ((_, computer, requirements, rule, drawn, feed_forward, _, _, make, log, _),) = given
    assert (requirements, rule, drawn, feed_forward, log) == (Requirements(10.0), "simc", None, True, None)
    assert (computer.period, make.name) == (2e-3, "link")


def test_run_gives_the_last_model_back(
    found: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run_all(folder: Path, path: Path, progress: Any, show: Any, stages: tuple[Stage, ...], asked: Any) -> str:
        assert (folder, asked) == (tmp_path / "rig", {"design": {"profile": "rusefi"}})
        assert stages == stages_until("design")
        save_diagnosis(path, found)
        show("design", Done(None, remark="made of \x1b[2J\u202e.csv"))
        return ""

    monkeypatch.setattr("etcfit.stages.run_all", run_all)
    last = etcfit.run(str(tmp_path / "rig"), str(tmp_path / "run"), profile="rusefi", until="design")
    assert capsys.readouterr().err == "design: made of (U+001B)[2J(U+202E).csv\n"
    assert isinstance(last, Diagnosed)
    assert equal(last.diagnosis, found)
