"""The XL330 pendulum: duty has the right sign and size, and open terminals lie in the right test."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.datasets.bam_xl330 import signed_duty


@pytest.fixture(scope="module")
def bam(fetched):
    return fetched("bam-xl330")


def test_duty_is_a_signed_count_logged_unsigned() -> None:
    load = np.array([0.0, 885.0, 65535.0, 65536.0 - 885.0])
    assert signed_duty(load) == pytest.approx([0.0, 1.0, -1 / 885, -1.0])


def test_eight_runs_of_which_two_are_let_go(bam) -> None:
    trajectories = "sin_sin", "lift_and_drop", "up_and_down", "sin_time_square"
    driven = {f"response/kp{kp}_{name}.csv" for kp in (100, 400) for name in trajectories}
    assert bam.traces == driven | {"inertia/kp100_lift_and_drop.csv", "inertia/kp400_lift_and_drop.csv"}


def test_one_run_of_each_gain_is_held_out(bam) -> None:
    held_out = bam.rig["holdout"]["files"]
    assert set(held_out) <= bam.traces
    assert sorted(file[:14] for file in held_out) == ["response/kp100", "response/kp400"]


@pytest.mark.parametrize("kp", [100, 400])
def test_positive_duty_raises_the_position(bam, kp: int) -> None:
    # held still against gravity, the motor pushes up the side the arm is on
    trace = bam.trace(f"response/kp{kp}_up_and_down.csv")
    up = trace[trace["position [rad]"] > 0.1]
    assert (up["duty [%]"] > 0).mean() > 0.95
    assert trace["duty [%]"].abs().max() <= 100.0
    assert trace["supply [V]"].between(5.5, 9.5).all()


@pytest.mark.parametrize("kp", [100, 400])
def test_open_terminals_are_cut_off_where_the_torque_goes_off(bam, kp: int) -> None:
    driven, free = (bam.trace(f"{test}/kp{kp}_lift_and_drop.csv") for test in ("response", "inertia"))
    assert list(free) == ["time [s]", "position [rad]"]
    assert driven["time [s]"].iloc[-1] < 2.0 < free["time [s]"].iloc[0] < 2.01
    assert driven["duty [%]"].iloc[-1] < -30.0  # still held up
    assert abs(free["position [rad]"].iloc[-1]) < 0.05  # fallen, and hanging down


def test_time_rises_everywhere(bam) -> None:
    assert all((np.diff(bam.trace(file)["time [s]"]) > 0).all() for file in bam.traces)
