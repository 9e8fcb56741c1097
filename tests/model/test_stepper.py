"""The stepper against closed forms, finite differences and conservation of energy."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

import bodies
from bodies import FREE, OPEN, N, batch, body, even, linear, path, run
from etcfit.backend import compiled_quickly
from etcfit.model.effects import EFFECT_BY_NAME, PAPER, AbstractEffect, Contribution, Inputs, State
from etcfit.model.parameters import Positive, Real, Scalar, parameter, parameters_of
from etcfit.model.stepper import simulate
from etcfit.model.throttle import Throttle

EQS_1_2 = [p.symbol for t in PAPER for p in parameters_of(t)]


def order(throttle: Throttle, duration: float, counts: tuple[int, ...], exact: np.ndarray, **how: Any) -> float:
    """Slope of log error over log h: the same trace in so many steps each, side by side, waiting for the longest.

    Args:
        exact: current, angle, speed and memories at the end.
        how: as for `batch`.
    """
    longest = max(counts)
    lanes = [batch(np.concatenate((even(duration, n), np.zeros(longest - n))), **how) for n in counts]
    x, z = run(throttle, *jax.tree.map(lambda *c: np.concatenate(c, axis=1), *lanes))
    errors = np.linalg.norm(np.array([c[-1] for c in (*x, *z)]).T - exact, axis=1)
    assert np.all(errors > 1e-12)
    return float(-np.polyfit(np.log(counts), np.log(errors), 1)[0])


# ---- closed forms


def test_second_order_on_a_held_plate() -> None:
    p, duration, volts = bodies.values(), 4e-3, 3.0
    exact = volts / p["R_a"] * (1.0 - np.exp(-p["R_a"] * duration / p["L_a"]))
    slope = order(body(), duration, (8, 16, 32, 64), np.array([exact, 0.0, 0.0]), early=volts, mobile=0.0)
    assert 1.8 <= slope <= 2.3


def test_second_order_on_a_damped_oscillator() -> None:
    throttle = body(T_f=0.0, T_PL=0.0, B_m=2e-6, J_m=2e-6)
    inertia, damping, stiffness = N**2 * 2e-6 + 6e-4, N**2 * 2e-6 + 1e-3, 0.150
    decay, t = damping / (2 * inertia), 0.7
    ring = np.sqrt(stiffness / inertia - decay**2)
    angle = np.exp(-decay * t) * (np.cos(ring * t) + decay / ring * np.sin(ring * t))
    speed = -np.exp(-decay * t) * stiffness / inertia / ring * np.sin(ring * t)
    exact = np.array([0.0, angle, speed])
    assert 1.8 <= order(throttle, t, (64, 128, 256, 512), exact, start=(0.0, 1.0, 0.0), circuit=0.0, **FREE) <= 2.3


def test_second_order_on_the_whole_linear_throttle() -> None:
    p, duration, start = bodies.values(T_f=0.0, T_PL=0.0), 0.1, (0.2, 0.4, 1.0)
    exact = (expm(linear(p) * duration) @ np.array([*start, 2.0]))[:3]
    throttle = body(T_f=0.0, T_PL=0.0)
    assert 1.8 <= order(throttle, duration, (256, 512, 1024, 2048), exact, early=2.0, start=start, **FREE) <= 2.3


@pytest.mark.parametrize("n", [1, 7])
def test_a_constant_voltage_ends_in_the_steady_state_whatever_the_step(n: int) -> None:
    """L-stable: one step of 10 s leaves nothing of the transient but what its damping of 1/z lets through."""
    end = path(body(), *batch(even(10.0, n), 1.2, mobile=0.0))[-1]
    assert_allclose(end[0], 1.2 / 1.513, rtol=2e-3)


def test_the_motor_alone_feels_neither_plate_nor_stop() -> None:
    """Its speed runs to N omega = K_m v / (K_m K_b + R_a B_m), far beyond the plate's travel."""
    p = bodies.values()
    end = path(body(), *batch(even(2.0, 2000), 6.0, plate=0.0))[-1]
    assert_allclose(N * end[2], p["K_m"] * 6.0 / (p["K_m"] * p["K_b"] + p["R_a"] * p["B_m"]), rtol=1e-9)
    assert end[1] > 10.0 * OPEN


