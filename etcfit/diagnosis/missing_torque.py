"""What the model lacks along the measured motion.

The plate of the simulation is drawn along the measured angle by a guide at its terminals; what this guide needs is
what the model lacks,

    T_missing = N K_m / R_a stiffness (theta_measured - theta),        V_missing = (R_a + R_series) (i_measured - i)

so that sticking friction, stops, effects with memory and the electrical side need no inverse formula: the stepper that
simulates the fit does it all. The second holds for what changes slower than L_a/R_a.

Source: synchronisation by a coupling (Abarbanel 2009); the guide as inverse dynamics with a finite bandwidth.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..estimation.guide import guide_stiffness_of
from ..kernels.machine import available
from ..model.stepper import StatePath, Step
from ..model.throttle import Throttle
from ..problem import filter_kernels
from ..problem.filter_kernels import along_path
from ..problem.free_parameters import SERIES, Form, Pick
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import run
from .candidate_model import CandidateModel
from .composition import is_of_the_rig
from .findings import Motion


def _shown(throttle: Throttle, path: StatePath, steps: Step) -> dict[str, Any]:
    """Signals of a batch or of one entry, and what every effect contributes, (effects, T, L).

    Args:
        throttle: the model.
        path: its states and memories at the end of each step.
        steps: what it ran on.
    """
    state, z = path
    u = steps.inputs(1.0)
    parts = throttle.parts(state, z, u)
    zero = jnp.zeros_like(state.omega)
    direction = jnp.sign(state.omega)
    torque = [zero + part.torque + part.drive - part.friction * direction for part in parts]
    drive, external = sum(part.drive for part in parts), sum(part.torque for part in parts)
    resting = (state.omega == 0.0) | (steps.mobile < 0.5) | (steps.guide_stiffness == 0.0)
    return {
        "time": steps.time,
        # a motor that runs alone turns no plate
        "angle": jnp.where(steps.plate > 0.5, state.theta, steps.lower),
        "speed": state.omega,
        "current": state.i,
        "load": zero + u._replace(motor=drive + u.torque, external=external).gear_load,
        "input": jnp.where(steps.circuit > 0.5, u.voltage, u.torque),
        "torque": jnp.where(resting, jnp.nan, steps.lever * steps.guide(1.0, state.theta)),
        "effect_torque": jnp.stack(torque),
        "effect_voltage": jnp.stack([zero + part.voltage for part in parts]),
    }


@partial(jax.jit, static_argnums=0)
def _by_jax(form: Form, x: Any, pick: Pick, arrays: Any) -> dict[str, Any]:
    throttle, path, steps, _ = run(form, x, pick, arrays)
    return _shown(throttle, path, steps)


_BY_KERNEL = along_path(lambda given: _shown(given.throttle, given.after, given.batch.steps))


def _along(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> dict[str, np.ndarray]:
    """Signals along a guided run, (T, L) each, and what every effect contributes, (effects, T, L)."""
    arrays = problem.arrays(guide_stiffness)
    if not available():
        return {k: np.asarray(v) for k, v in _by_jax(*problem.at(x), arrays).items()}
    found = jax.tree.map(np.asarray, filter_kernels.along(_BY_KERNEL, *problem.here(x, arrays)))
    return {k: np.moveaxis(v, 2, 0) if v.ndim > 2 else v for k, v in found.items()}


def signals(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[dict[str, np.ndarray]]:
    """Signals of each trace along a run drawn along its measured angle.

    Args:
        problem: the traces.
        x: coordinates, shape (P,).
        guide_stiffness: V/rad, or N m/rad where torque drives.
    Returns:
        for each trace, by name, shape (n,): "time" (s), "angle" (rad), "speed" (rad/s), "current" (A), "load" (N m
        through the gear), "input" (V or N m), "torque" (missing, N m; NaN where the plate rests); and of each effect,
        shape (effects, n): "effect_torque" (N m) and "effect_voltage" (V).
    """
    along = _along(problem, x, guide_stiffness)
    out = []
    for lane, _, marks in problem.batch.places:
        out.append({name: column[..., marks, lane] for name, column in along.items()})
    return out


def motions(before: CandidateModel, after: CandidateModel, held_out: bool) -> list[Motion]:
    """Missing torque and voltage of both models along the measured motion.

    Args:
        before, after: the first and the final model.
        held_out: of the traces held out rather than those fitted.
    """
    first, last = (s.holdout[0] if held_out and s.holdout is not None else s.problem for s in (before, after))
    stiffness = guide_stiffness_of(last, after.x, after.settings.guide)
    lacked, left = signals(first, before.x, stiffness), signals(last, after.x, stiffness)
    volts, volts_left = missing_voltage(first, before.x, stiffness), missing_voltage(last, after.x, stiffness)
    out = []
    for k, trace in enumerate(last.batch.traces):
        end = left[k]
        effects = {
            effect.name: {"torque": end["effect_torque"][n], "voltage": end["effect_voltage"][n]}
            for n, effect in enumerate(e for e in last.layout.types if not is_of_the_rig(e))
            if effect in after.added
        }
        axes = {name: end[name] for name in ("time", "angle", "speed", "current", "load")}
        rest = {"torque": end["torque"], "voltage": volts_left[k]}
        file, test = trace.measurement.file, trace.measurement.test
        out.append(Motion(file, test, held_out, axes, lacked[k]["torque"], volts[k], rest, effects))
    return out


def missing_voltage(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[np.ndarray]:
    """(R_a + R_series) (i_measured - i) of each trace, V, shape (n,); NaN where no current was logged.

    Args: as of `signals`.
    """
    values: Mapping[str, Any] = problem.layout.values(x, problem.free_parameters.held)
    out = []
    for trace, model in zip(
        problem.batch.traces, columns(problem.batch, problem.simulated(x, guide_stiffness)), strict=True
    ):
        if "current" not in trace.channels:
            out.append(np.full(trace.instants.size, np.nan))
            continue
        m = trace.channels.index("current")
        ohm = float(values["R_a"]) + float(values.get(SERIES + trace.test.name, 0.0))
        out.append(ohm * (trace.data[:, m] - model[:, m]))
    return out
