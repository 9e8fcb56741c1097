"""The throttle body as a linear plant: its transfer function from volts to angle about an operating point.

    G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0)

Dry friction and preload are left out, as in the paper: a torque of constant size has no transfer function. Memories of
effects are held at their initial values; delay and filter of the reading are kept apart from G and appended on request.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .effects import Inputs, State
from .effects.sensors import PositionSensorLag
from .parameters import Scalar
from .throttle import Throttle

if TYPE_CHECKING:
    import control


MIDDLE = 0.25  # share of the travel: the default operating point, the middle of the paper's trapezoid, 5 to 45 %


@dataclass(frozen=True)
class TransferFunction:
    """G(s) = b0 / (s^3 + a2 s^2 + a1 s + a0), followed by exp(-s delay) / (lag s + 1)."""

    b0: Scalar  # numerator, in output unit over input unit, 1/s3
    # a2, a1, a0: 1/s, 1/s2, 1/s3
    a2: Scalar
    a1: Scalar
    a0: Scalar
    delay: Scalar = 0.0  # delay of the input, s
    lag: Scalar = 0.0  # time constant of the position sensor, s

    @property
    def num(self) -> tuple[Scalar, ...]:
        """Of G alone."""
        return (self.b0,)

    @property
    def den(self) -> tuple[Scalar, ...]:
        """Denominator of G alone, highest power first."""
        return (1.0, self.a2, self.a1, self.a0)

    @property
    def poles(self) -> Any:
        """Poles of G alone, slowest first, 1/s, complex, shape (3,)."""
        roots = np.roots(self.den)
        return roots[np.lexsort((roots.imag, -roots.real))]

    @property
    def dc_gain(self) -> Scalar:
        """G(0), output unit over input unit; infinite without a spring."""
        return self.b0 / self.a0 if self.a0 else float("inf")

    def __call__(self, s: Any) -> Any:
        """Value at complex frequencies s (1/s), delay and lag included."""
        plant = self.b0 / (((s + self.a2) * s + self.a1) * s + self.a0)
        return plant * np.exp(-s * self.delay) / (self.lag * s + 1.0)

    def bare(self) -> TransferFunction:
        """G alone."""
        return replace(self, delay=0.0, lag=0.0)

    def to_control(self, pade_order: int = 0) -> control.TransferFunction:
        """For python-control; with delay and lag only if a Pade order is given.

        Args:
            pade_order: order of numerator and denominator of the approximation of exp(-s delay); 0 leaves delay and lag
                out.
        """
        import control

        plant: Any = control.tf(list(self.num), list(self.den))
        if not pade_order:
            return plant
        late: Any = control.tf(*control.pade(self.delay, pade_order)) if self.delay else control.tf([1.0], [1.0])
        return plant * late * control.tf([1.0], [self.lag, 1.0])


PAPER_EQ_8 = TransferFunction(3.10e4, 113.8, 2941.0, 2.38e4)
"""The paper's Eq. 8, rad/V. It does not follow from the paper's own Table 2: Eqs. 1-2 give 2.208e5 / (s^3 + 1033 s^2 +
9.370e4 s + 1.282e5), with poles near -1.4, -99 and -932 1/s where Eq. 8 has -81 and -16.3 +- 5.2j, and 1.722 rad/V
instead of 1.303 rad/V."""


def closed_form(values: Mapping[str, Scalar], gear_ratio: Scalar) -> Float[Array, "4 ..."]:
    """Coefficients b0, a2, a1, a0 of Eqs. 1-2 without dry friction and preload, rad/V, shape (4,).

        L J (b0, a2, a1, a0) = (N K_m, L B + R J, L K_s + R B + N^2 K_m K_b, R K_s)

    with J = N^2 J_m + J_L and B = N^2 B_m + B_L.

    Source: the paper, Eqs. 1 and 2. Differs from source: no.
    """
    n, v = gear_ratio, values
    inertia, damping = n**2 * v["J_m"] + v["J_L"], n**2 * v["B_m"] + v["B_L"]
    resistance, inductance = v["R_a"], v["L_a"]
    stiff = inductance * v["K_s"] + resistance * damping + n**2 * v["K_m"] * v["K_b"]
    top = (n * v["K_m"], inductance * damping + resistance * inertia, stiff, resistance * v["K_s"])
    return jnp.stack([jnp.asarray(part / (inductance * inertia)) for part in top])


def coefficients(
    throttle: Throttle, theta: Scalar, gear_ratio: Scalar, lower: Scalar, upper: Scalar
) -> Float[Array, " 4"]:
    """b0, a2, a1, a0 of a model with any effects, linearised about a plate held at theta, rad/V, shape (4,).

        dx/dt = A x + B v,    s^3 - tr A s^2 + (tr^2 A - tr A^2)/2 s - det A,    b0 = A[omega, i] B[i]

    Args:
        theta: operating point, rad; the current is the one that holds the plate there against its springs.
        gear_ratio, lower, upper: gear ratio and end stops (rad) of the rig.
    """
    current, volts = holding(throttle, theta, gear_ratio, lower, upper)
    u = _inputs(volts, gear_ratio, lower, upper)

    def rates(x: Float[Array, " 3"], volts: Float[Array, ""]) -> Float[Array, " 3"]:
        state = State(x[0], x[1], x[2])
        c = throttle(state, throttle.z0, u._replace(voltage=volts))
        return jnp.stack([(volts + c.voltage) / c.inductance, state.omega, (c.torque + c.drive) / c.inertia])

    at = jnp.stack([current, jnp.asarray(theta, dtype=float), jnp.zeros(())])
    a, b = jax.jacfwd(rates, argnums=(0, 1))(at, volts)
    a2 = -jnp.trace(a)
    a1 = 0.5 * (a2**2 - jnp.trace(a @ a))
    return jnp.stack([a[2, 0] * b[0], a2, a1, -_determinant(a)])


def sensor_lag(throttle: Throttle) -> Scalar:
    """Time constant of the position sensor, s; 0 if the model has none."""
    return next((effect.tau_p for effect in throttle.effects if isinstance(effect, PositionSensorLag)), 0.0)


def holding(
    throttle: Throttle, theta: Scalar, gear_ratio: Scalar, lower: Scalar, upper: Scalar
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Current (A) and voltage (V) that hold the plate in the middle of its dry friction; see `turning_against`."""
    return holding_against(throttle, theta, 0.0, gear_ratio, lower, upper)