def test_a_torque_drives_the_plate_without_an_electrical_side() -> None:
    """Constant net torque from rest: theta = (T - T_PL - T_f) t^2 / 2J while the rest is switched off."""
    throttle = body(K_s=0.0, B_m=0.0, B_L=0.0)
    end = path(throttle, *batch(even(0.05, 50), circuit=0.0, torque0=0.8, torque1=0.8, **FREE))[-1]
    assert_allclose(end[1], (0.8 - 0.362 - 0.239) * 0.05**2 / 2 / (N**2 * 1.4e-6 + 6e-4), rtol=1e-9)
    assert end[0] == 0.0


# ---- dry friction


def test_stick_stays_stuck_for_a_million_steps() -> None:
    n, theta = 1_000_000, 0.7123456789
    holding = 1.513 * (0.362 + 0.150 * theta) / (N * 0.0189)
    dither = holding + 0.8 * 0.239 * 1.513 / (N * 0.0189) * np.sin(np.arange(n + 1) * 0.037)
    start = (holding / 1.513, theta, 0.0)
    x = path(body(), *batch(np.full(n, 1e-3), dither[:-1], dither[1:], start))
    assert np.ptp(x[:, 0]) > 0.1  # the current did move
    assert_array_equal(x[:, 1], theta)
    assert_array_equal(x[:, 2], 0.0)


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_the_plate_breaks_away_at_t_f_and_not_before(share: float, moves: bool) -> None:
    torque = 0.362 + 0.150 * 0.5 + share * 0.239
    x = path(body(), *batch(even(0.2, 200), start=(0.0, 0.5, 0.0), circuit=0.0, torque0=torque, torque1=torque))
    assert bool(x[-1, 1] > 0.5) is moves
    assert bool(x[-1, 2] > 0.0) is moves


# ---- end stops


def test_a_plate_resting_on_a_stop_does_not_leak_speed_into_the_current() -> None:
    """0.5 V cannot lift the plate off the closed stop: the current is that of a held one, bit by bit, at 5 ms steps."""
    for start, volts, end in ((0.0, 0.5, 0.0), (OPEN, 8.0, OPEN)):
        dt = np.full(40, 5e-3)
        resting = path(body(), *batch(dt, volts, start=(0.0, start, 0.0)))
        held = path(body(), *batch(dt, volts, start=(0.0, start, 0.0), mobile=0.0))
        assert_array_equal(resting[:, 1], end)
        assert_array_equal(resting[:, 2], 0.0)
        assert_array_equal(resting[:, 0], held[:, 0])


# ---- sensitivities


