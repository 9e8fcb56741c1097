"""Edges as columns of steps; one in step with the samples acts where its phase says, by the exact current of a coil."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.model.rig_effects import EdgePhase, Place
from etcfit.problem import edges
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace, prepare
from etcfit.rig.base import Channel, Fixed, Measurement, RigConfig
from measurements import prepared

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
    trace = trace_of(turn, config)
    known = free_parameters(config)
    x = known.layout.coordinates({s: known.layout.parameter(s).nominal for s in known.layout.free})
    x = np.where([s.startswith("edge_phase") for s in known.layout.free], phase, x)
    problem = EstimationProblem.of_traces(config, known, (trace,), [np.full(ROWS - 1, 24)])
    return problem.free_run(x)[0][:, 0]


def exact(share: float) -> np.ndarray:
    """The current of a circuit whose voltage jumps that share of an interval after the last sample before it, A."""
    late = np.where(np.arange(ROWS) < JUMP, 0.0, DT * (np.arange(ROWS) - (JUMP - 1) - share))
    return 1.0 / R + 2.0 / R * (1.0 - np.exp(-late * R / L))


# ---- columns of one trace, five steps in each interval unless halved


def in_steps(trace: Trace, count: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Ends of so many equal steps in each interval, and the interval of each, the first instant before them."""
    fine = trace.instants[:-1, None] + DT * np.arange(1, count + 1) / count
    ends = np.concatenate((trace.instants[:1], fine.ravel()))
    return ends, np.concatenate(([0], np.repeat(np.arange(ROWS - 1), count)))


def trace_of(turn: float | None, config: RigConfig = CONFIG) -> Trace:
    return prepared(held_plate(turn), config)


def test_only_intervals_with_an_edge_in_step_get_an_even_number_of_steps() -> None:
    odd = np.full(ROWS - 1, 5)
    halved = edges.halved(trace_of(0.0), odd)
    assert halved[JUMP - 1] == 6
    assert np.all(np.delete(halved, JUMP - 1) == 5)
    assert edges.halved(trace_of(None, replace(CONFIG, effects=())), odd) is odd


def test_an_edge_in_step_is_a_jump_at_half_its_interval_and_another_one_a_ramp() -> None:
    for turn, config, sharp in ((0.0, CONFIG, True), (None, replace(CONFIG, effects=()), False)):
        trace = trace_of(turn, config)
        ends, interval = in_steps(trace, 6)
        early, late = edges.levels(trace, ends, interval)
        inside = interval == JUMP - 1
        if sharp:
            assert_allclose(early[inside], [1, 1, 1, 3, 3, 3], atol=1e-3)
            assert_allclose(late[inside], early[inside])
        else:
            assert_allclose(late[inside], 1.0 + 2.0 * np.arange(1, 7) / 6.0, atol=1e-3)
            assert_allclose(early[inside][1:], late[inside][:-1])


def test_steps_follow_the_phase_and_their_interval_keeps_its_length() -> None:
    trace = trace_of(1.0)
    ends, interval = in_steps(trace, 6)
    columns = edges.in_step(trace, ends, interval)
    inside = interval == JUMP - 1
    assert np.all(columns["turn"][inside] == 1.0)
    assert not np.any(columns["span"][~inside])
    assert_allclose(np.sum(columns["span"]), 0.0, atol=1e-15)
    # d time / ds is the sum of what came before, the whole interval at the jump itself, and 0 at the interval's end
    assert_allclose(columns["moves"][inside], np.cumsum(columns["span"][inside]), atol=1e-15)
    assert_allclose(columns["moves"][inside][2], DT)
    assert edges.in_step(trace_of(None, replace(CONFIG, effects=())), ends, interval) == {}


def test_a_jump_at_an_unknown_instant_stands_at_the_last_entry_of_its_interval() -> None:
    trace, marks = trace_of(None, replace(CONFIG, effects=())), 5 * np.arange(ROWS)
    columns = edges.unplaced(trace, marks, int(marks[-1]) + 1)
    (at,) = np.flatnonzero(columns["edge"])
    assert at == marks[JUMP]
    assert columns["edge"][at] == 5.0
    assert (columns["edge_from"][at], columns["edge_to"][at]) == (pytest.approx(1.0), pytest.approx(3.0))
    assert columns["edge_span"][at] == pytest.approx(DT)
    assert not np.any(edges.unplaced(trace_of(0.0), marks, int(marks[-1]) + 1)["edge"])


# ---- what comes of them


CASES = [(0.2, None, 0.2), (0.85, 0.0, 0.85), (-0.1, 1.0, 0.9), (-0.1, 0.0, 0.0), (0.05, 1.0, 1.0), (0.5, None, 0.5)]


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
    with_, without = (
        EstimationProblem.of_traces(CONFIG, free_parameters(CONFIG), (t,), step) for t in (known, unknown)
    )
    assert not np.any(with_.batch.disturbance.edge)
    assert np.any(without.batch.disturbance.edge)
    assert with_.batch.steps.edge is not None
    assert without.batch.steps.edge is None


def test_an_edge_on_its_sample_gets_the_steps_after_it_that_one_just_before_it_gets() -> None:
    """A plate pressed onto its stop: a step that ran backwards would meet the stop, and impacts are not integrated
    more finely."""
    config = RigConfig("by hand", effects=(EdgePhase.at(Place("response")).name,), parameters=CONFIG.parameters)
    held = held_plate(1.0)
    still = Channel(held.time, np.zeros(ROWS), 1e-4, True, "position", "rad", 1.0)
    pressed = replace(held, file="response/1.csv", test="response", channels={**held.channels, "position": still})
    trace = prepared(pressed, config)
    known = free_parameters(config)
    x = known.layout.coordinates({s: known.layout.parameter(s).nominal for s in known.layout.free})
    at = known.layout.free.index("edge_phase.response")
    counts = []
    for phase in (-0.01, 0.0, 0.02):
        x[at] = phase
        counts.append(EstimationProblem.of_traces(config, known, (trace,)).refined(x).substeps[0][JUMP : JUMP + 3])
    assert np.all(counts[0] > 1)
    for count in counts[1:]:
        assert np.all(np.abs(count - counts[0]) <= 1)
