"""The verbs: those of the command line, on results made by hand; what each takes and what it refuses."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import typer

import etcfit
import folders
import results
from equality import equal
from etcfit.api import verbs
from etcfit.api.controller import Designed, Reduced
from etcfit.api.explanation import Diagnosed
from etcfit.api.fit import Fit
from etcfit.api.measurements import Checked
from etcfit.cli import app
from etcfit.control.pid import RULES, Requirements
from etcfit.control.pid.optimal import SHARES
from etcfit.control.request import DesignRequest
from etcfit.errors import MeasurementError, UsageError
from etcfit.estimation.settings import FitSettings
from etcfit.experiment.advice import Advice, Option, Pair
from etcfit.experiment.plan import PLANS, Setting
from etcfit.experiment.settings import AdviceSettings
from etcfit.rig.base import Rig
from etcfit.run_folder.manifest import read_records

VALUES = {"R_a": 1.5, "K_m": 0.019, "K_s": 0.15, "T_PL": 0.36, "T_f": 0.24}
QUICK = {name: RULES[name] for name in ("manual", "damping_optimum", "as_found")}


@pytest.fixture(scope="module")
def reduced(fitted: Fit) -> Reduced:
    return verbs.reduce(fitted)


@pytest.fixture(scope="module")
def designed(fitted: Fit) -> Designed:
    """By three quick rules, one of which refuses."""
    with results.limits_unsought(), mock.patch.dict(RULES, QUICK, clear=True):
        return verbs.design(fitted, rule="manual", settings=replace(results.BRIEF, draws=30), period=1e-3)


def test_every_command_is_a_verb() -> None:
    commands = set(typer.main.get_command(app).commands)  # pyright: ignore[reportAttributeAccessIssue]
    folders = {"import", "new"}  # make a folder for the others; `import` is no name in Python
    assert commands - set(dir(etcfit)) == folders
    assert all(callable(getattr(etcfit, name)) for name in commands - folders)


@pytest.mark.slow
def test_check_takes_a_rig_and_a_folder(tmp_path: Path) -> None:
    folder = folders.write(tmp_path / "rig", folders.held())
    checked = etcfit.check(folder)
    assert isinstance(checked, Checked)
    assert list(checked.traces.index) == ["inductance/1.csv", "resistance/1.csv"]
    assert checked.traces.loc["resistance/1.csv", "samples"] == 40
    assert "J_L" in checked.not_identifiable
    assert etcfit.check(etcfit.read_folder(folder)).not_identifiable == checked.not_identifiable
    assert "not identifiable: " in checked._repr_html_()
    assert len(repr(checked)) < 1500
    with pytest.raises(MeasurementError, match="no such folder"):
        etcfit.check("nowhere")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Advice without working it out; notes what it is asked with."""
    seen: list[dict[str, Any]] = []

    def advise(rig: Rig, at: Any = None, **given: Any) -> Advice:
        seen.append({"rig": rig, "at": at, **given})
        once = Option("viscous", "a step", "noise assumed", np.array([0.25, 1.0]), Pair(("R_a", "K_b"), 0.9, 0.1), None)
        new = Option(
            "response", "a sweep", "", np.array([0.81, 1.0]), None, PLANS["resistance"](Setting.of_rig(rig, VALUES))
        )
        return Advice(rig, ("R_a", "K_b"), np.array([0.01, 0.02]), (once, new), (("sine", "no ECU"),), **given)

    monkeypatch.setattr("etcfit.experiment.advice.advise", advise)
    return seen


def test_advice_is_a_table_of_traces_and_one_of_widths(rig: Rig, asked: list[dict[str, Any]], tmp_path: Path) -> None:
    mine = etcfit.AdviceSettings(apart=0.5)
    found = etcfit.advise(rig, settings=mine)
    assert asked == [{"rig": rig, "at": None, "settings": mine}]
    assert list(found.options.index) == list(found.widths.index) == ["viscous", "response"]
    assert found.options["again"].tolist() == [True, False]
    assert found.options["mean"].tolist() == pytest.approx([0.5, 0.9])
    assert found.options["separates"].tolist() == ["R_a and K_b", ""]
    assert found.widths["R_a"].tolist() == [0.25, 0.81]
    assert found.stderr.tolist() == [0.01, 0.02]
    assert found.not_judged == {"sine": "no ECU"}
    assert "viscous, a step: 0.50" in repr(found)
    assert "a sweep" in found._repr_html_()
    assert "sine: no ECU" in found.summary()
    assert json.loads((found.save(tmp_path) / "advice.json").read_text(encoding="utf-8"))["settings"]["apart"] == 0.5