@pytest.fixture(scope="module")
def slide() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A plate that slides open in mid-travel all the while: its path (T, 3), and its sensitivity to each parameter of
    Eqs. 1-2 by forward mode and by central differences, (T, 3, P)."""
    steps, resets = batch(even(0.06, 60), 2.6, start=(1.2, 0.3, 4.0))
    at = np.array([bodies.values()[s] for s in EQS_1_2])

    def states(p: Scalar) -> Scalar:
        x, _ = simulate(Throttle.build(PAPER, dict(zip(EQS_1_2, p, strict=True))), steps, resets)
        return jnp.stack(x, axis=-1)[:, 0]

    values, slopes = compiled_quickly(states), compiled_quickly(jax.jacfwd(states))
    nudges = np.diag(1e-5 * at)
    differences = [(values(at + nudge) - values(at - nudge)) / (2.0 * nudge.sum()) for nudge in nudges]
    return np.asarray(values(at)), np.asarray(slopes(at)), np.stack(differences, axis=-1)


@pytest.mark.parametrize("symbol", EQS_1_2)
def test_forward_sensitivities_are_finite_differences(symbol: str, slide: tuple[np.ndarray, ...]) -> None:
    states, sensitivity, difference = slide
    assert np.all(states[:, 2] > 0.1)  # no event within reach of the perturbation
    k = EQS_1_2.index(symbol)
    scale = np.max(np.abs(difference[..., k]), axis=0)
    assert np.all(scale > 0.0)
    assert_allclose(sensitivity[..., k] / scale, difference[..., k] / scale, atol=1e-6)


def test_a_stuck_plate_is_sensitive_to_nothing() -> None:
    steps, resets = batch(even(0.1, 100), 1.8, start=(1.8 / 1.513, 0.6, 0.0))

    def angle(friction: Scalar) -> Scalar:
        return simulate(Throttle.build(PAPER, bodies.values() | {"T_f": friction}), steps, resets)[0].theta[:, 0]

    assert_array_equal(compiled_quickly(jax.jacfwd(angle))(0.239), 0.0)


# ---- energy

factor = st.floats(0.3, 3.0)
BODIES = st.fixed_dictionaries(
    {
        "J_m": factor.map(lambda f: 1.4e-6 * f),
        "B_m": st.floats(0.0, 6e-5),
        "K_s": st.floats(0.0, 0.5),
        "T_PL": st.floats(0.0, 1.0),
        "T_f": st.floats(0.0, 0.8),
        "L_a": factor.map(lambda f: 1.5e-3 * f),
        "R_a": factor.map(lambda f: 1.5 * f),
    }
)
STARTS = st.tuples(st.floats(-4.0, 4.0), st.floats(0.0, OPEN), st.floats(-20.0, 20.0))


def energy(p: dict[str, float], x: np.ndarray) -> np.ndarray:
    i, theta, omega = x.T
    kinetic = 0.5 * (N**2 * p["J_m"] + p["J_L"]) * omega**2
    return kinetic + 0.5 * p["K_s"] * theta**2 + p["T_PL"] * theta + 0.5 * p["L_a"] * i**2


def rises(changes: dict[str, float], dt: float, **how: Any) -> tuple[np.ndarray, np.ndarray]:
    """Rise of the stored energy in each of 200 steps (J), and the path."""
    x = path(body(**changes), *batch(np.full(200, dt), **how))
    return np.diff(energy(bodies.values(**changes), x)), x


LIFTED = {"J_m": 1.4e-6, "B_m": 0.0, "K_s": 0.0, "T_PL": 0.5, "T_f": 0.0, "L_a": 1.5e-3, "R_a": 1.5}


@settings(max_examples=200, deadline=None, derandomize=True)
@given(BODIES, STARTS, st.sampled_from([1e-4, 1e-3, 3e-3]))
@example(LIFTED, (0.0, 0.0, 1.0), 3e-3)  # lifted off the closed stop and pulled back in one step
def test_energy_is_never_created_with_open_terminals(
    changes: dict[str, float], start: tuple[float, float, float], dt: float
) -> None:
    """Stops, impacts, sticking and sliding included; the tolerance is rounding."""
    rise, _ = rises(changes, dt, start=(0.0, *start[1:]), circuit=0.0)
    assert np.max(rise) < 1e-14


@settings(max_examples=200, deadline=None, derandomize=True)
@given(BODIES, STARTS, st.sampled_from([1e-4, 1e-3, 3e-3]))
def test_a_shorted_throttle_is_passive(changes: dict[str, float], start: tuple[float, float, float], dt: float) -> None:
    """Exactly so between impacts. A new impact is clipped at the end of its step, so the back-EMF of a fall beyond the
    stop, by no more than the spring makes of one step, has entered the current."""
    rise, x = rises(changes, dt, start=start)
    p = bodies.values(**changes)
    guide_stiffness = p["T_PL"] + p["K_s"] * OPEN
    beyond = np.abs(x[:-1, 2]) * dt + guide_stiffness / (N**2 * p["J_m"] + p["J_L"]) * dt**2
    impact = (x[1:, 1] <= 0.0) & (x[:-1, 1] > 0.0)
    assert np.all(rise < 1e-14 + impact * guide_stiffness * beyond)


# ---- memories of effects


class LaggingDrag(AbstractEffect):
    """torque = -c z,  dz/dt = (omega - z)/tau: a drag that follows the speed late."""

    name = "lagging_drag"
    z0 = (0.0,)
    c_lag: Scalar = parameter("N*m*s/rad", Real(1e-2), 1e-2, "drag", "a test")
    tau: Scalar = parameter("s", Positive(1e-2), 2e-2, "lag", "a test")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(torque=-self.c_lag * z[0], dz=((x.omega - z[0]) / self.tau,))


class Pursuers(AbstractEffect):
    """Two memories that act on nothing: dz1/dt = (theta - z1)/0.03 s from 0.2, dz2/dt = -z2/0.05 s from 1."""

    name = "pursuers"
    z0 = (0.2, 1.0)

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(dz=((x.theta - z[0]) / 0.03, -z[1] / 0.05))


SMOOTH = {"T_f": 0.0, "T_PL": 0.0}
MEMORY = {"c_lag": 2e-2, "tau": 2e-2}


def with_memories(p: dict[str, float]) -> np.ndarray:
    """theta, omega, the drag's z, and the two pursuers', terminals open: dx/dt = A x."""
    inertia, damping = N**2 * p["J_m"] + p["J_L"], N**2 * p["B_m"] + p["B_L"]
    return np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-p["K_s"] / inertia, -damping / inertia, -MEMORY["c_lag"] / inertia, 0.0, 0.0],
            [0.0, 1.0 / MEMORY["tau"], -1.0 / MEMORY["tau"], 0.0, 0.0],
            [1.0 / 0.03, 0.0, 0.0, -1.0 / 0.03, 0.0],
            [0.0, 0.0, 0.0, 0.0, -1.0 / 0.05],
        ]
    )


@pytest.mark.parametrize("drag_first", [True, False], ids=["drag first", "drag last"])
def test_memories_are_second_order_and_keep_apart(drag_first: bool) -> None:
    theta, omega, drag, pursuer, fading = expm(with_memories(bodies.values()) * 0.2) @ [1.0, 0.0, 0.0, 0.2, 1.0]
    effects = (LaggingDrag, Pursuers) if drag_first else (Pursuers, LaggingDrag)
    memories = (drag, pursuer, fading) if drag_first else (pursuer, fading, drag)
    exact = np.array([0.0, theta, omega, *memories])
    throttle = body(*effects, **SMOOTH, **MEMORY)
    assert 1.8 <= order(throttle, 0.2, (50, 100, 200, 400), exact, start=(0.0, 1.0, 0.0), circuit=0.0, **FREE) <= 2.3


def test_a_memory_begins_anew_with_each_trace() -> None:
    steps, resets = batch(even(0.1, 20), start=(0.0, 1.0, 0.0), circuit=0.0, **FREE)
    twice = jax.tree.map(lambda c: np.concatenate((c, c)), (steps, resets))
    _, z = run(body(Pursuers), *twice)
    assert_array_equal(z[0][:21], z[0][21:])
    assert_array_equal(z[1][:21], z[1][21:])
    assert z[1][0, 0] == 1.0


# ---- lanes


def test_two_traces_in_a_lane_are_two_lanes() -> None:
    first = batch(even(0.3, 300), 5.0, start=(0.1, 0.2, 3.0))
    second = batch(even(0.3, 300), 0.2, start=(0.0, OPEN, 0.0))
    after = jax.tree.map(lambda a, b: np.concatenate((a, b)), first, second)
    beside = jax.tree.map(lambda a, b: np.concatenate((a, b), axis=1), first, second)
    (x, _), (y, _) = run(body(), *after), run(body(), *beside)
    for along, across in zip(x, y, strict=True):
        assert_array_equal(along[:301, 0], across[:, 0])
        assert_array_equal(along[301:, 0], across[:, 1])


# ---- the guide

MOTOR = 0.0189 * N / 1.513  # torque of the motor at the plate for each volt at a standstill, N m/V
SLIDING: dict[str, Any] = {"early": 3.4, "start": (1.5, 0.2, 1.0), **FREE}


def sines(n: int, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Angle at the begin and at the end of each step, rad: swings of 30 degrees about 40."""
    ends = np.linspace(0.0, duration, n + 1)
    angle = 0.7 + 0.5 * np.sin(2 * np.pi * 1.5 * ends)
    return angle[:-1], angle[1:]


