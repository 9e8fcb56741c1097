"""Fits one frequency in several signals: amplitude and phase of each, and their joint covariance.

    y_c(t) = o_c + d_c x + Re sum_k A_ck exp(2 pi i k f (t - m)),    k = 1 ... H,    x = (t - m) / half the span

f is common, m is the middle of all signals. Harmonics are fitted with the fundamental, so that those of dry friction do
not count as noise; the drift d is left out of a signal in which it is not significant.

Source: IEEE Std 1057-2017, sine fits of three and four parameters. Differs from source: several signals share f,
harmonics, drift, and a covariance that allows for the real residuals: of unequal size, correlated, and common to all
signals where the time of a row is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...estimation.goodness import inflation
from ...rig.signals import even_grid

_ROUNDS = 8
_SETTLED = 1e-9  # relative change of the frequency that ends the iteration
_Z = 1.959963984540054  # 95 %, two sides
_DRIFT_CYCLES = 3.5  # least number of cycles from which a drift is separated from the waves
_DRIFT_ERRORS = 3.0  # standard errors from which on a drift is significant
NEARLY = 0.05  # share of a cycle that may be missing from a whole one
STRAYS = 4.0  # scatter of the settled cycles within which an early cycle counts as settled
SAME = 1e-3  # share of the swing below which cycles never count as different


class Signal(NamedTuple):
    """One quantity: time (s, rising), value, shape (n,) each."""

    time: np.ndarray
    value: np.ndarray

    def between(self, begin: float, end: float) -> Signal:
        """The samples from begin to end, s, the end not included."""
        inside = (self.time >= begin) & (self.time < end)
        return Signal(self.time[inside], self.value[inside])


@dataclass(frozen=True, eq=False)
class Ratio:
    """One complex amplitude over another."""

    value: complex  # the ratio
    covariance: np.ndarray  # of ln magnitude and phase (rad), shape (2, 2)

    @property
    def magnitude(self) -> float:
        return abs(self.value)

    @property
    def magnitude_ci95(self) -> tuple[float, float]:
        """95 % interval of the magnitude."""
        factor = float(np.exp(_Z * np.sqrt(self.covariance[0, 0])))
        return self.magnitude / factor, self.magnitude * factor

    @property
    def phase_margin(self) -> float:
        """Half of the 95 % interval of the phase, rad; at most half of the circle."""
        return float(min(_Z * np.sqrt(self.covariance[1, 1]), np.pi))


@dataclass(frozen=True, eq=False)
class Waves:
    """The result of a fit of waves."""

    frequency: float  # Hz
    middle: float  # reference time of the phases, s
    harmonics: int  # H
    amplitudes: Mapping[str, np.ndarray]  # of each signal, complex, shape (H,), in its unit
    offsets: Mapping[str, float]  # o of each signal
    outside: Mapping[str, float]  # share of each signal's power about offset and drift that is not in the fundamental
    in_harmonics: Mapping[str, np.ndarray]  # share that is in the 2nd to the Hth
    # covariances of the fundamentals' real and minus imaginary parts, shape (2 C, 2 C): from rows, from whole cycles
    covariances: tuple[np.ndarray, np.ndarray]

    def ratio(self, over: Mapping[str, float], under: Mapping[str, float]) -> Ratio:
        """Sum of the fundamentals in `over` with these factors, over that in `under`.

            d ln(sum p_c A_c / sum q_c A_c) = sum_c (p_c / P - q_c / Q) dA_c

        The wider of the two covariances is used: where cycles differ from each other, rows are not independent.
        """
        top, bottom = self._sum(over), self._sum(under)
        g = [over.get(name, 0.0) / top - under.get(name, 0.0) / bottom for name in self.amplitudes]
        # d ln = g (da - i db): its real part is g.real da + g.imag db, its imaginary part g.imag da - g.real db
        rows = np.array([[part for each in g for part in (each.real, each.imag)],
                         [part for each in g for part in (each.imag, -each.real)]])  # fmt: skip
        spreads = [rows @ covariance @ rows.T for covariance in self.covariances]
        return Ratio(top / bottom, max(spreads, key=np.trace))

    def _sum(self, factors: Mapping[str, float]) -> complex:
        return sum((factor * complex(self.amplitudes[name][0]) for name, factor in factors.items()), 0j)


@dataclass(frozen=True, eq=False)
class _Part:
    """A signal's linear least squares at one frequency."""

    columns: np.ndarray
    coefficients: np.ndarray
    residual: np.ndarray
    sd: float
    slope: np.ndarray  # dy/df
    amplitudes: np.ndarray


