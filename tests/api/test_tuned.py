"""From logs of a car to gains: what stops it, what is withheld, what is said."""

from __future__ import annotations

import html
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import etcfit
import results
from etcfit.api.tuned import Tuned, TuneRequest, keep_tuned, reasons_to_withhold, tuned_json
from etcfit.api.work import keep_design, keep_fit
from etcfit.car_log.foretold import Comparison, Figure
from etcfit.cli import app
from etcfit.control.borne import Borne
from etcfit.control.design import ecu_of, task_of
from etcfit.control.pid import Gains
from etcfit.control.proposal import SHOWN, gain_steps, not_held
from etcfit.estimation.result import FitResult
from etcfit.importing.tuning import DUTY, LogCheck, TuneInput
from etcfit.model.ecus import ECUS
from etcfit.reporting.car_log import Held
from etcfit.reporting.closing.control import of_foretold, of_tune
from etcfit.reporting.numbers import short
from etcfit.reporting.page import write_page
from etcfit.reporting.tune import of_requirements
from etcfit.run_folder.folder import RunFolder
from independent.cars import draw_car, log_of, tracking_errors, write_log
from schemas import read_valid, validator

ASKED = TuneRequest("rusefi", ((1.0, 5.0, 0.01),))


def validated(written: dict[str, Any]) -> dict[str, Any]:
    validator("tune").validate(written)
    return written


@pytest.fixture(scope="module")
def tuned(fit: FitResult) -> Tuned:
    """A sound model, by one quick rule."""
    of, rusefi = fit.fitted(), ECUS["rusefi"]
    task = task_of(of, ecu_of(of, **rusefi.fixes), settings=results.BRIEF, profile=rusefi)
    design = results.proposed(of, task, "damping_optimum")
    steps = gain_steps(design, Gains(*(0.5 * gain for gain in design.proposed)))
    told = TuneInput(DUTY, "so", (LogCheck("fast enough", True, True, "so"),), {}, "", 12.0, 1e-3)
    return Tuned(ASKED, told, (), fit, design, steps, (0.97, 0.98))


def test_a_proposal_is_a_change_from_the_present_gains(tuned: Tuned) -> None:
    written = validated({"schema": "etcfit.tune/1"} | tuned_json(tuned))
    assert written["verdict"] == "gains"
    assert [step["name"] for step in written["steps"]] == ["present", "half_way", "proposed"]
    assert written["steps"][1]["factors"] == pytest.approx(dict.fromkeys("PID", 2**0.5))
    assert written["steps"][2]["factors"] == pytest.approx(dict.fromkeys("PID", 2.0))
    shown = tuned.summary()
    assert "x 1.41" in shown
    assert "x 2.00" in shown
    assert shown.index("half way") < shown.index("proposed")


def test_the_error_on_what_was_held_out_is_in_per_cent_of_the_travel(tuned: Tuned) -> None:
    result = tuned.result
    assert result is not None
    assert result.holdout is not None
    low, high = result.rig.config.travel
    squares = [
        (trace.data - result.predicted[trace.measurement.file])[:, trace.channels.index("position")] ** 2
        for trace in result.holdout.batch.traces if "position" in trace.channels
    ]  # fmt: skip
    rms = np.sqrt(np.nanmean(np.concatenate(squares)))
    assert tuned.held_out_error == pytest.approx(100.0 * rms / (high - low))


def test_a_model_that_never_reaches_a_step_is_none_to_tune_for(tuned: Tuned) -> None:
    last = tuned.steps[-1]
    missed = {**last.scenarios, SHOWN: replace(last.scenarios[SHOWN], steady_state_error_pct=80.0)}
    assert "do not determine its preload" in not_held([replace(last, scenarios=missed)])
    held = {**last.scenarios, SHOWN: replace(last.scenarios[SHOWN], steady_state_error_pct=0.3)}
    assert not_held([replace(last, scenarios=held)]) == ""


def test_a_long_finding_folds_and_leaves_the_table_of_checks_whole(tuned: Tuned) -> None:
    long = LogCheck("fast enough", True, True, "the log misses duties, for the ECU computes one every 2 ms " * 3)
    shown = replace(tuned, input=replace(tuned.input, checks=(long,))).summary(80)
    (line,) = [line for line in shown.splitlines() if line.startswith("fast enough")]
    assert line.split()[2:5] == ["ok", "the", "log"]
    assert shown.count("\ncheck ") == 1


