"""Throttle bodies and batches made by hand, for the tests of what steps and whitens them."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from etcfit.model.effects import PAPER, AbstractEffect, State
from etcfit.model.parameters import parameters_of
from etcfit.model.stepper import Reset, Step, simulate
from etcfit.model.throttle import Throttle

N = 20.68
OPEN = float(np.pi / 2)
NOMINAL = {p.symbol: p.nominal for t in PAPER for p in parameters_of(t)} | {"B_L": 1e-3}
FREE: dict[str, Any] = {"lower": -1e6, "upper": 1e6}  # a body without stops


def values(**changes: float) -> dict[str, Any]:
    """Nominal values of Eqs. 1-2, some changed; SI."""
    return NOMINAL | changes


def body(*more: type[AbstractEffect], **changes: float) -> Throttle:
    """Eqs. 1-2 and further effects."""
    return Throttle.build((*PAPER, *more), values(**changes))


def batch(
    dt: np.ndarray, early: Any = 0.0, late: Any = None, start: tuple[float, float, float] = (0.0, 0.0, 0.0), **how: Any
) -> tuple[Step, Reset]:
    """One trace on one lane: entry 0 is its start, then a step for each dt (s).

    Args:
        dt: s, shape (n,).
        early, late: voltage at the begin and the end of each step, V; one number for a constant.
        start: current, angle, speed.
        how: other fields of Step, e.g. `mobile`.
    """
    n = len(dt)
    late = early if late is None else late
    fields = {"mobile": 1.0, "circuit": 1.0, "plate": 1.0, "series": 0.0, "gear_ratio": N, "lower": 0.0, "upper": OPEN}
    fields |= {"torque0": 0.0, "torque1": 0.0, "voltage0": early, "voltage1": late}
    fields |= {"guide_stiffness": 0.0, "target0": 0.0, "target1": 0.0, "lever": 0.0}
    fields |= how
    columns: dict[str, Any] = {name: np.concatenate(([0.0], np.broadcast_to(v, n))) for name, v in fields.items()}
    for name in ("mobile", "circuit", "plate", "series", "gear_ratio", "lower", "upper"):
        columns[name][0] = columns[name][1]
    dt = np.concatenate(([0.0], dt))
    steps = Step(dt=dt, time=np.cumsum(dt), **columns)
    first = (np.arange(n + 1) == 0) * 1.0
    resets = Reset(first, *(first * s for s in start))
    return jax.tree.map(lambda c: c[:, None], (steps, resets))


def even(duration: float, n: int) -> np.ndarray:
    return np.full(n, duration / n)


def array(x: State) -> np.ndarray:
    """Path of one lane, shape (T, 3)."""
    return np.stack([np.asarray(c)[:, 0] for c in x], axis=-1)


run = jax.jit(simulate)


def path(throttle: Throttle, steps: Step, resets: Reset) -> np.ndarray:
    """Of one lane, shape (T, 3). Steps of no length behind it make its length one of few, each compiled once."""
    count = len(steps.dt)
    more = 2 ** max(6, (count - 1).bit_length()) - count

    def longer(column: Any) -> Any:
        return np.concatenate((column, np.repeat(column[-1:], more, axis=0))) if np.ndim(column) else column

    steps, resets = jax.tree.map(longer, (steps, resets))
    steps.dt[count:] = 0.0
    return array(run(throttle, steps, resets)[0])[:count]


def linear(p: dict[str, float]) -> np.ndarray:
    """Eqs. 1-2 without dry friction and preload as dx/dt = A x + b v, with v as a fourth, constant state."""
    inertia, damping = N**2 * p["J_m"] + p["J_L"], N**2 * p["B_m"] + p["B_L"]
    return np.array(
        [
            [-p["R_a"] / p["L_a"], 0.0, -p["K_b"] * N / p["L_a"], 1.0 / p["L_a"]],
            [0.0, 0.0, 1.0, 0.0],
            [p["K_m"] * N / inertia, -p["K_s"] / inertia, -damping / inertia, 0.0],
            [0.0, 0.0, 0.0, 0.0],
        ]
    )
