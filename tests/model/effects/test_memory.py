"""Effects with memory along a motion, integrated explicitly, against closed forms."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from effect_samples import AXES, follow, inputs, made, rows, table
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, PAPER, AbstractEffect, Inputs, State
from etcfit.model.parameters import parameters_of
from etcfit.model.stepper import Reset, Step, simulate
from etcfit.model.throttle import Throttle


def still(**x: Any) -> State:
    return State(**({"i": 0.0, "theta": 0.8, "omega": 0.0} | x))


def test_every_memory_is_followed_here() -> None:
    followed = {"winding_heating", "presliding_friction", "backlash", "position_sensor_lag"}
    assert {effect.name for effect in EFFECTS if effect.z0} == followed


# ---- a winding that warms


def resistance(tau_h: float, current: Any, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Times, and what the winding's resistance has grown by, ohm, under a current that is a function of time."""
    effect = made(EFFECT_BY_NAME["winding_heating"], r_h=0.01, tau_h=tau_h)
    path = follow(effect, lambda t: (still(i=current(t)), inputs()), duration, 4000)
    return path.time, -path.c.voltage / path.x.i


def test_a_constant_current_warms_a_winding_exponentially() -> None:
    """R - R_a = r_h tau i^2 (1 - exp(-t / tau)): cold at first, r_h i^2 t soon after, r_h tau i^2 in the end."""
    t, grown = resistance(0.5, lambda t: -3.0, 4.0)
    assert grown[0] == 0.0
    assert_allclose(grown, 0.01 * 0.5 * 9.0 * (1.0 - np.exp(-t / 0.5)), rtol=1e-9, atol=1e-14)
    assert grown[-1] == pytest.approx(0.045, rel=1e-3)


def test_a_winding_cools_when_the_current_falls() -> None:
    """From 3 A at 2 s down to 0.1 A: what is left decays with tau."""
    t, grown = resistance(0.5, lambda t: jnp.where(t < 2.0, 3.0, 0.1), 4.0)
    late = t > 2.01
    rest = 0.01 * 0.5 * 0.01
    hot = grown[late][0] - rest
    assert_allclose(grown[late] - rest, hot * np.exp(-(t[late] - t[late][0]) / 0.5), rtol=1e-6)
    assert hot > 0.04


# ---- a sensor that lags


