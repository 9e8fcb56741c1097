"""Eqs. 1-2 and the effects beyond them, stepped by compiled RK4 with every change of mode located in time.

Between changes of mode (slide up, slide down, stuck) the right-hand side is smooth. A step that ends outside its mode
is bisected to the instant at which the mode ends; there the speed is set to exactly zero and the torque balance decides
what comes next. So dry friction is set-valued and the end stops are inelastic and hard, without any smoothing, unless
an effect says otherwise: bristles take the place of set-valued friction, a stop may give speed back.

With backlash the motor is a body of its own, tied to the plate by its teeth alone; else it turns with the plate.

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
BRISTLES = 2  # the mode of a plate on bristles; -1 and 1 slide, 0 is stuck
AT_REST = 0.02  # rad/s; a rebound slower than this has come to rest
# the cache remembers the module's name, and `python -m independent...` gives it another one than pytest does
compiled = njit(cache=__name__ == "independent.kernel")


class Plant(NamedTuple):
    """What one rig test moves: parameters at the plate's shaft, SI."""

    # R, L: circuit of this test, ohm and H; R includes what the test adds in series
    R: float
    L: float
    closed_circuit: float  # 1, or 0 where the terminals are open and no current flows
    k: float  # N K_b, V s/rad; k_t: N K_m, N m/A
    k_t: float
    # J, B, K_s, T_PL, T_f: as in Eq. 2, lumped.
    J: float
    B: float
    K_s: float
    T_PL: float
    T_f: float
    N: float  # gear ratio, for what turns with the motor
    # lower, upper: end stops, rad
    lower: float
    upper: float
    effects: Effects = NONE  # beyond Eqs. 1-2.
    # J_m, B_m: the motor's part of J and B, for a motor that is a body of its own
    J_m: float = 0.0
    B_m: float = 0.0


class State(NamedTuple):
    """What changes in time, or its rate."""

    # i, w, theta: current A, plate speed rad/s, plate angle rad
    i: float
    w: float
    theta: float
    # warmth, housing: of winding and housing, K above the start
    warmth: float
    housing: float
    # w_m, theta_m: of a motor that is a body of its own, at the plate's shaft
    w_m: float
    theta_m: float
    bristle: float  # deflection, rad
    # filtered, sensed: angle behind the sensor's first and second filter, rad
    filtered: float
    sensed: float
    age: float  # s since the trace began


def at_rest(plant: Plant, theta: float) -> State:
    """No current, no speed, cold, teeth just touching on the flank that opens the plate."""
    flank = theta + 0.5 * plant.effects.backlash.gap
    return State(0.0, 0.0, theta, 0.0, 0.0, 0.0, flank, 0.0, theta, theta, 0.0)


def record(values: tuple) -> np.record:
    """A NamedTuple of floats and of NamedTuples as a record with the same fields."""
    return np.array([_cells(values)], dtype=_fields(values)).view(np.recarray)[0]


def _fields(values: Any) -> np.dtype:
    fields = zip(values._fields, values, strict=True)
    return np.dtype([(name, _fields(v) if isinstance(v, tuple) else np.float64) for name, v in fields])


def _cells(values: tuple) -> tuple:
    return tuple(_cells(v) if isinstance(v, tuple) else v for v in values)


# ---- torques on the plate


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
def airflow(p, theta):
    """peak sin(pi s^skew), s the share of a quarter turn, N m; closes."""
    air = p.effects.airflow_torque
    return air.peak * math.sin(math.pi * max(2.0 * theta / math.pi, 0.0) ** air.skew) if air.peak != 0.0 else 0.0


@compiled
def restoring_torque(p, theta):
    """All that depends on the plate's angle alone, N m; positive closes."""
    gravity, stiffening = p.effects.gravity_load, p.effects.stiffening_spring
    torque = spring_torque(p, theta)
    if gravity.torque != 0.0:
        torque += gravity.torque * math.sin(theta - gravity.tilt)
    if stiffening.torque != 0.0:
        torque += stiffening.torque * (2.0 * theta / math.pi) ** 3
    return torque + airflow(p, theta)


