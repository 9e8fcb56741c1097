"""Figures of a line against the independent generator, which shares no code: times within 1 %, angles within 0.1 %."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any

import jax
import numpy as np
import pytest
from scipy.optimize import brentq

import fleets
from etcfit.errors import UsageError
from etcfit.estimation.fitted_model import fleet_model
from etcfit.fleets.line import FIGURES, Condition, conditions, measured, predict
from etcfit.model.effects.sensors import PositionSensorNonlinearity
from independent.drives import Drive
from independent.effects import NONE, Effects, LimpHomeSpring
from independent.kernel import Plant, record, restoring_torque
from independent.simulate import resting_angle, simulate, terminals_open, throttle
from independent.truth import OPEN, Truth, draw_truth

INSTANTS = np.arange(0.0, 3.0, 2e-5)


def stroke(plant: Plant, volts: float, begin: float, *levels: float) -> list[float]:
    """s at which a plate at rest at an angle first passes each level, under a constant voltage."""
    angle = simulate(plant, Drive(np.array([0.0, 3.0]), np.full(2, volts)), INSTANTS, angle=begin).angle
    passed = [angle >= level if volts > 0.0 else angle <= level for level in levels]
    assert all(each.any() for each in passed)
    return [float(INSTANTS[np.argmax(each)]) for each in passed]


def back(plant: Plant, home: float, near: float = 0.05) -> float:
    """s from open until the plate stays within a share of the travel of its home; infinite for never."""
    angle = simulate(plant, Drive(np.array([0.0, 3.0]), np.zeros(2)), INSTANTS, angle=OPEN).angle
    far = np.abs(angle - home) > near * OPEN
    return np.inf if far[-1] else float(INSTANTS[np.flatnonzero(far)[-1]])


def moves(plant: Plant, begin: float, start: float, rate: float) -> tuple[float, float]:
    """Voltage and current of a slow ramp (V/s) at which a plate at rest at an angle begins to move, from `start` V."""
    longest = 12.0 / abs(rate)
    instants = np.arange(0.0, longest, 1e-3)
    # held until the current has settled, for the circuit is without one at the begin
    drive = Drive(np.array([0.0, 0.1, longest + 0.1]), np.array([start, start, start + rate * longest]))
    motion = simulate(plant, drive, instants, angle=begin, held_until=0.1)
    k = int(np.flatnonzero(np.abs(motion.angle - begin) > 1e-5)[0])
    return float(motion.voltage[k]), float(motion.current[k])


@pytest.mark.parametrize("seed", [4100, 4101])
def test_strokes_and_returns_are_those_of_the_independent_simulation(seed: int) -> None:
    truth = draw_truth(np.random.default_rng(seed), spread=0.3)
    found = {name: told.value[0] for name, told in measured(fleets.of([truth])).items()}
    plant = throttle(truth, NONE)
    early, late = stroke(plant, 12.0, 0.0, 0.1 * OPEN, 0.9 * OPEN)
    assert found["opening_time"] == pytest.approx(late - early, rel=0.01)
    early, late = stroke(plant, -12.0, OPEN, 0.9 * OPEN, 0.1 * OPEN)
    assert found["closing_time"] == pytest.approx(late - early, rel=0.01)
    weak, strong = (np.diff(stroke(plant, v, 0.0, 0.1 * OPEN, 0.9 * OPEN))[0] for v in (9.0, 14.0))
    assert found["supply_response"] == pytest.approx(weak / strong, rel=0.01)
    assert found["default_position"] == pytest.approx(resting_angle(truth, NONE), abs=1e-3 * OPEN)
    assert found["unpowered_return"] == pytest.approx(back(terminals_open(truth, NONE), 0.0), rel=0.01)
    slow = back(plant, 0.0)
    if slow < 2.5:  # a shorted motor makes a plate creep for seconds: one that is still on its way has no time
        assert found["unpowered_return_shorted"] == pytest.approx(slow, rel=0.01)


def test_slow_ramps_break_away_where_the_independent_plate_does() -> None:
    truth = draw_truth(np.random.default_rng(4200), spread=0.3)
    found = {name: told.value[0] for name, told in measured(fleets.of([truth])).items()}
    plant = throttle(truth, NONE)
    opens, _ = moves(plant, 0.0, 0.0, 1.0)
    assert found["breakaway_voltage_opening"] == pytest.approx(opens, abs=0.01)
    closes, _ = moves(plant, OPEN, 8.0, -1.0)
    assert found["breakaway_voltage_closing"] == pytest.approx(closes, abs=0.01)
    middle = found["holding_current"] * truth.R_a
    up, down = (moves(plant, 0.5 * OPEN, middle, rate)[1] for rate in (0.5, -0.5))
    assert found["holding_current"] == pytest.approx(0.5 * (up + down), abs=0.01 * abs(up))
    assert found["current_hysteresis"] == pytest.approx(0.5 * (up - down), rel=0.01)


def limp_home(truth: Truth, angle: float, preload: float, stiffness: float, corner: float) -> dict[str, Any]:
    """The same spring as the model writes it: what it adds to the return spring."""
    mine = {"T_lh": preload + truth.T_PL + truth.K_s * angle, "K_lh": stiffness - truth.K_s,
            "theta_lh": angle, "d_lh": 0.5 * corner}  # fmt: skip
    return {symbol: np.array([value]) for symbol, value in mine.items()}


def test_a_plate_with_a_limp_home_spring_rests_where_the_independent_one_does() -> None:
    rng = np.random.default_rng(4300)
    truth = draw_truth(rng, spread=0.3)
    angle, preload, stiffness = rng.uniform(0.08, 0.25), rng.uniform(0.35, 0.5), rng.uniform(0.5, 1.0)
    effects = Effects(limp_home_spring=LimpHomeSpring(angle, stiffness, preload, 0.002))
    model = fleets.of([truth], ("limp_home_spring",), **limp_home(truth, angle, preload, stiffness, 0.002))
    found = {name: told.value[0] for name, told in measured(model).items()}
    rest = resting_angle(truth, effects)
    assert rest > 0.02
    assert found["default_position"] == pytest.approx(rest, abs=1e-3 * OPEN)
    cut = terminals_open(truth, effects)
    home = float(np.asarray(brentq(partial(restoring_torque, record(cut)), 0.0, OPEN)))
    # where a swing just grazes the band its end jumps by half a swing: it lies between those of two bands close by
    late, early = (back(cut, home, near) for near in (0.0495, 0.0505))
    assert 0.99 * early <= found["unpowered_return"] <= 1.01 * late
    early, late = stroke(throttle(truth, effects), 12.0, 0.0, 0.1 * OPEN, 0.9 * OPEN)
    assert found["opening_time"] == pytest.approx(late - early, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "winding"), [("hot", 100.0), ("cold", -40.0)])
def test_a_hot_and_a_cold_unit_are_those_of_the_independent_simulation(name: str, winding: float) -> None:
    truth = draw_truth(np.random.default_rng(4400), spread=0.2)
    there = next(each for each in conditions((9.0,)) if each.name.startswith(name))
    found = {k: told.value[0] for k, told in measured(fleets.of([truth]), there).items()}
    flux = 1.0 - 0.002 * (winding - 20.0)
    changed = replace(truth, R_a=truth.R_a * (1.0 + 0.00393 * (winding - 20.0)), K_b=truth.K_b * flux,
                      K_m=truth.K_m * flux)  # fmt: skip
    early, late = stroke(throttle(changed, NONE), 9.0, 0.0, 0.1 * OPEN, 0.9 * OPEN)
    assert found["opening_time"] == pytest.approx(late - early, rel=0.01)


@pytest.mark.slow
def test_the_hysteresis_of_eqs_1_2_is_its_closed_form() -> None:
    units = fleets.truths(5, 1)
    model = fleets.of(units)
    found = measured(model)
    torque = np.array([unit.N * unit.K_m for unit in units])
    dry = np.array([unit.T_f for unit in units])
    spring = np.array([unit.T_PL + unit.K_s * 0.5 * OPEN for unit in units])
    assert found["current_hysteresis"].value == pytest.approx(dry / torque, rel=1e-9)
    assert found["holding_current"].value == pytest.approx(spring / torque, rel=1e-9)
    preload = np.array([unit.R_a * (unit.T_PL + unit.T_f) for unit in units]) / torque
    assert found["breakaway_voltage_opening"].value == pytest.approx(preload, rel=1e-9)


@pytest.mark.slow
def test_a_contact_that_yields_before_it_slides_counts_once_it_does() -> None:
    units = fleets.truths(2, 1)
    plain = measured(fleets.of(units))["current_hysteresis"].value
    share = 0.25 * np.array([unit.T_f for unit in units])
    model = fleets.of(units, ("presliding_friction",), T_z=share, delta_z=np.full(2, 0.002), tau_z=np.full(2, 0.01))
    assert measured(model)["current_hysteresis"].value == pytest.approx(1.25 * plain, rel=1e-9)


def test_what_cannot_be_told_is_nan_and_says_why() -> None:
    units = fleets.truths(5, 2)  # as many as elsewhere: one program
    units[1] = replace(units[1], T_PL=6.0)  # a spring that no supply overcomes
    found = measured(fleets.of(units))
    opening = found["opening_time"]
    assert np.isnan(opening.value).tolist() == [False, True, False, False, False]
    assert "never reaches 90 %" in opening.why
    linearity = found["sensor_linearity"]
    assert np.isnan(linearity.value).all()
    assert "not modelled" in linearity.why
    assert found["closing_time"].why == ""


@pytest.mark.slow
def test_the_line_of_a_sensor_is_as_bent_as_its_bow() -> None:
    model = fleets.of(
        fleets.truths(2, 3), ("position_sensor_nonlinearity",), E_2=np.array([0.01, -0.02]), E_3=np.zeros(2)
    )
    assert PositionSensorNonlinearity in model.types
    assert measured(model)["sensor_linearity"].value == pytest.approx([0.01, 0.02], rel=1e-4)


def test_one_unit_of_many_is_that_unit_alone() -> None:
    units = fleets.truths(5, 4, spread=0.2)
    together, alone = measured(fleets.of(units)), measured(fleets.of(units[3:4]))
    for figure in FIGURES:
        assert together[figure.name].value.shape == (5,)
        assert together[figure.name].value[3] == pytest.approx(alone[figure.name].value[0], rel=1e-9, nan_ok=True)


def test_every_figure_says_what_it_is() -> None:
    for figure in FIGURES:
        assert all((figure.name, figure.unit, figure.meaning, figure.source))
        assert figure.meaning[0].islower()
    assert len({figure.name for figure in FIGURES}) == len(FIGURES)


@pytest.mark.slow
def test_a_prediction_is_the_spread_of_the_units_at_each_condition() -> None:
    model = fleets.of(fleets.truths(40, 5))
    found = {each.condition.name: each for each in predict(model)}
    assert list(found)[:5] == ["bench, 9 V", "bench, 12 V", "bench, 14 V", "bench, 16 V", "hot, 9 V"]
    value = measured(model, Condition("", 9.0, 100.0))["opening_time"].value
    told = found["hot, 9 V"].figures["opening_time"]
    assert told.mean == pytest.approx(value.mean(), rel=1e-9)
    assert (told.low, told.high) == pytest.approx(tuple(np.quantile(value, (0.025, 0.975))), rel=1e-9)
    assert told.told == 40
    bent = found["hot, 9 V"].figures["sensor_linearity"]
    assert (bent.mean, bent.low, bent.told) == (None, None, 0)
    slower = [found[f"{name}, 9 V"].figures["opening_time"].mean or 0.0 for name in ("cold", "bench", "hot")]
    assert slower == sorted(slower)


def test_further_conditions_of_a_fleet_compile_nothing() -> None:
    model, traced = fleets.of(fleets.truths(5, 5)), []

    def heard(event: str, duration_secs: float, **kwargs: Any) -> None:
        traced.append(kwargs.get("fun_name"))

    jax.clear_caches()
    jax.monitoring.register_event_duration_secs_listener(heard)
    try:
        measured(model)
        first = traced.count("_simulate_motion")
        predict(model)
    finally:
        jax.monitoring.unregister_event_duration_listener(heard)
    assert traced.count("_simulate_motion") == first > 0


def test_friction_in_the_cold_is_left_alone_unless_asked_for() -> None:
    model = fleets.of(fleets.truths(5, 6))
    plain, more = (measured(model, conditions((12.0,), cold_friction)[-1])["current_hysteresis"].value
                   for cold_friction in (1.0, 1.5))  # fmt: skip
    assert more == pytest.approx(1.5 * plain)


def test_an_estimate_beyond_its_bound_is_taken_to_it_and_a_missing_one_refused() -> None:
    model = fleets.of(fleets.truths(3, 7))
    values = {s: v.copy() for s, v in model.values.items() if s in model.free_parameters.layout.free}
    values["T_f"][1] = -0.01
    bounded = fleet_model(model.config, model.free_parameters, model.units, values)
    assert bounded.values["T_f"].tolist() == [values["T_f"][0], 0.0, values["T_f"][2]]
    assert bounded.values["K_m"] == pytest.approx(bounded.values["K_b"])
    with pytest.raises(UsageError, match="no values of T_f"):
        fleet_model(model.config, model.free_parameters, model.units, {s: v for s, v in values.items() if s != "T_f"})
    values["R_a"][0] = np.nan
    with pytest.raises(UsageError, match="R_a of the fleet"):
        fleet_model(model.config, model.free_parameters, model.units, values)
    assert {f.name for f in fields(Truth)} - {"N"} <= set(bounded.values)
