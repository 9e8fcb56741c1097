"""MuJoCo: `mujoco.sysid` over a plate on a hinge joint driven by the engine's own `dcmotor`.

The joint has armature, damping, frictionloss, a spring with springref, and limits; the armature current is the
activation of the motor. Friction and limits are constraints, which are soft by default: a plate that should stick would
creep by 0.1 rad/s. They are made as hard as the step allows. The integrator is first order, so that the step is far
below the sample period. Release instants are delays of the predicted signals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any

import mujoco  # pyright: ignore[reportMissingImports]
import numpy as np
from mujoco import sysid  # pyright: ignore[reportMissingImports]

from ..plain import PlainTrace
from .problem import Problem, Solved

STEPS = 60  # of the optimiser at most
WITHIN, LEAST, LONGEST = 10, 5e-5, 5e-4  # steps in a sample period, as long as they are neither shorter nor longer, s
AFTER = 5e-3  # s that a released plate is simulated beyond the last sample
DIFFERENCE = 1e-4  # of a parameter over its start, for the Jacobian
BOUNDS = 0.01, 20.0  # of the same
HELD = 1e9  # kg m2 of a plate that is held

XML = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="implicitfast" gravity="0 0 0" tolerance="1e-12"/>
  <worldbody><body>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-12 1e-12 1e-12"/>
    <joint name="plate" axis="0 0 1" limited="{limited}" range="{lower} {upper}" armature="1e-3" frictionloss="0.1"
      solreffriction="{soft} 1" solimpfriction="0.9999 0.9999 0.001" solreflimit="{soft} 2"
      solimplimit="0.99 0.999 0.0001"/>
  </body></worldbody>
  <actuator>{actuator}</actuator>
  <sensor>{sensors}</sensor>
</mujoco>
"""
MOTOR = '<dcmotor name="motor" joint="plate" input="voltage" motorconst="0.4" resistance="1" inductance="1e-3"/>'
NONE = '<motor name="motor" joint="plate"/>'  # open terminals: an actuator that is never used
SENSORS = {"current": '<actuatorfrc actuator="motor"/>', "position": '<jointpos joint="plate"/>',
           "emf": '<jointvel joint="plate"/>', "motor_speed": '<jointvel joint="plate"/>'}  # fmt: skip


def solve(problem: Problem) -> Solved:
    """Its optimum from the problem's start; parameters over their start values."""
    parameters = sysid.ParameterDict()
    for symbol in problem.start:
        parameters.add(sysid.Parameter(symbol, 1.0, *BOUNDS))
    each = [_residual_of(problem, trace) for trace in problem.traces]
    count = 0

    def residual(x: np.ndarray, params: Any, **how: Any) -> tuple[list[np.ndarray], list[Any], list[Any]]:
        nonlocal count
        count += 1 if x.ndim == 1 else x.shape[1]
        return [part for one in each for part in one(x, params, **how)[0]], [], []

    found, outcome = sysid.optimize(
        parameters, residual, optimizer="mujoco", verbose=False, max_iters=STEPS, eps=DIFFERENCE, x_scale="jac"
    )
    rest = np.concatenate(residual(outcome.x, found)[0])
    return Solved(_values(problem, found), float(rest @ rest), f"{count} rollouts of all traces")


def _values(problem: Problem, params: Any) -> dict[str, float]:
    return {symbol: float(params[symbol].value[0]) * start for symbol, start in problem.start.items()}


