"""The error of a simulation at each sample: a linear Gaussian process along the model's path.

The logged input is noisy, its edges and the release of the plate occur at unlogged instants, and the initial state is
not known exactly. All of these act through the model's own dynamics. With the model linearised along its path

    dx_k = A_k dx_{k-1} + w_k,    w_k ~ N(0, Q_k),        y_k - y_hat_k = C_k dx_k + n_k,    n_k ~ N(0, R_k)

An impact is clipped at the end of a step: the uncertainty of its instant enters Q and R there, so that the few samples
around an impact do not dominate the fit.

Source: Anderson and Moore 1979, Optimal filtering, ch. 8 (linearisation along a path). Differs from source: the input's
error is a state of its own, and unlogged instants add to Q.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..model.delay import running_sum
from ..model.effects import AbstractEffect, State
from ..model.parameters import AnyArray, Scalar
from ..model.stepper import Reset, StatePath, Step, begun, step
from ..model.throttle import Throttle, followed
from .batch import BatchArrays, Disturbance, SampleSlots

_SHARES, _WEIGHTS = (0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5), (5 / 18, 8 / 18, 5 / 18)  # Gauss-Legendre on [0, 1]
ORDER = 4  # error states: current, angle, speed, and the input's error; before the last, memories of an ECU
_AROUND = 5  # samples on either side of an impact that get less weight


class ErrorProcess(NamedTuple):
    """The error of a simulation as a linear Gaussian process of n states: current (A), angle (rad), speed (rad/s),
    with an ECU in the model its memories and the error of the instant at which it last read its setpoint's jump (s),
    error of the input (V or N m). Formulas: head of this module.
    """

    transition: Float[AnyArray, "*batch n n"]  # A, shape (..., n, n); 0 at the first entry of a trace
    # Q, shape (..., n, n); at the first entry of a trace the covariance of its initial state
    noise: Float[AnyArray, "*batch n n"]
    sense: Float[AnyArray, "*batch M n"]  # C, shape (..., M, n)
    variance: Float[AnyArray, "*batch M"]  # R without jitter, square of the sample's unit, shape (..., M)
    timing: Float[AnyArray, "*batch M"]  # (dy/dt dt)^2, the contribution of a jitter of 1 to R, shape (..., M)

    def sample_variance(self, jitter: Scalar) -> Float[AnyArray, "*batch M"]:
        """R = variance + jitter^2 timing, shape (..., M), if instants scatter by `jitter` times the time between
        samples."""
        return self.variance + jitter**2 * self.timing


def order_of(effects: Sequence[type[AbstractEffect]]) -> int:
    """Number n of error states of a model with these effects."""
    memories = len(followed(effects))
    return ORDER + memories + (memories > 0)


class Events(NamedTuple):
    """Data of entries near an event in addition to their own step."""

    # speed lost in an impact within some samples, rad/s, shape (T, L), see `impacts_nearby`
    lost: Float[AnyArray, "*batch"]
    # covariance by a jump of the input somewhere within an interval, at the interval's last step, shape (T, L, 3, 3),
    # see `edge_covariance`
    edge: Float[AnyArray, "*batch 3 3"]


def error_process(throttle: Throttle, path: StatePath, batch: BatchArrays) -> ErrorProcess:
    """The error process of a model, linearised along a simulated path.

    Args:
        throttle: the model at the parameters to linearise about.
        path: its states and memories at the end of each step, shape (T, L) each.
        batch: the batch with the rig's effects and the guide's lever, see `residual.run`.
    """
    steps, resets, slots, disturbance, _ = batch
    before = before_steps(throttle, path, steps, resets)
    # entry by entry, here and below: such a loop compiles in a fraction of the time for whole arrays
    each = jax.vmap(partial(linearised_step, throttle))
    inner, push = jax.lax.map(lambda entry: each(*entry), (*before, steps, disturbance))
    lost = impacts_nearby(impact(before[0], path[0], steps), slots.weight)
    rows = jnp.arange(steps.dt.shape[0])[:, None] - jnp.maximum(disturbance.edge - 1.0, 0.0).astype(int)
    began = jax.tree.map(lambda column: jnp.take_along_axis(column, rows, axis=0), before)
    spread = jax.vmap(partial(edge_covariance, throttle))
    edge = jax.lax.map(lambda entry: spread(*entry), (*began, path[0], steps, disturbance))
    return process_of(throttle, before, path, batch, (inner, push), Events(lost, edge))


def process_of(
    throttle: Throttle,
    before: StatePath,
    after: StatePath,
    batch: BatchArrays,
    linear: tuple[Float[AnyArray, "*batch m m"], Float[AnyArray, "*batch m"]],
    events: Events,
) -> ErrorProcess:
    """The error process from its linearised steps; for a batch or one entry.

    Args:
        before, after: state and memories at the begin and the end of each step.
        batch: the batch with the rig's effects.
        linear: sensitivities of each step, see `linearised_step`.
        events: events near it.
    """
    steps, resets, slots, disturbance, test_of = batch
    transition, noise = _process(*linear, disturbance)
    order = noise.shape[-1]
    sense = slot_senses(throttle, steps, slots, test_of)
    blind = jnp.zeros((*sense.shape[:-1], order - ORDER))  # no sensor reads a memory
    sense = jnp.concatenate((sense, blind), axis=-1) if blind.size else sense
    noise += _events(throttle, before[0], after[0], steps, disturbance, events.lost, order)
    noise += _widened(events.edge, order)  # edges do not affect the input's error state, and no ECU reads them
    noise += _seen_covariance(disturbance, order)
    begins = resets.begins[..., None, None] > 0.5
    transition = jnp.where(begins, 0.0, transition)
    noise = jnp.where(begins, _start_covariance(disturbance, order), noise)
    timing = _timing_variance(before[0], after[0], steps, disturbance, sense)
    variance = slots.sigma**2 + _impact_variance(events.lost, disturbance, sense)
    return ErrorProcess(transition, noise, sense, variance, timing)


def free_run_variance(throttle: Throttle, path: StatePath, batch: BatchArrays, jitter: Scalar) -> Float[Array, "T L M"]:
    """Variance of measured - simulated in a free run, C P C^T + R, SI, shape (T, L, M):

        P_k = A_k P_{k-1} A_k^T + Q_k

    It grows along a trace, because no sample corrects it; the filter's covariance (`innovations.kalman`) does not.

    Args:
        throttle, path, batch: as in `error_process`.
        jitter: standard deviation of the sampling instants, as a share of the time between samples.
    """
    process = error_process(throttle, path, batch)

    def advance(covariance: Any, entry: Any) -> Any:
        return jax.vmap(spread_on)(covariance, *entry)

    start = jnp.zeros_like(process.noise[0])
    spread = jax.lax.scan(advance, start, (process.transition, process.noise, process.sense))[1]
    return spread + process.sample_variance(jitter)


def spread_on(
    covariance: Float[AnyArray, "n n"],
    transition: Float[AnyArray, "n n"],
    noise: Float[AnyArray, "n n"],
    sense: Float[AnyArray, "M n"],
) -> tuple[Float[AnyArray, "n n"], Float[AnyArray, " M"]]:
    """P after one step without correction by samples, and C P C^T of each slot."""
    covariance = transition @ covariance @ transition.T + noise
    return covariance, jnp.sum((sense @ covariance) * sense, axis=-1)


def before_steps(throttle: Throttle, path: StatePath, steps: Step, resets: Reset) -> StatePath:
    """State and memories at the begin of every step, shape (T, L) each, from those at its end."""
    x, z = jax.tree.map(lambda column: jnp.concatenate((jnp.zeros_like(column[:1]), column[:-1])), path)
    return begun(throttle, x, z, steps, resets)


def linearised_step(
    throttle: Throttle, x: State, z: tuple[Scalar, ...], s: Step, d: Disturbance
) -> tuple[Float[AnyArray, "m m"], Float[AnyArray, " m"]]:
    """Sensitivity of a step's end to its begin, shape (m, m) with m = n - 1, and to a shift of its input, shape (m,).

    Memories of effects are held constant along the path, because noise acts much less through them than on the state
    itself. Memories of an ECU are disturbed states. So is the instant of its setpoint's last jump, which moves its
    ticks and changes the lengths of the steps between ticks and samples.
    """
    memories = followed(throttle.effects)

    def end(vector: Any, shift: Any) -> Any:
        known = {k: vector[3 + n] for n, k in enumerate(memories)}
        later = tuple(known.get(k, each) for k, each in enumerate(z))
        pushed = s._replace(
            voltage0=s.voltage0 + s.circuit * shift,
            voltage1=s.voltage1 + s.circuit * shift,
            torque0=s.torque0 + (1.0 - s.circuit) * shift,
            torque1=s.torque1 + (1.0 - s.circuit) * shift,
        )
        if not memories:
            return jnp.stack(step(throttle, State(*vector[:3]), later, pushed)[0])
        late = vector[-1]
        x, after = step(throttle, State(*vector[:3]), later, pushed._replace(dt=s.dt + d.follows * late))
        return jnp.stack((*x, *(after[k] for k in memories), jnp.where(d.seen > 0.0, 0.0, late)))

    vector = (*x, *(z[k] for k in memories), *([jnp.zeros_like(x.i)] if memories else []))
    return jax.jacfwd(end, argnums=(0, 1))(jnp.stack(vector), 0.0)


def slot_senses(
    throttle: Throttle, steps: Step, slots: SampleSlots, test_of: Float[AnyArray, "*batch"]
) -> Float[Array, "*batch M 4"]:
    """C: derivatives of each slot's value, SI, in current, angle and speed; 0 in the input's error.

    Returns:
        Shape (..., M, 4).
    """
    lanes = slots.kind.shape
    speed = throttle.observe(State(0.0, 0.0, 1.0), throttle.z0, steps.inputs(1.0))
    shown = {"current": 1.0, "position": 1.0, "emf": speed["emf"], "motor_speed": speed["motor_speed"]}
    nothing = throttle.read(dict.fromkeys(shown, 0.0), test_of, steps.trace)
    gain = {
        name: jnp.broadcast_to(jnp.asarray(value - nothing[name])[..., None], lanes)
        for name, value in throttle.read(dict(shown), test_of, steps.trace).items()
    }
    zero = jnp.zeros(lanes)
    columns = [
        jnp.where(slots.kind == 0, gain["current"], 0.0),
        jnp.where(slots.kind == 1, gain["position"], 0.0),
        jnp.where(slots.kind == 2, gain["emf"], jnp.where(slots.kind == 3, gain["motor_speed"], 0.0)),
    ]
    return jnp.stack([*columns, zero], axis=-1)


def impact(before: State, after: State, steps: Step) -> Float[AnyArray, "*batch"]:
    """Speed lost in an impact on a stop within each step, rad/s; 0 elsewhere."""
    stopped = (after.omega == 0.0) & (before.omega != 0.0)
    on_stop = (after.theta <= steps.lower) | (after.theta >= steps.upper)
    turned = after.omega * before.omega < 0.0
    way = after.omega * steps.dt  # the most that a plate moves after a rebound within the step
    rebounded = turned & ((after.theta - steps.lower <= way) | (after.theta - steps.upper >= way))
    # a motor that rattles in the play of its gear, beyond the stop of the plate
    rattled = turned & (jnp.minimum(after.theta, before.theta) < steps.lower)
    has_stops = (steps.mobile > 0.5) & (steps.plate > 0.5)  # a motor without its plate has no stops
    return jnp.where(((stopped & on_stop) | rebounded | rattled) & has_stops, jnp.abs(before.omega - after.omega), 0.0)


def impacts_nearby(lost: Float[AnyArray, "T L"], weight: Float[AnyArray, "T L M"]) -> Float[Array, "T L"]:
    """Speed lost in an impact within some samples of each step, rad/s, shape (T, L); 0 elsewhere.

    While the parameters move, the simulated impact moves by some samples. Samples around it get less weight too,
    otherwise a sample of full weight could meet the jump.

    Args:
        lost: speed lost in each step, see `impact`.
        weight: weights of the samples, 0 without a sample.
    """
    here = running_sum(jnp.any(weight > 0.0, axis=-1).astype(float))  # samples so far

    def follow(last: Any, row: Any) -> Any:
        """The last impact, and the speed lost in it if it is near this row."""
        lost, here = row
        last = tuple(jnp.where(lost > 0.0, new, old) for new, old in zip(row, last, strict=True))
        return last, jnp.where(jnp.abs(last[1] - here) <= _AROUND, last[0], 0.0)

    never = jnp.zeros_like(lost[0]), jnp.full_like(lost[0], -jnp.inf)
    earlier, later = (jax.lax.scan(follow, never, (lost, here), reverse=back)[1] for back in (False, True))
    return jnp.maximum(earlier, later)


def impacts_nearby_here(lost: Float[np.ndarray, "T L"], weight: Float[np.ndarray, "T L M"]) -> Float[np.ndarray, "T L"]:
    """`impacts_nearby` without compiled programs: lane by lane, because few have impacts."""
    here = np.cumsum(np.any(weight > 0.0, axis=-1), axis=0)
    out = np.zeros(lost.shape)
    for lane in np.flatnonzero(lost.any(axis=0)):
        (met,) = np.nonzero(lost[:, lane])
        rows, samples = np.arange(lost.shape[0]), here[:, lane]
        for at in (np.searchsorted(met, rows, side="right") - 1, np.searchsorted(met, rows)):
            last = met[np.clip(at, 0, met.size - 1)]
            near = (at >= 0) & (at < met.size) & (np.abs(samples[last] - samples) <= _AROUND)
            out[:, lane] = np.maximum(out[:, lane], np.where(near, lost[last, lane], 0.0))
    return out


def _outer(vector: Float[AnyArray, "*batch n"]) -> Float[AnyArray, "*batch n n"]:
    return vector[..., :, None] * vector[..., None, :]


def _process(
    inner: Float[AnyArray, "*batch m m"], push: Float[AnyArray, "*batch m"], disturbance: Disturbance
) -> tuple[Float[AnyArray, "*batch n n"], Float[AnyArray, "*batch n n"]]:
    """A and Q with the input's error e as the last state: e_k = keep e_{k-1} + w, and e_k acts through `push`."""
    carried = (push * disturbance.keep[..., None])[..., None]
    below = jnp.concatenate((jnp.zeros_like(push), disturbance.keep[..., None]), axis=-1)[..., None, :]
    transition = jnp.concatenate((jnp.concatenate((inner, carried), axis=-1), below), axis=-2)
    enters = jnp.concatenate((push, jnp.ones_like(push[..., :1])), axis=-1)
    return transition, disturbance.fresh[..., None, None] * _outer(enters)


