"""The frozen whitening filter: turns measured - simulated into independent standard normal residuals.

The logged input is noisy, edges and the release of the plate come at instants nobody logged, and the initial state is
not known exactly. All of these act through the model's own dynamics, so the simulation's error is correlated. With the
model linearised along its path they form a linear Gaussian state space

    dx_k = A_k dx_{k-1} + w_k,    w_k ~ N(0, Q_k),        y_k - y_hat_k = C_k dx_k + n_k,    n_k ~ N(0, sigma^2)

whose Kalman filter gives the innovations nu_k and their variances S_k; r_k = nu_k / sqrt(S_k) are independent standard
normal where the model is right (Kailath 1968). Weights and gains are frozen while the parameters move (so the residual
stays a plain function of the simulation, and no log-determinant is needed) and renewed between rounds of the fit: the
generalised least squares estimate, in which a noisy input costs width of the intervals and not bias.

An impact is clipped at the end of a step: what its instant is uncertain by enters Q and sigma there, so that the few
samples around an impact do not steer the fit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from ..model.effects import State
from ..model.stepper import Reset, Step, step
from ..model.throttle import Throttle, followed
from .batch import Disturbance, SampleSlots

_SHARES, _WEIGHTS = (0.5 - 0.15**0.5, 0.5, 0.5 + 0.15**0.5), (5 / 18, 8 / 18, 5 / 18)  # Gauss-Legendre on [0, 1]
ORDER = 4  # error states: current, angle, speed, and the input's error; before it memories that are followed
_AROUND = 5  # samples either side of an impact that are discounted


class InnovationsFilter(NamedTuple):
    """A linear filter along the batch over n error states (current, angle, speed, followed memories, input error).

    Args:
        transition: A, shape (T, L, n, n); 0 at the first entry of a trace.
        sense: C, shape (T, L, M, n).
        gain: Kalman gains, shape (T, L, M, n).
        weight: 1 / sqrt(S), shape (T, L, M); 0 where there is no sample.
    """

    transition: Any
    sense: Any
    gain: Any
    weight: Any


def plain(slots: SampleSlots, order: int = ORDER) -> InnovationsFilter:
    """Whitening by each sample's own noise alone; for starts still far from the truth.

    Args:
        slots: samples, shape (T, L, M).
        order: error states that the filter of the same model has, for one compiled program to serve both.
    """
    steps, lanes, count = slots.value.shape
    empty = jnp.zeros((steps, lanes, count, order))
    return InnovationsFilter(jnp.zeros((steps, lanes, order, order)), empty, empty, slots.weight / slots.sigma)


def whiten(filter_: InnovationsFilter, error: Any, begins: Any) -> Any:
    """Innovations over their standard deviations.

    Args:
        filter_: the whitening.
        error: measured - simulated, 0 where there is no sample, shape (T, L, M).
        begins: 1 at the first entry of a trace, shape (T, L).
    Returns:
        shape (T, L, M), dimensionless.
    """
    start = tuple(jnp.zeros(error.shape[1]) for _ in range(filter_.transition.shape[-1]))
    return jax.lax.scan(lambda state, entry: innovate(state, *entry), start, (filter_, error))[1]


def innovate(state: tuple[Any, ...], filter_: InnovationsFilter, error: Any) -> tuple[tuple[Any, ...], Any]:
    """One entry of the batch through the filter.

    Args:
        state: the n error states before it, any shape, (L,) say.
        filter_: the whitening of that entry; leading axes as those of the state.
        error: measured - simulated, shape (..., M).
    Returns:
        the error states after it; innovations over their standard deviations, shape (..., M).
    """
    transition, sense, gain, weight = filter_
    order = range(len(state))
    state = tuple(sum(transition[..., p, q] * state[q] for q in order) for p in order)
    out = []
    for m in range(error.shape[-1]):
        here = weight[..., m]
        nu = jnp.where(here > 0.0, error[..., m] - sum(sense[..., m, q] * state[q] for q in order), 0.0)
        state = tuple(state[q] + gain[..., m, q] * nu for q in order)
        out.append(nu * here)
    return state, jnp.stack(out, axis=-1)


def kalman(
    throttle: Throttle,
    path: tuple[State, tuple[Any, ...]],
    steps: Step,
    resets: Reset,
    slots: SampleSlots,
    disturbance: Disturbance,
    jitter: Any,
) -> tuple[InnovationsFilter, Any]:
    """The whitening filter along a simulated path.

    Args:
        throttle: the model at the parameters to linearise about.
        path: its states and memories at the end of each step, shape (T, L) each.
        steps, resets, slots, disturbance: the batch.
        jitter: standard deviation of the sampling instants, as a share of the time between samples.
    Returns:
        the filter, and the variance that a jitter of 1 would add to each sample, over S, shape (T, L, M).
    """
    transition, noise, sense, quiet, timing = _state_space(throttle, path, steps, resets, slots, disturbance)
    variance = quiet + jitter**2 * timing
    gain, weight = _covariance(transition, noise, sense, variance, slots.weight)
    return InnovationsFilter(transition, sense, gain, weight), timing * weight**2


def free_run_variance(
    throttle: Throttle,
    path: tuple[State, tuple[Any, ...]],
    steps: Step,
    resets: Reset,
    slots: SampleSlots,
    disturbance: Disturbance,
    jitter: Any,
) -> Any:
    """Variance of measured - simulated where the simulation runs free, C P C^T + sigma^2, SI, shape (T, L, M).

    P is what noise of the input and instants not known exactly have added up to: the filter's covariance were no sample
    ever looked at.

    Args:
        throttle, path, steps, resets, slots, disturbance, jitter: as in `kalman`.
    """
    transition, noise, sense, quiet, timing = _state_space(throttle, path, steps, resets, slots, disturbance)

    def advance(covariance: Any, entry: Any) -> Any:
        a, q, c = entry
        covariance = jnp.einsum("lpq,lqs,lts->lpt", a, covariance, a) + q
        return covariance, jnp.einsum("lmp,lpq,lmq->lm", c, covariance, c)

    start = jnp.zeros_like(noise[0])
    return jax.lax.scan(advance, start, (transition, noise, sense))[1] + quiet + jitter**2 * timing


def _state_space(
    throttle: Throttle, path: Any, steps: Step, resets: Reset, slots: SampleSlots, disturbance: Disturbance
) -> tuple[Any, Any, Any, Any, Any]:
    """A, Q, C, each sample's own variance, and what a jitter of 1 would add to it."""
    before = before_steps(throttle, path, resets)
    inner, push = _linearise(throttle, before, steps)
    sense = slot_senses(throttle, path, steps, slots)
    transition, noise = _process(inner, push, disturbance)
    blind = jnp.zeros((*sense.shape[:-1], noise.shape[-1] - ORDER))  # nobody sees a memory
    sense = jnp.concatenate((sense, blind), axis=-1) if blind.size else sense
    lost = impact_nearby(before[0], path[0], steps, slots)
    noise += _events(throttle, before, path, steps, disturbance, lost, noise.shape[-1])
    noise += _edge_covariance(throttle, before, path, steps, disturbance, noise.shape[-1])
    begins = resets.begins[..., None, None] > 0.5
    transition = jnp.where(begins, 0.0, transition)
    noise = jnp.where(begins, _start_covariance(disturbance, noise.shape[-1]), noise)
    timing = _timing_variance(before[0], path[0], steps, disturbance, sense)
    return transition, noise, sense, slots.sigma**2 + _impact_variance(lost, disturbance, sense), timing


