"""A gear with play where its plate lands: the motor turns on by itself, by hand and by the laws of impact."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.model.effects import State
from etcfit.model.effects.gear import Backlash
from etcfit.model.effects.paper import Armature, CoulombFriction, EndStops, Inertia, ReturnSpring
from etcfit.model.stepper import Step, step
from etcfit.model.throttle import Throttle

N, J_m, J_L = 20.0, 1e-6, 8e-4
PLAY, C, E = 0.02, 1.0, 0.25
H = 1e-4
SPEED = -19.0  # rad/s, at which the plate lands

_STEP = jax.jit(step)
_READ = jax.jit(lambda body, x, z, s: x.theta + body(x, z, s.inputs(1.0)).position)


def throttle(play: float) -> Throttle:
    """Dry friction and a preloaded spring, of which a motor that turns by itself feels nothing."""
    motor = Armature(R_a=1.5, L_a=1e-3, K_b=0.02, K_m=0.02), Inertia(J_m=J_m, J_L=J_L)
    plate = ReturnSpring(K_s=0.1, T_PL=0.35), CoulombFriction(T_f=0.2), EndStops()
    return Throttle((*motor, *plate, Backlash(g_b=play, t_b=0.005, c_b=C, e_b=E)))


def one(torque: float = 0.0) -> Step:
    zero, unit = jnp.zeros(()), jnp.ones(())
    return Step(
        dt=H * unit, voltage0=zero, voltage1=zero, torque0=torque * unit, torque1=torque * unit, time=zero, mobile=unit,
        circuit=zero, plate=unit, series=zero, gear_ratio=N * unit, lower=zero, upper=1.5 * unit, guide_stiffness=zero,
        target0=zero, target1=zero, lever=zero,
    )  # fmt: skip


def run(play: float, x: State, count: int, torque: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motor angle and speed at the plate's shaft, and the angle that the sensor reads, after each step."""
    body, s, rows = throttle(play), one(torque), []
    z: tuple[Any, ...] = tuple(map(jnp.asarray, body.z0))
    for _ in range(count):
        x, z = _STEP(body, x, z, s)
        rows.append((x.theta, x.omega, _READ(body, x, z, s)))
    theta, omega, read = np.array(rows, dtype=float).T
    return theta, omega, read


def landing(play: float, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return run(play, State(jnp.zeros(()), jnp.asarray(1e-5), jnp.asarray(SPEED)), count)


@pytest.mark.slow
def test_without_play_the_plate_lands_and_stays() -> None:
    theta, omega, read = landing(0.0, 20)
    assert_allclose(theta, 0.0, atol=1e-15)
    assert_allclose(omega, 0.0, atol=1e-15)
    assert_allclose(read, theta, atol=1e-15)


def test_the_motor_crosses_its_play_at_an_even_pace_and_comes_back_by_the_law_of_impact() -> None:
    theta, omega, read = landing(PLAY, 400)
    first = int(np.argmax(omega > 0.0))  # after the impact on the teeth of the resting plate
    assert_allclose(first * H, PLAY / -SPEED, atol=1.5 * H)
    assert_allclose(omega[1:first], omega[0], rtol=1e-9)
    assert omega[0] == pytest.approx(SPEED, rel=0.02)  # the last step before the stop belongs to plate and spring
    back = -omega[0] / (1.0 - C * omega[0])
    second = first + int(np.argmax(omega[first:] < 0.0))  # ... and on those that open it
    assert_allclose(omega[first:second], back, rtol=1e-9)
    assert_allclose((second - first) * H, PLAY / back, atol=1.5 * H)
    assert omega[second] == pytest.approx(-E * back, rel=1e-9)
    assert np.all((theta >= -PLAY - 1e-12) & (theta <= 1e-12))
    assert_allclose(read, 0.0, atol=1e-10)  # the plate rests on its stop meanwhile


@pytest.mark.parametrize(("torque", "moves"), [(0.3, False), (-0.3, True), (0.9, True), (-0.01, False)])
def test_a_motor_that_touches_its_plate_leaves_it_only_backwards_or_with_it(torque: float, moves: bool) -> None:
    """0.35 N m of preload and 0.2 of friction hold the plate; a little torque away from it is the noise of a log."""
    rest = State(jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))
    theta, omega, read = run(PLAY, rest, 100, torque)
    assert np.any(omega != 0.0) is np.bool_(moves)
    if torque < -0.1:  # without plate: J_m N^2 alone, up to the other end of the play
        assert omega[0] == pytest.approx(torque / (J_m * N**2) * H, rel=1e-9)
        assert theta.min() == pytest.approx(-PLAY)
        assert_allclose(read, 0.0, atol=1e-10)
    if torque > 0.55:  # with it
        assert omega[0] == pytest.approx((torque - 0.55) / (J_m * N**2 + J_L) * H, rel=1e-3)
        assert_allclose(read, theta, atol=1e-12)


def test_a_play_that_is_crossed_within_a_step_does_not_rattle() -> None:
    theta, omega, _ = landing(1e-5, 50)
    assert_allclose(omega[2:], 0.0, atol=1e-12)
    assert theta.min() >= -1e-5 - 1e-12


@pytest.mark.slow
def test_the_motor_alone_has_no_plate_to_land() -> None:
    body, s = throttle(PLAY), one()._replace(plate=jnp.zeros(()))
    x, _ = step(body, State(jnp.zeros(()), jnp.asarray(1e-5), jnp.asarray(SPEED)), (jnp.ones(()),), s)
    assert float(x.omega) == pytest.approx(SPEED, rel=1e-9)
    assert float(x.theta) == pytest.approx(1e-5 + SPEED * H, rel=1e-9)