_NEWTON = 12


def holding_against(
    throttle: Throttle, theta: Scalar, share: Scalar, gear_ratio: Scalar, lower: Scalar, upper: Scalar
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Current (A) and voltage (V) at which the motor balances the springs and a share of the dry friction: 1 if the
    plate is about to open, -1 if it is about to close, 0 in the middle; see `turning_against`."""
    return turning_against(throttle, theta, 0.0, share, gear_ratio, lower, upper)


def turning_against(
    throttle: Throttle, theta: Scalar, omega: Scalar, share: Scalar, gear_ratio: Scalar, lower: Scalar, upper: Scalar
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Current (A) and voltage (V) at which the plate passes an angle at constant speed.

    Args:
        theta: rad.
        omega: rad/s.
        share: share of the dry friction on the motor: 1 if the plate slides open, -1 if it slides closed.
        gear_ratio, lower, upper: of the rig; rad.
    """
    u = _inputs(0.0, gear_ratio, lower, upper)

    def torque(i: Scalar) -> Scalar:
        c = throttle(State(i, theta, omega), throttle.z0, u)
        return c.torque + c.drive - share * c.friction

    def voltage(volts: Scalar, i: Scalar) -> Scalar:
        return volts + throttle(State(i, theta, omega), throttle.z0, u._replace(voltage=volts)).voltage

    current = _root(torque, 0.0)
    # a driver's dead zone has slope 0 at zero voltage: begin beyond it
    start = -throttle(State(current, theta, omega), throttle.z0, u).voltage
    return current, _root(lambda volts: voltage(volts, current), start + jnp.sign(start))


def _root(function: Callable[[Scalar], Scalar], start: Scalar) -> Float[Array, ""]:
    """Newton's method, as a loop that is traced once."""

    def better(_: Any, x: Float[Array, ""]) -> Float[Array, ""]:
        value, slope = jax.jvp(function, (x,), (jnp.ones_like(x),))
        return x - value / jnp.where(slope == 0.0, 1.0, slope)

    return jax.lax.fori_loop(0, _NEWTON, better, jnp.asarray(start, dtype=float))


def _inputs(volts: Scalar, gear_ratio: Scalar, lower: Scalar, upper: Scalar) -> Inputs:
    return Inputs(volts, 0.0, 0.0, 1.0, 0.0, gear_ratio, lower, upper)


def _determinant(a: Float[Array, "3 3"]) -> Float[Array, ""]:
    return jnp.dot(a[0], jnp.cross(a[1], a[2]))