def guided(guide_stiffness: float, target0: Any, target1: Any, **how: Any) -> dict[str, Any]:
    return {"guide_stiffness": guide_stiffness, "target0": target0, "target1": target1, **how}


def test_a_guide_that_does_not_pull_is_not_there_bit_by_bit() -> None:
    target0, target1 = sines(400, 1.0)
    driven: tuple[dict[str, Any], ...] = ({"early": 3.0}, {"circuit": 0.0, "torque0": 0.8, "torque1": 0.8})
    for how in driven:
        free = path(body(), *batch(even(1.0, 400), **how))
        led = path(body(), *batch(even(1.0, 400), **how, **guided(0.0, target0, target1, lever=7.0)))
        assert_array_equal(led, free)
        assert np.ptp(free[:, 1]) > 0.5


def test_a_plate_pulled_along_a_path_follows_it_the_closer_the_stronger_the_pull() -> None:
    """By what the motion asks for over the pull: spring, friction, inertia and back-EMF, some 6 V. More than
    N K_b R_a / L_a = 400 V/rad would shake it: the current comes too late."""
    target0, target1 = sines(1000, 2.0)
    off = []
    for guide_stiffness in (50.0, 100.0, 200.0):
        x = path(
            body(), *batch(even(2.0, 1000), 0.0, start=(0.0, 0.7, 4.7), **guided(guide_stiffness, target0, target1))
        )
        off.append(float(np.max(np.abs(x[101:, 1] - target1[100:]))))
    assert off[-1] < 6.0 / 200.0
    assert_allclose(np.array(off[:-1]) / off[1:], 2.0, rtol=0.1)
    without = path(body(), *batch(even(2.0, 1000), 0.0, start=(0.0, 0.7, 4.7)))
    assert np.max(np.abs(without[101:, 1] - target1[100:])) > 1.0


