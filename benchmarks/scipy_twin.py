"""Eqs. 1-2 as one would write them with SciPy and nothing else: the least-squares problem that etcfit is timed against.

    L_a di/dt = v - (R_a + R_series) i - N K_b w
    J dw/dt   = N K_m i - B w - K_s theta - T_PL - T_f tanh(w / e) + stops,    J = N^2 J_m + J_L,  B = N^2 B_m + B_L

LSODA; friction smoothed, the end stops stiff dampers, each sample weighed by its own noise alone. It is given what
etcfit finds out about a trace before any fit: the denoised input, the first state, the release instant, which is fitted
where it is among the symbols.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt, tanh
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import OptimizeResult, least_squares

from .plain import PlainTrace

SMOOTH = 1e-3  # rad/s, width e of the friction's bend: a plate that sticks must not creep by what its sensor sees
STIFF = 1e5  # N m/rad, so that a plate rests within 0.01 mrad of its stop
DAMPED = 50.0  # times sqrt(STIFF J), so that it does not rebound
LONGEST = 20  # samples in one step, so that no edge of the input is stepped over

Values = Mapping[str, float]
Rates = Callable[[float, Any], tuple[float, ...]]


@dataclass(frozen=True)
class Accuracy:
    """Of the integrator and of the Jacobian's differences.

    Args:
        rtol, atol: of a step, the latter in A, rad, rad/s; looser ones spoil the differences.
        difference: of a parameter, relative; a smaller one drowns in the integrator's own error.
    """

    rtol: float = 1e-5
    atol: tuple[float, float, float] = (1e-6, 1e-7, 1e-5)
    difference: float = 1e-3


USUAL = Accuracy()


@dataclass(frozen=True)
class Rig:
    """Gear ratio and travel (rad)."""

    N: float
    travel: tuple[float, float]


@dataclass(frozen=True)
class Solved:
    """A least-squares run, and how often it computed the residual, the Jacobian's differences included."""

    outcome: OptimizeResult
    evaluations: int


def solve(
    traces: Sequence[PlainTrace],
    symbols: Sequence[str],
    start: Values,
    rig: Rig,
    steps: int,
    accuracy: Accuracy = USUAL,
) -> Solved:
    """least_squares with its Jacobian by finite differences; parameters over their start values, none below zero.

    Args:
        traces: to fit.
        symbols: of the parameters that are free; K_m = K_b.
        start: SI, above zero.
        rig: what is not fitted.
        steps: trial points at most.
        accuracy: of each simulation.
    """
    first = np.array([start[s] for s in symbols])
    count = 0

    def fun(y: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        v = dict(zip(symbols, y * first, strict=True))
        return residual(traces, {**v, "K_m": v["K_b"]}, rig, accuracy)

    outcome = least_squares(fun, np.ones(first.size), bounds=(1e-6, np.inf), x_scale="jac", max_nfev=steps,
                            diff_step=accuracy.difference)  # fmt: skip
    return Solved(outcome, count)


def residual(traces: Sequence[PlainTrace], v: Values, rig: Rig, accuracy: Accuracy = USUAL) -> np.ndarray:
    """(measured - simulated) / sigma of every sample of every trace."""
    parts = [(t.data - simulate(t, v, rig, accuracy)) / t.sigma for t in traces]
    return np.concatenate([part[np.isfinite(part)] for part in parts])


def simulate(trace: PlainTrace, v: Values, rig: Rig, accuracy: Accuracy = USUAL) -> np.ndarray:
    """What the trace's channels would show, SI, shape (n, M); a plate that is let go is held until then."""
    times, x = trace.instants, np.array(trace.start)
    path, release = np.empty((times.size, 3)), trace.release_at(v)
    held = np.full(times.size, trace.plate_held)
    if release is not None:
        held |= times <= release
    still, moving = equations(trace, v, rig)
    begin = float(times[0])
    if held.any():
        end = float(times[-1]) if release is None else release
        path[held], x = _integrate(still, begin, end, x, times[held], accuracy)
        begin = end
    if not held.all():
        path[~held], _ = _integrate(moving, begin, float(times[-1]), x, times[~held], accuracy)
    i, theta, omega = path.T
    seen = {"current": i, "position": theta, "emf": rig.N * v["K_b"] * omega, "motor_speed": rig.N * omega}
    return np.stack([seen[name] for name in trace.channels], axis=1)


def equations(trace: PlainTrace, v: Values, rig: Rig) -> tuple[Rates, Rates]:
    """Rates of current, angle and speed with the plate held, and free."""
    N, (lower, upper) = rig.N, rig.travel
    plate = 0.0 if trace.gear_apart else 1.0
    J, B = N**2 * v["J_m"] + plate * v["J_L"], N**2 * v["B_m"] + plate * v["B_L"]
    R, L_a, K_b, K_m = v["R_a"] + v.get(f"series_ohm.{trace.test}", 0.0), v["L_a"], N * v["K_b"], N * v["K_m"]
    K_s, T_PL, T_f = plate * v["K_s"], plate * v["T_PL"], plate * v["T_f"]
    damp = DAMPED * sqrt(STIFF * J)
    volts, circuit = interpolated(trace), trace.circuit

    def still(t: float, x: Any) -> tuple[float, ...]:
        return (volts(t) - R * x[0]) / L_a if circuit else 0.0, 0.0, 0.0

    def moving(t: float, x: Any) -> tuple[float, ...]:
        i, theta, omega = x.tolist()
        torque = K_m * i - B * omega - K_s * theta - T_PL - T_f * tanh(omega / SMOOTH)
        if plate and theta < lower:
            torque += max(0.0, STIFF * (lower - theta) - damp * omega)
        elif plate and theta > upper:
            torque -= max(0.0, STIFF * (theta - upper) + damp * omega)
        return (volts(t) - R * i - K_b * omega) / L_a if circuit else 0.0, omega, torque / J

    return still, moving


def interpolated(trace: PlainTrace) -> Callable[[float], float]:
    """The input between its knots; np.interp on a single number would cost more than all the rest of Eqs. 1-2."""
    times, levels = trace.knots.tolist(), trace.volts.tolist()
    last = len(times) - 1

    def volts(t: float) -> float:
        k = bisect_right(times, t) - 1  # the later of two knots at one time
        if k < 0 or k >= last:
            return levels[max(k, 0)]
        return levels[k] + (t - times[k]) / (times[k + 1] - times[k]) * (levels[k + 1] - levels[k])

    return volts


def _integrate(
    rates: Rates, begin: float, end: float, x: np.ndarray, times: np.ndarray, accuracy: Accuracy
) -> tuple[np.ndarray, np.ndarray]:
    """States at `times`, shape (n, 3), and at the end."""
    longest = LONGEST * float(np.median(np.diff(times))) if times.size > 1 else np.inf
    got = solve_ivp(rates, (begin, end), x, "LSODA", np.union1d(times, end), rtol=accuracy.rtol, atol=accuracy.atol,
                    max_step=longest)  # fmt: skip
    if not got.success:
        raise RuntimeError(got.message)
    return got.y.T[: times.size], got.y[:, -1]