@compiled
def drag(p, w):
    """Viscous friction told apart by direction, b w / (1 + |w|/knee), and D |w|^power; N m, against w."""
    uneven, steep = p.effects.asymmetric_friction, p.effects.quadratic_drag
    viscous = (uneven.opening_viscous if w > 0.0 else uneven.closing_viscous) * w / (1.0 + abs(w) / uneven.knee)
    if steep.drag == 0.0:
        return viscous
    return viscous + math.copysign(steep.drag * abs(w) ** steep.power, w)


# ---- torques on the motor, at the plate's shaft


@compiled
def motor_torque(p, i):
    """k_t i, or limit tanh(k_t i / limit), N m."""
    limit = p.effects.torque_saturation.limit
    return limit * math.tanh(p.k_t * i / limit) if limit != 0.0 else p.k_t * i


@compiled
def rippled(p, x, theta):
    """Motor torque times 1 + share sin(n a), a = N th the motor's angle, N m."""
    ripple = p.effects.torque_ripple
    torque = motor_torque(p, x.i)
    return torque * (1.0 + ripple.share * math.sin(ripple.per_turn * p.N * theta)) if ripple.share != 0.0 else torque


@compiled
def cogging(p, theta):
    """A (1 + uneven sin a) (sin(n a + phase) + second sin(2 n a + phase)), a = N th the motor's angle; N m."""
    cog = p.effects.cogging_torque
    if cog.amplitude == 0.0:
        return 0.0
    wave = math.sin(cog.per_turn * p.N * theta + cog.phase)
    if cog.second != 0.0:
        wave += cog.second * math.sin(2.0 * cog.per_turn * p.N * theta + cog.phase)
    return cog.amplitude * (1.0 + cog.uneven * math.sin(p.N * theta)) * wave


@compiled
def motor_friction(p, w):
    """N T (1 + growth |w_m| / (|w_m| + speed)), w_m = N w; dry, N m."""
    dry = p.effects.motor_coulomb_friction
    fast = abs(p.N * w)
    return p.N * dry.torque * (1.0 + dry.growth * fast / (fast + dry.speed))


@compiled
def tooth_torque(p, x):
    """k d (1 + c d'), never pulling, with d how deep the teeth press into each other; N m, positive opens the plate.

    Source: Hunt and Crossley 1975, J. Appl. Mech. 42, with a straight spring.
    """
    play = p.effects.backlash
    apart, speed = x.theta_m - x.theta, x.w_m - x.w
    deep = abs(apart) - 0.5 * play.gap
    if deep <= 0.0:
        return 0.0
    way = math.copysign(1.0, apart)
    return way * play.stiffness * deep * max(1.0 + play.damping * way * speed, 0.0)


# ---- balances


@compiled
def driving_torque(p, x):
    """Everything in Eq. 2 but dry friction and inertia, N m; positive opens."""
    if p.effects.backlash.gap != 0.0:
        return tooth_torque(p, x) - (p.B - p.B_m) * x.w - restoring_torque(p, x.theta) - drag(p, x.w)
    return rippled(p, x, x.theta) - p.B * x.w - restoring_torque(p, x.theta) - cogging(p, x.theta) - drag(p, x.w)


@compiled
def friction_limit(p, x, way):
    """T_f + excess / (1 + (w/speed)^2) + dry friction of this way + share sqrt((T_motor^2 + T_spring^2) / 2), N m.

    And what sits at one angle, what grew with time, and the motor's own where it turns with the plate.
    """
    e = p.effects
    limit = p.T_f + e.stribeck_friction.excess / (1.0 + (x.w / e.stribeck_friction.speed) ** 2)
    limit += e.asymmetric_friction.opening if way > 0 else e.asymmetric_friction.closing
    if e.load_dependent_friction.share != 0.0:
        load = math.hypot(motor_torque(p, x.i), restoring_torque(p, x.theta)) * math.sqrt(0.5)
        limit += e.load_dependent_friction.share * load
    if e.motor_coulomb_friction.torque != 0.0 and e.backlash.gap == 0.0:
        limit += motor_friction(p, x.w)
    if e.friction_spot.torque != 0.0:
        limit += e.friction_spot.torque * math.exp(-(((x.theta - e.friction_spot.angle) / e.friction_spot.width) ** 2))
    if e.friction_tide.torque != 0.0:
        tide = e.friction_tide
        limit += tide.torque * math.sin(2.0 * math.pi * (tide.before + x.age) / tide.period)
    return limit + e.friction_drift.running * x.age + e.friction_drift.session * e.friction_drift.before


