"""Margins and stability against a loop that is run tick by tick, in plain numpy, with its gain or its phase turned."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

import rigs
from etcfit.control.pid import Gains
from etcfit.control.pid.formulas import Ultimate, from_ultimate, ultimate
from etcfit.control.pid.linear_loop import COARSE, closed, margins, respond, sampled
from etcfit.control.setpoint import trapezoid
from etcfit.model.ecu import Ecu
from etcfit.model.linear import PAPER_EQ_8, TransferFunction

TABLE_2 = TransferFunction(2.208e5, 1033.0, 9.370e4, 1.282e5)
SLOW = Ecu(period=5e-3, filter=10e-3)


class Case(NamedTuple):
    """A loop."""

    plant: TransferFunction
    ecu: Ecu
    gains: Gains


def late(plant: TransferFunction, delay: float, lag: float) -> TransferFunction:
    return TransferFunction(plant.b0, plant.a2, plant.a1, plant.a0, delay, lag)


CASES = {
    "the paper's": Case(PAPER_EQ_8, Ecu(), Gains(6.0, 100.0, 0.087)),
    "stiff": Case(TABLE_2, Ecu(), Gains(130.0, 2302.0, 0.73)),
    "no filter": Case(TABLE_2, Ecu(period=2e-3, filter=0.0), Gains(60.0, 600.0, 0.5)),
    "P alone": Case(TABLE_2, Ecu(period=5e-3), Gains(40.0, 0.0, 0.0)),
    "part of a tick late": Case(TABLE_2, Ecu(delay=0.4e-3), Gains(100.0, 1500.0, 0.6)),
    "a tick late": Case(TABLE_2, Ecu(delay=1e-3), Gains(80.0, 1000.0, 0.5)),
    "filtered": Case(TABLE_2, Ecu(delay=1e-3, lag=1e-3), Gains(70.0, 800.0, 0.45)),
    "filtered twice": Case(late(TABLE_2, 0.0, 2e-3), Ecu(delay=0.5e-3, lag=0.7e-3), Gains(50.0, 400.0, 0.35)),
    "late and slow to see": Case(late(TABLE_2, 1.3e-3, 2e-3), Ecu(delay=1e-3), Gains(40.0, 300.0, 0.3)),
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES)


@cache
def ticked_plant(p: TransferFunction, ecu: Ecu) -> tuple[np.ndarray, np.ndarray, int]:
    """By Runge-Kutta in small steps, column by column: a tick's map of the states, and of each voltage that acts in it.

    States: what the ECU reads, what the sensor shows, angle, speed, acceleration.
    """
    T = ecu.period
    ticks_late, part = divmod(round((p.delay + ecu.delay) / T, 9), 1.0)

    def rates(x: np.ndarray, volts: np.ndarray) -> np.ndarray:
        shown = (x[2] - x[1]) / p.lag if p.lag else x[3]
        read = (x[1] - x[0]) / ecu.lag if ecu.lag else shown
        return np.array([read, shown, x[3], x[4], p.b0 * volts - p.a2 * x[4] - p.a1 * x[3] - p.a0 * x[2]])

    # seven runs at once: five states, the voltage that acts first in the tick, the one that acts from `part` on
    x, first, then = np.eye(5, 7), np.eye(1, 7, 5)[0], np.eye(1, 7, 6)[0]
    for span, volts in ((part * T, first), ((1.0 - part) * T, then)):
        h = span / 400
        for _ in range(400):
            k1 = rates(x, volts)
            k2 = rates(x + 0.5 * h * k1, volts)
            k3 = rates(x + 0.5 * h * k2, volts)
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(x + h * k3, volts))
    return x[:, :5], x[:, 5:], int(ticks_late)


def _read(case: Case) -> int:
    """The state that the ECU reads: the angle itself where nothing lags."""
    return 0 if case.ecu.lag else 1 if case.plant.lag else 2


def swing(case: Case, factor: complex, ticks: int = 3000) -> float:
    """Largest state in the last quarter over that in the second, from a kick; above 1 where the loop diverges."""
    states, volts, back = ticked_plant(case.plant, case.ecu)
    (kp, ki, kd), (T, tf) = case.gains, (case.ecu.period, case.ecu.filter)
    x = np.array([1e-3, 1e-3, 1e-3, 0.0, 0.0], dtype=complex)
    integral = derivative = last = 0.0j
    sent = [0.0j] * (back + 2)
    size = np.empty(ticks)
    for k in range(ticks):
        error = -x[_read(case)]
        integral += ki * T * error
        derivative = (tf * derivative + error - last) / (tf + T)
        last = error
        sent = [factor * (kp * error + integral + kd * derivative), *sent[:-1]]
        x = states @ x + volts[:, 0] * sent[back + 1] + volts[:, 1] * sent[back]
        size[k] = abs(x[2]) + 1e-2 * abs(x[3])
    quarter = ticks // 4
    return float(size[-quarter:].max() / size[quarter : 2 * quarter].max())


def decibels(value: float) -> float:
    return 10.0 ** (value / 20.0)


@every_case
def test_the_loop_diverges_where_its_gain_is_turned_past_the_gain_margin(case: Case) -> None:
    found = float(margins(case.gains, case.plant, case.ecu).gain_db)
    assert found > 2.0
    assert max(swing(case, decibels(side * (found - 0.05))) for side in (1, -1)) < 1.0
    assert max(swing(case, decibels(side * (found + 0.05))) for side in (1, -1)) > 1.0


@every_case
def test_the_loop_diverges_where_its_phase_is_turned_past_the_phase_margin(case: Case) -> None:
    found = float(margins(case.gains, case.plant, case.ecu).phase_deg)
    assert found > 5.0
    assert swing(case, np.exp(-1j * np.radians(found - 0.1))) < 1.0
    assert swing(case, np.exp(-1j * np.radians(found + 0.1))) > 1.0


def test_ziegler_and_nichols_are_unstable_under_a_slow_clock_and_told_so() -> None:
    """With half a tick as the hold's only delay the loop would have 0.6 dB to spare."""
    found = ultimate(TABLE_2, SLOW.late)
    assert isinstance(found, Ultimate)
    case = Case(TABLE_2, SLOW, from_ultimate(found))
    assert swing(case, 1.0) > 1.0
    here = margins(case.gains, TABLE_2, SLOW)
    assert here.gain_db < 0.0
    assert here.phase_deg < 0.0
    # the gain that must be taken back to be stable
    assert swing(case, decibels(float(here.gain_db) - 0.05)) < 1.0 < swing(case, decibels(float(here.gain_db) + 0.05))