@pytest.mark.slow
def test_advice_is_given_at_a_fit_of_the_same_rig(
    rig: Rig, fitted: Fit, found: Diagnosed, asked: list[dict[str, Any]], tmp_path: Path
) -> None:
    fitted.save(tmp_path / "run")
    etcfit.advise(rig, at=fitted)
    etcfit.advise(rig.folder, at=tmp_path / "run")
    etcfit.advise(rig, at=found)
    final = found.final.result
    assert equal([each["at"] for each in asked], [fitted.result, fitted.result, final])
    with pytest.raises(UsageError, match="other measurements"):
        etcfit.advise(results.rig(tmp_path / "other", synthetic=False), at=fitted)
    wrong: Any = rig
    with pytest.raises(TypeError, match=r"etcfit.advise takes a fit, a diagnosis, a path or None for `at`, not Rig"):
        etcfit.advise(rig, at=wrong)
    with pytest.raises(UsageError):
        etcfit.advise(rig, at=tmp_path)


@pytest.mark.slow
def test_a_reduction_is_a_transfer_function_with_errors(fitted: Fit, found: Diagnosed, reduced: Reduced) -> None:
    plant = reduced.transfer_function
    b0, a2, a1, a0 = reduced.coefficients["value"]
    np.testing.assert_allclose(plant.num[0][0], [b0])
    np.testing.assert_allclose(plant.den[0][0], [1.0, a2, a1, a0])
    assert isinstance(reduced.stderr, pd.Series)
    assert list(reduced.stderr) == reduced.reduction.stderr.tolist()
    assert list(reduced.stderr.index) == ["b0", "a2", "a1", "a0"]
    assert len(reduced.plot.bode()) == 2
    assert "poles" in repr(reduced)
    assert "rad/V" in reduced._repr_html_()
    assert verbs.reduce(found).fit.result is found.diagnosis.after
    assert verbs.reduce(reduced).coefficients.equals(reduced.coefficients)
    assert verbs.reduce(fitted, output_unit="deg").unit == "deg/V"


@pytest.mark.slow
def test_a_design_has_every_rule_in_a_table(designed: Designed) -> None:
    rules = designed.rules
    assert list(rules.index) == list(QUICK)
    assert designed.gains.Kp == rules.loc["manual", "Kp"]
    assert rules.loc["as_found", "why"]
    assert np.isnan(rules.loc["as_found", "Kp"])
    assert rules["met"].dtype == bool
    assert str(rules["Kp"].dtype) == "float64"
    assert designed.rule == "manual"
    assert designed.design.draws == designed.design.settings.draws == 30
    assert len(repr(designed)) < 1500
    assert "manual" in designed._repr_html_()
    assert designed.plot.responses()[0].get_ylabel() == "position − new level\n[% of travel]"
    drawn = [panel for panel in designed.plot.scenarios() if panel.get_visible()]
    assert [panel.get_xlabel() for panel in drawn] == ["time [s]"] * len(designed.scenarios)
    assert designed.plot.front().get_ylabel() == "tracking error, root mean square [% of travel]"
    assert designed.plot.safety()[0].get_xlabel() == "error of the position [% of travel]"


@pytest.mark.slow
def test_a_design_has_its_scenarios_and_its_front_in_tables(designed: Designed) -> None:
    each, worst = designed.scenarios, designed.design.chosen.nonlinear
    assert worst is not None
    assert list(each.index)[:3] == ["trapezoid", "large steps", "small steps"]
    # a scenario is judged from its whole response, the worst of all tick by tick: other orders of one sum
    assert max(each["overshoot_pct"]) == pytest.approx(worst.overshoot_pct, rel=1e-12)
    assert each.loc["trapezoid", "rmse_pct"] == pytest.approx(worst.rmse_pct, rel=1e-12)
    assert len(designed.front) == len(SHARES) + 1
    assert designed.front["Kp"][0] == designed.design.front[0].gains.Kp


