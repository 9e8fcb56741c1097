"""CasADi and IPOPT: multiple shooting with CVODES, states at nodes along each trace variables beside the parameters.

    J dw/dt = ... - T_f tanh(w / e) + stops

Friction and stops are smooth and stiff, as for SciPy. From node to node CVODES integrates states and sensitivities, and
states at the nodes begin at the smoothed data. IPOPT gets the Hessian of Gauss and Newton and gradients by forward mode.
Transcribed without an integrator (Radau IIA, each state of each sample a variable) IPOPT did not reach feasibility in
hundreds of iterations: one step length for all kinks of friction and stops together is too short.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np
from scipy.signal import savgol_filter

from ..plain import PlainTrace
from .problem import Problem, Solved

SMOOTH = 1e-3  # rad/s, width e of the friction's bend
STIFF = 1e5  # N m/rad of a stop
DAMPED = 5e4  # 1/s, over J: a plate does not rebound
TOLERANCES = {"reltol": 1e-6, "abstol": 1e-8, "max_num_steps": 200_000}  # of CVODES
SAMPLES = 100  # from node to node
EARLY = 1.5e-3  # s after the reading of a release instant: the first sample that is looked at
SMOOTHED = 21  # samples under the parabola that gives the first states
STEPS = 60  # of IPOPT at most
TOLERANCE = 1e-6  # of IPOPT

Symbols = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Piece:
    """A trace in the optimisation problem.

    Args:
        variables: states at its nodes but the first, which is known; a column.
        first: where they begin.
        gaps: between a shot's end and the next node, that must vanish.
        rest: (measured - simulated) / sigma.
    """

    variables: Any
    first: np.ndarray
    gaps: Any
    rest: Any


def solve(problem: Problem) -> Solved:
    """Its optimum from the problem's start; parameters are logarithms over their start."""
    y = ca.MX.sym("y", len(problem.start))
    values = {s: ca.exp(y[k]) * start for k, (s, start) in enumerate(problem.start.items())}
    pieces = [_piece(problem, trace, values) for trace in problem.traces]
    x = ca.vertcat(y, *(piece.variables for piece in pieces))
    rest, gaps = ca.vertcat(*(piece.rest for piece in pieces)), ca.vertcat(*(piece.gaps for piece in pieces))
    solver = _solver(x, rest, gaps)
    found = solver(x0=np.concatenate([np.zeros(y.numel()), *(piece.first for piece in pieces)]), lbg=0.0, ubg=0.0)
    at, ended = found["x"].full().ravel(), solver.stats()
    best = {s: float(np.exp(at[k])) * start for k, (s, start) in enumerate(problem.start.items())}
    words = f"{at.size} variables, {ended['iter_count']} iterations; {ended['return_status']}"
    return Solved(best, 2.0 * float(found["f"]), words)


def _solver(x: Any, rest: Any, gaps: Any) -> Any:
    """IPOPT for the least squares of `rest` under `gaps` = 0."""
    forward = {"helper_options": {"enable_reverse": False}}
    slopes, bends = ca.jacobian(rest, x, forward), ca.jacobian(gaps, x, forward)
    p, weight, multipliers = ca.MX.sym("p", 0), ca.MX.sym("weight"), ca.MX.sym("multipliers", gaps.numel())
    half = 0.5 * ca.sumsqr(rest)
    options = {
        "grad_f": ca.Function("grad_f", [x, p], [half, slopes.T @ rest]),
        "jac_g": ca.Function("jac_g", [x, p], [gaps, bends]),
        "hess_lag": ca.Function("hess_lag", [x, p, weight, multipliers], [ca.triu(weight * (slopes.T @ slopes))]),
        "ipopt": {"max_iter": STEPS, "tol": TOLERANCE, "print_level": 5, "sb": "yes"},
        "print_time": False,
    }
    return ca.nlpsol("solver", "ipopt", {"x": x, "p": p, "f": half, "g": gaps}, options)


def _piece(problem: Problem, trace: PlainTrace, v: Symbols) -> Piece:
    """Shots of `SAMPLES` samples; those beyond the last sample are never looked at."""
    names, constants = _states(trace), _constants(problem, trace, v)
    begin = dict(zip(("i", "theta", "omega"), trace.start, strict=True))
    start, skipped = ca.MX([begin[name] for name in names]), 0
    times = trace.instants
    if trace.release is not None:  # a first shot from the release, whenever that is, to a sample
        skipped = int(np.searchsorted(times, trace.release + EARLY))
        first = _shot(problem, trace, names, 1)
        start = first(x0=start, p=ca.vertcat(*constants, times[skipped] - v[trace.release_symbol], 0.0))["xf"]
    period = float(np.median(np.diff(times)))
    count = int(np.ceil((times.size - 1 - skipped) / SAMPLES))
    firsts = skipped + SAMPLES * np.arange(count)
    nodes = ca.MX.sym("nodes", len(names), count - 1)
    begins = ca.horzcat(start, nodes)
    shot = _shot(problem, trace, names, SAMPLES).map(count)
    given = ca.vertcat(ca.repmat(ca.vertcat(*constants, period), 1, count), ca.MX(times[firsts][None]))
    path = shot(x0=begins, p=given)["xf"]  # states after each sample, shot by shot
    ends = path[:, SAMPLES - 1 :: SAMPLES]
    states = ca.horzcat(start, path)[:, : times.size - skipped]
    guess = _first(problem, trace, names)[:, firsts[1:]]
    rest = _rest(problem, trace, names, states, v, skipped)
    return Piece(ca.vec(nodes), guess.ravel(order="F"), ca.vec(ends[:, :-1] - nodes), rest)