@pytest.mark.parametrize(
    ("settling", "said"),
    [
        ((0.11, 0.12, 0.15), "settle in 0.11..0.15 s (95 %"),
        ((0.44, np.inf, np.inf), "settle in 0.44 s or later, in some models not before the next step (95 %"),
        ((np.inf, np.inf, np.inf), "not settle before the next step (95 %"),
    ],
)
def test_what_the_next_log_should_show_is_a_sentence_even_where_nothing_settles(
    tuned: Tuned, settling: tuple[float, float, float], said: str
) -> None:
    present, half, proposed = tuned.steps
    shown = replace(tuned, steps=(present, replace(half, settling=settling), proposed)).summary(1000)
    assert said in shown
    assert "never s" not in shown
    if not np.isfinite(settling[-1]):
        assert "never: not before the next step" in shown


def test_the_next_command_asks_whether_the_next_log_is_as_foretold(tuned: Tuned, tmp_path: Path) -> None:
    said = of_tune(tuned, tmp_path / "car", [Path("lap.csv")]).next
    assert said.endswith(f"then: etcfit drive NEXT_LOG --foretold {tmp_path / 'car'}")
    alone = replace(tuned, steps=tuned.steps[-1:])
    assert "etcfit tune lap.csv" in of_tune(alone, tmp_path / "car", [Path("lap.csv")]).next


def held(tuned: Tuned, run: Path, as_foretold: bool, made_with: str = "half_way") -> Held:
    """A log that is as foretold, or not."""
    figure = Figure("overshoot", "% of the step", 4.0, 6.0, -np.inf, 8.0, 5.0 if as_foretold else 20.0)
    return Held("next.csv", run, made_with, tuned_json(tuned), Comparison(2, (figure,), True, False))


def test_as_foretold_leads_on_and_anything_else_back_to_tune(tuned: Tuned, tmp_path: Path) -> None:
    """The proposed gains are needed once the half-way ones are confirmed: the run is spared."""
    run, log = tmp_path / "car", Path("next.csv")
    proposed = [short(gain, 4) for gain in tuned.written(tuned.steps[2].gains)]
    said = of_foretold(held(tuned, run, as_foretold=True), log).next
    assert said.startswith("type in the proposed gains, engine off: ")
    assert all(gain in said for gain in proposed)
    assert said.endswith(f"etcfit drive NEXT_LOG --foretold {run} --made-with proposed")
    assert of_foretold(held(tuned, run, True, "proposed"), log).next.startswith("keep these gains")
    assert "type in the half-way gains" in of_foretold(held(tuned, run, True, "present"), log).next
    run.mkdir()
    bad = of_foretold(held(tuned, run, as_foretold=False), log)
    assert "overshoot 20.0 % of the step, foretold 4.00..6.00" in bad.answer
    assert f"etcfit tune {log} --ecu rusefi --present " in bad.next
    assert bad.next.endswith(f"--out {tmp_path / 'car_2'}")
    as_before = held(tuned, run, as_foretold=False)
    as_before = replace(as_before, found=replace(as_before.found, unchanged=True))
    assert of_foretold(as_before, log).next.startswith("see whether these gains are in the ECU at all")


def test_gains_whose_loop_was_not_told_do_not_follow_those_that_are_as_foretold(tuned: Tuned, tmp_path: Path) -> None:
    """They had a WARNING: more is to be logged first."""
    for worst in (np.nan, 0.7):
        doubtful = replace(tuned, borne=(Borne(0.2, 0.1, 8.0, 9.0), Borne(worst, worst, 8.0, 9.0)))
        said = of_foretold(held(doubtful, tmp_path / "car", as_foretold=True), Path("next.csv")).next
        assert said.startswith("keep these gains: the run's logs do not tell whether the loop holds with the proposed")
        assert "etcfit tune next.csv --ecu rusefi --present " in said


@pytest.mark.usefixtures("drawn_quickly")
def test_terminal_page_and_json_say_the_same(tuned: Tuned, tmp_path: Path) -> None:
    run = RunFolder(tmp_path)
    assert tuned.result is not None
    assert tuned.design is not None
    keep_fit(run, tuned.result)
    keep_design(run, tuned.result, tuned.design, {})
    keep_tuned(tmp_path, tuned)
    told = read_valid(tmp_path / "tune.json")
    shown = " ".join(tuned.summary(1000).split())
    page = html.unescape(write_page(tmp_path).path.read_text(encoding="utf-8"))
    said = told["says"]
    assert said["requirements"]
    for sentence in (*said["model"], said["requirements"], *said["next"]):
        assert sentence in shown
        assert sentence in page
    assert said["answer"] in page
    assert said["answer"] == of_tune(tuned, tmp_path, [Path("lap.csv")]).answer
    for step in told["steps"]:
        assert all(short(gain, 4) in shown and short(gain, 4) in page for gain in step["gains"].values())
    assert "MISS" not in page.partition('aria-label="Verdict"')[2].partition("</section>")[0]  # no second verdict
    assert 'alt="bench, tune"' in page
    keep_design(run, tuned.result, replace(tuned.design, limits=("other",)), {})  # other gains, by its hash
    assert said["next"][0] not in html.unescape(write_page(tmp_path).path.read_text(encoding="utf-8"))


