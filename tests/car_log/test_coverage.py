"""What a log asks for is counted as it was made, and what it lacks is asked for."""

from __future__ import annotations

import numpy as np

import car_logs
from etcfit.car_log import DriveLog, Series, record_next
from etcfit.car_log.coverage import WANTED, moves_of


def held(*levels: float, seconds: float = 1.0, edge: float = 0.0, rate: float = 200.0) -> DriveLog:
    """Levels in per cent, held so long each, straight edges between them."""
    corners, values, now = [0.0], [levels[0]], 0.0
    for k, level in enumerate(levels):
        now += seconds
        corners += [now, now + edge]
        values += [level, levels[min(k + 1, len(levels) - 1)]]
    time = np.arange(0.0, now, 1.0 / rate)
    value = np.interp(time, corners, values)
    return DriveLog("a.csv", Series(time, value), Series(time, value))


def lacking(*logs: DriveLog) -> set[str]:
    return {lack.name for lack in record_next(logs)}


def test_steps_and_rests_are_counted_as_they_were_made() -> None:
    moves = moves_of([held(20.0, 22.0, 20.0, 60.0, 2.0, seconds=0.8)])
    assert np.allclose(moves.steps, [[20, 22], [22, 20], [20, 60], [60, 2]], atol=0.2)
    assert np.allclose(moves.rests, 0.8, atol=0.03)
    assert moves.reach == (2.0, 60.0)
    assert [moves.between(1.0, 3.0, sign) for sign in (1, -1)] == [1, 1]


def test_what_there_is_enough_of_is_not_asked_for() -> None:
    every = {wanted.name for wanted in WANTED}
    foot = car_logs.drive()
    time = foot["time"]
    street = DriveLog("a.csv", Series(time, foot["position"]), Series(time, foot["setpoint"]))
    assert lacking(street) == every | {"supply"}
    small, large = held(*[20.0, 22.0] * 5), held(*[2.0, 40.0] * 3)
    assert lacking(street, small) == (every | {"supply"}) - {"small steps"}
    assert lacking(small, large) == {"hold at rest", "the whole travel", "supply"}
    assert lacking(small, large, held(1.0, 99.0, 1.0, seconds=5.0)) == {"supply"}


def test_a_ramp_is_no_step_and_a_log_without_a_setpoint_asks_for_nothing() -> None:
    ramp = held(2.0, 60.0, 2.0, 60.0, edge=0.5)
    assert moves_of([ramp]).steps.size == 0
    blind = DriveLog("a.csv", ramp.position, None)
    assert lacking(blind) == {wanted.name for wanted in WANTED} | {"supply"}
