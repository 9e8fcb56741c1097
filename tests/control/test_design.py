"""From a fit to gains: reduction with errors, draws, what is met and what binds, and the files of a run folder."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

import results
from effect_samples import every_effect, made, rows, seen, typical
from etcfit.control.design import PAPERS, Design, binding, design, ecu_of, frictionless, propose, task_of
from etcfit.control.linearise import reduce
from etcfit.control.loop_figures import FIGURES
from etcfit.control.pid import RULES, Gains, Requirements
from etcfit.control.pid.formulas import Ultimate, ultimate
from etcfit.control.pid.loop import Loop
from etcfit.control.setpoint import trapezoid
from etcfit.control.settings import DesignSettings
from etcfit.errors import UsageError
from etcfit.estimation.fitted_model import Fitted
from etcfit.model.ecus import ECUS, FOME, RUSEFI, EcuProfile
from etcfit.model.effects import AbstractEffect
from etcfit.model.feed_forward import TermNames
from etcfit.model.linear import closed_form
from etcfit.model.pid import Memory, tick
from etcfit.model.throttle import Throttle
from etcfit.ranges import from_json
from etcfit.reporting.blocks import render
from etcfit.reporting.control.gains import design_table
from etcfit.reporting.control.pictures import draw_responses
from etcfit.reporting.control.sentence import hardest_place, misses
from etcfit.run_folder.manifest import replacing
from etcfit.run_folder.pid import PID
from etcfit.run_folder.plant import reduction_json
from etcfit.run_folder.reading import read_draws
from firmwares import Fome, PidV1, Rusefi, Settings, Textbook
from schemas import validator, written_valid

QUICK = ("manual", "damping_optimum", "amigo")
BRIEF = replace(results.BRIEF, draws=200)


@pytest.fixture(scope="module")
def designed(fitted: Fitted) -> Design:
    """By three quick rules."""
    return results.proposed(fitted, task_of(fitted, ecu_of(fitted), settings=BRIEF), *QUICK)


@pytest.mark.slow
def test_the_reduction_is_the_closed_form_in_any_unit(fitted: Fitted) -> None:
    plain = reduce(fitted).plant
    assert (*plain.num, *plain.den[1:]) == pytest.approx(
        tuple(np.asarray(closed_form(fitted.values, 20.68)).tolist()), rel=1e-9
    )
    duty = reduce(fitted, "%", "%").plant
    assert duty.b0 == pytest.approx(plain.b0 * (12.0 / 100.0) * (100.0 / (np.pi / 2)))
    assert reduce(fitted, "V", "deg").plant.b0 == pytest.approx(np.degrees(plain.b0))
    for wrong in (("A", "rad"), ("V", "mm")):
        with pytest.raises(UsageError):
            reduce(fitted, *wrong)


def test_standard_errors_are_those_of_many_draws(fitted: Fitted) -> None:
    found = reduce(fitted)
    drawn = fitted.laplace(4000, np.random.default_rng(1))
    throttles = fitted.throttles(drawn)
    values = {s: throttles.parameter(s) for s in fitted.values if s not in ("series_ohm.inductance",)}
    rows = np.asarray(closed_form(values, 20.68)).reshape(4, -1)
    assert np.allclose(found.stderr, rows.std(axis=1), rtol=0.06)


@pytest.mark.slow
def test_the_json_is_the_contract(designed: Design, fitted: Fitted, tmp_path: Path) -> None:
    found = written_valid(tmp_path, "pid", PID.json(designed))
    assert from_json(DesignSettings, found["settings"]) == BRIEF
    gains, ecu = found["gains"], found["ecu"]
    assert set(gains) == {"Kp", "Ki", "Kd", "unit"}
    assert {"P", "I", "D", "period_s"} <= set(ecu)
    assert ecu["P"] == gains["Kp"]
    assert ecu["I"] == pytest.approx(gains["Ki"] * ecu["period_s"])
    assert ecu["D"] == pytest.approx(gains["Kd"] / ecu["period_s"])
    assert set(found["linear"]) == set(found["nonlinear"]) == set(FIGURES)
    limits = {"overshoot_pct": 20.0, "settling_s": 0.2, "steady_state_error_pct": 0.5, "duty_activity_pct": 5.0}
    assert found["requirements"] == limits | dict.fromkeys(("rmse_pct", "current_rms_A", "winding_W", "bridge_W"))
    assert found["scenarios"]["small steps"]["overshoot_pct"] <= found["nonlinear"]["overshoot_pct"]
    assert found["conditions"]["worst"]["rmse_pct"] > found["nonlinear"]["rmse_pct"]
    assert found["front"][0]["duty_activity_limit_pct"] is None
    assert found["ecu"]["noise_rad"] == fitted.position_noise > 0.0
    assert set(found["met"]) == set(found["requirements"])
    assert 0.0 <= found["posterior"]["probability_met"] <= 1.0
    assert found["posterior"]["draws"] == found["settings"]["draws"] == 200
    assert found["settings"]["optimum"]["population"] == 8
    assert found["posterior"]["origin"] == "laplace"
    assert set(found["rules"]) == set(QUICK)
    tf = json.loads(json.dumps(reduction_json(fitted, reduce(fitted), 2), allow_nan=False))
    keys = {"input", "output", "operating_point", "num", "den", "poles", "stderr", "open_loop_dc_gain"}
    assert keys <= set(tf)
    assert (len(tf["num"]), len(tf["den"]), len(tf["poles"])) == (1, 4, 3)
    assert (len(tf["stderr"]["num"]), len(tf["stderr"]["den"])) == (1, 4)
    assert tf["synthetic"] is True


def made_for(fitted: Fitted, profile: EcuProfile, feed_forward: TermNames) -> Design:
    ecu = ecu_of(fitted, **profile.completed({"resolution": np.radians(90.0) / 2**12}))
    task = task_of(fitted, ecu, PAPERS, None, feed_forward, results.BRIEF, profile)
    return results.proposed(fitted, task, "damping_optimum")


@pytest.mark.slow
def test_every_rule_is_drawn_where_it_is_hardest_for_it(designed: Design) -> None:
    panels = [panel for panel in draw_responses(designed).axes if panel.get_visible()]
    assert len(panels) == len(designed.tuned)
    for panel, tuned in zip(panels, designed.tuned.values(), strict=True):
        place, asked = hardest_place(tuned, designed.task.requirements), designed.task.requirements
        assert place is not None
        assert any(text.get_text().startswith(f"{place.scenario}, ") for text in panel.texts)
        verdict = panel.get_title(loc="left").partition("\n")[2]
        assert verdict.startswith("misses: " if misses(tuned, asked) else "nominal model meets all; hardest: ")


@pytest.mark.slow
def test_gains_for_another_controller_are_none_for_rusefi(designed: Design) -> None:
    found = PID.json(designed)
    assert found["rusefi"] is None
    assert found["profile"] is None
    said = " ".join(render(design_table(designed)).split())
    assert "For no ECU in particular" in said
    assert "--ecu NAME designs in its own controller" in said
    assert all(name in said for name in ECUS)
    assert "<constant" not in said


@pytest.mark.slow
def test_rusefi_gains_drive_the_same_duty(fitted: Fitted) -> None:
    made = made_for(fitted, RUSEFI, feed_forward=True)
    his, gains, ecu = PID.json(made)["rusefi"], made.proposed, made.task.ecu
    assert (ecu.period, ecu.filter, ecu.limit) == (2e-3, 0.0, 0.9 * ecu.supply)
    error_pct = 3.0
    volts = gains.Kp * np.radians(90.0) * error_pct / 100.0
    assert his["pFactor"] * error_pct == pytest.approx(100.0 * volts / ecu.supply)
    assert (his["periodMs"], his["etb_iTermMin"], his["etb_iTermMax"]) == (2.0, -30.0, 30.0)
    assert len(his["etbBiasBins"]) == len(his["etbBiasValues"]) == 8
    assert np.all(np.diff(his["etbBiasBins"]) > 0)
    v = made.fitted.values
    per_torque = v["R_a"] / (20.68 * v["K_m"])
    open_ = per_torque * (v["K_s"] * np.pi / 2 + v["T_PL"])
    assert his["etbBiasValues"][-1] == pytest.approx(100.0 * open_ / ecu.supply, abs=0.02)
    friction = 100.0 * per_torque * v["T_f"] / ecu.supply
    assert np.subtract(his["duty_opening"], his["etbBiasValues"]) == pytest.approx(np.full(8, friction), abs=0.02)
    assert np.subtract(his["etbBiasValues"], his["duty_closing"]) == pytest.approx(np.full(8, friction), abs=0.02)
    validator("pid").validate({"schema": "etcfit.pid/1"} | json.loads(json.dumps(PID.json(made))))
    pasted = render(design_table(made))
    for name in ("pFactor", "iFactor", "dFactor"):
        assert f'name="etb_{name}">{his[name]:.8g}</constant>' in pasted
    assert '<constant digits="0" name="etb_iTermMax">30.0</constant>' in pasted
    assert [float(v) for v in array(pasted, "etbBiasBins")] == pytest.approx(his["etbBiasBins"], abs=1e-3)
    assert [float(v) for v in array(pasted, "etbBiasValues")] == pytest.approx(his["etbBiasValues"], abs=1e-9)


def array(pasted: str, name: str) -> list[str]:
    """Entries of a `<constant>` of several rows."""
    return re.search(rf'name="{name}" rows="8">([^<]*)</constant>', pasted)[1].split()  # type: ignore[index]


@pytest.mark.slow
def test_a_curve_that_gains_were_found_without_is_pasted_as_zero(fitted: Fitted) -> None:
    made = made_for(fitted, RUSEFI, feed_forward=False)
    assert set(array(render(design_table(made)), "etbBiasValues")) == {"0.0"}
    bias = PID.json(made)["profile"]["bias"]
    assert bias["etbBiasValues"] == [0.0] * 8
    assert np.ptp(made.bias.hold) > 0.1


def simulated(made: Design) -> tuple[Loop, list[float], list[float], np.ndarray]:
    """Its loop; at each tick setpoint and reading in per cent of the travel, and the duty that ours puts out."""
    loop, ecu, ours = made.task.loop.first(1), made.task.ecu, made.proposed
    path = loop.respond(Gains.stacked(ours), made.setpoint)
    wanted = np.asarray(loop.angle(made.setpoint.at(made.setpoint.instants(ecu.period))))
    seen = ecu.resolution * np.round(np.asarray(path.position)[0, 0] / ecu.resolution)
    memory, duties = Memory.at_rest(ours, ecu, wanted[0]), []
    for setpoint, position, ahead in zip(wanted, seen, loop.ahead(wanted), strict=True):
        volts, memory = tick(ours, ecu, memory, setpoint, position, ahead)
        duties.append(100.0 * float(volts) / ecu.supply)
    targets, readings = ([100.0 * float(loop.share(angle)) for angle in each] for each in (wanted, seen))
    return loop, targets, readings, np.array(duties)


@pytest.mark.slow
@pytest.mark.parametrize(("profile", "firmware"), [(RUSEFI, Rusefi), (FOME, Fome)], ids=["rusefi", "fome"])
def test_what_is_pasted_drives_the_plate_as_it_was_simulated(
    fitted: Fitted, profile: EcuProfile, firmware: type[Rusefi | Fome]
) -> None:
    """Their firmware with the pasted numbers in it sees the simulated plate, and puts out what ours does."""
    made = made_for(fitted, profile, feed_forward=True)
    pasted = render(design_table(made))
    p, i, d = (float(re.findall(rf'name="etb_{each}Factor">([^<]+)<', pasted)[0]) for each in "pid")
    bins, values = ([float(v) for v in array(pasted, name)] for name in ("etbBiasBins", "etbBiasValues"))
    theirs = firmware(Settings(p, i, d, bins, values))
    assert min(p, i, d) > 0.0
    _, wanted, seen, duty = simulated(made)
    duties = [theirs.update(*angles) for angles in zip(wanted, seen, strict=True)]
    assert np.ptp(duty) > 20.0
    # the rounding of the table's duties is all that parts them
    assert np.max(np.abs(duty - duties)) < 0.5 * 10.0 ** -(profile.bias.decimals if profile.bias else 0) + 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "firmware", "terms"),
    [("arduino", PidV1, ("friction", "rate")), ("arduino", PidV1, ("rate",)), ("generic", Textbook, "spring,friction")],
)
def test_the_lines_of_code_put_ahead_what_was_simulated(
    fitted: Fitted, name: str, firmware: type[PidV1 | Textbook], terms: TermNames
) -> None:
    """The printed lines, run as they stand behind the PID of that library, see the simulated plate."""
    made = made_for(fitted, ECUS[name], terms)
    lines = PID.json(made)["profile"]["code"]
    assert all(line in render(design_table(made)) for line in lines)
    (loop, wanted, seen, duty), ecu = simulated(made), made.task.ecu
    bias = loop.bias
    bins, values = ((0.0, 100.0), (0.0, 0.0)) if bias is None else (
        100.0 * np.asarray(loop.share(bias.angles)), 100.0 * bias.hold / ecu.supply)  # fmt: skip
    theirs = firmware(Settings(*made.written(made.proposed, made.task.profile.notation)))  # type: ignore[union-attr]
    known = {"constrain": lambda x, low, high: min(max(x, low), high), "rate": 0.0, "before": wanted[0],
             "table": lambda target: np.interp(target, bins, values)}  # fmt: skip
    program = compile("\n".join(line.rstrip(";") for line in lines), "pasted", "exec")
    duties, alone = [], []
    for setpoint, position in zip(wanted, seen, strict=True):
        alone.append(theirs.update(setpoint, position))
        known |= {"target": setpoint, "output": alone[-1]}
        exec(program, known)
        duties.append(known["duty"])
    # from the second tick on: at the first the library takes the reading for where it was before
    near = len(duties) if firmware is PidV1 else round(0.55 / ecu.period)  # whose integral waits at another limit
    assert np.max(np.abs(duty - duties)[1:near]) < 1e-3
    assert np.max(np.abs(duty - alone)[1:near]) > 3.0


def test_friction_and_rate_are_refused_where_no_code_can_be_written(fitted: Fitted) -> None:
    for profile in ECUS.values():
        if profile.name in ("arduino", "generic"):
            continue
        with pytest.raises(
            UsageError, match=r"has no feed-forward of friction.*for an ECU that does: arduino, generic"
        ):
            task_of(fitted, ecu_of(fitted), feed_forward=("friction",), settings=BRIEF, profile=profile)
    with pytest.raises(UsageError, match=r"air: no such term of feed-forward\. Known: spring, friction, rate"):
        task_of(fitted, ecu_of(fitted), feed_forward="friction,air", settings=BRIEF)


@pytest.mark.slow
def test_gains_without_the_terms_are_those_of_before(fitted: Fitted) -> None:
    """Off unless asked: nothing ahead at any tick; asked, what the setpoint's edges make."""
    none, spring, both = (task_of(fitted, ecu_of(fitted), feed_forward=asked, settings=BRIEF)
                          for asked in (False, True, "friction,rate"))  # fmt: skip
    wanted = none.loop.angle(none.setpoint.at(none.setpoint.instants(none.ecu.period)))
    assert np.all(none.loop.ahead(wanted) == 0.0)
    assert spring.loop.bias is not None
    assert np.all(spring.loop.ahead(wanted) == spring.loop.bias.volts(wanted))
    assert np.ptp(both.loop.ahead(wanted)) > 1.0
    assert both.loop.ahead(wanted)[:400] == pytest.approx(np.zeros(400))