def fundamental(signal: Signal, frequency: float, middle: float, harmonics: int) -> complex:
    """Amplitude of a signal at a known frequency; offset, drift and harmonics are fitted too."""
    return complex(_part(signal, frequency, middle, harmonics, drifts=True).amplitudes[0])


def departure(signal: Signal, reference: Signal, frequency: float, harmonics: int) -> np.ndarray:
    """A signal less the waves fitted to a part of it; with a drift where that part has enough cycles.

    Args:
        reference: the part of the signal to which the waves are fitted.
    Returns:
        shape (N,), unit of the signal.
    """
    middle, span = 0.5 * float(reference.time[0] + reference.time[-1]), float(np.ptp(reference.time))
    drifts = span * frequency > _DRIFT_CYCLES
    part = _part(reference, frequency, middle, harmonics, drifts)
    columns = _columns(signal.time - middle, frequency, harmonics)
    if drifts:
        columns = _drifting(columns, signal.time - middle, span)
    return signal.value - columns @ part.coefficients


def fit_waves(signals: Mapping[str, Signal], frequency: float, harmonics: int = 1) -> Waves:
    """Fit all signals with one frequency.

    Args:
        signals: by name, each with more than 2 H + 2 samples and about two cycles or more.
        frequency: Hz, a guess within a fraction of 1 / duration.
        harmonics: H; the highest one needs two samples a cycle.
    """
    every = frozenset(signals)
    middle = 0.5 * (min(s.time[0] for s in signals.values()) + max(s.time[-1] for s in signals.values()))
    frequency, parts = _settled(signals, frequency, middle, harmonics, every)
    place, covariances = _covariances(signals, parts, frequency)
    slope = {name: (parts[name].coefficients[1], place[name] + 1) for name in signals}
    drifting = frozenset(n for n, (d, k) in slope.items() if abs(d) > _DRIFT_ERRORS * np.sqrt(covariances[0][k, k]))
    if drifting != every:
        frequency, parts = _settled(signals, frequency, middle, harmonics, drifting)
        place, covariances = _covariances(signals, parts, frequency)
    first = [place[name] + 1 + (name in drifting) + k for name in signals for k in (0, 1)]
    shares = {name: _shares(part) for name, part in parts.items()}
    return Waves(
        frequency,
        middle,
        harmonics,
        {name: part.amplitudes for name, part in parts.items()},
        {name: float(part.coefficients[0]) for name, part in parts.items()},
        {name: outside for name, (outside, _) in shares.items()},
        {name: each for name, (_, each) in shares.items()},
        (covariances[0][np.ix_(first, first)], covariances[1][np.ix_(first, first)]),
    )


def _settled(
    signals: Mapping[str, Signal], frequency: float, middle: float, harmonics: int, drifting: frozenset[str]
) -> tuple[float, dict[str, _Part]]:
    """Gauss-Newton in the frequency, all other parameters eliminated (variable projection); each signal is weighed by
    its own residual."""
    reach = 0.25 / max(np.ptp(signal.time) for signal in signals.values())
    parts = {n: _part(s, frequency, middle, harmonics, n in drifting) for n, s in signals.items()}
    for _ in range(_ROUNDS):
        pull = power = 0.0
        for part in parts.values():
            own = part.slope - part.columns @ _least_squares(part.columns, part.slope)
            pull += float(own @ part.residual) / part.sd**2
            power += float(own @ own) / part.sd**2
        step = float(np.clip(pull / power, -reach, reach)) if power > 0.0 else 0.0
        frequency += step
        parts = {n: _part(s, frequency, middle, harmonics, n in drifting) for n, s in signals.items()}
        if abs(step) < _SETTLED * frequency:
            break
    return frequency, parts


def _columns(t: np.ndarray, frequency: float, harmonics: int) -> np.ndarray:
    """1, cos, sin, cos 2, sin 2 ..., shape (n, 1 + 2 H)."""
    angle = 2.0 * np.pi * frequency * t[:, None] * np.arange(1, harmonics + 1)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(t.size, -1)
    return np.column_stack([np.ones(t.size), waves])


