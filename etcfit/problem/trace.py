"""A measurement prepared for the model: its input, its observed channels, and its initial state."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..rig import TEST_BY_NAME
from ..rig.base import AbstractRigTest, Measurement, RigConfig
from .input_signal import InputSignal, commanded, input_of
from .setpoint import Setpoint


@dataclass(frozen=True, eq=False)
class InitialState:
    """State at the first instant and its uncertainty."""

    state: tuple[float, float, float]  # current (A), angle (rad), speed (rad/s)
    sd: tuple[float, float, float]  # their standard deviations, same units; 0 if known exactly, as on a stop


@dataclass(frozen=True, eq=False)
class Trace:
    """One measurement, prepared for the model."""

    measurement: Measurement  # the measurement as read
    test: AbstractRigTest  # its rig test
    instants: Float[np.ndarray, " n"]  # instants of its samples, s, shape (n,)
    input: InputSignal | None  # its input; None with open terminals
    channels: tuple[str, ...]  # M names of observed channels
    data: Float[np.ndarray, "n M"]  # samples, SI, shape (n, M); NaN where nothing was logged
    sigma: Float[np.ndarray, " M"]  # standard deviation of the noise of one sample, SI, shape (M,)
    start: InitialState  # initial state
    # instant of the held plate's release and its standard deviation, s; None: free from the start
    release: tuple[float, float] | None
    # setpoint of the ECU of rig.toml in the model; None if no such ECU drives the plate
    setpoint: Setpoint | None = None

    @property
    def controlled(self) -> bool:
        """Whether the ECU of rig.toml drives the plate in the model."""
        return self.setpoint is not None

    @property
    def torque_driven(self) -> bool:
        """Whether a torque was logged as the input; then there is no electrical side."""
        return self.input is not None and "torque" in self.measurement.channels

    @property
    def sags(self) -> bool:
        """Whether the input is a duty with a supply that was not logged."""
        return self.input is not None and self.input.held and "supply" not in self.measurement.channels

    @property
    def circuit(self) -> bool:
        """Whether current can flow."""
        return self.input is not None and not self.torque_driven

    @property
    def logged(self) -> frozenset[str]:
        """The channels that the model predicts, "voltage" or "torque" if it is the input, and "duty" if the voltage is
        a duty times a supply that was not logged."""
        driven = {"voltage"} if self.circuit else {"torque"} if self.torque_driven else set()
        return frozenset({*self.channels, *driven, *({"duty"} if self.sags else ())})

    def released_at(self, instant: float, sd: float) -> Trace:
        """The trace with another release instant and its standard deviation, s."""
        return replace(self, release=(instant, sd))

    def with_jumps_at(self, share: float) -> Trace:
        """The trace with each jump of its setpoint read at a share of its window; itself without such an ECU."""
        return self if self.setpoint is None else replace(self, setpoint=self.setpoint.with_jumps_at(share))

    def with_jumps_placed(self, paths: Sequence[Float[np.ndarray, "n M"]]) -> Trace:
        """The trace with each jump of its setpoint read at the instant that best fits its angle, see
        `Setpoint.placed`."""
        if self.setpoint is None or "position" not in self.channels:
            return self
        m = self.channels.index("position")
        placed = self.setpoint.placed(self.data[:, m], float(self.sigma[m]), [path[:, m] for path in paths])
        return replace(self, setpoint=placed)

    def holding(self, volts: float) -> Trace:
        """The trace with another initial voltage (V) in the integral of the ECU in the model; itself without such an
        ECU."""
        if self.input is None or not self.controlled:
            return self
        return replace(self, input=replace(self.input, value=np.full(self.instants.size, volts)))


def by_test(traces: Iterable[Trace]) -> dict[str, frozenset[str]]:
    """The logged channels of each rig test."""
    found: dict[str, frozenset[str]] = {}
    for trace in traces:
        found[trace.test.name] = found.get(trace.test.name, frozenset()) | trace.logged
    return found


_LEAST_OHM = 1.0  # least resistance of a winding
_BEYOND_NOISE = 4.0  # standard deviations above which a value is significant
_STRAIGHT = 1.5  # standard deviations up to which samples on a line show no bend
_HIGHEST = 5  # highest power of a polynomial
_BENT = 4.0  # largest misfit of a polynomial, variances per degree of freedom
_FEW = 6  # samples to use if a plate oscillates within ten
_STEADY = 6.0  # largest range of the first samples of a steady current, in units of the noise

_NOWHERE = InitialState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def prepare(measurement: Measurement, config: RigConfig) -> Trace | None:
    """Prepare a trace: input, samples, initial state, release.

    Returns:
        None if the model cannot predict it: no input was logged, or nothing was observed.
    """
    test = TEST_BY_NAME[measurement.test]
    instants = measurement.time
    signal = None if test.boundary.terminals_open else input_of(measurement, config, instants)
    setpoint = None
    if signal is None and follows_setpoint(measurement) and config.ecu is not None:
        signal, setpoint = (
            commanded(instants, config.ecu.supply),
            Setpoint.of_measurement(measurement, config.ecu.period),
        )
    channels = _observed(measurement, test, signal)
    if not channels or (signal is None and not test.boundary.terminals_open):
        return None
    data = np.stack([_at(instants, measurement, name) for name in channels], axis=1)
    sigma = np.array([measurement.channels[_source(measurement, name)].error for name in channels], dtype=float)
    trace = Trace(measurement, test, instants, signal, channels, data, sigma, _NOWHERE, None, setpoint)
    start = _start(trace, config)
    release = _release(trace) if test.boundary.released else None
    if release is not None:
        start = InitialState((0.0, start.state[1], 0.0), (0.0, start.sd[1], 0.0))
    return replace(trace, start=start, release=release)


def follows_setpoint(measurement: Measurement) -> bool:
    """Whether a setpoint and the resulting angle were logged, at closed terminals."""
    logged = {"setpoint", "position"} <= set(measurement.channels)
    return logged and not TEST_BY_NAME[measurement.test].boundary.terminals_open


def _source(measurement: Measurement, name: str) -> str:
    """The logged channel of a name: with open terminals the logged terminal voltage is the EMF."""
    return "voltage" if name == "emf" and "emf" not in measurement.channels else name


def _observed(measurement: Measurement, test: AbstractRigTest, signal: InputSignal | None) -> tuple[str, ...]:
    names = [name for name in test.observes if name in measurement.channels]
    if test.boundary.terminals_open and "voltage" in measurement.channels and "emf" not in names:
        names.insert(0, "emf")
    if not test.boundary.terminals_open and "torque" in measurement.channels:
        names = [name for name in names if name in ("position", "motor_speed")]
    return tuple(names)


def _at(instants: Float[np.ndarray, " n"], measurement: Measurement, name: str) -> Float[np.ndarray, " n"]:
    channel = measurement.channels[_source(measurement, name)]
    row = np.full(instants.size, np.nan)
    row[np.searchsorted(instants, channel.time)] = channel.value
    return row


def _first(trace: Trace, name: str, count: int) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]] | None:
    """Times and values of the first samples of a channel."""
    if name not in trace.channels:
        return None
    column = trace.data[:, trace.channels.index(name)]
    rows = np.flatnonzero(np.isfinite(column))[:count]
    return trace.instants[rows] - trace.instants[0], column[rows]


class _Begin(NamedTuple):
    """Initial value and slope of a channel, in its SI unit (and per second)."""

    level: float  # value at the first instant
    slope: float  # slope there
    slope_sd: float  # standard deviation of the slope
    top: float = 0.0  # coefficient of the fitted polynomial's highest power, in its standard deviations
    misfit: float = 0.0  # sum of squared residuals over their variance, per degree of freedom

    @property
    def moves(self) -> bool:
        """Whether the slope is significant."""
        return abs(self.slope) > _BEYOND_NOISE * self.slope_sd


def _beginning(t: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"], sigma: float) -> _Begin:
    """Initial value and slope of samples with noise sigma: exactly at rest if neither the slope of a line nor a bend is

    significant. Otherwise a polynomial one power above the highest significant one, because terms hidden in the noise
    change the slope at the end; only through the first few samples if it does not fit the others. Without any bend the
    line itself: its slope has a quarter of the error.
    """
    if y.size < 3:
        return _Begin(float(y[0]), 0.0, 0.0)
    each = [_polynomial(t, y, sigma, k) for k in range(1, min(_HIGHEST, y.size - 1) + 1)]
    needed = [k for k, line in enumerate(each) if line.top > _BEYOND_NOISE]
    if not needed:
        return _Begin(float(y.mean()), 0.0, 0.0)
    found, above = each[needed[-1]], each[min(needed[-1] + 1, len(each) - 1)]
    if needed == [0] and all(line.top < _STRAIGHT for line in each[1:3]):
        return found._replace(slope_sd=float(np.hypot(found.slope_sd, above.slope - found.slope)))
    return _beginning(t[:_FEW], y[:_FEW], sigma) if above.misfit > _BENT and y.size > _FEW else above


def _polynomial(t: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"], sigma: float, degree: int) -> _Begin:
    """A polynomial of one degree, by least squares."""
    span, freedom = float(t[-1] - t[0]), max(1, y.size - degree - 1)
    powers = np.vander((t - t[0]) / span, degree + 1, increasing=True)
    found = np.linalg.lstsq(powers, y, rcond=None)[0]
    sd = sigma * np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    misfit = float(np.sum((y - powers @ found) ** 2)) / sigma**2 / freedom
    return _Begin(float(found[0]), float(found[1] / span), float(sd[1] / span), float(abs(found[-1]) / sd[-1]), misfit)


def _start(trace: Trace, config: RigConfig) -> InitialState:
    sigma = dict(zip(trace.channels, trace.sigma, strict=True))
    i, i_sd, theta, theta_sd, omega, omega_sd = (0.0,) * 6
    if (first := _first(trace, "current", 3)) is not None:
        steady = float(np.ptp(first[1])) < _STEADY * sigma["current"]  # else there is an edge at the first sample
        i = float(np.mean(first[1]) if steady else first[1][0])
        i_sd = 3.0 * sigma["current"] + 0.1 * abs(i)
    elif trace.controlled and trace.input is not None:  # as uncertain as the voltage that drives it
        i_sd = float(trace.input.error[0]) / _LEAST_OHM
    if (first := _first(trace, "position", 10)) is not None:
        begin = _beginning(*first, sigma["position"])
        theta, omega, omega_sd, *_ = begin
        theta_sd = 3.0 * sigma["position"]
        for stop in config.travel:  # driven from the first sample on, the angle bends, and its slope is no speed
            if not begin.moves and abs(theta - stop) < 2.0 * sigma["position"]:
                theta, theta_sd, omega, omega_sd = float(stop), 0.0, 0.0, 0.0
    if trace.test.boundary.gear_apart and (first := _first(trace, "motor_speed", 5)) is not None:
        omega, omega_sd = float(np.mean(first[1])) / config.gear_ratio, sigma["motor_speed"] / config.gear_ratio
    if trace.test.boundary.plate_held:
        omega, omega_sd = 0.0, 0.0
    if not trace.circuit:
        i, i_sd = 0.0, 0.0
    return InitialState((i, theta, omega), (i_sd, theta_sd, omega_sd))


def _release(trace: Trace) -> tuple[float, float] | None:
    """The release of the plate: its speed grows in proportion to time, so the EMF's rise, or without an EMF the square
    root of the angle's fall, is extrapolated back to zero. None if the plate moves from the first sample."""
    if _moves_at_once(trace):
        return None
    rise, t = _rising(trace)
    top = int(np.argmax(rise))
    span = (rise > 0.1 * rise[top]) & (rise < 0.4 * rise[top]) & (np.arange(rise.size) < top)
    if span.sum() < 3:
        return None
    slope, level = np.polyfit(t[span], rise[span], 1)
    instant = -level / slope
    dt = float(np.median(np.diff(t)))
    if not slope > 0.0 or instant <= t[0] + dt:
        return None
    return float(instant), max(2.0 * dt, 1e-3)


