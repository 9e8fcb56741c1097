"""The phase of edges within a sample, from currents made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from etcfit.rig.base import Channel, Measurement
from etcfit.rig.checks.edge_phase import edge_phase, edge_phases

R, TAU, STEP, SIGMA = 1.5, 1e-3, 1e-3, 0.005  # ohm, s, s, A


def edges(phases: np.ndarray, seed: int = 0) -> Measurement:
    """A held plate at 1 kHz: steps between 1 and 3 V, each so many sample intervals before the sample that shows it."""
    rng, period = np.random.default_rng(seed), 40
    time = STEP * np.arange(period * (phases.size + 1))
    instants = STEP * (period * np.arange(1, phases.size + 1) - phases)
    volts, current = np.full(time.size, 1.0), np.full(time.size, 1.0 / R)
    for k, instant in enumerate(instants):
        jump, after = 2.0 * (-1.0) ** k, time >= instant - 1e-9
        volts = volts + jump * after
        current = current + after * jump / R * (1.0 - np.exp(-np.maximum(time - instant, 0.0) / TAU))
    channels = {"voltage": volts + 0.01 * rng.standard_normal(time.size),
                "current": current + SIGMA * rng.standard_normal(time.size)}  # fmt: skip
    made = {n: Channel(time, v, 0.01 if n == "voltage" else SIGMA, False, n, "", 1.0) for n, v in channels.items()}
    return Measurement("response/1.csv", "response", time, made)


@pytest.mark.parametrize("phase", [0.1, 0.5, 0.93])
def test_a_common_phase_is_found_with_its_error(phase: float) -> None:
    found = edge_phase([edges(np.full(12, phase))])
    assert found is not None
    assert found.phase == pytest.approx(phase, abs=max(4 * found.error, 0.02))
    assert found.error < 0.02
    assert found.chance < 1e-4


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("phase", [0.0, 0.9999])
def test_an_edge_on_its_sample_and_one_a_whole_interval_earlier_are_not_the_same(phase: float, seed: int) -> None:
    found = edge_phase([edges(np.full(12, phase), seed)])
    assert found is not None
    assert found.phase == pytest.approx(phase, abs=0.02)


def test_each_edge_tells_its_own_phase() -> None:
    phases = np.linspace(0.05, 0.95, 16)
    assert edge_phases([edges(phases)]) == pytest.approx(phases, abs=0.05)


@pytest.mark.parametrize("seed", range(20))
def test_edges_at_any_instant_have_none(seed: int) -> None:
    assert edge_phase([edges(np.random.default_rng(seed).uniform(size=12), seed)]) is None


def test_few_edges_say_nothing() -> None:
    assert edge_phase([edges(np.full(3, 0.5))]) is None
