"""Diffrax and Optimistix: Levenberg-Marquardt over an adaptive, implicit solve, its Jacobian by forward mode.

    J dw/dt = ... - T_f tanh(w / e) + stops

Friction and stops are smooth and stiff, as for SciPy. Traces of a kind are solved side by side. Parameters are
logarithms over the start, so that none can fall below zero; the residual is divided by the root of its length, for
the damping of Optimistix begins at 1 whatever the problem's scale.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import diffrax as dfx
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array

from ..plain import PlainTrace
from .problem import Problem, Solved

SMOOTH = 1e-3  # rad/s, width e of the friction's bend
STIFF = 1e5  # N m/rad of a stop
DAMPED = 5e4  # 1/s, over J: a plate does not rebound
RTOL, ATOL = 1e-5, (1e-6, 1e-7, 1e-5)  # of a step: A, rad, rad/s
SOLVES = 200_000  # steps of a solve at most
STEPS = 80  # of the optimiser at most
TOLERANCE = 1e-7  # of the optimiser, relative and absolute

Values = Mapping[str, Array]


class Lanes(eqx.Module):
    """Traces of one kind side by side, each padded to the longest.

    Args:
        instants, data: as in `PlainTrace`, shape (K, n) and (K, n, M); padded with the last instant and NaN.
        knots, volts, jumps: its input and where it jumps, s; padded with ever later instants.
        sigma, start: by trace.
    """

    instants: Array
    data: Array
    knots: Array
    volts: Array
    jumps: Array
    sigma: Array
    start: Array


jax.config.update("jax_enable_x64", True)


def solve(problem: Problem) -> Solved:
    """Its optimum from the problem's start."""
    kinds: dict[tuple[bool, ...], list[PlainTrace]] = {}
    for trace in problem.traces:
        kinds.setdefault((trace.plate_held, trace.gear_apart, trace.circuit), []).append(trace)
    first = jnp.array(list(problem.start.values()))
    scale = problem.samples**-0.5

    def values(y: Array) -> Values:
        return dict(zip(problem.start, first * jnp.exp(y), strict=True))

    def residual(y: Array, lanes: Sequence[Lanes]) -> Array:
        parts = [_residual(problem, *each, values(y)) for each in zip(kinds.values(), lanes, strict=True)]
        return scale * jnp.concatenate(parts)

    lanes = [_side_by_side(traces) for traces in kinds.values()]  # as arguments: constants slow compilation down
    solver = optx.LevenbergMarquardt(rtol=TOLERANCE, atol=TOLERANCE)
    found = optx.least_squares(
        residual, solver, jnp.zeros(first.size), lanes, options={"jac": "fwd"}, max_steps=STEPS, throw=False
    )
    rest = jax.jit(residual)(found.value, lanes)
    words = f"{int(found.stats['num_steps'])} steps; {_ending(found.result)}"
    return Solved({s: float(v) for s, v in values(found.value).items()}, float(rest @ rest) / scale**2, words)


def _ending(result: optx.RESULTS) -> str:
    return "converged" if bool(result == optx.RESULTS.successful) else optx.RESULTS[result]


def _residual(problem: Problem, traces: Sequence[PlainTrace], lanes: Lanes, v: Values) -> Array:
    """(measured - simulated) / sigma of traces of one kind, 0 where nothing was logged."""
    kind = traces[0]

    def of_one(lane: Lanes, series: Array, release: Array) -> Array:
        path = _path(kind, lane, problem, v, series, release)
        emf = problem.N * v["K_b"] * path[:, 2]
        seen = {"current": path[:, 0], "position": path[:, 1], "emf": emf, "motor_speed": problem.N * path[:, 2]}
        rest = (lane.data - jnp.stack([seen[name] for name in kind.channels], axis=1)) / lane.sigma
        return jnp.where(jnp.isnan(lane.data), 0.0, rest)

    series = jnp.stack([v.get(f"series_ohm.{trace.test}", jnp.zeros(())) for trace in traces])
    release = jnp.stack([v.get(trace.release_symbol, jnp.zeros(())) for trace in traces])
    return jax.vmap(of_one)(lanes, series, release).ravel()


