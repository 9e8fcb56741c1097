"""Feed-forward of a plate that is to move: what dry friction, back-EMF and viscous drag will take."""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.feed_forward import Term
from ...model.linear import turning_against
from ...model.throttle import Throttle
from ..settings import SlidingSettings


@dataclass(frozen=True)
class Sliding:
    """ahead(w) = V_o sat(w / w_f) - V_c sat(-w / w_f) + k w, w the setpoint's rate and sat(s) = min(max(s, 0), 1).

    Of Eqs. 1-2, where both directions have the same dry friction:

        V_o = V_c = R_a T_f / (N K_m),    k = N K_b + R_a (N^2 B_m + B_L) / (N K_m)

    Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, European Journal of Control 4(3), for friction
    by the sign of the speed asked for; the rest from Eqs. 1-2 at a speed that does not change. Differs from source: the
    sign is straight within +-w_f.

    Args:
        opening, closing: V_o and V_c, what dry friction takes of a plate that slides open and closed, V.
        full: w_f, rad/s.
        slope: k, V s/rad.
    """

    opening: float
    closing: float
    full: float
    slope: float

    def volts(self, rate: np.ndarray) -> np.ndarray:
        """At rates of the setpoint (rad/s), shape (K,); V."""
        share = rate / self.full
        friction = self.opening * np.clip(share, 0.0, 1.0) - self.closing * np.clip(-share, 0.0, 1.0)
        return friction + self.slope * rate

    def only(self, terms: tuple[Term, ...]) -> Sliding | None:
        """The terms of it that are asked for; None where none is."""
        if not {Term.FRICTION, Term.RATE} & set(terms):
            return None
        slope = self.slope if Term.RATE in terms else 0.0
        kept = replace(self, slope=slope)
        return kept if Term.FRICTION in terms else kept.frictionless()

    def frictionless(self) -> Sliding:
        """Without the term of dry friction."""
        return replace(self, opening=0.0, closing=0.0)


@jax.jit
def _turns(
    throttle: Throttle, angles: np.ndarray, speed: float, share: float, gear_ratio: float, lower: float, upper: float
):
    return jax.vmap(lambda theta: turning_against(throttle, theta, speed, share, gear_ratio, lower, upper)[1])(angles)


def sliding_of(
    throttle: Throttle,
    gear_ratio: float,
    lower: float,
    upper: float,
    settings: SlidingSettings = SlidingSettings(),
) -> Sliding:
    """The terms of a model: what turning at a speed takes more than without dry friction, and at the opposite speed.

        V_o = mean v(w, 1) - v(w, 0),   V_c = mean v(-w, 0) - v(-w, -1),   k = mean (v(w, 0) - v(-w, 0)) / (2 w)

    v(w, s) is the voltage of a plate that turns at w against s times its dry friction, the mean that of places over the
    travel. Memories of effects are held where a trace begins: friction that yields (`presliding_friction`) and a
    winding that warms up are not in it.

    Args:
        throttle: the model.
        gear_ratio, lower, upper: of the rig; rad.
        settings: the speed, and the places.
    """
    travel = upper - lower
    angles = jnp.asarray(lower + travel * (np.arange(settings.places) + 0.5) / settings.places)
    speed = settings.rate * travel
    body = gear_ratio, lower, upper
    opens, up, down, closes = (np.asarray(_turns(throttle, angles, way * speed, share, *body))
                               for way, share in ((1.0, 1.0), (1.0, 0.0), (-1.0, 0.0), (-1.0, -1.0)))  # fmt: skip
    return Sliding(
        opening=float(np.mean(opens - up)),
        closing=float(np.mean(down - closes)),
        full=settings.full * travel,
        slope=float(np.mean(up - down)) / (2.0 * speed),
    )


def rates(setpoint: np.ndarray, ecu: Ecu) -> np.ndarray:
    """Rate of a setpoint as the ECU takes it, tick by tick, rad/s: filtered as the derivative of its PID is.

        w <- (T_f w + r - r_last) / (T_f + T),    0 at the first tick

    Args:
        setpoint: rad at each tick, shape (K,).
        ecu: its period T, and T_f, the time constant of its derivative's filter.
    """
    rate = np.diff(setpoint, prepend=setpoint[:1]) / (ecu.filter + ecu.period)
    kept = ecu.filter / (ecu.filter + ecu.period)
    for k in range(1, rate.size if kept else 0):
        rate[k] += kept * rate[k - 1]
    return rate