def _moves_at_once(trace: Trace) -> bool:
    """Whether the log begins after the release: the angle already falls, or the EMF is not zero and changes.

    A constant EMF is the zero of its channel.
    """
    falls, rises = (_first(trace, name, 10) for name in ("position", "emf"))
    if falls is not None and _beginning(*falls, _sigma_of(trace, "position")).moves:
        return True
    if rises is None:
        return False
    sigma = _sigma_of(trace, "emf")
    return bool(abs(np.median(rises[1])) > 4.0 * sigma) and _beginning(*rises, sigma).moves


def _sigma_of(trace: Trace, name: str) -> float:
    return float(trace.sigma[trace.channels.index(name)])


def _rising(trace: Trace) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    name = "emf" if "emf" in trace.channels else "position"
    column = trace.data[:, trace.channels.index(name)]
    rows = np.flatnonzero(np.isfinite(column))
    signal = column[rows] - np.median(column[rows[:10]])
    width = max(1, rows.size // 100)
    signal = moving_mean(np.abs(signal), width)
    return (signal if name == "emf" else np.sqrt(signal)), trace.instants[rows]


def moving_mean(value: Float[np.ndarray, " k"], width: int) -> Float[np.ndarray, " k"]:
    """Mean over `width` samples about each, unit and shape of the value; zeros beyond its ends.

    By running sums, because a log may be very long.
    """
    before = width // 2
    sums = np.cumsum(np.pad(value, (before + 1, width - 1 - before)))
    return (sums[width:] - sums[:-width]) / width
