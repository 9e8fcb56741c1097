"""The stepper against other ways of solving the same equations: events located in time, and Diffrax."""

from __future__ import annotations

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

import bodies
from bodies import FREE, OPEN, N, batch, body, linear, path
from etcfit.model.parameters import Scalar
from independent import CONSISTENT, NONE
from independent import simulate as independent
from independent.drives import Drive, line

# ---- the event-located generator


def both(drive: Drive, per_sample: int, angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Paths of generator and stepper at 1 kHz under one voltage whose knots lie on whole samples, (n, 3) each."""
    instants = np.arange(0.0, drive.time[-1] + 5e-4, 1e-3)
    plant = independent.throttle(CONSISTENT, NONE)
    motion = independent.simulate(plant, drive, instants, angle=angle)
    fine = np.linspace(0.0, instants[-1], per_sample * (instants.size - 1) + 1)
    nudge = 1e-9  # either side of a jump
    early = np.interp(fine[:-1] + nudge, drive.time, drive.volts)
    late = np.interp(fine[1:] - nudge, drive.time, drive.volts)
    p = {s: getattr(CONSISTENT, s) for s in bodies.NOMINAL}
    x = path(body(**p), *batch(np.diff(fine), early, late, (0.0, angle, 0.0)))[::per_sample]
    return x, np.stack([motion.current, motion.angle, motion.speed], axis=-1)


def slow_triangles() -> Drive:
    """Across the width of dry friction, slowly: the plate sticks at each turn."""
    return line(list(0.4 * np.arange(7)), [1.7, 3.2, 0.4, 3.2, 0.4, 3.2, 0.4])


def wobble() -> Drive:
    """2 to 12 Hz, a straight line between whole samples: the plate slides back and forth through mid-travel."""
    t = np.arange(2001) * 1e-3
    return Drive(t, 1.75 + 3.0 * np.sin(2 * np.pi * (2.0 + 2.5 * t) * t))


def slams() -> Drive:
    """Against the open stop, back against the closed one, and again."""
    return Drive(np.array([0.0, 0.3, 0.3, 0.8, 0.8, 1.1, 1.1, 1.7]), np.repeat([6.0, -1.0, 7.0, -1.0], 2))


@pytest.mark.parametrize("drive", [slow_triangles(), wobble()], ids=["slow triangles", "wobble"])
def test_stick_slip_agrees_with_the_event_located_generator(drive: Drive) -> None:
    """Tolerance at h = 0.25 ms: a change of mode is rounded to a stage, which costs the speed up to h times its jump in
    acceleration. 0.5 mrad and 10 mA are half of one sample's noise on a good bench."""
    x, exact = both(drive, 4, 0.6)
    stuck = exact[:, 2] == 0.0
    assert 0.05 < np.mean(stuck) < 0.9  # the plate does both
    assert np.ptp(exact[:, 1]) > 0.1
    assert np.all((exact[:, 1] > 0.0) & (exact[:, 1] < OPEN))  # and meets no stop
    assert np.max(np.abs(x[:, 1] - exact[:, 1])) < 5e-4
    assert np.max(np.abs(x[:, 0] - exact[:, 0])) < 1e-2
    assert np.mean((x[:, 2] == 0.0) == stuck) > 0.99


@pytest.mark.parametrize(("drive", "gain"), [(slow_triangles(), 50.0), (wobble(), 8.0)], ids=["slow", "fast"])
def test_stick_slip_converges_to_the_generator(drive: Drive, gain: float) -> None:
    """Sixteen times finer: second order where the plate turns slowly, first order at least where it turns at speed."""
    wrong = [np.max(np.abs(np.subtract(*both(drive, n, 0.6)))[:, :2], axis=0) for n in (1, 16)]
    assert np.all(wrong[1] < wrong[0] / gain)


def test_stop_impacts_agree_with_the_event_located_generator() -> None:
    """Tolerance: an impact is clipped at the end of a step, so its instant is wrong by up to h = 0.125 ms; at 3 rad/s
    that is 0.4 mrad, and a current that has forgotten it twelve samples (time constants L/R) later."""
    x, exact = both(slams(), 8, 0.0)
    hits = np.flatnonzero((exact[1:, 2] == 0.0) & (np.abs(exact[:-1, 2]) > 1.0))
    assert hits.size == 4
    since = np.min(np.abs(np.arange(exact.shape[0])[:, None] - hits), axis=1)
    assert np.max(np.abs(x[:, 1] - exact[:, 1])) < 4e-4
    assert np.max(np.abs(x[since > 12, 0] - exact[since > 12, 0])) < 4e-3
    assert np.all((x[:, 1] >= 0.0) & (x[:, 1] <= OPEN))
    assert np.all(x[hits + 2, 2] == 0.0)


# ---- another solver


@pytest.mark.slow
def test_a_smooth_case_agrees_with_diffrax() -> None:
    """Tolerance: h = 0.25 ms against L/R = 1 ms leaves (h R/L)^2/12 of what each bend of the voltage excites; halving
    h must quarter it."""
    reference = _diffrax(0.5)
    wrong = []
    for n in (2000, 4000):
        fine = np.linspace(0.0, 0.5, n + 1)
        volts = _sine(fine)
        x = path(body(T_f=0.0), *batch(np.diff(fine), volts[:-1], volts[1:], (0.0, 0.5, 0.0), **FREE))
        wrong.append(np.max(np.abs(x[:: n // 50] - reference), axis=0))
    assert np.all(wrong[1] < [2e-5, 2e-6, 5e-5])
    assert_allclose(wrong[0] / wrong[1], 4.0, atol=0.4)


def _sine(t: Scalar) -> Scalar:
    return 2.0 + 1.5 * jnp.sin(2.0 * jnp.pi * 6.0 * t)


def _diffrax(duration: float) -> np.ndarray:
    p = bodies.values(T_f=0.0)
    a = jnp.asarray(linear(p)[:3, :3])
    inertia = N**2 * p["J_m"] + p["J_L"]

    def rates(t: Scalar, y: Scalar, _: None) -> Scalar:
        return a @ y + jnp.array([_sine(t) / p["L_a"], 0.0, -p["T_PL"] / inertia])

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        diffrax.Tsit5(),
        0.0,
        duration,
        1e-4,
        jnp.array([0.0, 0.5, 0.0]),
        saveat=diffrax.SaveAt(ts=jnp.linspace(0.0, duration, 51)),
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-11),
        max_steps=100_000,
    )
    return np.asarray(solution.ys)