@compiled
def on_bristles(p):
    """Whether friction is elastic before it slides."""
    return p.effects.presliding_friction.angle > 0.0


@compiled
def bristle_stiffness(p):
    """T_f / angle, N m/rad."""
    return p.T_f / p.effects.presliding_friction.angle


@compiled
def bristle_rate(p, x):
    """w (1 - (z/z_ss)^2 sgn(z w)), rad/s, with z_ss the deflection that carries all of dry friction.

    Source: Dahl 1968 in form; its exponent is 2 in the deflection.
    """
    share = x.bristle * bristle_stiffness(p) / friction_limit(p, x, 1 if x.w > 0.0 else -1)
    return x.w - abs(x.w) * share * abs(share)


@compiled
def dry_friction(p, mode, x):
    """Friction of a moving plate, N m, positive against opening."""
    if mode != BRISTLES:
        return mode * friction_limit(p, x, mode)
    stiffness = bristle_stiffness(p)
    damping = 2.0 * p.effects.presliding_friction.damping * math.sqrt(stiffness * p.J)
    return stiffness * x.bristle + damping * bristle_rate(p, x)


@compiled
def terminal_voltage(p, v, i):
    """What the driver makes of the command v, V."""
    dead, limit = p.effects.driver_dead_zone, p.effects.current_limit
    if dead.volts != 0.0:
        v -= v / (1.0 + (v / dead.volts) ** 6) ** (1.0 / 6.0)
    if limit.amps != 0.0:
        over = (abs(i) - limit.amps) / limit.corner
        if over > -30.0:
            soft = over if over > 30.0 else math.log1p(math.exp(over))
            v -= math.copysign(limit.ohms * limit.corner * soft, i)
    return v


@compiled
def supplied(p, v, age):
    """What is left of the command v while a thermostat's load takes its share, V."""
    load = p.effects.supply_cycling
    if load.share == 0.0:
        return v
    on = math.tanh(math.sin(2.0 * math.pi * (load.before + age) / load.period) / load.edge)
    return v * (1.0 - load.share * 0.5 * (1.0 + on))


@compiled
def brush_drop(p, i):
    """V (1 - exp(-|i|/i_0)) sgn i, V."""
    brush = p.effects.brush_voltage_drop
    return math.copysign(brush.volts * math.expm1(-abs(i) / brush.current), i) if brush.volts != 0.0 else 0.0


@compiled
def current_rate(p, v, R, x):
    """Eq. 1, A/s."""
    w = x.w_m if p.effects.backlash.gap != 0.0 else x.w
    return (
        p.closed_circuit
        * (terminal_voltage(p, supplied(p, v, x.age), x.i) - R * x.i - p.k * w - brush_drop(p, x.i))
        / p.L
    )


@compiled
def motor_rate(p, x):
    """Eq. 2 of the motor alone within its gap, rad/s2; its dry friction is smooth, since nothing rests on it."""
    if p.effects.backlash.gap == 0.0:
        return 0.0
    dry = motor_friction(p, x.w_m) * math.tanh(x.w_m / AT_REST)
    free = rippled(p, x, x.theta_m) - p.B_m * x.w_m - cogging(p, x.theta_m) - dry
    return (free - tooth_torque(p, x)) / p.J_m