def _part(signal: Signal, frequency: float, middle: float, harmonics: int, drifts: bool) -> _Part:
    t = signal.time - middle
    columns = _columns(t, frequency, harmonics)
    rates = _rates(t, columns)
    if drifts:
        columns = _drifting(columns, t, float(np.ptp(t)))
    coefficients = _least_squares(columns, signal.value)
    residual = signal.value - columns @ coefficients
    waves = coefficients[-2 * harmonics :]
    spread = np.sqrt(np.sum(residual**2) / max(t.size - columns.shape[1], 1))
    sd = max(float(spread), 1e-10 * float(np.ptp(signal.value)), 1e-300)  # simulated data may have no noise
    return _Part(columns, coefficients, residual, sd, rates @ waves, waves[::2] - 1j * waves[1::2])


def _drifting(columns: np.ndarray, t: np.ndarray, span: float) -> np.ndarray:
    """The columns with that of the drift after that of the offset."""
    return np.insert(columns, 1, 2.0 * t / span, axis=1)


def _least_squares(columns: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares by the normal equations: over whole cycles the columns are nearly orthogonal."""
    return np.linalg.solve(columns.T @ columns, columns.T @ y)


def _rates(t: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Derivative of the waves' columns by the frequency: of cos it is -2 pi k t sin, of sin 2 pi k t cos."""
    order = np.arange(1, (columns.shape[1] + 1) // 2)
    rates = np.empty((t.size, 2 * order.size))
    rates[:, ::2] = -2.0 * np.pi * t[:, None] * order * columns[:, 2::2]
    rates[:, 1::2] = 2.0 * np.pi * t[:, None] * order * columns[:, 1::2]
    return rates


def _covariances(
    signals: Mapping[str, Signal], parts: Mapping[str, _Part], frequency: float
) -> tuple[dict[str, int], tuple[np.ndarray, np.ndarray]]:
    """For frequency and all coefficients: the index of each signal's first coefficient, and the sandwich covariances

        (J^T J)^-1 (sum_g s_g s_g^T) (J^T J)^-1,    s_g = sum_(rows of g) sqrt(f) J r

    over rows g, with f the inflation of each signal's correlated residuals, and over whole cycles g, the latter widened
    by the ratio of Student's t for that number of cycles to a normal distribution.

    Source: White 1980 (rows), Liang and Zeger 1986 (groups), Geyer 1992 (f).
    """
    from scipy import stats

    rows = np.unique(np.concatenate([signal.time for signal in signals.values()]))
    width = 1 + sum(part.columns.shape[1] for part in parts.values())
    normal, scores, plain = np.zeros((width, width)), np.zeros((rows.size, width)), np.zeros((rows.size, width))
    place, begin = {}, 1
    for name, part in parts.items():
        n, count = part.columns.shape
        jacobian = np.zeros((n, width))
        jacobian[:, 0] = part.slope
        jacobian[:, begin : begin + count] = part.columns
        jacobian /= part.sd
        r = part.residual / part.sd
        normal += jacobian.T @ jacobian
        at = np.searchsorted(rows, signals[name].time)
        each = jacobian * (r * np.sqrt(n / max(n - count, 1)))[:, None]
        plain[at] += each
        scores[at] += np.sqrt(inflation(r)) * each
        place[name], begin = begin, begin + count
    size = np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal / np.outer(size, size), hermitian=True) / np.outer(size, size)
    cycle = np.floor((rows - rows[0]) * frequency).astype(int)
    groups = np.zeros((cycle[-1] + 1, width))
    np.add.at(groups, cycle, plain)
    # Student's t allows for the uncertainty of the scatter of few cycles
    groups *= np.sqrt(len(groups) / max(len(groups) - 1, 1)) * stats.t.ppf(0.975, max(len(groups) - 1, 1)) / _Z
    return place, (inverse @ (scores.T @ scores) @ inverse, inverse @ (groups.T @ groups) @ inverse)


def _shares(part: _Part) -> tuple[float, np.ndarray]:
    """Shares of the power about offset and drift: outside the fundamental, and in each higher harmonic."""
    count = 2 * part.amplitudes.size
    waves, coefficients = part.columns[:, -count:], part.coefficients[-count:]
    rest = waves[:, 2:] @ coefficients[2:] + part.residual
    power = max(float(np.var(waves[:, :2] @ coefficients[:2] + rest)), 1e-300)
    return float(np.var(rest)) / power, 0.5 * np.abs(part.amplitudes[1:]) ** 2 / power


_PADDED = 8  # length of the padded transform over that of the setpoint, to find the frequency between the bins
_FEWEST = 4  # least number of samples to which a cycle is fitted


class Window(NamedTuple):
    """Part of a trace."""

    # begin, end: s
    begin: float
    end: float
    cycles: int  # number of whole cycles in it
    skipped: float  # number of cycles before it that were left out


def moving(setpoint: Signal) -> Signal:
    """A setpoint without the parts before and after its motion."""
    first = np.flatnonzero(setpoint.value != setpoint.value[0])
    last = np.flatnonzero(setpoint.value != setpoint.value[-1])
    if not first.size:
        return Signal(setpoint.time[:0], setpoint.value[:0])
    begin, end = max(int(first[0]) - 1, 0), min(int(last[-1]) + 1, setpoint.time.size - 1)
    return Signal(setpoint.time[begin : end + 1], setpoint.value[begin : end + 1])


def frequency_of(setpoint: Signal) -> float:
    """Frequency of the setpoint, Hz: the peak of its spectrum, refined by least squares."""
    time, step = even_grid(setpoint.time)
    even = np.interp(time, setpoint.time, setpoint.value)
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), _PADDED * even.size))
    rough = float(np.argmax(spectrum)) / (_PADDED * even.size * step)
    return fit_waves({"setpoint": setpoint}, rough).frequency


