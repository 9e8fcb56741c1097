"""Every command ends with what came of it, a file that exists, and a command that can be typed as it stands."""

from __future__ import annotations

import hashlib
import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import fleet_pages
import runs
from etcfit.cli import app
from etcfit.control.design import Design
from etcfit.control.judged import Robust, Tuned
from etcfit.control.loop_figures import LoopFigures
from etcfit.control.pid.base import Task
from etcfit.errors import command
from etcfit.estimation.fitted_model import SOUND, FitState
from etcfit.model.ecus import ECUS
from etcfit.reporting.closing import Closing, first_few
from etcfit.reporting.closing.control import of_design, of_export, of_fleet
from etcfit.reporting.closing.model import of_run
from partial import partial


def test_three_lines_and_the_files_that_are_there(tmp_path: Path) -> None:
    there = tmp_path / "a page.html"
    there.touch()
    closing = Closing("All is well.", "etcfit report runs/a", (tmp_path / "gone.png", there))
    assert str(closing).splitlines() == ["Answer: All is well.", f"Look:   '{there}'", "Next:   etcfit report runs/a"]
    assert str(Closing("Yes.", "etcfit check a")) == "Answer: Yes.\nNext:   etcfit check a"


def test_a_path_with_blanks_is_one_word_of_the_next_command() -> None:
    assert shlex.split(command("diagnose", Path("runs/my throttle"))) == ["etcfit", "diagnose", "runs/my throttle"]


@pytest.mark.parametrize(
    ("names", "words"),
    [(["R_a"], "R_a"), (["R_a", "K_b"], "R_a and K_b"), (["R_a", "K_b", "L_a"], "R_a, K_b and L_a"),
     (["R_a", "K_b", "L_a", "J"], "R_a, K_b and 2 more")],
)  # fmt: skip
def test_names_are_counted_where_there_are_many(names: list[str], words: str) -> None:
    assert first_few(names) == words


def scored(run: Path, kind: str, left: str) -> None:
    """The same run, with all its residuals of one kind."""
    content = json.loads((run / f"{kind}.json").read_text("utf-8"))
    key = "score" if kind == "fit" else "after"
    rows = [row | {"left": left} for row in content[key]["fit"]]
    runs.changed(run, kind, **{key: content[key] | {"fit": rows, "chi2_per_dof": 1.01}})