@compiled
def rates(p, v, mode, x):
    """d/dt of the state; mode -1, 1 slide, 0 stuck, BRISTLES."""
    heat, lag = p.effects.winding_heating, p.effects.position_sensor_lag
    R = p.R * (1.0 + heat.coefficient * x.warmth)
    di = current_rate(p, v, R, x)
    warming, housing, filtered, sensed = 0.0, 0.0, 0.0, 0.0
    if heat.coefficient != 0.0:
        out = heat.conductance * (x.warmth - x.housing)
        warming = (R * x.i * x.i - out) / heat.capacity
        housing = (out - heat.housing_conductance * x.housing) / heat.housing_capacity
    if lag.time != 0.0:
        filtered = (x.theta - x.filtered) / lag.time
        sensed = (x.filtered - x.sensed) / (lag.second * lag.time)
    dw, bristle = 0.0, 0.0
    if mode != 0:
        dw = (driving_torque(p, x) - dry_friction(p, mode, x)) / (p.J if p.effects.backlash.gap == 0.0 else p.J - p.J_m)
        bristle = bristle_rate(p, x) if mode == BRISTLES else 0.0
    return State(
        di,
        dw,
        x.w if mode != 0 else 0.0,
        warming,
        housing,
        motor_rate(p, x),
        x.w_m,
        bristle,
        filtered,
        sensed,
        1.0,
    )


# ---- stepping


@compiled
def _ahead(x, k, h):
    return State(
        x.i + h * k.i,
        x.w + h * k.w,
        x.theta + h * k.theta,
        x.warmth + h * k.warmth,
        x.housing + h * k.housing,
        x.w_m + h * k.w_m,
        x.theta_m + h * k.theta_m,
        x.bristle + h * k.bristle,
        x.filtered + h * k.filtered,
        x.sensed + h * k.sensed,
        x.age + h * k.age,
    )


@compiled
def _placed(x, w, theta):
    """The same with the plate's speed and angle given."""
    return State(x.i, w, theta, x.warmth, x.housing, x.w_m, x.theta_m, x.bristle, x.filtered, x.sensed, x.age)


@compiled
def _bent(p, x):
    """The same with bristles that carry, as far as they can, what a resting plate would start to move under."""
    torque = driving_torque(p, x)
    limit = friction_limit(p, x, 1 if torque > 0.0 else -1)
    bristle = min(max(torque, -limit), limit) / bristle_stiffness(p)
    return State(x.i, x.w, x.theta, x.warmth, x.housing, x.w_m, x.theta_m, bristle, x.filtered, x.sensed, x.age)


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
    torque = driving_torque(p, x)
    if on_bristles(p):
        torque -= bristle_stiffness(p) * x.bristle
        pressed = (torque <= 0.0 and x.theta <= p.lower) or (torque >= 0.0 and x.theta >= p.upper)
        return 0 if pressed else BRISTLES
    if torque > friction_limit(p, x, 1) and x.theta < p.upper:
        return 1
    if torque < -friction_limit(p, x, -1) and x.theta > p.lower:
        return -1
    return 0


@compiled
def has_ended(p, mode, x):
    """Whether this state lies outside its mode: torque beyond friction, speed reversed, or a stop passed."""
    if mode == 0:
        return mode_at_rest(p, x) != 0
    return (mode != BRISTLES and mode * x.w < 0.0) or x.theta > p.upper or x.theta < p.lower


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
def rebound(p, x):
    """Speed after a mode has ended, rad/s: what a stop gives back, e / (1 + |w|/speed) of it; else none."""
    bounce = p.effects.stop_bounce
    if bounce.restitution == 0.0 or p.lower <= x.theta <= p.upper:
        return 0.0
    back = -bounce.restitution * x.w / (1.0 + abs(x.w) / bounce.speed)
    return back if abs(back) > AT_REST else 0.0


@compiled
def mode_after(p, x):
    """The mode in which a state goes on."""
    if x.w == 0.0:
        return mode_at_rest(p, x)
    if on_bristles(p):
        return BRISTLES
    return 1 if x.w > 0.0 else -1


@compiled
def step(p, v, slope, mode, x, h):
    """h seconds, through however many changes of mode; returns the mode and the state at the end."""
    for _ in range(EVENTS_PER_STEP):
        end = rk4(p, v, slope, mode, x, h)
        if not has_ended(p, mode, end):
            return mode, end
        part = end_of_mode(p, v, slope, mode, x, h)
        end = rk4(p, v, slope, mode, x, part)
        x = _placed(end, rebound(p, end), min(max(end.theta, p.lower), p.upper))
        mode, v, h = mode_after(p, x), v + slope * part, h - part
    raise RuntimeError("the mode changes without end")