def of_gains(settling: float, worst: float, limits: tuple[str, ...] = ()) -> dict[str, Any]:
    """What matters here of pid.json."""
    hardest = {"supply_V": 9.0, "winding_degC": 110.0, "friction_over_bench": 1.5}
    return {"requirements": {"settling_s": 0.2}, "nonlinear": {"settling_s": settling}, "limits": limits,
            "conditions": {"stable": True, "worst": {"settling_s": worst}, "hardest": hardest}}  # fmt: skip


def test_what_the_proposed_gains_miss_comes_with_what_it_means_and_what_decides() -> None:
    better, worse = ([{"rmse_pct": 4.0}, {"rmse_pct": now}] for now in (2.0, 5.0))
    assert "meet every requirement" in of_requirements(of_gains(0.1, 0.15), better)
    said = of_requirements(of_gains(0.1, 0.3), better)
    assert "on the fitted model the proposed gains meet every requirement. But in the worst corner" in said
    assert "(9 V, winding at 110 °C, dry friction 1.5 times that of the log) they miss settling time 0.300 s" in said
    assert "track better than the present ones all the same (RMSE 2.00 instead of 4.00 %" in said
    assert "log there before you rely on it" in said
    said = of_requirements(of_gains(0.25, 0.3, ("dry friction", "the supply voltage")), worse)
    assert "on the fitted model the proposed gains miss settling time 0.250 s (limit 0.2 s)" in said
    assert "Nor do they track better" in said
    assert "Gains could meet everything if this were eased: dry friction; or the supply voltage." in said


class _Asked(Exception):
    """What the command line made of its words."""


def asked_by(monkeypatch: pytest.MonkeyPatch, words: list[str]) -> TuneRequest:
    def told(files: list[Path], run: object, report: object, request: TuneRequest) -> None:
        raise _Asked(request)

    monkeypatch.setattr("etcfit.stages.tune_logs", told)
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, _Asked), done.output
    return done.exception.args[0]