def _residual_of(problem: Problem, trace: PlainTrace) -> Callable[..., Any]:
    """A residual of sysid for one trace."""
    begin = float(trace.instants[0]) if trace.release is None else 0.0  # a released plate: since its release
    end = float(trace.instants[-1]) - (0.0 if trace.release is None else trace.release - AFTER)
    period = float(np.median(np.diff(trace.instants)))
    step = float(np.clip(period / WITHIN, LEAST, LONGEST))
    spec = mujoco.MjSpec.from_string(  # pyright: ignore[reportAttributeAccessIssue]
        XML.format(
            step=step, soft=2.0 * step, limited=str(not trace.gear_apart).lower(), lower=problem.travel[0],
            upper=problem.travel[1], actuator=MOTOR if trace.circuit else NONE,
            sensors="".join(SENSORS[name] for name in trace.channels),
        )
    )  # fmt: skip
    base = spec.compile()
    grid = begin + step * np.arange(int(np.ceil((end - begin) / step)) + 2)
    i, theta, omega = trace.start
    state = sysid.create_initial_state(base, np.array([theta]), np.array([omega]), np.array([i] * base.na))
    state[0] = begin
    logged = sysid.TimeSeries.from_names(trace.instants, np.nan_to_num(trace.data), base)
    control = sysid.TimeSeries(grid, _means(trace, grid)[:, None])
    sequence = sysid.ModelSequences(trace.name, spec, trace.name, state, control, logged)
    seen = np.isfinite(trace.data)

    def build(params: Any, _: Any) -> Any:
        return _model(base, trace, _values(problem, params), problem.N)

    def weighed(params: Any, _: Any, measured: Any, model: Any, *__: Any, state: np.ndarray, **___: Any) -> Any:
        v = _values(problem, params)
        path = _shown(trace, np.vstack((initial, state)), v, problem.N)
        return ((trace.data - path) / trace.sigma)[seen], measured, measured

    initial = state[None]
    return sysid.build_residual_fn(
        models_sequences=[sequence], build_model=build, modify_residual=weighed, n_threads=1, resample_true=False
    )


def _model(base: Any, trace: PlainTrace, v: Mapping[str, float], N: float) -> Any:
    """The compiled model with these parameters."""
    model, plate = copy(base), 0.0 if trace.gear_apart else 1.0
    model.dof_armature[0] = HELD if trace.plate_held else N**2 * v["J_m"] + plate * v["J_L"]
    model.dof_damping[0] = N**2 * v["B_m"] + plate * v["B_L"]
    model.dof_frictionloss[0] = plate * v["T_f"]
    model.jnt_stiffness[0] = plate * v["K_s"]
    model.qpos_spring[0] = -v["T_PL"] / v["K_s"]
    if trace.circuit:
        R = v["R_a"] + v.get(f"series_ohm.{trace.test}", 0.0)
        model.actuator_dynprm[0, 0] = v["L_a"] / R
        model.actuator_gainprm[0, :2] = R, N * v["K_b"]
    data = mujoco.MjData(model)  # pyright: ignore[reportAttributeAccessIssue]
    mujoco.mj_setConst(model, data)  # pyright: ignore[reportAttributeAccessIssue]  # what it derives from these
    return model


def _shown(trace: PlainTrace, states: np.ndarray, v: Mapping[str, float], N: float) -> np.ndarray:
    """What the channels show at the trace's instants: states are time, angle, speed and, with a circuit, current."""
    instants = trace.instants - (trace.release_at(v) or 0.0)
    theta, omega = (np.interp(instants, states[:, 0], states[:, k]) for k in (1, 2))
    seen = {"position": theta, "emf": N * v["K_b"] * omega, "motor_speed": N * omega}
    if trace.circuit:
        seen["current"] = np.interp(instants, states[:, 0], states[:, 3])
    return np.stack([seen[name] for name in trace.channels], axis=1)


def _means(trace: PlainTrace, grid: np.ndarray) -> np.ndarray:
    """Mean input from each instant of a grid to the next, V: the engine holds it constant over a step."""
    knots, volts = trace.knots, trace.volts
    area = np.append(0.0, np.cumsum(0.5 * (volts[1:] + volts[:-1]) * np.diff(knots)))
    edges = np.append(grid, 2.0 * grid[-1] - grid[-2])
    k = np.clip(np.searchsorted(knots, edges, side="right") - 1, 0, knots.size - 1)
    along = edges - knots[k]
    slope = np.append(np.diff(volts) / np.maximum(np.diff(knots), 1e-12), 0.0)[k]
    return np.diff(area[k] + volts[k] * along + 0.5 * slope * along**2) / np.diff(edges)