@compiled
def _log(p, x, v, row):
    """Current, speed, angle, warmth, voltage, speed of the motor, angle as sensed."""
    row[0], row[1], row[2], row[3], row[4] = x.i, x.w, x.theta, x.warmth, v
    row[5] = x.w_m if p.effects.backlash.gap != 0.0 else x.w
    row[6] = x.sensed if p.effects.position_sensor_lag.time != 0.0 else x.theta


@compiled
def run(p, knots, volts, instants, held_until, x, h_max):
    """States at the given instants, from the first knot on.

    Args:
        p: record of a Plant.
        knots, volts: the voltage, linear between knots (s, V); two knots at one time are a jump.
        instants: s, rising, within the knots.
        held_until: s; before it the plate is held where it is.
        x: State at the first knot; at rest.
        h_max: longest step, s.
    Returns:
        shape (len(instants), 7): as `_log` has them.
    """
    out = np.empty((len(instants), 7))
    t, n, free, mode = knots[0], 0, False, 0
    for k in range(len(knots) - 1):
        span = knots[k + 1] - knots[k]
        slope = (volts[k + 1] - volts[k]) / span if span > 0.0 else 0.0
        while t < knots[k + 1]:
            if not free and t >= held_until:
                if on_bristles(p):
                    x = _bent(p, x)
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
                _log(p, x, volts[k] + slope * (t - knots[k]), out[n])
                n += 1
    return out


@compiled
def run_loop(p, wanted, ahead, misread, shown, feed, period, parts, gains, slow, limit, hold, late, grain, mode, x):
    """The throttle body under a computer that samples, computes a PID and holds its output.

    Args:
        p: record of a Plant.
        wanted: angle asked for at each sample, rad.
        ahead: what is added to the output of the PID at each sample, V; the limit holds for both together.
        misread: noise of each reading, rad.
        shown: what a sensor that has failed shows instead, rad; NaN while it has not, infinite for what it showed last.
        feed: supply over the one that the computer reckons with, at each sample.
        period: between samples, s.
        parts: steps in a period.
        gains: V/rad, V/(rad s), V s/rad.
        slow: time constant of the derivative's filter, s.
        limit: of the output, V.
        hold: largest integral, V, which then runs on at the output's limit; 0: it stands still there.
        late: parts of a period by which the output acts late.
        grain: of the sensor, rad; 0 for none.
        mode, x: at the start.
    Returns:
        angle and voltage at each sample, shape (n, 2), and the angle that the sensor shows at each step, (n parts,).
    """
    path = np.empty(len(wanted) * parts)
    out = np.empty((len(wanted), 2))
    queue = np.zeros(late + 1)
    area, smooth, h, last = 0.0, 0.0, period / parts, 0.0
    for n in range(len(wanted)):
        seen = x.sensed if p.effects.position_sensor_lag.time != 0.0 else x.theta
        seen += misread[n]
        if np.isinf(shown[n]):
            seen = last
        elif not np.isnan(shown[n]):
            seen = shown[n]
        last = seen
        if grain > 0.0:
            seen = grain * np.rint(seen / grain)
        miss = wanted[n] - seen
        # the filtered error chases the error; the derivative is the speed of the chase
        chase = (miss - smooth) / (slow + period)
        smooth += period * chase
        if hold > 0.0:
            most = hold / gains[1] if gains[1] > 0.0 else 0.0
            area = min(max(area + period * miss, -most), most)
            volts = gains[0] * miss + gains[1] * area + gains[2] * chase
        else:
            volts = gains[0] * miss + gains[1] * (area + period * miss) + gains[2] * chase
            if abs(volts + ahead[n]) <= limit or (volts + ahead[n]) * miss < 0.0:
                area += period * miss
        volts = min(max(volts + ahead[n], -limit), limit)
        out[n, 0], out[n, 1] = x.theta, volts
        for j in range(parts):
            path[n * parts + j] = x.sensed if p.effects.position_sensor_lag.time != 0.0 else x.theta
            for k in range(late, 0, -1):
                queue[k] = queue[k - 1]
            queue[0] = volts
            mode, x = step(p, feed[n] * queue[late], 0.0, mode, x, h)
    return out, path