def _states(trace: PlainTrace) -> tuple[str, ...]:
    if trace.plate_held:
        return ("i",)
    if trace.gear_apart:
        return "i", "omega"
    return ("i", "theta", "omega") if trace.circuit else ("theta", "omega")


def _constants(problem: Problem, trace: PlainTrace, v: Symbols) -> list[Any]:
    """R, L, k, J, B, K_s, T_PL, T_f at the plate's shaft."""
    N, plate = problem.N, 0.0 if trace.gear_apart else 1.0
    R = v["R_a"] + v.get(f"series_ohm.{trace.test}", 0.0)
    J, B = N**2 * v["J_m"] + plate * v["J_L"], N**2 * v["B_m"] + plate * v["B_L"]
    return [R, v["L_a"], N * v["K_b"], J, B, v["K_s"], v["T_PL"], v["T_f"]]


def _shot(problem: Problem, trace: PlainTrace, names: tuple[str, ...], samples: int) -> Any:
    """CVODES over so many periods; after the constants its parameters are the period and the instant at its begin."""
    x, p, t = ca.MX.sym("x", len(names)), ca.MX.sym("p", 10), ca.MX.sym("t")
    R, L, k, J, B, K_s, T_PL, T_f, period, begin = ca.vertsplit(p)
    at = {name: x[n] for n, name in enumerate(names)}
    i, theta, omega = (at.get(name, 0.0) for name in ("i", "theta", "omega"))
    torque = k * i - B * omega
    if "theta" in at:
        (lower, upper), damp = problem.travel, DAMPED * J
        torque -= K_s * theta + T_PL + T_f * ca.tanh(omega / SMOOTH)
        torque += ca.if_else(theta < lower, ca.fmax(STIFF * (lower - theta) - damp * omega, 0.0), 0.0)
        torque -= ca.if_else(theta > upper, ca.fmax(STIFF * (theta - upper) + damp * omega, 0.0), 0.0)
    rate = {"theta": omega, "omega": torque / J}
    if "i" in at:
        rate["i"] = (_volts(trace, begin + period * t) - R * i - k * omega) / L
    dae = {"x": x, "p": p, "t": t, "ode": period * ca.vertcat(*(rate[name] for name in names))}
    return ca.integrator("shot", "cvodes", dae, 0.0, np.arange(1.0, samples + 1.0), TOLERANCES)


def _volts(trace: PlainTrace, t: Any) -> Any:
    """The input at an instant; a jump takes a microsecond, for the look-up knows no two knots at one time."""
    knots = trace.knots + 1e-6 * np.append(0.0, np.diff(trace.knots) == 0.0)
    return ca.interpolant("volts", "linear", [knots], trace.volts)(t)


def _rest(problem: Problem, trace: PlainTrace, names: tuple[str, ...], states: Any, v: Symbols, skipped: int) -> Any:
    """(measured - simulated) / sigma of all that was logged; a column of states for each sample but those skipped."""
    row = {name: states[n, :].T for n, name in enumerate(names)}
    parts = []
    for m, channel in enumerate(trace.channels):
        column, sigma = trace.data[:, m], trace.sigma[m]
        name, size = {"current": ("i", 1.0), "position": ("theta", 1.0), "emf": ("omega", problem.N * v["K_b"]),
                      "motor_speed": ("omega", problem.N)}[channel]  # fmt: skip
        seen = np.flatnonzero(np.isfinite(column[skipped:]))
        parts.append((column[skipped:][seen] - size * row[name][seen.tolist()]) / sigma)
        if skipped:  # since the release the speed grows evenly
            since = ca.fmax(trace.instants[:skipped] - v[trace.release_symbol], 0.0)
            gain = row["omega"][0] / (trace.instants[skipped] - v[trace.release_symbol])
            early = size * gain * since if name == "omega" else trace.start[1] + 0.5 * gain * since**2
            parts.append((column[:skipped] - early) / sigma)
    return ca.vertcat(*parts)


def _first(problem: Problem, trace: PlainTrace, names: tuple[str, ...]) -> np.ndarray:
    """States at each sample as the data show them, smoothed; shape (states, n)."""
    period = float(np.median(np.diff(trace.instants)))
    seen = {}
    for m, channel in enumerate(trace.channels):
        good = np.isfinite(trace.data[:, m])
        seen[channel] = np.interp(trace.instants, trace.instants[good], trace.data[good, m])
    found = {}
    if "current" in seen:
        found["i"] = seen["current"]
    if "position" in seen:
        found["theta"] = np.clip(savgol_filter(seen["position"], SMOOTHED, 2), *problem.travel)
        found["omega"] = savgol_filter(seen["position"], SMOOTHED, 2, 1, period)
    if "motor_speed" in seen:
        found["omega"] = seen["motor_speed"] / problem.N
    return np.stack([found[name] for name in names])
