"""CasADi and IPOPT: multiple shooting with CVODES, states at nodes along each trace variables beside the parameters.

    J dw/dt = ... - T_f tanh(w / e) + stops

Friction and stops are smooth and stiff, as for SciPy. From node to node CVODES integrates states and sensitivities.
States at the nodes begin at the smoothed data. IPOPT gets the Hessian of Gauss and Newton and gradients by forward
mode. Tried and left: each state of each sample a variable and no integrator (Radau IIA, Gauss-Newton Hessian, friction
sharpened in stages). IPOPT was far from feasible after 90 iterations, for one step length must suit all kinks of
friction and stops at once.
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
STIFF = 1e4  # N m/rad of a stop
DAMPED = 5e4  # 1/s, over J: a plate does not rebound
GRADUAL = 1e-5  # rad into a stop over which its damping sets in: where it jumps, CVODES takes steps without end
TOLERANCES = {"reltol": 1e-6, "abstol": 1e-8, "max_num_steps": 200_000, "fsens_err_con": False}  # of CVODES
SAMPLES = 100  # from node to node
EARLY = 1.5e-3  # s after the reading of a release instant: the first sample that is looked at
OFF = 1e-4  # rad off a stop of a first state: at its corner CVODES finds no slopes
SMOOTHED = 21  # samples under the parabola that gives the first states
STEPS = 60  # of IPOPT at most
TOLERANCE = 2e-3  # of IPOPT, scaled; below it the gradient is the integrator's own error

ORDER = ("i", "theta", "omega")  # of a trace's start

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
    solver, _calls = _solver(x, rest, gaps)
    found = solver(x0=np.concatenate([np.zeros(y.numel()), *(piece.first for piece in pieces)]), lbg=0.0, ubg=0.0)
    at, ended = found["x"].full().ravel(), solver.stats()
    best = {s: float(np.exp(at[k])) * start for k, (s, start) in enumerate(problem.start.items())}
    words = f"{at.size} variables, {ended['iter_count']} iterations; {ended['return_status']}"
    return Solved(best, 2.0 * float(found["f"]), words)


class Shared(ca.Callback):
    """Some outputs of a function of x, whose last result all who share it use: slopes cost a hundred times the rest."""

    def __init__(
        self, name: str, whole: Any, outputs: tuple[str, ...], inputs: tuple[int, ...], last: dict[bytes, Any]
    ):
        ca.Callback.__init__(self)
        self.whole, self.outputs, self.inputs, self.last = whole, outputs, inputs, last
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self.inputs)

    def get_n_out(self) -> int:
        return len(self.outputs)

    def get_sparsity_in(self, k: int) -> Any:
        return ca.Sparsity.dense(self.inputs[k], 1)

    def get_sparsity_out(self, k: int) -> Any:
        return self.whole.sparsity_out(self.outputs[k])

    def eval(self, arg: list[Any]) -> list[Any]:
        """At x; what IPOPT asks for a Lagrangian is multiplied by the weight of its objective."""
        key = arg[0].full().tobytes()
        if key not in self.last:
            self.last.clear()
            self.last[key] = self.whole(x=arg[0])
        found = [self.last[key][name] for name in self.outputs]
        return [arg[2] * each for each in found] if len(arg) > 2 else found


def _solver(x: Any, rest: Any, gaps: Any) -> tuple[Any, list[Shared]]:
    """IPOPT for the least squares of `rest` under `gaps` = 0, and what it calls, which must outlive it."""
    forward = {"helper_options": {"enable_reverse": False}}
    slopes, bends = ca.jacobian(rest, x, forward), ca.jacobian(gaps, x, forward)
    half = 0.5 * ca.sumsqr(rest)
    outputs = {"f": half, "grad": slopes.T @ rest, "g": gaps, "jac": bends, "hess": ca.triu(slopes.T @ slopes)}
    whole = ca.Function("whole", [x], list(outputs.values()), ["x"], list(outputs))
    last: dict[bytes, Any] = {}
    n, m = x.numel(), gaps.numel()
    calls = [
        Shared("grad_f", whole, ("f", "grad"), (n, 0), last),
        Shared("jac_g", whole, ("g", "jac"), (n, 0), last),
        Shared("hess_lag", whole, ("hess",), (n, 0, 1, m), last),
    ]
    options = {
        **dict(zip(("grad_f", "jac_g", "hess_lag"), calls, strict=True)),
        "ipopt": {"max_iter": STEPS, "tol": TOLERANCE, "dual_inf_tol": 1e6, "print_level": 0, "sb": "yes"},
        "print_time": False,
    }
    nlp = {"x": x, "p": ca.MX.sym("p", 0), "f": half, "g": gaps}
    return ca.nlpsol("solver", "ipopt", nlp, options), calls


def _piece(problem: Problem, trace: PlainTrace, v: Symbols) -> Piece:
    """Shots of `SAMPLES` samples; those beyond the last sample are never looked at."""
    names, constants = _states(trace), _constants(problem, trace, v)
    start, skipped = ca.MX([trace.start[ORDER.index(name)] for name in names]), 0
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
        for sign, deep in ((1.0, ca.fmax(lower - theta, 0.0)), (-1.0, ca.fmax(theta - upper, 0.0))):
            torque += sign * ca.fmax(STIFF * deep - sign * damp * omega * deep / (deep + GRADUAL), 0.0)
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
        lower, upper = problem.travel
        found["theta"] = np.clip(np.asarray(savgol_filter(seen["position"], SMOOTHED, 2)), lower + OFF, upper - OFF)
        found["omega"] = savgol_filter(seen["position"], SMOOTHED, 2, 1, period)
    if "motor_speed" in seen:
        found["omega"] = seen["motor_speed"] / problem.N
    return np.stack([found[name] for name in names])