def before_steps(throttle: Throttle, path: Any, resets: Reset) -> tuple[State, tuple[Any, ...]]:
    """State at the begin of every step."""

    def shift(column: Any, first: Any) -> Any:
        late = jnp.concatenate((jnp.zeros_like(column[:1]), column[:-1]))
        return jnp.where(resets.begins > 0.5, first, late)

    x, z = path
    state = State(shift(x.i, resets.i), shift(x.theta, resets.theta), shift(x.omega, resets.omega))
    return state, tuple(shift(c, first) for c, first in zip(z, throttle.z0, strict=True))


def _linearise(throttle: Throttle, before: Any, steps: Step) -> tuple[Any, Any]:
    """Sensitivity of each step's end to its begin, (T, L, n - 1, n - 1), and to a shift of its input, (T, L, n - 1).

    Memories of effects are taken as they are along the path, since what noise does through them is small beside what
    it does to the state itself; those of an ECU are not, and belong to what is disturbed.
    """
    memories = followed(throttle.effects)

    def end(vector: Any, z: Any, shift: Any, s: Step) -> Any:
        known = {k: vector[3 + n] for n, k in enumerate(memories)}
        z = tuple(known.get(k, each) for k, each in enumerate(z))
        pushed = s._replace(
            voltage0=s.voltage0 + s.circuit * shift,
            voltage1=s.voltage1 + s.circuit * shift,
            torque0=s.torque0 + (1.0 - s.circuit) * shift,
            torque1=s.torque1 + (1.0 - s.circuit) * shift,
        )
        x, z = step(throttle, State(*vector[:3]), z, pushed)
        return jnp.stack((*x, *(z[k] for k in memories)))

    x, z = before
    x = (*x, *(z[k] for k in memories))
    both = jax.vmap(jax.vmap(jax.jacfwd(end, argnums=(0, 2)), in_axes=(0, 0, None, 0)), in_axes=(0, 0, None, 0))
    return both(jnp.stack(x, axis=-1), z, 0.0, steps)


