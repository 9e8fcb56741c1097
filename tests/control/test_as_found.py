"""The ECU that drove the logs, taken over by the design: what is not given of it, and its gains beside the rules'.

The rig has a limp-home spring; its responses are also simulated by the independent generator, under its own computer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from etcfit.control.design import Design, ecu_of, gains_as_found, task_of
from etcfit.control.judged import judged, outside_the_bench
from etcfit.control.pid import RULES, Gains, Refusal
from etcfit.control.pid.feedforward import Bias, sliding_of
from etcfit.control.safety import safety
from etcfit.control.setpoint import trapezoid
from etcfit.control.supply_table import supply_table
from etcfit.estimation.fitted_model import Fitted
from etcfit.estimation.settings import IdentifiabilitySettings
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.throttle import catalogue
from etcfit.problem.free_parameters import free_parameters
from etcfit.reporting.blocks import render
from etcfit.reporting.control.gains import design_table
from etcfit.reporting.control.pictures import draw_responses
from etcfit.rig.base import Fixed, RigConfig
from etcfit.run_folder.pid import PID
from independent import draw_truth
from independent.control import Computer, follow, score, trapezoids
from independent.simulate import throttle
from independent.strengths import MEDIUM

SPRING = MEDIUM["limp_home_spring"]
LIMP = SPRING.limp_home_spring
TRUTH = draw_truth(np.random.default_rng(4))
GAINS = {"K_p": 60.0, "K_i": 400.0, "K_d": 0.6}
LOGGED = Ecu(period=2e-3, supply=11.0, filter=3e-3, delay=1e-3)
PLATE = {name: getattr(TRUTH, name) for name in ("R_a", "L_a", "K_b", "J_m", "J_L", "B_m", "B_L", "K_s", "T_PL", "T_f")}
# the generator's spring, as ours would have it
LIMP_HOME = {
    "T_lh": TRUTH.T_PL + TRUTH.K_s * LIMP.angle + LIMP.preload,
    "K_lh": LIMP.stiffness - TRUTH.K_s,
    "theta_lh": LIMP.angle,
    "d_lh": 0.5 * LIMP.corner,
}


def fitted(ecu: Ecu | None = LOGGED, changes: Mapping[str, float] = MappingProxyType({})) -> Fitted:
    """The rig as it is, each coordinate known to 0.01; of its ECU the derivative's gain was told, the others fitted."""
    told = {} if ecu is None else {symbol: Fixed(value) for symbol, value in ecu.constants.items()}
    told |= {} if ecu is None else {"K_d": Fixed(GAINS["K_d"])}
    config = RigConfig("synthetic", True, TRUTH.N, True, 12.0, parameters=told, effects=("limp_home_spring",), ecu=ecu)
    known = free_parameters(config)
    values = {s: p.nominal for s, p in catalogue(known.layout.types).items()} | PLATE | LIMP_HOME | GAINS | {**changes}
    x = known.layout.coordinates(values)
    return Fitted(config, known, x, 1e-4 * np.eye(x.size))


def unsure(of: Fitted, symbol: str, sd: float) -> Fitted:
    """One coordinate known to so much of its reach."""
    k = of.free_parameters.layout.free.index(symbol)
    covariance = of.covariance.copy()
    covariance[k, k] = (sd * of.free_parameters.layout.reach(of.x)[k]) ** 2
    return replace(of, covariance=covariance)


def test_what_is_not_given_of_an_ecu_is_that_of_the_one_that_drove_the_logs() -> None:
    assert ecu_of(fitted()) == LOGGED
    assert ecu_of(fitted(), period=5e-3) == LOGGED._replace(period=5e-3)
    assert ecu_of(fitted(), resolution=0.01) == LOGGED._replace(resolution=0.01)


def test_a_rig_that_describes_none_has_its_supply_and_a_filter_of_two_periods() -> None:
    assert ecu_of(fitted(None)) == Ecu(supply=12.0)
    assert ecu_of(fitted(None), period=5e-3) == Ecu(5e-3, 12.0, filter=10e-3)


def test_gains_as_found_are_those_told_and_those_fitted() -> None:
    found = gains_as_found(fitted())
    assert isinstance(found, Gains)
    assert found == pytest.approx(tuple(GAINS.values()))


def test_gains_that_the_data_do_not_tell_are_none() -> None:
    found = gains_as_found(unsure(fitted(), "K_i", 0.4))
    assert found == Refusal("the data do not determine K_i")
    hazy = unsure(fitted(), "K_i", 0.2)
    assert isinstance(gains_as_found(hazy), Gains)
    strict = replace(hazy, identifiability=IdentifiabilitySettings(unknown=0.1))  # as the fit decided
    assert gains_as_found(strict) == found
    assert isinstance(gains_as_found(unsure(fitted(), "K_s", 3.0)), Gains)


@pytest.mark.parametrize("variance", [np.nan, np.inf, -1.0])
def test_nor_are_gains_whose_error_could_not_be_computed(variance: float) -> None:
    of = fitted()
    of.covariance[of.free_parameters.layout.free.index("K_p")] = variance
    assert gains_as_found(of) == Refusal("the data do not determine K_p")


def test_without_an_ecu_there_are_none_and_it_says_where_to_describe_one() -> None:
    found = gains_as_found(fitted(None))
    assert isinstance(found, Refusal)
    assert "[ecu]" in found.why


