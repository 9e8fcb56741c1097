"""Feed-forward: the voltage that holds each position, and what friction, back-EMF and drag take of a moving plate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...model.ecu import Ecu
from ...model.feed_forward import Term
from ...model.linear import holding_against, turning_against
from ...model.throttle import Throttle
from ..settings import SlidingSettings

POINTS = 8  # of a curve, where no ECU says
PLACES = 20_001  # angles from which they are chosen, where no ECU says
_HALVINGS = 24
SLIDING_PLACES = 41  # evenly over the travel, of which friction and drag of a moving plate are the mean


@dataclass(frozen=True, eq=False)
class Bias:
    """bias(r): spring, preload and limp-home spring by a curve over the setpoint, linear between its points.

    Source: rusEFI, electronic_throttle.cpp (bias table over the target position). Differs from source: no.
    """

    angles: np.ndarray  # rad, rising, shape (P,)
    hold: np.ndarray  # V that hold the plate there in the middle of its dry friction, shape (P,)
    # closing, opening: V at which it is about to close and to open, shape (P,): what its dry friction leaves open
    closing: np.ndarray
    opening: np.ndarray

    def volts(self, setpoint: np.ndarray) -> np.ndarray:
        """Feed-forward at setpoints (rad), shape (K,), V."""
        return np.interp(setpoint, self.angles, self.hold)


@jax.jit
def held(throttle: Throttle, angles: np.ndarray, share: float, gear_ratio: float, lower: float, upper: float):
    """Currents (A) and voltages (V) that hold a plate at these angles against a share of its dry friction."""
    return jax.vmap(lambda theta: holding_against(throttle, theta, share, gear_ratio, lower, upper))(angles)


class HoldingVoltages(NamedTuple):
    """Voltages that hold a plate at some angles, V, shape (K,) each."""

    down: np.ndarray  # at which it is about to close
    middle: np.ndarray  # in the middle of its dry friction
    up: np.ndarray  # at which it is about to open


def hold_curve(
    throttle: Throttle, angles: np.ndarray, gear_ratio: float, lower: float, upper: float
) -> HoldingVoltages:
    """Voltages that hold a plate at these angles (rad), shape (K,), between stops (rad)."""
    down, middle, up = (np.asarray(held(throttle, np.asarray(angles), share, gear_ratio, lower, upper)[1])
                        for share in (-1.0, 0.0, 1.0))  # fmt: skip
    return HoldingVoltages(down, middle, up)


def bias_of(
    throttle: Throttle, gear_ratio: float, lower: float, upper: float, points: int = POINTS, places: int = PLACES
) -> Bias:
    """The curve of so many points that misses the holding voltage least, wherever it misses it most.

    The points are chosen from so many places, evenly over the travel: as finely as an ECU's table can name them.

    The least miss is bisected: within one, each straight piece reaches as far as it can (`polygon`). So the points come
    to lie on the corners of the limp-home spring; what is left of them halves the longest pieces.
    """
    fine = np.linspace(lower, upper, places)
    down, middle, up = hold_curve(throttle, fine, gear_ratio, lower, upper)
    least, most = 0.0, float(np.ptp(middle)) + 1e-9
    for _ in range(_HALVINGS):
        within = 0.5 * (least + most)
        least, most = (least, within) if len(polygon(middle, within)) <= points else (within, most)
    chosen = polygon(middle, most)
    while len(chosen) < points:
        k = int(np.argmax(np.diff(chosen)))
        chosen.insert(k + 1, (chosen[k] + chosen[k + 1]) // 2)
    return Bias(fine[chosen], middle[chosen], down[chosen], up[chosen])


def polygon(curve: np.ndarray, within: float) -> list[int]:
    """Places on an evenly spaced curve, both ends among them, between which straight lines miss it by so much at most.

    Source: Imai and Iri 1986, Computer Vision, Graphics, and Image Processing 36 (the longest reach first). Differs
    from source: the miss is that of the value, and where it does not rise with the reach the latter may fall short.
    """
    places = [0]
    while places[-1] < curve.size - 1:
        reaches, fails = places[-1] + 1, curve.size
        while fails - reaches > 1:
            end = (reaches + fails) // 2
            piece = curve[places[-1] : end + 1]
            miss = float(np.max(np.abs(piece - np.linspace(piece[0], piece[-1], piece.size))))
            reaches, fails = (end, fails) if miss <= within else (reaches, end)
        places.append(reaches)
    return places


@dataclass(frozen=True)
class Sliding:
    """ahead(w) = V_o sat(w / w_f) - V_c sat(-w / w_f) + k w, w the setpoint's rate and sat(s) = min(max(s, 0), 1).

    Of Eqs. 1-2, where both directions have the same dry friction:

        V_o = V_c = R_a T_f / (N K_m),    k = N K_b + R_a (N^2 B_m + B_L) / (N K_m)

    Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, European Journal of Control 4(3), for friction
    by the sign of the speed asked for; the rest from Eqs. 1-2 at a speed that does not change. Differs from source: the
    sign is straight within +-w_f.
    """

    # opening, closing: V_o and V_c, what dry friction takes of a plate that slides open and closed, V
    opening: float
    closing: float
    full: float  # w_f, rad/s
    slope: float  # k, V s/rad

    def volts(self, rate: np.ndarray) -> np.ndarray:
        """Feed-forward at rates of the setpoint (rad/s), shape (K,), V."""
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
    """
    travel = upper - lower
    angles = jnp.asarray(lower + travel * (np.arange(SLIDING_PLACES) + 0.5) / SLIDING_PLACES)
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