@pytest.mark.slow
def test_fomes_curve_is_one_that_its_table_holds(fitted: Fitted) -> None:
    made = made_for(fitted, FOME, feed_forward=True)
    bias = PID.json(made)["profile"]["bias"]
    bins, values = (np.array(bias[name]) for name in ("etbBiasBins", "etbBiasValues"))
    assert 2.0 * bins == pytest.approx(np.round(2.0 * bins), abs=1e-9)
    assert 10.0 * values == pytest.approx(np.round(10.0 * values), abs=1e-9)
    # what was simulated is what is pasted, to the table's own step
    ahead = made.task.loop.bias
    assert ahead is not None
    assert 100.0 * np.asarray(made.task.loop.share(ahead.angles)) == pytest.approx(bins, abs=1e-9)
    assert 100.0 * ahead.hold / made.task.ecu.supply == pytest.approx(values, abs=0.05 + 1e-9)
    curve = PID.json(made)["bias_curve"]  # what the page's loop runs through
    assert (curve["angles_rad"], curve["hold_V"]) == (ahead.angles.tolist(), ahead.hold.tolist())


@pytest.mark.slow
@pytest.mark.parametrize("profile", ECUS.values(), ids=ECUS)
def test_every_make_of_ecu_has_settings_that_give_the_same_controller(fitted: Fitted, profile: EcuProfile) -> None:
    made = made_for(fitted, profile, feed_forward=False)
    found = json.loads(json.dumps(PID.json(made), allow_nan=False))
    validator("pid").validate({"schema": "etcfit.pid/1"} | found)
    written, ecu = found["profile"], made.task.ecu
    assert (written["name"], written["source"]) == (profile.name, profile.source)
    assert {field: getattr(ecu, field) for field in profile.fixes} == dict(profile.fixes)
    # by hand: % of duty over % of travel, per s and times s
    volts = ecu.supply / 100.0
    travel = made.task.loop.body.upper - made.task.loop.body.lower
    si = [float(g) for g in made.chosen.gains or ()]
    gains = [gain["value"] for gain in written["gains"].values()]
    units = [gain["unit"] for gain in written["gains"].values()]
    if profile.notation is None:  # no unit is made up: a share of the ultimate gain, and two times
        Kp, Ki, Kd = si
        most = ultimate(made.task.plant, ecu.late)
        assert isinstance(most, Ultimate)
        assert gains == pytest.approx([Kp / most.gain, Kp / Ki if Ki else 0.0, Kd / Kp])
        assert units[0] == "times the P at which P alone becomes unstable"
        assert not any("%" in unit for unit in units)
    else:
        assert gains == pytest.approx([g * travel / 100.0 / volts for g in si])
        assert units == ["%/%", "%/%, per s", "%/%, times s"]
    assert tuple(written["gains"]) == profile.gains
    said = " ".join(render(design_table(made)).split())
    assert f"For {profile.title}: {profile.pasting.value}" in said
    assert all(" ".join(f"assumed: {each}".split()) in said for each in profile.assumed)