def slot_senses(throttle: Throttle, path: Any, steps: Step, slots: SampleSlots) -> Any:
    """C, shape (T, L, M, n): the slots' sensitivity to current, angle and speed."""
    lanes = slots.kind.shape
    speed = throttle.observe(State(0.0, 0.0, 1.0), throttle.z0, steps.inputs(1.0))
    zero = jnp.zeros(lanes)
    emf = jnp.broadcast_to(jnp.asarray(speed["emf"])[..., None], lanes)
    motor = jnp.broadcast_to(jnp.asarray(speed["motor_speed"])[..., None], lanes)
    columns = [
        jnp.where(slots.kind == 0, 1.0, 0.0),
        jnp.where(slots.kind == 1, 1.0, 0.0),
        jnp.where(slots.kind == 2, emf, jnp.where(slots.kind == 3, motor, 0.0)),
    ]
    return jnp.stack([*columns, zero], axis=-1)


def impact_nearby(before: State, after: State, steps: Step, slots: SampleSlots) -> Any:
    """Speed lost in an impact within some samples of each step, rad/s; 0 elsewhere.

    While the parameters move, the simulated impact moves by some samples; were only the step of the impact discounted,
    a frozen weight would meet a jump in full.
    """
    stopped = (after.omega == 0.0) & (before.omega != 0.0) & (steps.mobile > 0.5) & (steps.plate > 0.5)
    on_stop = (after.theta <= steps.lower) | (after.theta >= steps.upper)
    lost = jnp.where(stopped & on_stop, jnp.abs(before.omega), 0.0)
    here = jnp.cumsum(jnp.any(slots.weight > 0.0, axis=-1), axis=0)  # samples so far
    last = lost.shape[0] - 1
    rows = jnp.broadcast_to(jnp.arange(last + 1)[:, None], lost.shape)
    earlier = jax.lax.cummax(jnp.where(lost > 0.0, rows, 0))
    later = jax.lax.cummin(jnp.where(lost > 0.0, rows, last), reverse=True)
    found = []
    for row in (earlier, later):
        near = jnp.abs(jnp.take_along_axis(here, row, axis=0) - here) <= _AROUND
        found.append(jnp.where(near, jnp.take_along_axis(lost, row, axis=0), 0.0))
    return jnp.maximum(*found)


def _outer(vector: Any) -> Any:
    return vector[..., :, None] * vector[..., None, :]


def _process(inner: Any, push: Any, disturbance: Disturbance) -> tuple[Any, Any]:
    """A and Q with the input's error e as the last state: e_k = keep e_{k-1} + w, and e_k acts through `push`."""
    carried = (push * disturbance.keep[..., None])[..., None]
    below = jnp.concatenate((jnp.zeros_like(push), disturbance.keep[..., None]), axis=-1)[..., None, :]
    transition = jnp.concatenate((jnp.concatenate((inner, carried), axis=-1), below), axis=-2)
    enters = jnp.concatenate((push, jnp.ones_like(push[..., :1])), axis=-1)
    return transition, disturbance.fresh[..., None, None] * _outer(enters)


def _events(
    throttle: Throttle, before: Any, path: Any, steps: Step, disturbance: Disturbance, lost: Any, order: int
) -> Any:
    """Q of a release and of an impact whose instants are not known exactly, shape (T, L, n, n)."""
    (early, _), (late, _) = before, path
    acceleration = jnp.where(steps.dt > 0.0, (late.omega - early.omega) / jnp.where(steps.dt > 0.0, steps.dt, 1.0), 0.0)
    release = disturbance.release * acceleration**2
    inputs, z0 = steps.inputs(1.0), throttle.z0
    emf = throttle.observe(State(0.0, 0.0, 1.0), z0, inputs)["emf"] * lost
    still, flowing = (throttle(State(i, 0.0, 0.0), z0, inputs) for i in (0.0, 1.0))
    resistance = jnp.maximum(still.voltage - flowing.voltage, 1e-12)
    rise = jnp.minimum(steps.dt / still.inductance, 1.0 / resistance)
    impact = steps.circuit * (emf * rise) ** 2
    zero = jnp.zeros_like(release)
    return jax.vmap(jax.vmap(jnp.diag))(jnp.stack((impact, zero, release, *[zero] * (order - 3)), axis=-1))


