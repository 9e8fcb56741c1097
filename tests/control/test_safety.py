"""Figures of safety: the pieces by hand, the whole against the independent simulation of the same rigs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rigs
from benchmarks.safety import compare
from etcfit.control.pid import Requirements, Task
from etcfit.control.pid import loop as loop_module
from etcfit.control.pid.conditions import COPPER
from etcfit.control.pid.loop_kernel import kernel_of
from etcfit.control.safety import Envelope
from etcfit.control.safety.faults import detection_time, propose_jam_check
from etcfit.control.safety.guarded import Guards, SensorFault, longest_above, of_setpoint, run_trials, stack_trials
from etcfit.control.safety.unpowered import holding_currents
from etcfit.control.setpoint import stairs
from etcfit.control.settings import DesignSettings, SafetySettings
from etcfit.kernels.machine import available
from etcfit.model.ecu import Ecu
from etcfit.model.effects.electrical import WindingHeating
from etcfit.model.linear import TransferFunction
from etcfit.model.pid import Gains

STEPS = stairs("steps", (0.25, 0.26, 0.25, 0.6), 0.4, 0.3)


def task(**changes: float) -> Task:
    loop = rigs.loop(ecu=Ecu())
    settings = DesignSettings(safety=replace(SafetySettings(), **changes))
    return Task(TransferFunction(1.0, 1.0, 1.0, 1.0), Ecu(), Requirements(), loop, STEPS, settings=settings)


def test_the_longest_time_above_a_threshold_is_that_of_counting() -> None:
    error = np.random.default_rng(3).normal(size=(4, 200))
    for level in (0.0, 0.7, 1.3, 9.0):
        by_hand = [max(map(len, "".join("x" if abs(e) > level else " " for e in row).split()), default=0)
                   for row in error]  # fmt: skip
        assert longest_above(error, level).tolist() == by_hand


def test_the_least_threshold_that_is_told_in_time_is_proposed() -> None:
    seen = Envelope(np.array([0.01, 0.02, 0.05, 0.1]), np.array([1.0, 0.2, 0.101, 0.0]), 3, 0.09)
    check = propose_jam_check(seen, task(within=0.25))
    assert check is not None
    assert (check.error, check.timeout) == (0.05, pytest.approx(0.16))  # 1.5 times 0.101 s, up to a whole 10 ms
    assert (check.longest, check.sustained) == (0.101, 0.02)
    slower = propose_jam_check(seen, task(within=0.3))
    assert slower is not None
    assert slower.error == 0.02
    assert propose_jam_check(Envelope(seen.errors[:2], seen.longest[:2], 3, 0.09), task(within=0.25)) is None


def test_a_plate_that_is_held_is_told_once_enough_has_been_asked_for_long_enough() -> None:
    late = detection_time(STEPS, "steps", 0.05, 0.1, 1e-3)
    assert late == pytest.approx(0.8 + 0.1)  # the third step is the first beyond 5 %
    assert detection_time(STEPS, "steps", 0.005, 0.1, 1e-3) == pytest.approx(0.1)
    assert detection_time(STEPS, "steps", 0.05, 0.5, 1e-3) is None


def test_heat_of_holding_is_that_of_the_closed_form_where_copper_does_not_warm() -> None:
    loop = rigs.loop(WindingHeating, ecu=Ecu(), r_h=1e-2, tau_h=8.0)
    settings = DesignSettings()
    held = holding_currents(loop, Task(rigs.plant(loop), Ecu(), Requirements(), loop, settings=settings))
    assert held.rise is not None
    alpha, ohm = COPPER, float(np.asarray(loop.nominal.parameter("R_a")))
    assert held.rise == pytest.approx(1e-2 * 8.0 * held.current**2 / (alpha * ohm))
    assert held.watts == pytest.approx(ohm * held.current**2)
    assert held.stall_A == pytest.approx(12.0 / ohm)
    # Euler's method, step by step
    warmer, time = 0.0, 0.0
    while warmer < settings.safety.insulation - settings.conditions.bench and time < 10.0:
        amps = 12.0 / (ohm * (1.0 + alpha * warmer))
        warmer += 1e-4 * (1e-2 / (alpha * ohm) * amps**2 - warmer / 8.0)
        time += 1e-4
    assert held.longest == pytest.approx(time, rel=1e-3)
    cold = rigs.loop(ecu=Ecu())
    unknown = holding_currents(cold, Task(rigs.plant(cold), Ecu(), Requirements(), cold, settings=settings))
    assert (unknown.rise, unknown.longest) == (None, None)


def test_trials_that_are_asked_different_things_run_as_machine_code_as_by_jax(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = rigs.loop(ecu=Ecu())
    gains, ticks = Gains(60.0, 200.0, 2.0), 60
    sagging, stuck = np.where(np.arange(ticks) < 30, 1.0, 0.4), SensorFault(0.02, kept=0.0, frozen=1.0)
    trials = stack_trials([
        of_setpoint(loop, gains, np.full(ticks, 0.3)),
        of_setpoint(loop, gains, np.linspace(0.3, 0.7, ticks), supply=sagging),
        of_setpoint(loop, gains, np.linspace(0.3, 0.7, ticks), stuck, Guards(0.05, 0.01)),
    ])  # fmt: skip
    made: list[object] = []
    monkeypatch.setattr(loop_module, "kernel_of", lambda *of: made.append(kernel_of(*of)) or made[-1])
    by_machine = run_trials(loop, trials, 0.3)
    assert [kernel is not None for kernel in made] == [available()]
    monkeypatch.setattr(loop_module, "kernel_of", lambda *_: None)
    for machine, jax in zip(by_machine, run_trials(loop, trials, 0.3), strict=True):
        np.testing.assert_allclose(machine, jax, rtol=1e-9, atol=1e-12)
    assert by_machine.tripped.any(axis=-1).tolist() == [[False, False, True]]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7650, 7653))
def test_every_figure_is_that_of_the_independent_simulation(seed: int) -> None:
    off = compare(seed)
    assert off.disagreements == 0
    assert off.envelope_s <= 0.01
    assert off.opens_pct < 1.0
    assert off.tells_s < 0.005
    assert off.creeps_s < 0.2
    assert off.sag_pct < 0.5
    assert off.returns_s < 0.01
    assert off.shorted_s < 0.2
    assert off.holding_pct < 0.01
