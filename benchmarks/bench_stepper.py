"""The stepper against SciPy on one driven trace, side by side in one run.

    python -m benchmarks.bench_stepper [--repeats 15] [--vectors 256]

4 s at 1 kHz of random voltage steps about the balance of the spring, one step a sample. SciPy's LSODA cannot take
set-valued friction: it gets T_f tanh(omega / 0.01 rad/s), along which a stuck plate creeps (hence the difference in
angle), stiff springs for end stops, rtol 1e-6, and steps no longer than 2 ms lest it miss an edge.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

from etcfit.model.effects import PAPER
from etcfit.model.stepper import simulate
from etcfit.model.throttle import Throttle
from independent import CONSISTENT
from independent.drives import random_steps
from tests import bodies
from tests.bodies import OPEN, N, batch

DURATION, RATE = 4.0, 1000.0
SLIP = 0.01  # rad/s over which SciPy's friction changes sign
STOP = 5e3, 5.0  # N m/rad and N m s/rad of SciPy's end stops
LONGEST = 2e-3  # s
SYMBOLS = tuple(bodies.NOMINAL)
AT = np.array([getattr(CONSISTENT, s) for s in SYMBOLS])


def voltage() -> tuple[np.ndarray, np.ndarray]:
    """Instants and volts."""
    rng = np.random.default_rng(3)
    balance = CONSISTENT.volts_for(CONSISTENT.T_PL + CONSISTENT.K_s * OPEN / 2)
    drive = random_steps(rng, DURATION, balance, CONSISTENT.volts_for(CONSISTENT.T_f))
    t = np.arange(0.0, DURATION + 0.5 / RATE, 1.0 / RATE)
    return t, np.interp(t, drive.time, drive.volts)


def median_seconds(call: Callable[[], Any], repeats: int) -> float:
    """Median wall time of a call, after one that is not counted."""
    call()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def by_scan(t: np.ndarray, volts: np.ndarray) -> Callable[[Any], Any]:
    """Angles (T, lanes) at parameter vectors (P,) or (lanes, P)."""
    steps, resets = jax.tree.map(jnp.asarray, batch(np.diff(t), volts[:-1], volts[1:]))

    def angles(p: Any) -> Any:
        return simulate(Throttle.build(PAPER, dict(zip(SYMBOLS, p, strict=True))), steps, resets)[0].theta[:, 0]

    return jax.jit(lambda p: angles(p) if p.ndim == 1 else jax.vmap(angles)(p))


def by_scipy(t: np.ndarray, volts: np.ndarray) -> np.ndarray:
    """Angles (T,)."""
    c = CONSISTENT

    def rates(now: float, x: np.ndarray) -> list[float]:
        i, theta, omega = x
        k = min(int(now * RATE), t.size - 2)
        v = volts[k] + (now - t[k]) * (volts[k + 1] - volts[k]) * RATE
        beyond = min(theta, 0.0) + max(theta - OPEN, 0.0)
        stop = STOP[0] * beyond + STOP[1] * omega if beyond else 0.0
        torque = N * c.K_m * i - c.B_eq * omega - c.K_s * theta - c.T_PL - c.T_f * np.tanh(omega / SLIP) - stop
        return [(v - c.R_a * i - N * c.K_b * omega) / c.L_a, omega, torque / c.J_eq]

    out = solve_ivp(rates, (0.0, t[-1]), [0.0] * 3, method="LSODA", t_eval=t, rtol=1e-6, atol=1e-8, max_step=LONGEST)
    return out.y[1]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--vectors", type=int, default=256)
    options = parser.parse_args()
    t, volts = voltage()
    scan = by_scan(t, volts)
    scatter = 1.0 + 0.1 * np.random.default_rng(0).standard_normal((options.vectors, AT.size))
    batch = AT * scatter

    apart = np.degrees(np.max(np.abs(np.asarray(scan(AT)) - by_scipy(t, volts))))
    slow = median_seconds(lambda: by_scipy(t, volts), max(3, options.repeats // 5))
    single = median_seconds(lambda: scan(AT).block_until_ready(), options.repeats)
    many = median_seconds(lambda: scan(batch).block_until_ready(), options.repeats) / options.vectors

    steps = t.size - 1
    print(f"{DURATION:g} s at {RATE:g} Hz, {steps} steps; angles of both differ by at most {apart:.3f} deg")
    print(f"{'':34}{'ms a trace':>12}{'ns a step':>12}{'x SciPy':>10}")
    for name, seconds in (
        ("SciPy solve_ivp(LSODA)", slow),
        ("etcfit, one parameter vector", single),
        (f"etcfit, {options.vectors} vectors, per vector", many),
    ):
        print(f"{name:34}{1e3 * seconds:12.3f}{1e9 * seconds / steps:12.1f}{slow / seconds:10.0f}")


if __name__ == "__main__":
    main()
