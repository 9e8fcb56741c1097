"""An edge in step with the samples acts where its phase says: against the exact current of an RL circuit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.model.rig_effects import EdgePhase, Place
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import prepare
from etcfit.rig.base import Channel, Fixed, Measurement, RigConfig

R, L, DT, ROWS, JUMP = 2.0, 1e-3, 2e-4, 60, 20  # ohm, H, s; the first sample that shows the jump
TEST = "inductance"
PHASE = EdgePhase.at(Place(TEST))
CONFIG = RigConfig("by hand", effects=(PHASE.name,), parameters={"R_a": Fixed(R), "L_a": Fixed(L), "K_b": Fixed(0.03)})


def held_plate(turn: float | None = None) -> Measurement:
    """1 V, and 3 V from the jump on; the logged current does not matter."""
    time = DT * np.arange(ROWS)
    volts = np.where(np.arange(ROWS) < JUMP, 1.0, 3.0)
    channels = {
        "voltage": Channel(time, volts, 1e-3, True, "voltage", "V", 1.0),
        "current": Channel(time, volts / R, 1e-3, True, "current", "A", 1.0),
    }
    turns = None if turn is None else np.where(np.arange(ROWS - 1) == JUMP - 1, turn, np.nan)
    return Measurement(f"{TEST}/1.csv", TEST, time, channels, edge_turn=turns)


def simulated(phase: float, turn: float | None = None, config: RigConfig = CONFIG) -> np.ndarray:
    """The model's current, A."""
    trace = prepare(held_plate(turn), config)
    assert trace is not None
    known = free_parameters(config)
    x = known.layout.coordinates({s: known.layout.parameter(s).nominal for s in known.layout.free})
    x = np.where([s.startswith("edge_phase") for s in known.layout.free], phase, x)
    problem = EstimationProblem.of(config, known, (trace,), [np.full(ROWS - 1, 24)])
    return problem.free_run(x)[0][:, 0]


def exact(share: float) -> np.ndarray:
    """The current of a circuit whose voltage jumps that share of an interval after the last sample before it, A."""
    late = np.where(np.arange(ROWS) < JUMP, 0.0, DT * (np.arange(ROWS) - (JUMP - 1) - share))
    return 1.0 / R + 2.0 / R * (1.0 - np.exp(-late * R / L))


CASES = [(0.2, None, 0.2), (0.85, 0.0, 0.85), (-0.1, 1.0, 0.9), (-0.1, 0.0, -0.1), (0.05, 1.0, 1.05), (0.5, None, 0.5)]


@pytest.mark.parametrize(("phase", "turn", "share"), CASES)
def test_the_current_rises_from_where_the_phase_puts_the_edge(phase: float, turn: float | None, share: float) -> None:
    assert_allclose(simulated(phase, turn), exact(share), atol=2e-5)


def test_an_edge_that_keeps_no_step_is_spread_over_its_interval() -> None:
    alone = replace(CONFIG, effects=())
    assert_allclose(simulated(0.9, np.nan), simulated(0.9, None, alone), atol=1e-12)


def test_a_jump_at_a_known_place_has_no_uncertain_instant() -> None:
    known, unknown = (prepare(held_plate(), c) for c in (CONFIG, replace(CONFIG, effects=())))
    assert known is not None
    assert unknown is not None
    step = [np.ones(ROWS - 1, dtype=int)]
    with_, without = (EstimationProblem.of(CONFIG, free_parameters(CONFIG), (t,), step) for t in (known, unknown))
    assert not np.any(with_.batch.disturbance.edge)
    assert np.any(without.batch.disturbance.edge)
    assert with_.batch.steps.edge is not None
    assert without.batch.steps.edge is None