def tried(**changes: float) -> Design:
    """The gains as found and nothing else, judged and proposed."""
    model = fitted(changes=changes)
    task = replace(task_of(model, ecu_of(model), drawn=np.empty((0, model.x.size))), setpoint=trapezoid())
    tuned = judged(task, {"as_found": RULES["as_found"](task)})
    bias = Bias(*(np.linspace(0.0, end, 8) for end in (np.pi / 2, 3.0, 2.0, 4.0)))
    chosen = tuned["as_found"]
    assert chosen.gains is not None
    robust, safe = outside_the_bench(task, chosen.gains), safety(task, chosen.gains)
    sliding = sliding_of(model.throttle, *task.loop.body, task.settings.sliding)
    table = supply_table(task, chosen.gains)
    return Design(model, task, chosen, tuned, 1, "laplace", bias, sliding, robust, table, (), safe, ())


@pytest.fixture(scope="module")
def present() -> Design:
    return tried()


def noted(of: Design, notation: Notation) -> Design:
    """The same design of a rig whose [ecu] names a unit and a form."""
    return replace(of, fitted=replace(of.fitted, config=replace(of.fitted.config, notation=notation)))


def rmse(of: Design) -> float:
    assert of.chosen.nonlinear is not None
    return float(of.chosen.nonlinear.rmse_pct)


@pytest.mark.slow
def test_they_are_judged_like_any_rules_and_respond_as_the_rig_itself_would(present: Design) -> None:
    """Tracking error on the paper's trapezoid, whose low level lies below the default position of the spring."""
    assert present.chosen.gains == pytest.approx(tuple(GAINS.values()))
    wanted = trapezoids(0.05 * np.pi / 2, 0.45 * np.pi / 2, LOGGED.period)
    limits = {name: getattr(LOGGED, name) for name in ("period", "supply", "filter", "delay")}
    real = score(
        follow(throttle(TRUTH, SPRING), Computer(*GAINS.values(), **limits), wanted)[0],
        wanted,
        LOGGED.period,
        np.pi / 2,
    ).rmse
    assert rmse(present) == pytest.approx(real, rel=0.05)
    assert rmse(tried(T_lh=1e-6, K_lh=1e-6)) != pytest.approx(real, rel=0.05)


@pytest.mark.slow
def test_the_table_shows_them_and_says_whose_ecu_it_is(present: Design) -> None:
    shown = render(design_table(present))
    assert "as_found" in shown
    assert "ticks of 2.00 ms, delay 1.00 ms, derivative filter 3.00 ms, output within 11.0 V; " in " ".join(
        shown.split()
    )
    assert "[ecu]" in shown


@pytest.mark.slow
def test_pid_json_has_the_same_keys_with_them(present: Design) -> None:
    found = PID.json(present)
    assert found["rule"] == "as_found"
    assert set(found["gains"]) == {"Kp", "Ki", "Kd", "unit"}
    assert found["ecu"]["period_s"] == LOGGED.period
    assert found["ecu"]["I"] == pytest.approx(GAINS["K_i"] * LOGGED.period)
    assert found["as_written"] is None
    plain = {"gains", "as_written", "why_not", "linear", "nonlinear", "met", "stable", "probability_met",
             "probability_margins"}  # fmt: skip
    assert set(found["rules"]["as_found"]) == plain


@pytest.mark.slow
def test_gains_stand_in_the_users_unit_and_form_where_rig_toml_names_them(present: Design) -> None:
    """12 V over 11 V of the supply, 90 deg of travel; ticks of 2 ms."""
    mine = noted(present, Notation("%", "deg", "ticks"))
    per_degree = np.pi / 180.0 * 100.0 / LOGGED.supply  # % of duty for a degree, of V/rad
    shown = PID.json(mine)["as_written"]
    assert shown == PID.json(mine)["rules"]["as_found"]["as_written"]
    assert (shown["unit"], shown["form"]) == ("%/deg", "ticks")
    assert shown["P"] == pytest.approx(60.0 * per_degree)
    assert shown["I"] == pytest.approx(400.0 * per_degree * 2e-3)
    assert shown["D"] == pytest.approx(0.6 * per_degree / 2e-3)
    text = " ".join(render(design_table(mine)).split())
    assert "as [ecu] of rig.toml writes them: %/deg, I and D by the tick of 2.00 ms" in text
    assert f"as_found {shown['P']:.4g}" in text
    assert f"as in rig.toml {shown['P']:.5g}" in text
    assert "of rig.toml writes them" not in render(design_table(present))


@pytest.mark.slow
def test_an_unstable_loop_meets_nothing_whatever_its_response_looks_like() -> None:
    """Friction and clamps can hold it still: then one response alone looks well."""
    wild = tried(K_p=2000.0)
    assert wild.chosen.linear is not None
    assert wild.chosen.linear.gain_margin_db < 0.0
    assert not wild.chosen.stable
    calm = replace(wild.chosen, met=dict.fromkeys(wild.chosen.met, True))
    assert not calm.meets_all
    assert calm.probability_met == 0.0
    shown = replace(wild, chosen=calm, tuned={"as_found": calm})
    titles = [panel.get_title(loc="left") for panel in draw_responses(shown).axes]
    assert "UNSTABLE" in titles[0]
    assert "meets" not in titles[0]
    assert "unstable" in render(design_table(shown))
    assert PID.json(shown)["stable"] is False
