"""Eqs. 1-2 and the effects beyond them, stepped by compiled RK4 with every change of mode located in time.

Between changes of mode (slide up, slide down, stuck) the right-hand side is smooth. A step that ends outside its mode
is bisected to the instant at which the mode ends; there the speed is set to exactly zero and the torque balance decides
what comes next. So dry friction is set-valued and the end stops are inelastic and hard, without any smoothing.

Everything compiled lives in this one file: numba's cache looks only at the file of the function it compiles. The
compiled code takes the Plant as a NumPy record, so that a cached one never meets fields in another order.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from .effects import NONE, Effects

BISECTIONS = 60
EVENTS_PER_STEP = 100
# the cache remembers the module's name, and `python -m tests.independent...` gives it another one than pytest does
compiled = njit(cache=__name__ == "independent.kernel")


class Plant(NamedTuple):
    """What one rig test moves: parameters at the plate's shaft, SI.

    Args:
        R, L: circuit of this test, ohm and H; R includes what the test adds in series.
        closed_circuit: 1, or 0 where the terminals are open and no current flows.
        k: N K_b, V s/rad; k_t: N K_m, N m/A.
        J, B, K_s, T_PL, T_f: as in Eq. 2, lumped.
        N: gear ratio, for what turns with the motor.
        lower, upper: end stops, rad.
        effects: beyond Eqs. 1-2.
    """

    R: float
    L: float
    closed_circuit: float
    k: float
    k_t: float
    J: float
    B: float
    K_s: float
    T_PL: float
    T_f: float
    N: float
    lower: float
    upper: float
    effects: Effects = NONE


def record(values: tuple) -> np.record:
    """A NamedTuple of floats and of NamedTuples as a record with the same fields."""
    return np.array([_cells(values)], dtype=_fields(values)).view(np.recarray)[0]


def _fields(values: Any) -> np.dtype:
    fields = zip(values._fields, values, strict=True)
    return np.dtype([(name, _fields(v) if isinstance(v, tuple) else np.float64) for name, v in fields])


def _cells(values: tuple) -> tuple:
    return tuple(_cells(v) if isinstance(v, tuple) else v for v in values)


@compiled
def spring_torque(p, theta):
    """T_PL + K_s th, handed over to -(preload + stiffness (angle - th)) below the default position, N m."""
    main = p.T_PL + p.K_s * theta
    limp = p.effects.limp_home_spring
    above = (theta - limp.angle) / limp.corner
    if above > 20.0:
        return main
    share = 0.5 * (1.0 + math.tanh(above))
    return share * main - (1.0 - share) * (limp.preload + limp.stiffness * (limp.angle - theta))


@compiled
def cogging(p, theta):
    """A sin(n N th + phase), N m."""
    cog = p.effects.cogging_torque
    return cog.amplitude * math.sin(cog.per_turn * p.N * theta + cog.phase) if cog.amplitude != 0.0 else 0.0


@compiled
def driving_torque(p, i, w, theta):
    """Everything in Eq. 2 but dry friction and inertia, N m; positive opens."""
    return p.k_t * i - p.B * w - spring_torque(p, theta) - cogging(p, theta)


@compiled
def friction_limit(p, i, w, theta):
    """T_f + excess / (1 + (w/speed)^2) + share (|T_motor + T_spring| / 2), N m, never negative.

    The teeth carry the mean of what pulls at either side of them, as in Rhoban's BAM; inertia is left out of it.
    """
    stribeck, load = p.effects.stribeck_friction, p.effects.load_dependent_friction
    limit = p.T_f + stribeck.excess / (1.0 + (w / stribeck.speed) ** 2)
    if load.share != 0.0:
        limit += load.share * 0.5 * abs(p.k_t * i + spring_torque(p, theta))
    return limit


@compiled
def rates(p, v, mode, x):
    """d/dt of (i, w, th, warmth): A, rad/s, rad, K above the start; mode -1, 1 slide, 0 stuck."""
    i, w, theta, warmth = x
    heat = p.effects.winding_heating
    R = p.R * (1.0 + heat.coefficient * warmth)
    di = p.closed_circuit * (v - R * i - p.k * w) / p.L
    warming = (R * i * i - heat.conductance * warmth) / heat.capacity if heat.coefficient != 0.0 else 0.0
    if mode == 0:
        return di, 0.0, 0.0, warming
    dw = (driving_torque(p, i, w, theta) - mode * friction_limit(p, i, w, theta)) / p.J
    return di, dw, w, warming


@compiled
def _ahead(x, k, h):
    return x[0] + h * k[0], x[1] + h * k[1], x[2] + h * k[2], x[3] + h * k[3]


@compiled
def rk4(p, v, slope, mode, x, h):
    """One classical Runge-Kutta step of h seconds under the voltage v + slope t, within one mode."""
    half = 0.5 * h
    k1 = rates(p, v, mode, x)
    k2 = rates(p, v + slope * half, mode, _ahead(x, k1, half))
    k3 = rates(p, v + slope * half, mode, _ahead(x, k2, half))
    k4 = rates(p, v + slope * h, mode, _ahead(x, k3, h))
    x = _ahead(_ahead(x, k1, h / 6.0), k4, h / 6.0)
    return _ahead(_ahead(x, k2, h / 3.0), k3, h / 3.0)


@compiled
def mode_at_rest(p, x):
    """Which way the plate starts from rest: 1 opens, -1 closes, 0 stays; a stop takes any torque pressed on it."""
    i, _, theta, _ = x
    torque, limit = driving_torque(p, i, 0.0, theta), friction_limit(p, i, 0.0, theta)
    if torque > limit and theta < p.upper:
        return 1
    if torque < -limit and theta > p.lower:
        return -1
    return 0


@compiled
def has_ended(p, mode, x):
    """Whether this state lies outside its mode: torque beyond friction, speed reversed, or a stop passed."""
    if mode == 0:
        return mode_at_rest(p, x) != 0
    return mode * x[1] < 0.0 or x[2] > p.upper or x[2] < p.lower


@compiled
def end_of_mode(p, v, slope, mode, x, h):
    """The shortest step within (0, h] that leaves the mode, by bisection; s."""
    inside, outside = 0.0, h
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        if has_ended(p, mode, rk4(p, v, slope, mode, x, middle)):
            outside = middle
        else:
            inside = middle
    return outside


@compiled
def step(p, v, slope, mode, x, h):
    """h seconds, through however many changes of mode; returns the mode and the state at the end."""
    for _ in range(EVENTS_PER_STEP):
        end = rk4(p, v, slope, mode, x, h)
        if not has_ended(p, mode, end):
            return mode, end
        part = end_of_mode(p, v, slope, mode, x, h)
        i, _, theta, warmth = rk4(p, v, slope, mode, x, part)
        x = (i, 0.0, min(max(theta, p.lower), p.upper), warmth)
        mode, v, h = mode_at_rest(p, x), v + slope * part, h - part
    raise RuntimeError("the mode changes without end")


@compiled
def run(p, knots, volts, instants, held_until, x, h_max):
    """States at the given instants, from the first knot on.

    Args:
        p: record of a Plant.
        knots, volts: the voltage, linear between knots (s, V); two knots at one time are a jump.
        instants: s, rising, within the knots.
        held_until: s; before it the plate is held where it is.
        x: state at the first knot (A, rad/s, rad, K); at rest.
        h_max: longest step, s.
    Returns:
        shape (len(instants), 5): current, speed, angle, warmth and the true voltage.
    """
    out = np.empty((len(instants), 5))
    t, n, free, mode = knots[0], 0, False, 0
    for k in range(len(knots) - 1):
        span = knots[k + 1] - knots[k]
        slope = (volts[k + 1] - volts[k]) / span if span > 0.0 else 0.0
        while t < knots[k + 1]:
            if not free and t >= held_until:
                free, mode = True, mode_at_rest(p, x)
            stop = min(knots[k + 1], instants[n]) if n < len(instants) else knots[k + 1]
            if not free:
                stop = min(stop, held_until)
            parts = max(1, math.ceil((stop - t) / h_max))
            h = (stop - t) / parts
            for j in range(parts):
                v = volts[k] + slope * (t - knots[k] + j * h)
                if free:
                    mode, x = step(p, v, slope, mode, x, h)
                else:
                    x = rk4(p, v, slope, 0, x, h)
            t = stop
            while n < len(instants) and instants[n] <= t:
                out[n, 0], out[n, 1], out[n, 2], out[n, 3] = x
                out[n, 4] = volts[k] + slope * (t - knots[k])
                n += 1
    return out