@pytest.mark.parametrize("lever", [1.0, MOTOR])
def test_a_guide_in_torque_asks_for_what_a_slow_motion_takes(lever: float) -> None:
    """lever pull (target - theta) = T_PL + T_f + K_s theta + B omega, at constant speed; no current is driven."""
    ends = 0.1 + 0.5 * np.linspace(0.0, 2.0, 401)
    how = guided(60.0 / lever, ends[:-1], ends[1:], lever=lever, circuit=0.0, start=(0.0, 0.1, 0.5))
    steps, resets = batch(even(2.0, 400), **how)
    p = bodies.values(B_L=0.05)
    x = path(body(B_L=p["B_L"]), steps, resets)
    _, theta, omega = x[-1]
    asked = steps.lever[-1, 0] * steps.guide_stiffness[-1, 0] * (ends[-1] - theta)
    assert_allclose(omega, 0.5 * 60.0 / (60.0 + p["K_s"]), rtol=1e-6)  # the spring lets it fall behind
    damping = N**2 * p["B_m"] + p["B_L"]
    assert_allclose(asked, p["T_PL"] + p["T_f"] + p["K_s"] * theta + damping * omega, rtol=1e-6)
    assert_array_equal(x[:, 0], 0.0)


def test_where_current_flows_the_guide_acts_at_the_terminals_and_its_lever_is_no_torque() -> None:
    target0, target1 = sines(400, 1.0)
    some, other = (
        path(body(), *batch(even(1.0, 400), **guided(300.0, target0, target1, lever=lever))) for lever in (0.0, 5.0)
    )
    assert_array_equal(some, other)
    assert np.ptp(some[:, 0]) > 1.0


@pytest.mark.parametrize("missing", [0.03, -0.05])
def test_what_the_guide_asks_for_is_the_torque_that_the_model_lacks(missing: float) -> None:
    """A plate that a constant torque helps, opening; the model, without that torque, is drawn along its path.

    lever pull e = T_missing lever pull / (lever pull + K_s), e = theta_measured - theta
    """
    p, guide_stiffness = bodies.values(), 40.0
    true = path(body(T_PL=p["T_PL"] - missing), *batch(even(0.4, 400), **SLIDING))
    assert np.min(true[:, 2]) > 0.3  # it never rests
    measured = true[:, 1]
    how = guided(guide_stiffness, measured[:-1], measured[1:], lever=MOTOR)
    steps, resets = batch(even(0.4, 400), **SLIDING, **how)
    model = path(body(), steps, resets)
    read = np.array([float(steps.lever[k, 0] * guide_stiffness * (measured[k] - model[k, 1])) for k in range(200, 401)])
    assert_allclose(read, missing * MOTOR * guide_stiffness / (MOTOR * guide_stiffness + p["K_s"]), rtol=2e-3)
    assert_allclose(read, missing, rtol=0.02)
    exact = path(body(T_PL=p["T_PL"] - missing), steps, resets)
    assert np.max(np.abs(exact[:, 1] - measured)) < 1e-3 * np.max(np.abs(model[:, 1] - measured))