def reading(tau_p: float, theta: Any, omega: Any, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, true angle, and what is read besides it."""
    effect = made(EFFECT_BY_NAME["position_sensor_lag"], tau_p=tau_p)
    path = follow(effect, lambda t: (still(theta=theta(t), omega=omega(t)), inputs()), duration, 4000)
    return path.time, path.x.theta, path.c.position


def test_a_sensor_falls_behind_a_ramp_by_its_time_constant() -> None:
    """tau w, reached exponentially."""
    t, _, error = reading(0.01, lambda t: 2.0 * t, lambda t: 2.0, 0.2)
    assert_allclose(error, -0.01 * 2.0 * (1.0 - np.exp(-t / 0.01)), rtol=1e-9, atol=1e-15)
    assert error[-1] == pytest.approx(-0.02, rel=1e-6)


def test_a_sensor_is_a_filter_of_first_order() -> None:
    """Of a sine it reads the gain 1 / sqrt(1 + (w tau)^2) and the phase -atan(w tau)."""
    rate, tau = 40.0, 0.02
    t, theta, error = reading(tau, lambda t: jnp.sin(rate * t), lambda t: rate * jnp.cos(rate * t), 1.0)
    expected = np.sin(rate * t - np.arctan(rate * tau)) / np.hypot(1.0, rate * tau)
    late = t > 20.0 * tau
    assert_allclose((theta + error)[late], expected[late], atol=1e-7)


def test_a_sensor_without_lag_has_the_slope_of_a_delay() -> None:
    """Settled, error / tau_p = -omega: the same at 1 ns as at 1 ms, so the off value can be left by its slope."""
    effect = EFFECT_BY_NAME["position_sensor_lag"]
    for tau_p in (1e-9, 1e-6, 1e-3):
        c = made(effect, tau_p=tau_p)(still(omega=2.0), (2.0,), inputs())
        assert float(c.position) / tau_p == pytest.approx(-2.0, rel=1e-12)
        assert float(c.dz[0]) == 0.0


# ---- a contact that yields


def contact(speed: float, angle: float, tau_z: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Angle gone and torque of a contact that is slid along at a constant speed."""
    effect = made(EFFECT_BY_NAME["presliding_friction"], T_z=0.08, delta_z=0.004, tau_z=tau_z)
    path = follow(effect, lambda t: (still(theta=speed * t, omega=speed), inputs()), angle / abs(speed), 4000)
    return path.x.theta, path.c.torque


@pytest.mark.parametrize("speed", [0.01, 5.0, -5.0])
def test_a_contact_slides_at_its_friction_torque(speed: float) -> None:
    """-T_z (1 - exp(-|angle| / delta_z)) against the motion, whatever the pace."""
    angle, torque = contact(speed, 0.06)
    assert_allclose(torque, -np.sign(speed) * 0.08 * (1.0 - np.exp(-np.abs(angle) / 0.004)), rtol=1e-7, atol=1e-15)
    assert abs(torque[-1]) == pytest.approx(0.08, rel=1e-6)


def test_a_contact_is_damped_while_it_yields_and_not_where_it_slides() -> None:
    """-T_z (1 + (tau_z v / delta_z - 1) exp(-angle / delta_z)) at speed v."""
    angle, torque = contact(5.0, 0.06, tau_z=3e-3)
    assert_allclose(torque, -0.08 * (1.0 + (3e-3 * 5.0 / 0.004 - 1.0) * np.exp(-angle / 0.004)), rtol=1e-6)
    assert torque[0] == pytest.approx(-0.3, rel=1e-6)
    assert torque[-1] == pytest.approx(-0.08, rel=1e-5)


def test_a_contact_is_bounded_by_its_friction_torque() -> None:
    """|s| <= 1 under any motion that begins inside; damping comes on top."""
    effect = made(EFFECT_BY_NAME["presliding_friction"], T_z=0.08, delta_z=0.004, tau_z=0.0)

    def motion(t: Any) -> tuple[State, Inputs]:
        return still(omega=3.0 * jnp.sin(40.0 * t) + jnp.cos(97.0 * t)), inputs()

    torque = follow(effect, motion, 1.0, 20000).c.torque
    assert 0.07 < np.max(np.abs(torque)) <= 0.08


@pytest.mark.parametrize(("load", "carried"), [(0.03, 0.03), (-0.03, -0.03), (0.5, 0.08), (-0.5, -0.08), (0.0, 0.0)])
def test_the_contact_of_a_plate_at_rest_carries_its_load_as_far_as_it_can(load: float, carried: float) -> None:
    effect = made(EFFECT_BY_NAME["presliding_friction"], T_z=0.08, delta_z=0.004, tau_z=2e-3)
    assert float(effect(still(), effect.first(load), inputs()).torque) == pytest.approx(-carried, abs=1e-15)


def test_a_plate_that_rests_on_its_contact_stays_where_it_is() -> None:
    """A spring pulls it with half of what the contact holds; unloaded, the contact would let it sink."""
    types = (*PAPER, EFFECT_BY_NAME["presliding_friction"])
    values = {p.symbol: p.nominal for t in types for p in parameters_of(t)}
    values |= {"K_s": 0.05, "T_PL": 0.0, "T_f": 0.0, "T_z": 0.08, "delta_z": 0.004, "tau_z": 1e-3}
    throttle = Throttle.build(types, values)
    begin, lane = State(*(jnp.full((200, 1), v) for v in (0.0, 0.8, 0.0))), jnp.ones((200, 1))
    none = 0.0 * lane
    steps = Step(1e-3 * lane, none, none, none, none, none, lane, lane, lane, none, 20.0 * lane, none, 1.5 * lane,
                 none, none, none, none)  # fmt: skip
    path = simulate(throttle, steps, Reset(none.at[0].set(1.0), begin.i, begin.theta, begin.omega))
    assert_allclose(path[0].theta[-1], 0.8, atol=1e-9)
    assert_allclose(path[1][0][-1], -0.04 / 0.08, rtol=1e-6)


# ---- a gear with play


def play(load: Any) -> tuple[np.ndarray, np.ndarray]:
    effect = made(EFFECT_BY_NAME["backlash"], g_b=0.012, t_b=0.005)

    def at(t: Any) -> tuple[State, Inputs]:
        return still(), inputs(motor=load(t), external=-load(t))

    path = follow(effect, at, 0.2, 4000)
    return path.time, path.c.position


def test_a_gear_flips_when_its_load_changes_sign() -> None:
    """By the whole play, in the time t_b, and back again."""
    t, position = play(lambda t: jnp.where((t > 0.05) & (t < 0.15), -0.5, 0.5))
    away = (t > 0.0501) & (t < 0.1499)
    assert_allclose(position[t < 0.05], 0.0, atol=1e-15)
    left = 0.012 - position[away]
    assert_allclose(left, left[0] * np.exp(-(t[away] - t[away][0]) / 0.005), rtol=1e-6, atol=1e-14)
    assert left[0] == pytest.approx(0.012, rel=0.04)
    assert left[-1] < 1e-6 * 0.012
    assert abs(position[-1]) < 1e-4 * 0.012


# ---- all of them


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.z0], ids=lambda effect: effect.name)
def test_a_memory_forgets(effect: type[AbstractEffect]) -> None:
    """d rate / d memory <= 0 at every state, each entry by itself: what the stepper's implicit solve relies on."""
    at = rows(effect)
    for k in range(len(effect.z0)):
        nudged = at.copy()
        nudged[:, len(AXES) + k] += 0.1
        column = table(effect, nudged)[:, -len(effect.z0) :] - table(effect, at)[:, -len(effect.z0) :]
        assert np.all(column[:, k] <= 0.0)
        assert np.all(np.delete(column, k, axis=1) == 0.0)


def test_a_trace_begins_with_a_memory_that_says_nothing() -> None:
    """Before anything has moved, carried current or been loaded, an effect with memory adds nothing."""
    for effect in EFFECTS:
        if effect.z0:
            c = made(effect)(still(), effect.z0, inputs(motor=0.5, external=-0.5))
            assert [float(v) for v in (c.torque, c.voltage, c.position)] == [0.0, 0.0, 0.0]
