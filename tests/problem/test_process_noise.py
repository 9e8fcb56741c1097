"""How far a simulation may be off, against what follows by hand for the coil of a held plate."""

from __future__ import annotations

from inspect import signature
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.model.effects import PAPER
from etcfit.model.effects.controller import Controller
from etcfit.model.stepper import State, Step
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.process_noise import ORDER, impact, impacts_nearby, impacts_nearby_here, order_of
from etcfit.rig.base import Channel, Fixed, Measurement, RigConfig
from measurements import prepared

R, L, DT, ROWS = 2.0, 1e-3, 1e-4, 80  # ohm, H, s
SIGMA = 0.01  # A
CONFIG = RigConfig("by hand", parameters={"R_a": Fixed(R), "L_a": Fixed(L), "K_b": Fixed(0.03)})


def problem() -> EstimationProblem:
    """1 V without noise from before the log begins; the current is logged with some."""
    time, volts = DT * np.arange(ROWS), np.ones(ROWS)
    channels = {
        "voltage": Channel(time, volts, 1e-9, False, "voltage", "V", 1.0),
        "current": Channel(time, volts / R, SIGMA, False, "current", "A", 1.0),
    }
    trace = prepared(Measurement("inductance/1.csv", "inductance", time, channels), CONFIG)
    return EstimationProblem.of_traces(CONFIG, free_parameters(CONFIG), (trace,), [np.full(ROWS - 1, 8)])


def at(problem: EstimationProblem) -> np.ndarray:
    layout = problem.layout
    return layout.coordinates({s: layout.parameter(s).nominal for s in layout.free})


@pytest.mark.slow
def test_what_is_uncertain_of_the_start_fades_with_the_time_constant() -> None:
    """var = sigma^2 + var_0 exp(-2 R t / L)."""
    known = problem()
    (trace,) = known.batch.traces
    begun = trace.start.sd[0] ** 2
    assert begun > SIGMA**2
    (found,) = known.free_run_variance(at(known))
    assert_allclose(found[:, 0], SIGMA**2 + begun * np.exp(-2.0 * R / L * trace.instants), rtol=2e-3)


def test_the_filter_knows_the_current_better_the_more_samples_it_has_seen() -> None:
    """1 / weight^2 = S, from sigma^2 + var_0 down to sigma^2."""
    known = problem()
    (trace,), ((lane, _, marks),) = known.batch.traces, known.batch.places
    spread = 1.0 / np.asarray(known.kalman(at(known)).weight)[marks, lane, 0] ** 2
    assert spread[0] == pytest.approx(SIGMA**2 + trace.start.sd[0] ** 2, rel=1e-6)
    assert np.all(np.diff(spread) < 1e-12)
    assert spread[-1] == pytest.approx(SIGMA**2, rel=1e-3)


def test_an_engine_computer_adds_its_memories_and_an_instant_to_the_error_states() -> None:
    assert order_of(PAPER) == ORDER
    assert order_of((*PAPER, Controller)) == ORDER + len(Controller.z0) + 1


@pytest.mark.parametrize(
    ("theta", "omega", "mobile", "plate", "lost"),
    [
        pytest.param((0.1, 0.0), (-30.0, 0.0), 1.0, 1.0, 30.0, id="a plate that lands"),
        pytest.param((0.01, 0.002), (-30.0, 12.0), 1.0, 1.0, 42.0, id="a plate that rebounds from the closed stop"),
        pytest.param((98.99, 98.998), (30.0, -12.0), 1.0, 1.0, 42.0, id="a plate that rebounds from the open stop"),
        pytest.param((0.1, 0.1), (-3.0, 12.0), 1.0, 1.0, 0.0, id="a plate that turns back far from a stop"),
        pytest.param((0.0, -0.01), (-30.0, 12.0), 1.0, 1.0, 42.0, id="a motor that rattles in its gear's play"),
        pytest.param((0.1, 0.1), (-3.0, 0.0), 1.0, 1.0, 0.0, id="a plate that sticks half open"),
        pytest.param((-9.0, -9.0), (-2.0, 1.0), 1.0, 0.0, 0.0, id="a motor without a plate that turns back"),
        pytest.param((0.0, 0.0), (-2.0, 0.0), 0.0, 1.0, 0.0, id="a plate that is held"),
    ],
)
def test_an_impact_is_what_a_plate_or_its_gear_meets_and_five_samples_around_it_know(
    theta: tuple[float, float], omega: tuple[float, float], mobile: float, plate: float, lost: float
) -> None:
    """The twentieth of forty steps, each with a sample; a stop at 0 and one far off."""
    rows, at_step = 40, 20
    moving = np.arange(rows)[:, None] == at_step
    before, after = (State(np.zeros((rows, 1)), *(np.where(moving, x[k], 1.0) for x in (theta, omega))) for k in (0, 1))
    nothing, sampled = np.zeros((rows, 1)), np.ones((rows, 1, 1))
    known: dict[str, Any] = {
        name: nothing for name, each in signature(Step).parameters.items() if each.default is each.empty
    }
    known |= {"dt": nothing + 1e-3, "upper": nothing + 99.0, "mobile": nothing + mobile, "plate": nothing + plate}
    steps = Step(**known)
    lost_there = np.asarray(impact(before, after, steps))
    near = np.abs(np.arange(rows) - at_step) <= 5
    for nearby in (impacts_nearby, impacts_nearby_here):
        assert_allclose(np.asarray(nearby(lost_there, sampled))[:, 0], np.where(near, lost, 0.0))