def _edge_covariance(
    throttle: Throttle, before: Any, path: Any, steps: Step, disturbance: Disturbance, order: int
) -> Any:
    """Q of a jump of the input somewhere within an interval, shape (T, L, n, n), at the interval's last step:

        E[(x(s) - x) (x(s) - x)^T],    s uniform in [0, 1], by three-point Gauss-Legendre quadrature

    where x is the path, for which the input rises linearly, which is its mean over s, and x(s) is reached when it jumps
    at the share s of the interval.
    """
    rows = jnp.arange(steps.dt.shape[0])[:, None] - jnp.maximum(disturbance.edge - 1.0, 0.0).astype(int)
    x_began, z_began = jax.tree.map(lambda column: jnp.take_along_axis(column, rows, axis=0), before)

    def hold(x: State, z: tuple[Any, ...], s: Step, level: Any, span: Any) -> tuple[State, tuple[Any, ...]]:
        electric = s.circuit * level
        half = s._replace(dt=0.5 * span, voltage0=electric, voltage1=electric, torque0=level - electric)
        half = half._replace(torque1=half.torque0)
        return step(throttle, *step(throttle, x, z, half), half)

    def missed(share: Any, x: State, z: tuple[Any, ...], s: Step, d: Disturbance, end: Any) -> Any:
        x, z = hold(x, z, s, d.edge_from, share * d.edge_span)
        x, z = hold(x, z, s, d.edge_to, (1.0 - share) * d.edge_span)
        return jnp.stack(x) - jnp.stack(end)

    # mapped over the shares rather than looped over them: one copy of the model to compile, not three
    entry = jax.vmap(missed, in_axes=(0, None, None, None, None, None))
    each = jax.vmap(jax.vmap(entry, in_axes=(None, 0, 0, 0, 0, 0)), in_axes=(None, 0, 0, 0, 0, 0))
    vector = each(jnp.array(_SHARES), x_began, z_began, steps, disturbance, path[0])
    vector = jnp.where(disturbance.edge[..., None, None] > 0.0, vector, 0.0)
    moment = jnp.einsum("k,tlkp,tlkq->tlpq", jnp.array(_WEIGHTS), vector, vector)
    rest = order - 3  # the input's own error knows nothing of its edges, and no ECU sees them
    return jnp.pad(moment, ((0, 0), (0, 0), (0, rest), (0, rest)))


def _impact_variance(lost: Any, disturbance: Disturbance, sense: Any) -> Any:
    """Extra variance of the samples at an impact, shape (T, L, M): a speed jumps, an angle bends."""
    bend = _AROUND * (lost * disturbance.spacing)[..., None]
    return (sense[..., 2] * lost[..., None]) ** 2 + (sense[..., 1] * bend) ** 2


def _timing_variance(before: State, after: State, steps: Step, disturbance: Disturbance, sense: Any) -> Any:
    """(dy/dt times the time between samples)^2, shape (T, L, M): what a clock that jitters does to each sample."""
    span = jnp.where(steps.dt > 0.0, steps.dt, 1.0)
    rate = jnp.stack([(late - early) / span for early, late in zip(before, after, strict=True)])
    seen = jnp.einsum("tlmn,ntl->tlm", sense[..., :3], rate)
    return (seen * disturbance.spacing[..., None]) ** 2


def _start_covariance(disturbance: Disturbance, order: int) -> Any:
    """P at the first instant, shape (T, L, n, n)."""
    zero = jnp.zeros_like(disturbance.start_i)
    known = (disturbance.start_i, disturbance.start_theta, disturbance.start_omega)
    return jax.vmap(jax.vmap(jnp.diag))(jnp.stack((*known, *[zero] * (order - 3)), axis=-1))


def _covariance(transition: Any, noise: Any, sense: Any, variance: Any, present: Any) -> tuple[Any, Any]:
    """Run the Riccati recursion, one slot after the other: gains (T, L, M, n) and 1 / sqrt(S) (T, L, M)."""
    lanes, count, order = sense.shape[1:]

    def advance(covariance: Any, entry: Any) -> Any:
        a, q, c, r, there = entry
        covariance = jnp.einsum("lpq,lqs,lts->lpt", a, covariance, a) + q
        gains, weights = [], []
        for m in range(count):
            row = jnp.einsum("lpq,lq->lp", covariance, c[:, m])
            spread = jnp.einsum("lp,lp->l", row, c[:, m]) + r[:, m]
            gain = jnp.where(there[:, m, None] > 0.0, row / spread[:, None], 0.0)
            covariance = covariance - gain[:, :, None] * row[:, None, :]
            covariance = 0.5 * (covariance + jnp.swapaxes(covariance, 1, 2))
            gains.append(gain)
            weights.append(jnp.where(there[:, m] > 0.0, 1.0 / jnp.sqrt(spread), 0.0))
        return covariance, (jnp.stack(gains, axis=1), jnp.stack(weights, axis=1))

    start = jnp.zeros((lanes, order, order))
    return jax.lax.scan(advance, start, (transition, noise, sense, variance, present))[1]