def _diagonal(entries: Sequence[Float[AnyArray, "*batch"]]) -> Float[AnyArray, "*batch n n"]:
    row = jnp.stack(list(entries), axis=-1)[..., None, :]
    return row * np.eye(len(entries)).reshape((1,) * (row.ndim - 2) + (len(entries),) * 2)


def _widened(matrix: Float[AnyArray, "*batch m m"], order: int) -> Float[AnyArray, "*batch n n"]:
    """A matrix padded with zeros, shape (..., n, n)."""
    rest = order - matrix.shape[-1]
    right = jnp.concatenate((matrix, jnp.zeros((*matrix.shape[:-1], rest))), axis=-1)
    return jnp.concatenate((right, jnp.zeros((*matrix.shape[:-2], rest, order))), axis=-2)


def _events(
    throttle: Throttle,
    early: State,
    late: State,
    steps: Step,
    disturbance: Disturbance,
    lost: Float[AnyArray, "*batch"],
    order: int,
) -> Float[AnyArray, "*batch n n"]:
    """Q of a release and of an impact with uncertain instants, shape (..., n, n)."""
    acceleration = jnp.where(steps.dt > 0.0, (late.omega - early.omega) / jnp.where(steps.dt > 0.0, steps.dt, 1.0), 0.0)
    release = disturbance.release * acceleration**2
    inputs, z0 = steps.inputs(1.0), throttle.z0
    emf = throttle.observe(State(0.0, 0.0, 1.0), z0, inputs)["emf"] * lost
    still, flowing = (throttle(State(i, 0.0, 0.0), z0, inputs) for i in (0.0, 1.0))
    resistance = jnp.maximum(still.voltage - flowing.voltage, 1e-12)
    rise = jnp.minimum(steps.dt / still.inductance, 1.0 / resistance)
    impact = steps.circuit * (emf * rise) ** 2
    zero = jnp.zeros_like(release)
    return _diagonal((impact, zero, release, *[zero] * (order - 3)))