def test_feed_forward_for_an_ecu_without_a_table_is_refused(fitted: Fitted) -> None:
    with pytest.raises(UsageError, match="Arduino PID library has no table of feed-forward"):
        task_of(fitted, ecu_of(fitted), feed_forward=True, settings=BRIEF, profile=ECUS["arduino"])


@pytest.mark.slow
def test_requirements_nobody_could_meet_are_not_met(fitted: Fitted) -> None:
    impossible = Requirements(settling_s=1e-4)
    task = task_of(fitted, ecu_of(fitted), impossible, settings=results.BRIEF)  # what binds is then a guess
    found = propose(fitted, task, "damping_optimum", {"damping_optimum": RULES["damping_optimum"]}, "laplace")
    assert found.chosen.met["settling_s"] is False
    assert not found.chosen.meets_all
    assert found.chosen.probability_met == 0.0
    assert found.limits == ("no limit alone: several bind together, or the setpoint itself is too fast",)


def test_an_unknown_rule_is_a_usage_error(fitted: Fitted) -> None:
    with pytest.raises(UsageError, match="Known: optimal"):
        design(fitted, ecu_of(fitted), rule="guess")


def test_a_posterior_of_the_same_model_is_drawn_from(tmp_path: Path, fitted: Fitted) -> None:
    assert read_draws(tmp_path, fitted, 10, 0) is None
    rng = np.random.default_rng(0)
    values = {s: np.asarray(fitted.values[s]) * np.exp(0.1 * rng.standard_normal((2, 50)))
              for s in fitted.free_parameters.layout.free}  # fmt: skip
    made = xarray.Dataset({s: (("chain", "draw"), v) for s, v in values.items()})
    with replacing(tmp_path, "sample", 0, {}) as draft:
        made.to_netcdf(draft / "posterior.nc", group="posterior", engine="h5netcdf")
    drawn = read_draws(tmp_path, fitted, 400, 0)
    assert drawn is not None
    spread = np.asarray(fitted.throttles(drawn).parameter("R_a"))
    assert np.isin(np.round(spread, 9), np.round(values["R_a"], 9)).all()
    assert spread.std() > 0.05 * spread.mean()


