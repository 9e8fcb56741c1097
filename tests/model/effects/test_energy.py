"""What takes energy, what gives it back, and what can never make any."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from effect_samples import AXES, Path, every_effect, follow, inputs, made, rows, seen
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS, AbstractEffect, Inputs, State

POTENTIALS = ["return_spring", "limp_home_spring", "stiffening_spring", "gravity_load", "airflow_torque",
              "cogging_torque"]  # fmt: skip
DISSIPATIVE = [
    *("viscous_friction", "coulomb_friction", "stribeck_friction", "load_dependent_friction"),
    *("motor_coulomb_friction", "presliding_friction", "quadratic_drag"),
]


def integral(y: np.ndarray, x: np.ndarray) -> float:
    """Trapezoids."""
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))


def work(path: Path) -> float:
    """Done on the plate, J: the smooth torques, and dry friction at its whole budget against the motion."""
    torque = path.c.torque + path.c.drive - path.c.friction * np.sign(path.x.omega)
    return integral(torque * path.x.omega, path.time)


def swing(amplitude: float, rate: float, t: Any) -> tuple[State, Inputs]:
    """theta = 0.8 + a sin(w t) under a loaded gear."""
    x = State(1.0, 0.8 + amplitude * jnp.sin(rate * t), amplitude * rate * jnp.cos(rate * t))
    return x, inputs(motor=0.6, external=-0.4)


def second_cycle(effect: AbstractEffect, amplitude: float, rate: float) -> Path:
    """A closed path once the memory has settled on it, and its closing memory with it."""
    steps = 20000
    path = follow(effect, lambda t: swing(amplitude, rate, t), 4.0 * math.pi / rate, 2 * steps)
    late = {name: getattr(path.c, name)[steps:] for name in path.c._fields if name != "dz"}
    x = State(*(v[steps:] for v in path.x))
    return Path(path.time[steps:], x, path.c._replace(**late, dz=()))


# ---- friction


@every_effect
def test_what_is_odd_in_speed_takes_energy(effect: type[AbstractEffect]) -> None:
    """omega (torque(omega) - torque(-omega)) <= 0, at every state; what is even in speed cannot be friction alone."""
    at = rows(effect)
    back = at.copy()
    back[:, AXES.index("omega")] *= -1.0
    there, here = seen(effect, at), seen(effect, back)
    torque = there["torque"] + there["drive"] - here["torque"] - here["drive"]
    assert np.all(torque * at[:, AXES.index("omega")] <= 0.0)


def test_every_friction_is_tested_for_taking_energy() -> None:
    budget = {effect.name for effect in EFFECTS if np.any(seen(effect, rows(effect))["friction"] != 0.0)}
    assert budget <= set(DISSIPATIVE)


@pytest.mark.parametrize("rate", [0.5, 20.0])
@pytest.mark.parametrize("amplitude", [0.002, 0.4])
@pytest.mark.parametrize("name", DISSIPATIVE)
def test_friction_takes_energy_over_a_closed_path(name: str, amplitude: float, rate: float) -> None:
    path = second_cycle(made(EFFECT_BY_NAME[name]), amplitude, rate)
    scale = np.ptp(path.c.torque - path.c.friction * np.sign(path.x.omega)) * amplitude
    assert work(path) < -1e-3 * scale < 0.0


@pytest.mark.parametrize("name", ["coulomb_friction", "motor_coulomb_friction", "load_dependent_friction"])
def test_dry_friction_takes_four_budgets_times_the_amplitude(name: str) -> None:
    path = second_cycle(made(EFFECT_BY_NAME[name]), 0.4, 3.0)
    assert path.c.friction[0] > 0.0
    assert work(path) == pytest.approx(-4.0 * 0.4 * path.c.friction[0], rel=1e-6)


def test_a_drag_that_differs_by_direction_gives_back_what_it_took() -> None:
    """T_a + B_a |omega| is even in speed: at one pace each way it is a potential, and no friction at all."""
    path = second_cycle(made(EFFECT_BY_NAME["asymmetric_friction"]), 0.4, 3.0)
    assert np.ptp(path.c.torque) > 1e-3
    assert abs(work(path)) < 1e-9


# ---- springs


@pytest.mark.slow
@pytest.mark.parametrize("name", POTENTIALS)
def test_a_spring_returns_what_it_took(name: str) -> None:
    """The work over a closed path is zero: sum torque dtheta from 0 to open and back, at whatever speed and current."""
    effect = made(EFFECT_BY_NAME[name])
    there = np.linspace(0.0, math.pi / 2, 2001)
    theta = np.concatenate((there, there[::-1]))
    omega = np.concatenate((np.full(2001, 3.0), np.full(2001, -0.2)))
    current = np.concatenate((np.full(2001, 5.0), np.full(2001, -1.0)))
    torque = np.array([float(effect(State(*x), (), inputs()).torque) for x in zip(current, theta, omega, strict=True)])
    assert abs(integral(torque, theta)) < 1e-12
    assert np.ptp(torque) > 0.01


# ---- stops, motor and circuit


@pytest.mark.parametrize("e_r", [0.0, 0.4, 0.95, 1.0, 7.0])
def test_a_stop_never_gives_back_more_than_it_got(e_r: float) -> None:
    c = made(EFFECT_BY_NAME["stop_bounce"], e_r=e_r)(State(0.0, 0.0, -3.0), (), inputs())
    assert 0.0 <= float(c.restitution) < 1.0


@pytest.mark.parametrize("name", ["brush_voltage_drop", "winding_heating"])
def test_a_drop_takes_power_from_the_current(name: str) -> None:
    effect = made(EFFECT_BY_NAME[name])
    for i in (-6.0, -0.01, 0.01, 6.0):
        assert float(effect(State(i, 0.5, 3.0), tuple(2.0 for _ in effect.z0), inputs()).voltage) * i < 0.0


@pytest.mark.parametrize("voltage", [-6.0, -0.1, 0.0, 0.1, 6.0])
def test_a_dead_zone_takes_no_more_than_there_is(voltage: float) -> None:
    effect = made(EFFECT_BY_NAME["driver_dead_zone"], V_d=0.3)
    left = voltage + float(effect(State(0.0, 0.5, 0.0), (), inputs(voltage=voltage)).voltage)
    assert left == pytest.approx(math.copysign(max(abs(voltage) - 0.3, 0.0), voltage), abs=1e-15)


@pytest.mark.parametrize("duty", [-1.2, -0.75, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0, 1.2])
def test_a_bridge_that_coasts_drives_by_the_mean_of_its_period(duty: float) -> None:
    """V_0 while it is on, -V_0 while the current dies, and for the rest the EMF itself, which drives nothing."""
    effect, emf = made(EFFECT_BY_NAME["coasting_bridge"], K_c=0.3, k_d=0.6, V_0=12.0), 0.3 * 2.0
    on = min(abs(duty), 1.0)
    dying = min(0.6 * on, 1.0 - on)
    mean = on * 12.0 - dying * 12.0 + math.copysign(1.0, duty) * (1.0 - on - dying) * emf
    voltage = math.copysign(on * 12.0, duty)
    added = float(effect(State(0.0, 0.5, 2.0), (), inputs(voltage=voltage)).voltage)
    assert math.copysign(1.0, duty) * (voltage + added) == pytest.approx(mean, abs=1e-14)


@pytest.mark.parametrize("motor", [-3.0, -0.2, 0.2, 3.0])
def test_a_saturated_motor_still_pulls_the_same_way(motor: float) -> None:
    effect = made(EFFECT_BY_NAME["torque_saturation"])
    left = motor + float(effect(State(0.0, 0.5, 0.0), (), inputs(motor=motor)).drive)
    assert 0.0 < left / motor < 1.0