def test_a_fit_that_leaves_more_than_noise_says_how_much_and_asks_for_a_diagnosis(tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    scored(run, "fit", "more")
    closing = of_run(run)
    assert "the model leaves noise in 0 of " in closing.answer
    assert closing.next == f"etcfit diagnose {run}"
    assert closing.look == (run / "pictures" / "parameters.png",)


def test_a_fit_far_from_its_data_gives_ranges_and_asks_for_a_diagnosis(tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path)
    runs.changed(run, "fit", compromise="the model is far from the data (chi2/dof 2e+03)")
    closing = of_run(run)
    assert closing.answer.startswith("Parameters are ranges, not estimates: the model is far from the data")
    assert closing.next == f"etcfit diagnose {run}"


def test_a_fit_that_leaves_noise_goes_on_to_gains_or_to_what_it_cannot_tell(tmp_path: Path) -> None:
    for part, lost in (("a", ()), ("b", ("K_b",))):
        (tmp_path / part).mkdir()
        run = runs.run_folder(tmp_path / part, lost=lost)
        scored(run, "fit", "strays")
        closing = of_run(run)
        assert "leaves nothing but noise from sample to sample" in closing.answer
        assert ("cannot tell K_b" in closing.answer) == bool(lost)
        folder = tmp_path / part / "rig"
        assert closing.next == (f"etcfit check {folder} --advise --at {run}" if lost else f"etcfit design {run}")


def test_gains_from_logs_of_a_car_are_what_a_run_answers(tmp_path: Path) -> None:
    run = runs.run_folder(tmp_path, ("pid",))
    says = {"answer": "Half-way gains to try first: P 3.", "next": ["Type them in."]}
    made_from = hashlib.sha256((run / "pid.json").read_bytes()).hexdigest()
    told = {"schema": "etcfit.tune/1", "pid": made_from, "says": says, "steps": [{}, {}]}
    (run / "tune.json").write_text(json.dumps(told), "utf-8")
    copy = (tmp_path / "mine_etcfit.msq",)
    assert "half-way gains of etcfit tune before them" in of_export(copy, (), "a tune", SOUND, run).next
    assert "half-way" not in of_export((tmp_path / "throttle.c",), (), "C99", SOUND, run).next
    closing = of_run(run)
    assert closing.answer == says["answer"]
    assert closing.next == f"etcfit drive NEXT_LOG --foretold {run}"
    runs.changed(run, "pid", name="designed since")
    assert "Half-way" not in of_run(run).answer


def test_the_measurement_folder_is_seen_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run = runs.run_folder(Path(), lost=("K_b",))
    scored(run, "fit", "strays")
    assert of_run(run).next == "etcfit check rig --advise --at run"


@pytest.fixture
def diagnosed(tmp_path: Path) -> Path:
    run = runs.run_folder(tmp_path, ("diagnosis",))
    scored(run, "diagnosis", "fits")
    return run


def stated(acted_on: bool, sentence: str) -> list[dict[str, Any]]:
    return [{"effect": "limp_home_spring", "acted_on": acted_on, "sentence": sentence}]


def test_a_name_that_is_proven_is_said_and_gains_come_next(diagnosed: Path) -> None:
    closing = of_run(diagnosed, diagnosed / "report.html")
    assert closing.answer.startswith("Found: the model lacked limp_home_spring (0.90).")
    assert closing.next == f"etcfit design {diagnosed}"
    assert closing.look == (diagnosed / "report.html", diagnosed / "pictures" / "diagnosis" / "ledger.png")


def test_a_name_that_is_not_proven_instructs_nobody(diagnosed: Path) -> None:
    mistake = {"effect": "limp_home_spring", "sentence": "mend me", "mend": "[scale]", "kind": "channel_gain"}
    said = "There may be a mistake. A measurement that would decide: a probe."
    runs.changed(diagnosed, "diagnosis", statements=stated(False, said), rig=[mistake])
    closing = of_run(diagnosed)
    assert closing.answer.startswith(said)
    assert "[scale]" not in str(closing)
    assert "--advise" in closing.next


def test_a_proven_mistake_of_the_rig_is_mended_before_the_next_fit(diagnosed: Path) -> None:
    mistake = {"effect": "limp_home_spring", "sentence": "the probe reads high", "mend": "probe = 1.1",
               "kind": "channel_gain"}  # fmt: skip
    runs.changed(diagnosed, "diagnosis", statements=stated(True, "Found: the probe reads high."), rig=[mistake])
    closing = of_run(diagnosed)
    assert closing.answer.startswith("Found: the probe reads high.")
    folder = diagnosed.parent / "rig"
    assert closing.next == (
        f"etcfit fit {folder} --out {diagnosed}, after this change in {folder / 'rig.toml'}: probe = 1.1"
    )


def test_what_no_effect_explains_is_looked_at(diagnosed: Path) -> None:
    runs.changed(diagnosed, "diagnosis", added=[], statements=[], probabilities={"stiction": 0.3, "unexplained": 0.98})
    scored(diagnosed, "diagnosis", "more")
    closing = of_run(diagnosed)
    assert "no known effect explains it; it may be stiction (P 0.30), not proven" in closing.answer
    assert closing.next == f"etcfit report {diagnosed} --interactive"
    page = diagnosed / "report_interactive.html"
    assert "--advise" in of_run(diagnosed, page).next, "the page is open already"


def test_a_fit_that_did_not_converge_has_no_results(diagnosed: Path) -> None:
    runs.changed(diagnosed, "diagnosis", converged=False, reason="too rough", probabilities={"limp_home_spring": 0.9})
    closing = of_run(diagnosed)
    assert "did not converge: too rough. Its parameters are no results." in closing.answer
    assert closing.next == f"etcfit report {diagnosed} --interactive"


@pytest.mark.parametrize(
    ("profile", "met", "further"),
    [
        (None, True, "etcfit design runs/a --ecu NAME, for gains as your ECU writes them; NAME: rusefi, "),
        ("rusefi", True, "etcfit export runs/a --to msq"),
        ("rusefi", False, "etcfit report runs/a"),
        ("link", True, "etcfit report runs/a"),
    ],
)
def test_gains_that_fail_in_a_corner_are_not_sent_into_an_ecu(
    profile: str | None, met: bool, further: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("etcfit.reporting.closing.control.said_of", lambda design: "Gains.")
    good = LoopFigures(10.0, 0.1, 0.2, 1.0, 12.0, 45.0, 4.0)
    made = partial(
        Design,
        task=partial(Task, profile=None if profile is None else ECUS[profile]),
        chosen=partial(Tuned, linear=good, met={"overshoot_pct": True}),
        robust=partial(Robust, stable=True, met={"overshoot_pct": met}),
    )
    closing = of_design(made, SOUND, Path("runs/a"))
    assert closing.next.startswith(further)
    compromised = of_design(made, FitState(90.0, True, "", "the model is far from the data"), Path("runs/a"))
    assert compromised.next == "etcfit diagnose runs/a"


def test_what_is_exported_from_a_compromise_is_not_to_be_used(tmp_path: Path) -> None:
    state = FitState(90.0, True, "", "the model is far from the data")
    files = (tmp_path / "plant.c",)
    assert "Do not use it yet" in of_export(files, (), "C99", state, tmp_path).answer
    assert of_export(files, (), "C99", state, tmp_path).next == f"etcfit diagnose {tmp_path}"
    assert "Do not use" not in of_export(files, (), "C99", SOUND, tmp_path).answer


def test_a_fleet_says_what_somebody_must_do_something_about(tmp_path: Path) -> None:
    content = fleet_pages.fleet(20, 1).content
    oddest = content["odd"][0]["unit"]
    content["members"][oddest]["page"] = f"units/{oddest}.html"
    closing = of_fleet(content, tmp_path)
    assert f"1 unit is odd (5.0 %): {oddest}" in closing.answer
    assert closing.look == (tmp_path / "fleet.html", tmp_path / "units" / f"{oddest}.html")
    assert closing.next == f"etcfit design {tmp_path} --fleet"


def closing_of(*words: Any) -> list[str]:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.stderr
    return done.stdout.splitlines()[-3:]


def test_commands_that_make_a_folder_say_where_and_what_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer, look, further = closing_of("new", "my rig")
    assert answer.startswith("Answer: A rig.toml with every key explained")
    assert look == "Look:   'my rig/rig.toml'"
    assert further.startswith("Next:   etcfit import RECORDING --to FOLDER --rig 'my rig/rig.toml'")
    Path("my rig/log.csv").write_text("time [s],voltage [V],position [rad]\n" + "".join(
        f"{0.001 * k},{1.0 + (k // 50) % 3},{0.1 + 0.001 * (k % 50)}\n" for k in range(500)))  # fmt: skip
    answer, look, further = closing_of("import", "my rig/log.csv", "--to", "mine", "--yes", "--quiet",
                                       "--test", "my rig/log.csv=response")  # fmt: skip
    assert answer.startswith("Answer: 1 trace of 1 rig test")
    assert (look, further) == ("Look:   mine/rig.toml", "Next:   etcfit check mine")