# ---- restitution

DROPPED = {"K_s": 0.0, "B_m": 0.0, "B_L": 0.0, "T_f": 0.0}  # constant acceleration onto the closed stop
BOUNCE = EFFECT_BY_NAME["stop_bounce"]
FALL = 0.4  # s, in which it falls 0.3 rad and bounces


def dropped(share: float, **how: Any) -> np.ndarray:
    """A plate let go at 0.3 rad with open terminals, (T, 3)."""
    return path(body(BOUNCE, e_r=share, **DROPPED), *batch(even(FALL, 800), start=(0.0, 0.3, 0.0), circuit=0.0, **how))


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_stop_gives_back_its_share_of_the_speed(share: float) -> None:
    """Constant acceleration: up to the impact it falls as if there were no stop, then up to the next one a parabola."""
    x, through = dropped(share), dropped(share, lower=-1e6)
    impact = int(np.argmax(x[:, 2] > 0.0))
    assert 10 < impact < 300
    assert_allclose(x[:impact], through[:impact], rtol=1e-12)
    again = impact + int(np.argmin(x[impact:, 2] > -0.9 * x[impact, 2]))
    pull = -through[1, 2] * 800 / FALL
    fell = np.sqrt(2 * 0.3 / pull)
    since = FALL / 800 * np.arange(impact, again) - fell
    assert_allclose(x[impact:again, 1], share * pull * fell * since - pull * since**2 / 2, atol=2e-5)
    assert_allclose(x[impact:again, 2], share * pull * fell - pull * since, atol=5e-3)


def test_the_open_stop_gives_back_as_much_as_the_closed_one() -> None:
    up = path(body(BOUNCE, e_r=0.5, **DROPPED | {"T_PL": -0.362}),
              *batch(even(FALL, 800), start=(0.0, OPEN - 0.3, 0.0), circuit=0.0))  # fmt: skip
    down = dropped(0.5)
    assert_allclose(OPEN - up[:, 1], down[:, 1], atol=1e-9)
    assert_allclose(up[:, 2], -down[:, 2], atol=1e-7)
    assert np.max(down[int(np.argmax(down[:, 2] > 0.0)) :, 1]) > 0.05


def test_without_restitution_an_impact_ends_the_motion_as_before() -> None:
    plain = path(body(**DROPPED), *batch(even(FALL, 800), start=(0.0, 0.3, 0.0), circuit=0.0))
    assert_array_equal(dropped(0.0), plain)
    impact = int(np.argmax(plain[:, 1] <= 0.0))
    assert_array_equal(plain[impact:, 1:], 0.0)


@pytest.mark.parametrize(("start", "volts"), [(0.0, 0.5), (OPEN, 8.0)])
def test_a_plate_that_rests_on_a_stop_does_not_bounce(start: float, volts: float) -> None:
    """Pressed against it by a voltage and by its spring, however springy the stop."""
    x = path(body(BOUNCE, e_r=0.9), *batch(even(0.2, 200), volts, start=(0.0, start, 0.0)))
    assert_array_equal(x[:, 1], start)
    assert_array_equal(x[:, 2], 0.0)


def test_a_plate_lifted_off_its_stop_and_pulled_back_in_one_step_does_not_bounce() -> None:
    """No impact: it never left the stop by the end of a step."""
    x = path(body(BOUNCE, e_r=0.9, **LIFTED), *batch(np.full(3, 3e-3), start=(0.0, 0.0, 0.4), circuit=0.0))
    assert_array_equal(x[1:, 1:], 0.0)


@pytest.mark.parametrize(("share", "friction"), [(0.25, 0.239), (0.5, 0.05), (0.8, 0.1)])
def test_a_bouncing_plate_comes_to_rest(share: float, friction: float) -> None:
    """Every bounce takes its share until one is shorter than a step; its motor is shorted. The current fades in L/R."""
    throttle = body(BOUNCE, e_r=share, T_f=friction)
    x = path(throttle, *batch(even(2.0, 2000), start=(0.0, 0.3, 0.0)))
    assert_array_equal(x[-100:, 1:], 0.0)
    assert np.max(np.abs(x[-100:, 0])) < 1e-12