def common(setpoint: Signal, position: Signal) -> tuple[float, float]:
    """Begin and end of the time in which both were logged, including the step of the last sample, s."""
    last = min(float(s.time[-1] + np.median(np.diff(s.time))) for s in (setpoint, position))
    return max(float(setpoint.time[0]), float(position.time[0])), last


def settled(setpoint: Signal, position: Signal, frequency: float, harmonics: int) -> Window:
    """Whole cycles counted back from the end, without the first cycles that differ from the last half of them.

    A cycle differs where its mean and fundamental deviate from those of the last half by more than `STRAYS` times the
    root mean square deviation of the cycles of that half. The very first cycle is left out where three others remain: a
    transient below the noise of single samples may still be above that of their mean.

    Args:
        setpoint, position: two cycles or more of both.
        frequency: Hz.
        harmonics: H of the waves that are fitted to the last half.
    """
    begin, end = common(setpoint, position)
    count = int((end - begin) * frequency + NEARLY)
    edges = end - np.arange(count, -1, -1) / frequency
    first = max(_strays(signal, edges, frequency, harmonics) for signal in (setpoint, position))
    first = max(first, 1) if count > 3 else first
    return Window(float(edges[first]), end, count - first, (end - begin) * frequency - (count - first))


def _strays(signal: Signal, edges: np.ndarray, frequency: float, harmonics: int) -> int:
    """Number of cycles before the first one after which none differs."""
    half = max((edges.size - 1) // 2, 2)
    reference = signal.between(edges[-1 - half], edges[-1])
    residual = Signal(signal.time, departure(signal, reference, frequency, harmonics))
    sizes = np.array([_size(residual.between(a, b), frequency) for a, b in pairwise(edges)])
    scatter, swing = float(np.sqrt(np.mean(sizes[-half:] ** 2))), float(np.ptp(reference.value))
    limit = max(STRAYS * scatter, SAME * swing)
    return int(np.max(np.flatnonzero(sizes[:-half] > limit) + 1, initial=0))


def _size(cycle: Signal, frequency: float) -> float:
    """Size of mean and fundamental together; 0 in a gap."""
    if cycle.time.size < _FEWEST:
        return 0.0
    angle = 2.0 * np.pi * frequency * cycle.time
    columns = np.column_stack([np.ones(angle.size), np.cos(angle), np.sin(angle)])
    return float(np.linalg.norm(np.linalg.lstsq(columns, cycle.value, rcond=None)[0]))
