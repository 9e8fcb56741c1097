"""Gains over the supply: as typed in, by hand, on the independent throttle body, and what they are worth there."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

import rigs
from etcfit.control.pid import Gains, Requirements, Task
from etcfit.control.pid.feedforward import bias_of
from etcfit.control.setpoint import trapezoid
from etcfit.control.settings import ConditionSettings, DesignSettings
from etcfit.control.supply_table import SupplyTable, ecu_for_supply, over_position, supply_table
from etcfit.model.ecu import Ecu, Notation
from etcfit.model.ecus import ECUS, EcuProfile, Scheduling
from etcfit.model.effects.springs import LimpHomeSpring
from etcfit.reporting.blocks import render, shown
from etcfit.reporting.control import gains
from etcfit.reporting.table import there
from etcfit.run_folder.pid import supply_table_json
from independent.bench_twin import TRUTH
from independent.control import Computer, failing, follow
from independent.effects import NONE
from independent.simulate import throttle
from independent.truth import OPEN

GAINS = Gains(60.0, 300.0, 0.6)
ECU = Ecu(period=1e-3, supply=12.0, filter=2e-3)
SUPPLIES = ConditionSettings(winding=(23.0, 23.0), friction=(1.0, 1.0))  # nothing but the supply changes
TRAPEZOID = trapezoid(lead=0.3)


def task_with(profile: EcuProfile | None = None, ecu: Ecu = ECU, **further: Any) -> Task:
    given = {symbol: value for symbol, value in asdict(TRUTH).items() if symbol != "N"}
    loop = replace(rigs.loop(ecu=ecu, **given), **further)
    settings = DesignSettings(conditions=SUPPLIES)
    return Task(rigs.plant(loop), ecu, Requirements(), loop, TRAPEZOID, settings=settings, profile=profile)


@pytest.fixture(scope="module")
def found() -> SupplyTable:
    return supply_table(task_with(), GAINS)


def written(profile: EcuProfile | None = None) -> dict[str, Any]:
    task = task_with(profile)
    return supply_table_json(task, GAINS, supply_table(task, GAINS))


def volts(percent: float, supply: float) -> float:
    """V/rad of a gain in % of duty over % of the travel, by hand."""
    return percent / 100.0 * supply / (OPEN / 100.0)


@pytest.mark.slow
@pytest.mark.parametrize("supply", [9.0, 15.0])
def test_a_row_of_the_table_keeps_the_response_of_the_independent_plate(supply: float) -> None:
    """What is typed in for 9 V, in 9 V, is what was designed in 12 V; what is typed in for 12 V is not."""
    table = written()
    plant, wanted = throttle(TRUTH, NONE), OPEN * TRAPEZOID.at(TRAPEZOID.instants(1e-3))
    rows = dict(zip(table["supply_V"], zip(*(table["gains"][name] for name in "PID"), strict=True), strict=True))
    assert list(rows) == [9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0]

    def angle(row: float) -> np.ndarray:
        typed = Computer(*(volts(percent, supply) for percent in rows[row]), supply=supply)
        return follow(plant, typed, wanted)[0]

    designed, _ = follow(plant, Computer(*GAINS, supply=12.0), wanted)
    assert np.max(np.abs(angle(supply) - designed)) < 1e-6 * OPEN
    assert np.max(np.abs(angle(12.0) - designed)) > 0.01 * OPEN


def test_what_it_is_worth_is_what_the_independent_plate_says(found: SupplyTable) -> None:
    """Their computer reckons with 12 V and gets another supply; its gains over that supply are the table's."""
    plant, time = throttle(TRUTH, NONE), TRAPEZOID.instants(1e-3)
    wanted, begins = OPEN * TRAPEZOID.at(time), 300
    still, sound = np.zeros(time.size), np.full(time.size, np.nan)

    def rmse(supply: float, scale: float) -> float:
        computer = Computer(*(scale * gain for gain in GAINS), supply=12.0)
        angle = failing(plant, computer, wanted, still, sound, np.full(time.size, supply / 12.0))
        return 100.0 / OPEN * float(np.sqrt(np.mean((angle - wanted)[begins:] ** 2)))

    assert [end.supply for end in found.ends] == [9.0, 15.0]
    for end in found.ends:
        assert end.fixed.rmse_pct == pytest.approx(rmse(end.supply, 1.0), rel=0.02)
        assert end.table.rmse_pct == pytest.approx(rmse(end.supply, 12.0 / end.supply), rel=0.02)
    low, high = found.ends
    assert low.fixed.rmse_pct > 1.15 * high.fixed.rmse_pct
    # the table is the loop that was designed, in either
    assert low.table.rmse_pct == pytest.approx(high.table.rmse_pct, rel=1e-3)
    assert (low.helps, high.helps) == (True, False)
    assert low.table.gain_margin_db == pytest.approx(high.table.gain_margin_db)
    assert low.fixed.gain_margin_db - high.fixed.gain_margin_db == pytest.approx(20.0 * np.log10(15.0 / 9.0), abs=0.05)


