"""Effects of the gear, of the motor that turns it, and of the end stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp

from ..parameters import NonNegative, Positive, Real, Scalar, parameter
from .base import AbstractEffect, Contribution, Inputs, State

_CONTACT = 0.02  # torque through the teeth, N m, below which they are not firmly in contact
_MOST = 0.95  # largest restitution: without losses a motor would rattle, and a plate bounce, for ever


# Play between the teeth of the gear
class Backlash(AbstractEffect):
    """position = g_b (1 - s)/2, ds/dt = (tanh(T_g / 0.02 N m) - s)/t_b, T_g the torque through the teeth.

    The memory s is the flank in contact: 1 if the motor opens the plate, -1 if it closes it; each trace begins with 1.
    theta is the angle of the motor at the plate; the plate itself, which the sensor reads, lags by s g_b/2. If g_b is
    negative, the sensor is on the motor's side.

    A spring with preload keeps the teeth in contact. But when the plate lands on its lower stop, the motor turns on
    alone, without plate, spring and their friction, and rattles within lower - g_b <= theta <= lower: it rebounds from
    the teeth of the plate on its stop with v/(1 + c_b v), and from the teeth that open the plate, which yields, with
    e_b v.

    Source: Nordin and Gutman 2002, Automatica 38(10), the dead-zone model; Hunt and Crossley 1975, J. Appl. Mech. 42,
    for the impacts. Differs from source: quasi-static except at the lower stop; the impact's loss has a closed form,
    which is that of a heavy body within 15 %.
    """

    name = "backlash"
    told_by = "free returns onto the stop with open terminals, sampled at 1 kHz; reversals of the load of the gear"
    off: ClassVar[Mapping[str, float] | None] = {"g_b": 0.0}
    z0: ClassVar[tuple[float, ...]] = (1.0,)
    loaded: ClassVar[bool] = True
    rough: ClassVar[bool] = True
    inexact: ClassVar[float] = 0.1
    # chi2 has a valley for each impact that falls on the right sample
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "g_b": (0.004, 0.0053, 0.0071, 0.0095, 0.0126, 0.0168, 0.0224, 0.03),
        "c_b": (0.5, 0.8, 1.25, 2.0),
    }
    needs: ClassVar[tuple[str, ...]] = ("position",)
    g_b: Scalar = parameter("rad", Real(0.01), 0.0, "play of the gear, at the plate", "Nordin and Gutman 2002")
    t_b: Scalar = parameter("s", Positive(0.005), 0.005, "time the plate takes to cross the play", "quasi-static play")
    c_b: Scalar = parameter("s/rad", Positive(1.0), 1.0, "damping of the teeth in an impact", "Hunt and Crossley 1975")
    e_b: Scalar = parameter("1", NonNegative(0.3), 0.3, "restitution of teeth that give way", "Newton's law of impact")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        rate = u.plate * (jnp.tanh(u.gear_load / _CONTACT) - z[0]) / self.t_b
        behind = 0.5 * u.plate * self.g_b * (1.0 - z[0])
        below = jnp.where(u.plate > 0.5, u.lower - x.theta, 0.0)  # the plate stays on its stop
        return Contribution(
            position=jnp.where(self.g_b > 0.0, jnp.maximum(behind, below), behind),
            play=jnp.where(self.g_b >= 0.0, self.g_b, 0.0),
            tooth_damping=jnp.where(self.g_b > 0.0, self.c_b, 0.0),
            tooth_restitution=jnp.where(self.g_b > 0.0, jnp.minimum(self.e_b, _MOST), 0.0),
            dz=(rate,),
        )


# Cogging of the motor's magnets
class CoggingTorque(AbstractEffect):
    """torque = -(A_c cos(n_c N theta) + A_s sin(n_c N theta)): n_c periods in one turn of the motor.

    Cosine and sine replace an amplitude and a phase, because a phase is undefined if the amplitude is zero.

    Source: Hanselman 2006, Brushless permanent magnet motor design, 2nd ed., cogging torque. Differs from source: the
    first harmonic only, at the plate; left out for the motor alone, whose angle is not logged.
    """

    name = "cogging_torque"
    scope = "motor"
    told_by = "slow constant-speed strokes, read against the motor's angle"
    off: ClassVar[Mapping[str, float] | None] = {"A_c": 0.0, "A_s": 0.0}
    inexact: ClassVar[float] = 0.1
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {
        "n_c": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 12.0, 14.0, 15.0, 16.0, 18.0, 20.0, 24.0),
    }
    needs: ClassVar[tuple[str, ...]] = ("position", "gear")
    A_c: Scalar = parameter("N*m", Real(0.02), 0.0, "cogging torque at the plate, cosine", "Hanselman 2006")
    A_s: Scalar = parameter("N*m", Real(0.02), 0.0, "cogging torque at the plate, sine", "Hanselman 2006")
    n_c: Scalar = parameter("1", Positive(6.0), 6.0, "cogging periods per turn of the motor", "Hanselman 2006")

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        phase = self.n_c * u.gear_ratio * x.theta
        return Contribution(torque=-u.plate * (self.A_c * jnp.cos(phase) + self.A_s * jnp.sin(phase)))


# Rebound from the end stops
class StopBounce(AbstractEffect):
    """omega after an impact = -e_r omega before it, e_r at most 0.95.

    Source: Newton's law of impact; Brogliato 2016, Nonsmooth mechanics, 3rd ed. Differs from source: no.
    """

    name = "stop_bounce"
    told_by = "fast strokes onto the stops, sampled at 1 kHz or more"
    off: ClassVar[Mapping[str, float] | None] = {"e_r": 0.0}
    # a small rebound ends within its step, and chi2 has as many valleys as there are rebounds
    scan: ClassVar[Mapping[str, tuple[float, ...]]] = {"e_r": (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6)}
    e_r: Scalar = parameter(
        "1", NonNegative(0.3), 0.0, "restitution coefficient of the end stops", "Newton's law of impact"
    )

    def __call__(self, x: State, z: tuple[Scalar, ...], u: Inputs) -> Contribution:
        return Contribution(restitution=u.plate * jnp.minimum(self.e_r, _MOST))
