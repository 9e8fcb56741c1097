"""What the model lacks along the measured motion.

The plate of the simulation is drawn along the measured angle by a guide at its terminals; what this guide needs is
what the model lacks,

    T_missing = N K_m / R_a pull (theta_measured - theta),        V_missing = (R_a + R_series) (i_measured - i)

so that friction that sticks, stops, memories and the electrical side need no second formula: it is the same stepper.
The second holds for what changes slower than L_a/R_a.

Source: synchronisation by a coupling (Abarbanel 2009); the guide as inverse dynamics with a finite bandwidth.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..problem.free_parameters import SERIES, Form, Pick
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import run
from .findings import Motion
from .trial import CandidateModel

_BANDWIDTH = 15.0  # Hz, w above; no more than a tenth of the sample rate
_STABLE = 0.3  # of the stiffness at which the current no longer follows the guide
_LEAST = 0.003  # of J w^2: where there is no dry friction to measure by
_GIVE = 0.01  # of the travel that was measured: how far the guide gives way to a torque as large as dry friction


def pull_of(problem: EstimationProblem, x: np.ndarray) -> float:
    """Stiffness of the guide: T_f over a hundredth of the travel; where there is hardly any, a share of J w^2.

    In V/rad, by the motor's torque per volt, or in N m/rad where torque drives.
    """
    values = problem.layout.values(x, problem.free_parameters.held)
    inertia = problem.config.gear_ratio**2 * float(values["J_m"]) + float(values["J_L"])
    guided = [t for t in problem.batch.traces if "position" in t.channels]
    if not guided:
        return 0.0
    angles = [t.data[:, t.channels.index("position")] for t in guided]
    span = max(float(np.nanmax(a) - np.nanmin(a)) for a in angles)
    rate = 1.0 / float(np.median(np.concatenate([np.diff(t.instants) for t in guided])))
    stiff = inertia * (2.0 * np.pi * min(_BANDWIDTH, 0.1 * rate)) ** 2
    torque = max(float(values["T_f"]) / max(_GIVE * span, 1e-9), _LEAST * stiff)
    if all(t.torque_driven for t in guided):
        return torque
    gear, R_a = problem.config.gear_ratio, float(values["R_a"])
    fastest = gear * float(values["K_b"]) * R_a / float(values["L_a"])  # V/rad: beyond it, guide and coil would swing
    return min(torque * R_a / (gear * float(values["K_m"])), _STABLE * fastest)


@partial(jax.jit, static_argnums=(0, 1))
def _along(form: Form, circuits: tuple[str, ...], x: Any, pick: Pick, arrays: Any) -> dict[str, Any]:
    """Signals along a guided run, (T, L) each, and what every effect contributes, (effects, T, L)."""
    throttle, (state, z), steps = run(form, circuits, x, pick, arrays)
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


def signals(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[dict[str, np.ndarray]]:
    """For each trace its signals at the instants, see `_along`; effects first where there is one row for each."""
    along = {k: np.asarray(v) for k, v in _along(*problem.at(x), problem.arrays(guide_stiffness)).items()}
    out = []
    for lane, _, marks in problem.batch.places:
        out.append({name: column[..., marks, lane] for name, column in along.items()})
    return out


def motions(before: CandidateModel, after: CandidateModel, held_out: bool) -> list[Motion]:
    """Missing torque and voltage of both models along the traces that were fitted, or along those held out."""
    first, last = (s.holdout[0] if held_out and s.holdout is not None else s.problem for s in (before, after))
    guide_stiffness = pull_of(last, after.x)
    lacked, left = signals(first, before.x, guide_stiffness), signals(last, after.x, guide_stiffness)
    volts, volts_left = (
        missing_voltage(first, before.x, guide_stiffness),
        missing_voltage(last, after.x, guide_stiffness),
    )
    out = []
    for k, trace in enumerate(last.batch.traces):
        end = left[k]
        effects = {
            effect.name: {"torque": end["effect_torque"][n], "voltage": end["effect_voltage"][n]}
            for n, effect in enumerate(last.layout.types)
            if effect in after.added
        }
        axes = {name: end[name] for name in ("time", "angle", "speed", "current", "load")}
        rest = {"torque": end["torque"], "voltage": volts_left[k]}
        file, test = trace.measurement.file, trace.measurement.test
        out.append(Motion(file, test, held_out, axes, lacked[k]["torque"], volts[k], rest, effects))
    return out


def missing_voltage(problem: EstimationProblem, x: np.ndarray, guide_stiffness: float) -> list[np.ndarray]:
    """(R_a + R_series) (i_measured - i) of each trace, V, shape (n,); NaN where no current was logged."""
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