@every_case
def test_the_spectral_radius_is_how_fast_a_kick_dies(case: Case) -> None:
    radius = float(closed(case.gains, sampled(case.plant, case.ecu), case.ecu).spectral_radius)
    assert radius < 1.0
    assert swing(case, 1.0) ** (1.0 / 1500.0) == pytest.approx(radius, abs=5e-4)


@every_case
def test_the_margins_that_the_search_sees_are_those_that_are_reported(case: Case) -> None:
    coarse, fine = margins(case.gains, case.plant, case.ecu, COARSE), margins(case.gains, case.plant, case.ecu)
    assert float(coarse.gain_db) == pytest.approx(float(fine.gain_db), abs=0.1)
    assert float(coarse.phase_deg) == pytest.approx(float(fine.phase_deg), abs=0.2)


def test_many_gains_around_many_plants_are_each_what_they_are_alone() -> None:
    loop = rigs.loop(ecu=Ecu(delay=0.7e-3), draws={"K_s": [0.3], "L_a": [2e-3]})
    plants = loop.linear()
    gains = Gains(np.array([[40.0, 90.0]]), np.array([[300.0, 900.0]]), np.array([[0.3, 0.5]]))
    found = margins(gains, plants, loop.ecu)
    assert found.gain_db.shape == (2, 2)
    numbers = [float(np.asarray(v)[1, 0]) for v in (plants.b0, plants.a2, plants.a1, plants.a0)]
    alone = margins(Gains(90.0, 900.0, 0.5), TransferFunction(*numbers), loop.ecu)
    assert float(found.gain_db[1, 1]) == pytest.approx(float(alone.gain_db), abs=1e-9)
    assert float(found.phase_deg[1, 1]) == pytest.approx(float(alone.phase_deg), abs=1e-9)


def test_a_plant_that_falls_over_needs_a_least_gain() -> None:
    """1 / (s - 1) twice lagged: P alone must exceed 1 / |G(0)|; with 3 times that 9.5 dB are to spare downwards."""
    den = np.poly([1.0, -400.0, -500.0])
    plant = TransferFunction(-float(den[3]), *den[1:].tolist())
    found = margins(Gains(3.0, 0.0, 0.0), plant, Ecu())
    assert float(found.gain_db) == pytest.approx(20.0 * np.log10(3.0), abs=1e-6)
    assert margins(Gains(0.9, 0.0, 0.0), plant, Ecu()).gain_db < 0.0


@pytest.mark.parametrize("name", ["part of a tick late", "late and slow to see", "filtered", "filtered twice"])
def test_the_response_is_the_loop_run_tick_by_tick(name: str) -> None:
    case = CASES[name]
    setpoint = trapezoid(lead=0.05)
    wanted = setpoint.at(setpoint.instants(case.ecu.period)) - setpoint.shares[0]
    states, volts, back = ticked_plant(case.plant, case.ecu)
    (kp, ki, kd), (T, tf) = case.gains, (case.ecu.period, case.ecu.filter)
    x, integral, derivative, last, sent, y = np.zeros(5), 0.0, 0.0, 0.0, [0.0] * (back + 2), []
    for r in wanted:
        y.append(x[_read(case)])
        error = r - x[_read(case)]
        integral += ki * T * error
        derivative, last = (tf * derivative + error - last) / (tf + T), error
        sent = [kp * error + integral + kd * derivative, *sent[:-1]]
        x = states @ x + volts[:, 0] * sent[back + 1] + volts[:, 1] * sent[back]
    here = respond(case.plant, case.gains, case.ecu, setpoint) - setpoint.shares[0]
    assert np.ptp(here) > 0.3
    assert np.max(np.abs(here - np.array(y))) < 1e-9