def edge_covariance(
    throttle: Throttle, x: State, z: tuple[Scalar, ...], end: State, s: Step, d: Disturbance
) -> Float[AnyArray, "3 3"]:
    """Q of a jump of the input somewhere within an interval, shape (3, 3), at the interval's last step; 0 at others:

        E[(x(s) - x) (x(s) - x)^T],    s uniform in [0, 1], by three-point Gauss-Legendre quadrature

    where x is the path with an input that rises linearly, its mean over s, and x(s) is the path with a jump at the
    share s of the interval.

    Args:
        x, z: state and memories at the interval's begin.
        end: the path's state at its end.
        s: its last step.
        d: the disturbance there.
    """

    def hold(reached: StatePath, each: Any) -> Any:
        level, span = each
        electric = s.circuit * level
        held = s._replace(dt=span, voltage0=electric, voltage1=electric, torque0=level - electric)
        return step(throttle, *reached, held._replace(torque1=held.torque0)), None

    def missed(share: Any) -> Any:
        """The error after four steps, each with its own level and length."""
        level = jnp.stack((d.edge_from, d.edge_from, d.edge_to, d.edge_to))
        span = 0.5 * d.edge_span * jnp.stack((share, share, 1.0 - share, 1.0 - share))
        return jnp.stack(jax.lax.scan(hold, (x, z), (level, span))[0][0]) - jnp.stack(end)

    # mapped over the shares, not looped over them: one copy of the model is compiled, not three
    ways = jax.vmap(missed)(jnp.array(_SHARES))
    return jnp.where(d.edge > 0.0, (ways * np.array(_WEIGHTS)[:, None]).T @ ways, 0.0)