def test_the_next_command_keeps_what_the_user_said(
    tuned: Tuned, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is typed once more: the same request but for gains, logs and run folder."""
    monkeypatch.chdir(tmp_path)
    given = ["--ecu", "generic", "--present", "1,5,0.01", "--ecu-period", "1.5ms", "--ecu-delay", "700us", "--supply",
             "12.6", "--hold-out", "30", "--column", "TPS 1=position [%]"]  # fmt: skip
    given += ["--column", "lap.csv:PPS=ignore"]
    first = asked_by(monkeypatch, ["tune", "lap.csv", *given, "--out", "car"])
    found = replace(tuned, request=first)
    bad = held(found, tmp_path / "car", as_foretold=False)
    _, _, command = of_foretold(bad, Path("next.csv")).next.partition("with this log: etcfit ")
    again = asked_by(monkeypatch, shlex.split(command))
    of_this_log = {("", "TPS 1"): first.answers.columns["", "TPS 1"]}  # the next log has another name
    assert again.gains == pytest.approx(tuned.written(tuned.steps[1].gains), rel=1e-3)
    assert replace(again, sets=first.sets) == replace(first, answers=replace(first.answers, columns=of_this_log))
    withheld = replace(found, why_not="The parameters behind this are a compromise.")
    _, _, command = of_tune(withheld, tmp_path / "car", [Path("lap.csv")]).next.partition("all the same: etcfit ")
    assert asked_by(monkeypatch, shlex.split(command)) == replace(first, anyway=True)


def test_a_tune_has_the_bias_table_and_gains_that_are_given_beside_it_go_before_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    # a table of three points, its last one repeated, as TunerStudio fills it
    bins, values = ("0 50 100 100 100 100 100 100", "-20.5 10 25 25 25 25 25 25")
    constants = "".join(f'<constant name="etb_{key}Factor">{gain}</constant>' for key, gain in
                        zip("pid", ("6", "40", "0.05"), strict=True))  # fmt: skip
    constants += '<constant name="etb_iTermMin">-25</constant><constant name="etb_iTermMax">25</constant>'
    constants += f'<constant name="etbBiasBins" rows="8">{bins}</constant>'
    constants += f'<constant name="etbBiasValues" rows="8">{values}</constant>'
    head = '<msq xmlns="http://www.msefi.com/:msq"><versionInfo signature="rusEFI"/>'
    (tmp_path / "mine.msq").write_text(f"{head}<page>{constants}</page></msq>")
    words = ["tune", "lap.csv", "--ecu", "rusefi", "--msq", "mine.msq", "--out", "car"]
    found = asked_by(monkeypatch, words)
    bias = ((0.0, -20.5), (50.0, 10.0), (100.0, 25.0))
    assert (found.gains, found.own) == ((6.0, 40.0, 0.05), ("mine.msq", (6.0, 40.0, 0.05), bias, 0.25))
    assert found.options(of_files=True) == ["--ecu", "rusefi", "--msq", "mine.msq"]
    assert found.options() == ["--ecu", "rusefi"]  # new gains come with a table of zeros
    assert asked_by(monkeypatch, [*words, "--present", "9,80,0.06"]) == replace(found, sets=((9.0, 80.0, 0.06),))


def compromised(tuned: Tuned) -> Tuned:
    """The same of a model far from its data."""
    assert tuned.result is not None
    return replace(tuned, result=results.compromised(tuned.result))


def test_gains_of_a_compromise_are_named_nowhere(tuned: Tuned) -> None:
    far = replace(compromised(tuned), why_not="The parameters behind this are a compromise.")
    written = validated({"schema": "etcfit.tune/1"} | tuned_json(far))
    assert written["verdict"] == "not from this log"
    assert [step["gains"] is None for step in written["steps"]] == [False, True, True]
    assert {step["probability_met"] for step in written["steps"]} == {None}
    assert "NOT FROM THIS LOG" in far.summary()
    assert "half way" not in far.summary()


def test_asked_for_all_the_same_they_come_below_the_caution(tuned: Tuned) -> None:
    shown = compromised(tuned).summary()
    assert shown.index("a compromise, not estimates") < shown.index("half way")


def test_a_compromise_gives_gains_where_the_loops_bear_what_it_misses(tuned: Tuned) -> None:
    """Half way and proposed each; an estimate is not asked, and a motion that is not explained is never enough."""
    far, sound = compromised(tuned).result, tuned.result
    assert far is not None
    assert sound is not None
    bears, breaks = Borne(0.2, 0.1, 8.0, 9.0), Borne(0.7, 0.6, 8.0, 9.0)
    assert reasons_to_withhold(far, 0.99, (bears, bears), tuned.steps) == ()
    (why,) = reasons_to_withhold(far, 0.99, (breaks, bears), tuned.steps)
    assert "a compromise" in why
    assert "record more quick steps" in why
    assert reasons_to_withhold(sound, 0.99, (breaks, breaks), tuned.steps) == ()
    (why,) = reasons_to_withhold(sound, 0.9, (bears, bears), tuned.steps)
    assert "95 %" in why


def test_the_picture_is_drawn(tuned: Tuned, tmp_path: Path) -> None:
    keep_tuned(tmp_path, tuned)
    assert (tmp_path / "pictures" / "tune.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_log_that_tells_nothing_ends_with_1_and_what_to_record(tmp_path: Path) -> None:
    car = replace(draw_car(9000), duration=8.0)  # 100 Hz, and nobody says the gains
    write_log(tmp_path / "lap.csv", log_of(car, 9000))
    done = CliRunner().invoke(
        app, ["tune", str(tmp_path / "lap.csv"), "--ecu", "rusefi", "--out", str(tmp_path / "a"), "-q"]
    )
    assert done.exit_code == 1
    assert "Next:   Log position, duty and battery at 400 Hz or faster" in done.stdout
    written = read_valid(tmp_path / "a" / "tune.json")
    assert (written["verdict"], written["steps"], written["fit"]) == ("not from this log", [], None)
    assert not (tmp_path / "a" / "fit.json").exists()


SLIPS = [(("--present", "1,2,3", "--present", "4,5,6"), "2 sets for 1 logs"),
         (("--present", "1,2"), "three numbers"), (("--present", "1,-2,3"), "negative"),
         (("--ecu-period", "1ms"), "rusefi fixes it"), (("--ecu", "maxxecu"), "does not publish the unit")]  # fmt: skip


@pytest.mark.parametrize(("options", "said"), SLIPS)
def test_a_slip_in_an_option_is_told_before_anything_is_read(
    tmp_path: Path, options: tuple[str, ...], said: str
) -> None:
    done = CliRunner().invoke(app, ["tune", "lap.csv", "--ecu", "rusefi", "--out", str(tmp_path / "a"), *options])
    assert done.exit_code == 2
    assert said in done.stderr


@pytest.mark.slow
def test_a_fast_log_leads_to_gains_that_are_better_on_the_car(tmp_path: Path) -> None:
    car = draw_car(9003)
    write_log(tmp_path / "lap.csv", log_of(car, 9003))
    found = etcfit.tune(tmp_path / "lap.csv", "rusefi", tmp_path / "run", car.gains, quiet=True)
    assert found.why_not == ""
    assert found.explained[0] is not None
    assert found.explained[0] > 0.98
    p, i, d = (float(gain) for gain in found.written(found.steps[-1].gains))
    assert tracking_errors(car, (p, i, d), 1)[0] < 0.8 * tracking_errors(car, car.gains, 1)[0]