def test_feed_forward_is_divided_with_the_gains() -> None:
    """A bias in % holds the wrong spring in another supply; without an integral that is what is left of the error."""
    model = task_with().loop
    task = task_with(bias=bias_of(model.nominal, *model.body))
    low, high = supply_table(task, GAINS._replace(Ki=0.0)).ends
    assert low.table.steady_state_error_pct == pytest.approx(high.table.steady_state_error_pct, abs=0.02)
    assert low.fixed.steady_state_error_pct > 1.3 * low.table.steady_state_error_pct


def test_the_limit_of_the_duty_is_the_ecus_and_goes_with_the_supply() -> None:
    ecu = ECU._replace(pwm=0.012, slew=120.0, duty=0.8, integral=0.3)
    weak = ecu_for_supply(ecu, 9.0)
    assert (weak.limit, weak.pwm, weak.slew) == pytest.approx((7.2, 0.009, 90.0))
    assert (weak.duty, weak.integral, weak.period) == (ecu.duty, ecu.integral, ecu.period)
    # the supply of 4 V cannot drive the trapezoid, whatever its gains
    narrow = replace(task_with().settings, conditions=replace(SUPPLIES, supply=(2.5, 12.0)))
    weak_end, end = supply_table(replace(task_with(), settings=narrow), GAINS).ends
    assert weak_end.table.rmse_pct > 2.0 * end.table.rmse_pct


def test_an_ecu_that_divides_by_the_battery_means_volts_as_the_independent_computer_in_volts_does() -> None:
    """Its gains mean the same at 9 and at 15 V, a table has nothing to do; what is left is the supply's limit."""
    task = task_with(ecu=ECU._replace(compensated=1.0))
    table = supply_table(task, GAINS)
    plant, time = throttle(TRUTH, NONE), TRAPEZOID.instants(1e-3)
    wanted, begins = OPEN * TRAPEZOID.at(time), 300
    for end in table.ends:
        angle, _ = follow(plant, Computer(*GAINS, supply=end.supply), wanted)
        rmse = 100.0 / OPEN * float(np.sqrt(np.mean((angle - wanted)[begins:] ** 2)))
        assert end.fixed.rmse_pct == pytest.approx(rmse, rel=0.02)
        assert end.table == end.fixed
    low, high = table.ends
    assert low.fixed.rmse_pct == pytest.approx(high.fixed.rmse_pct, rel=1e-3)
    assert low.fixed.gain_margin_db == pytest.approx(high.fixed.gain_margin_db)
    said = supply_table_json(task, GAINS, table)
    assert len({*said["gains"]["P"]}) == 1
    assert "no table is needed" in said["says"][0]
    # more than the supply has it cannot send: 2.5 V do not drive the trapezoid
    narrow = replace(task.settings, conditions=replace(SUPPLIES, supply=(2.5, 12.0)))
    weak, sound = supply_table(replace(task, settings=narrow), GAINS).ends
    assert weak.fixed.rmse_pct > 2.0 * sound.fixed.rmse_pct