def _path(kind: PlainTrace, lane: Lanes, problem: Problem, v: Values, series: Array, release: Array) -> Array:
    """Current, angle and speed at the instants of a trace, shape (n, 3); a plate is held until its release."""
    N, plate = problem.N, 0.0 if kind.gear_apart else 1.0
    lower, upper = problem.travel
    J, B = N**2 * v["J_m"] + plate * v["J_L"], N**2 * v["B_m"] + plate * v["B_L"]

    def rates(t: Any, x: Array, _: None) -> Array:
        i, theta, omega = x
        volts = _volts(lane, t)
        di = (volts - (v["R_a"] + series) * i - N * v["K_b"] * omega) / v["L_a"] if kind.circuit else jnp.zeros(())
        if kind.plate_held:
            return jnp.stack([di, jnp.zeros(()), jnp.zeros(())])
        torque = N * v["K_b"] * i - B * omega
        if plate:
            torque -= v["K_s"] * theta + v["T_PL"] + v["T_f"] * jnp.tanh(omega / SMOOTH)
            below, above = STIFF * (lower - theta) - DAMPED * J * omega, STIFF * (theta - upper) + DAMPED * J * omega
            torque += jnp.where(theta < lower, jnp.maximum(below, 0.0), 0.0)
            torque -= jnp.where(theta > upper, jnp.maximum(above, 0.0), 0.0)
        return jnp.stack([di, omega, torque / J])

    instants = jnp.maximum(lane.instants - release, 0.0) if kind.release is not None else lane.instants
    control = dfx.PIDController(rtol=RTOL, atol=jnp.array(ATOL))
    if lane.jumps.size:
        control = dfx.ClipStepSizeController(control, jump_ts=lane.jumps)
    solution = dfx.diffeqsolve(
        dfx.ODETerm(rates), dfx.Kvaerno5(), instants[0], instants[-1], 1e-5, lane.start,
        saveat=dfx.SaveAt(ts=instants), stepsize_controller=control, max_steps=SOLVES, adjoint=dfx.ForwardMode(),
        throw=False,
    )  # fmt: skip
    assert solution.ys is not None
    return solution.ys


def _volts(lane: Lanes, t: Any) -> Array:
    """The input at an instant, V; after the jump where it jumps."""
    k = jnp.clip(jnp.searchsorted(lane.knots, t, side="right") - 1, 0, lane.knots.size - 2)
    span = lane.knots[k + 1] - lane.knots[k]
    share = (t - lane.knots[k]) / jnp.where(span > 0.0, span, 1.0)
    return lane.volts[k] + share * (lane.volts[k + 1] - lane.volts[k])


def _side_by_side(traces: Sequence[PlainTrace]) -> Lanes:
    late = max(float(trace.instants[-1]) for trace in traces) + 1.0
    jumps = [trace.knots[1:][np.diff(trace.knots) == 0.0] for trace in traces]
    padded = [late + 1e-3 * np.arange(1, max(j.size for j in jumps) + 1) for _ in traces]
    return Lanes(
        _stacked(t.instants for t in traces),
        _stacked((t.data for t in traces), np.nan),
        _stacked(np.append(t.knots, late) for t in traces),
        _stacked(np.append(t.volts, t.volts[-1]) for t in traces),
        jnp.array([np.append(j, p)[: p.size] for j, p in zip(jumps, padded, strict=True)]),
        jnp.array([t.sigma for t in traces]),
        jnp.array([t.start for t in traces]),
    )


def _stacked(rows: Iterable[np.ndarray], fill: float | None = None) -> Array:
    """Rows of different length as one array; what they lack is a number, or their last entry."""
    rows = list(rows)
    most = max(row.shape[0] for row in rows)
    return jnp.array([np.concatenate((row, _lacking(row, most, fill))) for row in rows])


def _lacking(row: np.ndarray, most: int, fill: float | None) -> np.ndarray:
    lacking = np.repeat(row[-1:], most - row.shape[0], axis=0)
    return lacking if fill is None else np.full(lacking.shape, fill)
