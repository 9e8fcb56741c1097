"""Robust stability of a loop against the error of its model, measured on motion that was not fitted.

    Delta(w) = |E(w)| / |Y(w)|,        borne where |Delta(w) T(w)| < 1 for all w,        T = L/(1 + L)

E is the spectrum of measured - predicted (free running) less that of the sensor's noise, Y that of the predicted
position, L the loop of the new gains on the nominal model. Where the present ECU is in the model, the log is of a
closed loop, whose feedback reduced the errors: there Delta is divided by |1/(1 + L)| of the present gains. Delta counts
every difference as an error of the plant, also that of dry friction: it is too large rather than too small.

chi2 answers a different question: whether the parameters are estimates. A sensor that is good to 0.04 % of the travel
shows that a model is wrong long before this matters for a loop with a margin.

Source: Skogestad and Postlethwaite 2005, Multivariable Feedback Control, sections 7.4 and 7.5 (multiplicative
uncertainty; robust stability). Differs from source: Delta is estimated from one log by Welch's method, not bounded
beforehand; the limit is 0.5 instead of 1, as with a gain margin of 6 dB, for changes that the log does not show
(supply, heat, wear).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..model.ecu import Ecu
from ..model.linear import TransferFunction
from .pid import Gains
from .pid.linear_loop import OpenLoop, controller

MOST = 0.5  # limit of |Delta T|
_SEGMENT = 1.0  # s: length of one periodogram
_NEAR = 3.0  # factor below and above the crossover within which gain and phase decide on stability
_AT = 1.5  # factor below and above it within which the log must show Delta
_ROWS = 4.0  # least sample rate of a log over a frequency that it shows
_SEEN = 4.0  # power of the motion over that of the noise from which on Delta is known


def is_borne(worst: float | None) -> bool:
    """Whether the largest |Delta T| is within the limit; False where the log does not show it (NaN, in tune.json
    null)."""
    return worst is not None and worst <= MOST


@dataclass(frozen=True)
class Borne:
    """Robust stability of the loop of one set of gains."""

    worst: float  # the largest |Delta T| within a factor of 3 of the crossover; NaN where the log does not show it
    missed: float  # Delta there, a share of the plant's response
    hertz: float  # frequency of that largest value, Hz
    crossover: float  # of the loop, Hz
    rows: float = np.inf  # sample rate of the fastest trace, 1/s

    @property
    def enough(self) -> bool:
        """See `is_borne`."""
        return is_borne(self.worst)

    @property
    def says(self) -> str:
        """A sentence."""
        if not np.isfinite(self.worst):
            if (needed := _ROWS * self.crossover) > self.rows:
                return (f"{self.rows:.3g} rows a second are too few near the crossover of the new loop, "
                        f"{self.crossover:.2g} Hz: log at {needed:.0f} Hz or faster.")  # fmt: skip
            return (f"The log has no motion near the crossover of the new loop, {self.crossover:.2g} Hz: record ten "
                    "quick steps of 20 to 60 % of the travel.")  # fmt: skip
        if self.worst == 0.0:
            return f"Near {self.crossover:.2g} Hz the error of the model is below the sensor's noise."
        found = (f"At {self.hertz:.2g} Hz the error of the model is {100.0 * self.missed:.2g} % of the plate's "
                 f"response; the loop tolerates {100.0 * self.missed / self.worst * MOST:.2g} %")  # fmt: skip
        if self.enough:
            return f"{found}."
        return (f"{found} (|Delta T| {self.worst:.2g}, at most {MOST:g}). Log at each tick of the ECU if it can, and "
                "record more quick steps with rests between them.")  # fmt: skip


def borne(
    parts: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]], noise: float, plant: TransferFunction, ecu: Ecu,
    gains: Gains, present: Gains | None = None,
) -> Borne:  # fmt: skip
    """The robust stability of gains, from the measured and the predicted motion.

    Args:
        parts: instants (s), measured and predicted position (rad) of each trace, shape (n,) each; NaN where none is.
        noise: standard deviation of one sample, rad.
        plant, ecu: the nominal loop.
        gains: the gains to be judged.
        present: gains of the ECU in the model; None where the logged duty drove it.
    """
    under = OpenLoop.of_plants(plants=plant, ecu=ecu)
    omega = np.angle(under.z[:-1]) / ecu.period
    response = np.ravel(under.response)[:-1]
    loop = np.ravel(controller(gains, ecu, under.z[:-1])) * response
    above = np.flatnonzero(np.abs(loop) >= 1.0)
    crossover = float(omega[above[-1]] if above.size else omega[0]) / (2.0 * np.pi)
    parts = tuple(parts)
    rows = max((1.0 / float(np.median(np.diff(instants))) for instants, *_ in parts), default=np.inf)
    hertz, missed = _missed(parts, noise)
    near = (hertz >= crossover / _NEAR) & (hertz <= crossover * _NEAR) & np.isfinite(missed)
    if not (near & (np.abs(np.log(np.maximum(hertz, 1e-9) / crossover)) <= np.log(_AT))).any():
        return Borne(float("nan"), float("nan"), float("nan"), crossover, rows)
    hertz, missed = hertz[near], missed[near]
    at = 2.0 * np.pi * hertz
    if present is not None:
        there = np.ravel(controller(present, ecu, under.z[:-1])) * response
        missed = missed * np.interp(at, omega, np.abs(1.0 + there))
    product = missed * np.interp(at, omega, np.abs(loop / (1.0 + loop)))
    k = int(np.argmax(product))
    return Borne(float(product[k]), float(missed[k]), float(hertz[k]), crossover, rows)


def _missed(parts: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]], noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, Hz, and Delta there; NaN where the motion does not rise above the noise."""
    from scipy.signal import welch

    error, motion, hertz, weight, floor = 0.0, 0.0, np.zeros(0), 0.0, 0.0
    step = None
    for time, measured, predicted in parts:
        there = np.isfinite(measured) & np.isfinite(predicted)
        step = float(np.median(np.diff(time))) if step is None else step
        size = round(_SEGMENT / step)
        even = np.arange(time[there][0], time[there][-1], step)
        if even.size < size:
            continue
        y, left = (np.interp(even, time[there], each[there]) for each in (predicted, measured - predicted))
        hertz, power = welch(left, 1.0 / step, nperseg=size)
        error, motion = error + even.size * power, motion + even.size * welch(y, 1.0 / step, nperseg=size)[1]
        weight, floor = weight + even.size, 2.0 * step * noise**2
    if not weight:
        return hertz, np.full(hertz.shape, np.nan)
    error, motion = np.asarray(error) / weight, np.asarray(motion) / weight
    seen = motion > _SEEN * floor
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.sqrt(np.maximum(error - floor, 0.0) / motion)
    return hertz, np.where(seen & (hertz > 0.0), missed, np.nan)