@pytest.mark.slow
def test_gains_that_are_saved_say_with_what_a_run_makes_them_anew(designed: Designed, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("etcfit.reporting.draw_design", lambda *_: None)
        designed.save(tmp_path)
    settings = read_records(tmp_path)["design"].settings
    assert (settings["rule"], settings["feed_forward"], settings["ecu"]) == ("manual", False, {"period": 1e-3})
    assert Requirements(**settings["limits"]) == designed.design.task.requirements
    asked = {each.name: settings[each.name] for each in fields(DesignRequest)}
    assert DesignRequest(**asked) == designed.request


@pytest.mark.slow
def test_a_design_for_a_make_of_ecu_runs_its_controller(fitted: Fit, tmp_path: Path) -> None:
    amigo = {"amigo": RULES["amigo"]}
    with pytest.MonkeyPatch.context() as patch, results.limits_unsought(), mock.patch.dict(RULES, amigo, clear=True):
        patch.setattr("etcfit.reporting.draw_design", lambda *_: None)
        made = verbs.design(
            fitted, rule="amigo", settings=replace(results.BRIEF, draws=2), profile="arduino", period=5e-3
        )
        made.save(tmp_path)
    ecu = made.design.task.ecu
    assert (ecu.period, ecu.derivative_weight, ecu.integral) == (5e-3, 0.0, 1.0)
    again = read_records(tmp_path)["design"].settings
    assert again["profile"] == "arduino"
    assert etcfit.ECUS["arduino"].clashes(again["ecu"]) == ()  # a run makes them anew


def test_a_make_of_ecu_that_is_unknown_or_contradicted_is_refused(fitted: Fit) -> None:
    with pytest.raises(UsageError, match=r"period: rusEFI fixes it at 0\.002\. Leave it out"):
        verbs.design(fitted, profile="rusefi", period=1e-3)
    with pytest.raises(UsageError, match="Known: rusefi"):
        verbs.design(fitted, profile="motronic")


def test_what_a_verb_cannot_use_is_refused_in_words(rig: Rig, found: Diagnosed) -> None:
    wrong: Any = rig
    for verb in (verbs.diagnose, verbs.sample, verbs.reduce, verbs.design):
        with pytest.raises(TypeError, match=f"etcfit.{verb.__name__} takes .* not Rig"):
            verb(wrong)
    with pytest.raises(UsageError, match="run folder"):
        etcfit.report(found)
    with pytest.raises(TypeError, match=r"knows no perod.*period"):
        etcfit.design(found, perod=1e-3)


def test_settings_reach_the_stage(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[Any, ...]] = []

    def stub(rig: Rig, report: Any, **given: Any) -> Any:
        seen.append((rig, given))
        return results.result(rig)

    monkeypatch.setattr("etcfit.estimation.joint_fit.fit", stub)
    assert isinstance(etcfit.fit(rig), Fit)
    mine = FitSettings(starts=1)
    etcfit.fit(rig.folder, settings=mine)
    assert seen[0] == (rig, {})
    assert seen[1][0].config == rig.config
    assert seen[1][1] == {"settings": mine}


def test_fetch_writes_a_measurement_folder(measured: Path, tmp_path: Path) -> None:
    folder = etcfit.fetch("kassel-throttle", tmp_path / "kassel", measured)
    assert etcfit.read_folder(folder).measurements
    with pytest.raises(UsageError, match="kassel-throttle"):
        etcfit.fetch("no-such-set", tmp_path / "x")


VERBS = {
    "check": 1, "advise": 1, "plan": 1, "fit": 1, "diagnose": 1, "sample": 1, "reduce": 1, "design": 1, "report": 1,
    "drive": 1, "load": 1, "fetch": 1, "export": 2, "fleet": 2, "run": 2,
}  # fmt: skip


@pytest.mark.parametrize("name", VERBS)
def test_an_argument_of_a_wrong_kind_is_named_with_what_the_verb_takes(name: str) -> None:
    for given in (None, 3, [], {}, object()):
        with pytest.raises((TypeError, UsageError), match=rf"etcfit\.{name}") as said:
            getattr(etcfit, name)(*[given] * VERBS[name])
        assert type(given).__name__ in str(said.value) or isinstance(said.value, UsageError)


@pytest.mark.parametrize(("verb", "wrong"), [
    ("fit", {"settings": 3}), ("fit", {"settings": AdviceSettings()}), ("fit", {"quiet": None}),
    ("plan", {"without": "response"}), ("plan", {"supply": "12"}), ("sample", {"steps": 1.5}),
    ("sample", {"steps": True}),
    ("reduce", {"share": "a"}), ("design", {"period": "1ms"}), ("design", {"requirements": {}}), ("design", {"log": 3}),
    ("export", {"to": 3}), ("fleet", {"out": "x", "workers": "2"}),
])  # fmt: skip
def test_every_argument_is_held_against_its_kind(verb: str, wrong: dict[str, object]) -> None:
    (name, value), *_ = reversed(wrong.items())
    with pytest.raises(TypeError, match=rf"etcfit\.{verb} takes .* for `{name}`, not {type(value).__name__}"):
        getattr(etcfit, verb)("nowhere", **wrong)
