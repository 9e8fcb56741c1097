"""Feed-forward: the voltage that holds each position, and the voltage for friction, back-EMF and drag of a moving
plate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...backend import compiled_quickly
from ...model.ecu import Ecu
from ...model.feed_forward import Term
from ...model.linear import holding_against, turning_against
from ...model.throttle import Throttle
from ..settings import SlidingSettings

POINTS = 8  # points of a curve, where the ECU has no table
PLACES = 20_001  # angles from which they are chosen, where the ECU has no table
_HALVINGS = 24
SLIDING_PLACES = 41  # places, evenly over the travel, over which friction and drag of a moving plate are averaged


@dataclass(frozen=True, eq=False)
class Bias:
    """bias(r): spring, preload and limp-home spring by a curve over the setpoint, linear between its points.

    Source: rusEFI, electronic_throttle.cpp (bias table over the target position). Differs from source: no.
    """

    angles: np.ndarray  # angles of the curve, rad, rising, shape (P,)
    hold: np.ndarray  # voltage that holds the plate there in the middle of its dry friction, V, shape (P,)
    closing: np.ndarray  # voltage at which it is about to close, V, shape (P,)
    opening: np.ndarray  # voltage at which it is about to open, V, shape (P,)

    def volts(self, setpoint: np.ndarray) -> np.ndarray:
        """Feed-forward at setpoints (rad), shape (K,), V."""
        return np.interp(setpoint, self.angles, self.hold)


@compiled_quickly
def _held(throttle: Throttle, angles: Any, share: float, gear_ratio: float, lower: float, upper: float) -> Any:
    return jax.vmap(lambda theta: holding_against(throttle, theta, share, gear_ratio, lower, upper))(angles)


_AT_ONCE = 512  # angles in one call of a compiled function, whatever their number, so that one program serves all


def held(
    throttle: Throttle, angles: np.ndarray, share: float, gear_ratio: float, lower: float, upper: float
) -> tuple[np.ndarray, np.ndarray]:
    """Currents (A) and voltages (V) that hold a plate at these angles against a share of its dry friction, shape (K,)
    each."""
    angles, count = np.asarray(angles, dtype=float), len(angles)
    chosen = (np.minimum(np.arange(k, k + _AT_ONCE), count - 1) for k in range(0, count, _AT_ONCE))
    parts = [_held(throttle, angles[some], share, gear_ratio, lower, upper) for some in chosen]
    current, volts = (np.concatenate(each)[:count] for each in zip(*parts, strict=True))
    return current, volts


class HoldingVoltages(NamedTuple):
    """Voltages that hold a plate at some angles, V, shape (K,) each."""

    down: np.ndarray  # at which it is about to close
    middle: np.ndarray  # in the middle of its dry friction
    up: np.ndarray  # at which it is about to open


def hold_curve(
    throttle: Throttle, angles: np.ndarray, gear_ratio: float, lower: float, upper: float
) -> HoldingVoltages:
    """Voltages that hold a plate at these angles (rad), shape (K,), between stops (rad)."""
    return HoldingVoltages(*(held(throttle, angles, share, gear_ratio, lower, upper)[1] for share in (-1.0, 0.0, 1.0)))


def bias_of(
    throttle: Throttle, gear_ratio: float, lower: float, upper: float, points: int = POINTS, places: int = PLACES
) -> Bias:
    """The curve with a given number of points whose largest error against the holding voltage is least.

    The points are chosen from places evenly over the travel, with the resolution of the ECU's table.

    The largest error is bisected: for each value, every straight piece reaches as far as it can (`polygon`). So points
    are placed at the corners of the limp-home spring; the remaining points halve the longest pieces.
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
    """Places on an evenly spaced curve, including both ends, between which straight lines deviate by `within` at most.

    Source: Imai and Iri 1986, Computer Vision, Graphics, and Image Processing 36 (the longest reach first). Differs
    from source: the error is that of the value, and where it does not rise with the reach the reach may be too short.
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

    From Eqs. 1-2, where both directions have the same dry friction:

        V_o = V_c = R_a T_f / (N K_m),    k = N K_b + R_a (N^2 B_m + B_L) / (N K_m)

    Source: Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, European Journal of Control 4(3), for friction
    by the sign of the commanded speed; the rest from Eqs. 1-2 at a constant speed. Differs from source: the sign is
    replaced by a straight line within +-w_f.
    """

    # opening, closing: V_o and V_c, the voltage for dry friction of a plate that slides open and closed, V
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
        """Only the given terms; None where none of them is of this kind."""
        if not {Term.FRICTION, Term.RATE} & set(terms):
            return None
        slope = self.slope if Term.RATE in terms else 0.0
        kept = replace(self, slope=slope)
        return kept if Term.FRICTION in terms else kept.frictionless()

    def frictionless(self) -> Sliding:
        """The same without the term of dry friction."""
        return replace(self, opening=0.0, closing=0.0)


@compiled_quickly
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
    """The terms of a model, from the voltages at a speed and its opposite with and without dry friction.

        V_o = mean v(w, 1) - v(w, 0),   V_c = mean v(-w, 0) - v(-w, -1),   k = mean (v(w, 0) - v(-w, 0)) / (2 w)

    v(w, s) is the voltage of a plate that turns at w against s times its dry friction; the mean is over places of the
    travel. The memories of effects have their initial values: friction that yields (`presliding_friction`) and a
    warming winding are not included.
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
    """Rate of a setpoint as the ECU computes it, tick by tick, rad/s: filtered like the derivative of its PID.

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