@pytest.mark.slow
def test_the_optimum_meets_everything_and_tracks_better_than_the_safe_rules(fitted: Fitted) -> None:
    found = design(fitted, ecu_of(fitted))
    best = found.chosen
    asked = found.task.requirements
    assert best.meets_all
    assert best.probability_met is not None
    assert best.probability_met >= 0.95
    assert best.probability_stable is not None
    assert best.probability_stable >= 0.9
    for tuned in found.tuned.values():
        if tuned is best or tuned.nonlinear is None or not tuned.meets_all:
            continue
        safe = (tuned.nonlinear.gain_margin_db >= asked.gain_margin_db
                and tuned.nonlinear.phase_margin_deg >= asked.phase_margin_deg)  # fmt: skip
        assert best.nonlinear is not None
        assert not safe or best.nonlinear.rmse_pct < tuned.nonlinear.rmse_pct


@pytest.mark.slow
def test_a_flat_battery_is_named_as_what_binds(fitted: Fitted) -> None:
    # 40 % of the travel in 0.2 s: 1.3 V of back-EMF, up to 1.7 V of spring and 0.9 V of friction are more than 3.2 V;
    # without the friction they are not
    weak = ecu_of(fitted, supply=3.2)
    task = task_of(fitted, weak, drawn=fitted.laplace(11, np.random.default_rng(0)))
    task = replace(task, setpoint=trapezoid())  # 60 % of it, as the large steps ask, are too much without friction too
    assert binding(task) == ("the supply voltage", "dry friction")


@every_effect
def test_no_dry_friction_of_the_registry_survives_being_taken_out(effect: type[AbstractEffect]) -> None:
    (smooth,) = frictionless(Throttle((made(effect),))).effects
    off = {symbol: getattr(smooth, symbol) for symbol in typical(effect)}
    np.testing.assert_array_equal(seen(effect, rows(effect, **off))["friction"], 0.0)
