"""Which columns are duty and sensors of the throttle; never an engine's."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.car_log.others import DUTY, SECOND, VOLTS_1, VOLTS_2, found, series

TIME = np.arange(5) / 10.0


@pytest.mark.parametrize(
    ("header", "quantity"),
    [("ETB Duty [%]", DUTY), ("ETB: Duty (%)", DUTY), ("duty [1]", DUTY), ("TP (Sub)", SECOND), ("TPS2", SECOND),
     ("TPS1 secondary [%]", SECOND), ("rawTps1Primary [V]", VOLTS_1), ("rawTps1Secondary [V]", VOLTS_2),
     ("TPS 1 Voltage", VOLTS_1), ("TPS2 (mV)", VOLTS_2)],
)  # fmt: skip
def test_names_of_the_throttle(header: str, quantity: str) -> None:
    assert list(found(["Time", header])) == [quantity]


@pytest.mark.parametrize(
    "header",
    ["Injector Duty Cycle [%]", "Inj Duty", "Boost Duty [%]", "Fan Duty", "TPS [%]", "AFR Target", "TPS2 [deg]"],
)
def test_an_engine_s_duty_and_other_units_are_left_alone(header: str) -> None:
    assert found(["Time", header]) == {}


def test_units_and_holes() -> None:
    cells = [TIME, np.array([0.1, -0.2, np.nan, 0.4, 0.5]), 1e3 * np.arange(5.0)]
    out = series(TIME, cells, {DUTY: (1, "1"), VOLTS_2: (2, "mv")})
    assert out[DUTY].value == pytest.approx([10.0, -20.0, 40.0, 50.0])
    assert out[DUTY].time == pytest.approx(TIME[[0, 1, 3, 4]])
    assert out[VOLTS_2].value == pytest.approx(np.arange(5.0))


def test_a_duty_without_a_unit_is_a_share_where_it_is_never_above_one() -> None:
    share, percent = np.linspace(-0.9, 1.0, 5), np.linspace(-90.0, 100.0, 5)
    for cells in (share, percent):
        assert series(TIME, [cells], {DUTY: (0, "")})[DUTY].value == pytest.approx(percent)