def test_gains_whose_unit_is_not_published_have_a_table_of_shares() -> None:
    task = task_with(ECUS["maxxecu"])
    found = supply_table_json(task, GAINS, supply_table(task, GAINS))
    assert found["gains"]["P"] == pytest.approx([12.0 / volt for volt in found["supply_V"]])
    assert found["unit"] == "share of the gain at 12 V"


def test_gains_in_volts_need_no_table(found: SupplyTable) -> None:
    rows = found.written(GAINS, Notation("V", "rad"), ECU, OPEN)
    assert all(row == pytest.approx(tuple(GAINS)) for row in rows)
    percent = found.written(GAINS, Notation("%", "%", "ticks"), ECU, OPEN)
    assert [row.I * supply for row, supply in zip(percent, found.supplies, strict=True)] == pytest.approx(
        [100.0 * GAINS.Ki * 1e-3 * OPEN / 100.0] * 7
    )


def test_a_straight_table_is_off_by_as_little_as_it_says(found: SupplyTable) -> None:
    between = np.linspace(9.0, 15.0, 601)
    rows = [row.P for row in found.written(GAINS, Notation("%", "%"), ECU, OPEN)]
    exact = 100.0 * GAINS.Kp * OPEN / 100.0 / between
    off = np.abs(np.interp(between, found.supplies, rows) / exact - 1.0)
    assert np.max(off) < 1.0 / (4.0 * 9.0**2)
    assert np.max(off) > 0.8 / (4.0 * 9.5**2)


def test_over_the_position_the_springs_alone_differ() -> None:
    """Without a limp-home spring nothing does; with one the gain below its corner is that of the stiffer spring."""
    plain = over_position(task_with(), GAINS)
    assert plain.alike == 1.0
    assert plain.ratio == pytest.approx(np.ones(201), abs=1e-6)
    loop = rigs.loop(LimpHomeSpring, ecu=ECU, T_lh=0.5, K_lh=8.0, theta_lh=0.3 * OPEN, d_lh=0.002)
    task = Task(rigs.plant(loop), ECU, Requirements(), loop, TRAPEZOID)
    at = over_position(task, GAINS._replace(Ki=0.0))
    assert np.ptp(at.ratio[at.shares < 0.28]) < 1e-6
    w = 2.0 * np.pi * at.frequency
    assert w > 1.0
    assert at.ratio[-1] == pytest.approx(by_hand(w, 0.15) / by_hand(w, 8.15), rel=1e-3)
    assert at.alike < 0.4


def by_hand(w: float, stiffness: float) -> float:
    """|N K_m / ((R + j w L)(K_s - J w^2 + j w B) + j w N^2 K_m K_b)| of the nominal values, rad/V."""
    n, k = 20.68, 0.0189
    of = {p: rigs.values()[p] for p in ("R_a", "L_a", "J_m", "J_L", "B_m", "B_L")}
    inertia, damping = n**2 * of["J_m"] + of["J_L"], n**2 * of["B_m"] + of["B_L"]
    mechanics = stiffness - inertia * w**2 + 1j * w * damping
    return abs(n * k / ((of["R_a"] + 1j * w * of["L_a"]) * mechanics + 1j * w * n**2 * k**2))


@pytest.mark.parametrize("profile", ECUS.values(), ids=ECUS)
def test_a_table_is_shown_where_there_is_somewhere_to_type_it_in(profile: EcuProfile, found: SupplyTable) -> None:
    pid = {"supply_table": supply_table_json(task_with(profile), GAINS, found)}
    parts = there(gains.supply_table(pid), gains.tables_of_gains(pid))
    said = " ".join("".join(render(shown(part)) for part in parts).split())
    has = profile.scheduling in (Scheduling.TABLE, Scheduling.CODE)
    assert has == (profile.name in ("emtron", "arduino", "generic"))
    assert has == ("Gains over the supply" in said)
    assert f"{profile.title} has {profile.scheduling.value}" in said
    assert "RMSE" in said
    assert pid["supply_table"]["ecu_has"] == profile.scheduling.name.lower()