def _seen_covariance(disturbance: Disturbance, order: int) -> Float[AnyArray, "*batch n n"]:
    """Q of the instant at which an ECU in the model read a jump of its setpoint, shape (..., n, n)."""
    zero = jnp.zeros_like(disturbance.seen)
    each = [zero] * order
    each[-2] = disturbance.seen if order > ORDER else zero
    return _diagonal(each)


def _impact_variance(
    lost: Float[AnyArray, "*batch"], disturbance: Disturbance, sense: Float[AnyArray, "*batch M n"]
) -> Float[AnyArray, "*batch M"]:
    """Extra variance of the samples at an impact, shape (..., M): a speed jumps, an angle bends."""
    bend = _AROUND * (lost * disturbance.spacing)[..., None]
    return (sense[..., 2] * lost[..., None]) ** 2 + (sense[..., 1] * bend) ** 2


def _timing_variance(
    before: State, after: State, steps: Step, disturbance: Disturbance, sense: Float[AnyArray, "*batch M n"]
) -> Float[AnyArray, "*batch M"]:
    """(dy/dt times the time between samples)^2, shape (..., M): the effect of a clock's jitter on each sample."""
    span = jnp.where(steps.dt > 0.0, steps.dt, 1.0)
    rate = jnp.stack([(late - early) / span for early, late in zip(before, after, strict=True)], axis=-1)
    seen = jnp.sum(sense[..., :3] * rate[..., None, :], axis=-1)
    return (seen * disturbance.spacing[..., None]) ** 2


def _start_covariance(disturbance: Disturbance, order: int) -> Float[AnyArray, "*batch n n"]:
    """P at the first instant, shape (..., n, n)."""
    zero = jnp.zeros_like(disturbance.start_i)
    known = (disturbance.start_i, disturbance.start_theta, disturbance.start_omega)
    return _diagonal((*known, *[zero] * (order - 3)))
