"""Reads R, L, k and the brushes' drop from windows of a trace by the circuit's equation, without a fit of the motion.

The detectors of this room (`constants`, `signs`, `bridge`, `clock`, `levels`, `lags`) compare these readings between
traces and rig tests, by way of `base.Records`.

    integral v dt = R integral i dt + L [i] + k [theta] + V_b integral sgn i dt

over windows of some samples, [x] being the change of x over the window. No signal is differentiated, so noise has
little influence, and the equation holds for any torque on the plate: with the plate held [theta] = 0, with open
terminals i = 0, with the gear apart theta is the motor's angle and k its K_b; at the plate k = N K_b. Robust least
squares: L over all windows, the others over windows without a jump of the voltage, because its instant within a sample
is unknown.

Source: integral of the paper's Eq. 1, with a voltage drop V_b of the brushes.

Is the logged current that of the motor, or one that was measured at another place or by another instrument?

    of the motor       i
    of the supply      i_s = d i,  d = v / V_s      so   i = i_s V_s / v
    without its sign   |i|                          so   i = |i| sgn(v - k w)

Each interpretation is put into the equation over the same windows, and the right one leaves the smallest residual.
Windows with almost no voltage are left out, because the duty d is zero there.

Source: Mohan, Undeland and Robbins 2003, ch. 7 (mean current of the source of a bridge). Differs from source: no.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .. import TEST_BY_NAME
from ..base import Channel, Measurement, RigConfig
from ..signals import BISQUARE, MAD_TO_SIGMA, drive_voltage, jumps, on_times, robust_fit

# samples in a window, the least number of them, and the number of windows of a short trace
SAMPLES, LEAST_SAMPLES, WINDOWS = 20, 5, 20
FEWEST = 12  # least number of windows for a reading
SEEN = 5.0  # least rms change over a window, in standard deviations of the noise
JUMP, JUMP_SHARE = 8.0, 0.02  # standard deviations of the noise, and share of the span: a larger change is a jump
ALIKE = 0.97  # correlation at which brushes and resistance cannot be separated
NEAR = 0.1  # share of the largest voltage below which windows are left out of the comparison of currents
ROUNDS = 3  # rounds in which the sign of the current and k are found together


class Value(NamedTuple):
    """A reading and its standard error, SI."""

    value: float
    error: float

    def sign(self, errors: float) -> int:
        """-1 or 1; 0 where the value is within so many standard errors of zero."""
        return 0 if abs(self.value) <= errors * self.error else (1 if self.value > 0.0 else -1)


def weighted_mean(values: Iterable[Value]) -> Value:
    """The mean of readings, each weighted by its error: sum(x / e^2) / sum(1 / e^2)."""
    value, error = np.array(list(values)).T
    weight = 1.0 / error**2
    whole = max(float(np.sum(weight)), 1e-300)  # not 0 where no reading has a finite error
    return Value(float(np.sum(weight * value)) / whole, whole**-0.5)


@dataclass(frozen=True, eq=False)
class Windows:
    """Integrals and changes over each window, SI, shape (n,) each."""

    volts: np.ndarray  # integral of the voltage, V s; with open terminals of the EMF
    amperes: np.ndarray  # integral of the current, A s
    rise: np.ndarray  # change of the current, A
    # change of the angle, rad: of the plate, or of the motor where the gear is apart; 0 with the plate held
    turn: np.ndarray
    brushes: np.ndarray  # integral of the current's sign, s
    seconds: np.ndarray  # length of the window, s
    calm: np.ndarray  # 1 where the voltage does not jump within the window, else 0
    noise: tuple[float, float]  # standard deviations of the noise of rise and turn

    def where(self, rows: np.ndarray) -> Windows:
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "noise"})


@dataclass(frozen=True)
class Circuit:
    """The values that windows show; None for a value that they do not show."""

    R: Value | None  # ohm; of the whole circuit
    L: Value | None  # H
    k: Value | None  # V s/rad; N K_b at the plate, K_b where the gear is apart
    drop: float  # V, at the brushes; 0 where it cannot be separated from R
    amperes: float  # typical current, rms, A


def read_circuit(traces: Sequence[Measurement], config: RigConfig) -> Circuit | None:
    """The circuit that these traces of one rig test show together; None where voltage or motion were not logged."""
    windows = joined(windows_of(trace, config) for trace in traces)
    return _solved(windows) if windows is not None else None


def joined(parts: Iterable[Windows | None]) -> Windows | None:
    """All windows of several traces; None where there are none."""
    there = [part for part in parts if part is not None]
    if not there:
        return None
    names = [f.name for f in fields(Windows) if f.name != "noise"]
    arrays = {name: np.concatenate([getattr(part, name) for part in there]) for name in names}
    return Windows(**arrays, noise=max(part.noise for part in there))


def windows_of(trace: Measurement, config: RigConfig) -> Windows | None:
    """The trace cut into windows; None where it lacks a channel that the equation needs, or is too short."""
    boundary = TEST_BY_NAME[trace.test].boundary
    emf = trace.channels.get("emf", trace.channels.get("voltage"))
    volts = emf if boundary.terminals_open else drive_voltage(trace, config)
    current = None if boundary.terminals_open else trace.channels.get("current")
    angle = None if boundary.plate_held else _angle(trace, boundary.gear_apart)
    if volts is None or (angle is None and not boundary.plate_held):
        return None
    if current is None and not boundary.terminals_open:
        return None
    return _cut(volts, current, angle)


def _angle(trace: Measurement, gear_apart: bool) -> Channel | None:
    """Angle of the plate, or of the motor alone from its speed, rad."""
    channel = trace.channels.get("motor_speed" if gear_apart else "position")
    if channel is None or not gear_apart:
        return channel
    step = float(np.median(np.diff(channel.time)))
    turned = _integral(channel.time, channel.value)
    return replace(channel, value=turned, sigma=channel.sigma * step * np.sqrt(SAMPLES))


def _cut(volts: Channel, current: Channel | None, angle: Channel | None) -> Windows | None:
    time = volts.time
    count = (time.size - 1) // int(np.clip(time.size // WINDOWS, LEAST_SAMPLES, SAMPLES))
    if count < 2:
        return None
    ends = np.linspace(0, time.size - 1, count + 1).astype(int)
    amperes = np.zeros(time.size) if current is None else on_times(current, time)
    turned = np.zeros(time.size) if angle is None else on_times(angle, time)
    threshold = 0.0 if current is None else SEEN * current.sigma
    sign = np.sign(amperes) * (np.abs(amperes) > threshold)
    passed = np.concatenate(([0], np.cumsum(jumps(volts, JUMP, JUMP_SHARE))))

    def gain(value: np.ndarray) -> np.ndarray:
        return np.diff(value[ends])

    whole = Windows(
        volts=gain(_integral(time, volts.value)),
        amperes=gain(_integral(time, amperes)),
        rise=gain(amperes),
        turn=gain(turned),
        brushes=gain(_integral(time, sign)),
        seconds=gain(time),
        calm=(gain(passed) == 0).astype(float),
        noise=(0.0 if current is None else current.sigma, 0.0 if angle is None else angle.sigma),
    )
    return whole if current is None else whole.where(gain(np.cumsum(_in_gaps(current.time, time))) == 0.0)


def _in_gaps(logged: np.ndarray, time: np.ndarray) -> np.ndarray:
    """1 at instants around which a channel has no sample for three of its intervals, shape (n,)."""
    steps = np.concatenate(([np.inf], np.diff(logged), [np.inf]))
    about = np.minimum(np.searchsorted(logged, time), steps.size - 1)
    inside = (time > logged[0]) & (time < logged[-1])
    ends = np.minimum(np.abs(time - logged[0]), np.abs(time - logged[-1]))
    usual = 3.0 * float(np.median(np.diff(logged))) if logged.size > 1 else 0.0
    return np.where(inside, steps[about] > usual, ends > usual).astype(float)


def _integral(time: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Integral from the first sample by trapezoids, shape as `value`."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (value[1:] + value[:-1]) * np.diff(time))))


def excess(traces: Sequence[Measurement], config: RigConfig, drop: float) -> Value | None:
    """R of these traces' circuit, the brushes' drop (V) being known from another test; None where it is unknown."""
    w = joined(windows_of(trace, config) for trace in traces)
    if w is None:
        return None
    found = _solved(replace(w, volts=w.volts - drop * w.brushes, brushes=np.zeros_like(w.brushes)))
    return found.R if found is not None else None


def left_by(values: Mapping[str, Value], w: Windows) -> np.ndarray:
    """The part of the voltage in each window that these values do not explain, V, shape (n,)."""
    columns = {"R": w.amperes, "L": w.rise, "k": w.turn, "drop": w.brushes}
    return (w.volts - sum(value.value * columns[name] for name, value in values.items())) / w.seconds


def _solved(w: Windows) -> Circuit | None:
    whole, calm = values_of(w), values_of(w.where(w.calm > 0.0))
    if whole is None or calm is None:
        return None
    typical = float(np.sqrt(np.mean(w.amperes**2) / np.mean(w.seconds**2)))
    drop = calm["drop"].value if "drop" in calm else 0.0
    return Circuit(calm.get("R"), whole.get("L"), calm.get("k"), drop, typical)


def values_of(w: Windows) -> dict[str, Value] | None:
    """Those of R, L, k and drop that these windows show; None where there are too few windows."""
    columns = {"R": w.amperes} if np.any(w.amperes) else {}
    for name, gain, noise in (("L", w.rise, w.noise[0]), ("k", w.turn, w.noise[1])):
        if gain.size and np.sqrt(np.mean(gain**2)) > SEEN * noise and np.any(gain):
            columns[name] = gain
    both = np.sqrt(np.sum(w.amperes**2) * np.sum(w.brushes**2))
    if "R" in columns and both > 0.0 and abs(np.sum(w.amperes * w.brushes)) < ALIKE * both:
        columns["drop"] = w.brushes
    if w.volts.size < max(FEWEST, 3 * len(columns)) or not columns:
        return None
    return _least_squares(columns, w.volts)


def _least_squares(columns: dict[str, np.ndarray], right: np.ndarray) -> dict[str, Value]:
    """Coefficients with standard errors from the scatter of the windows that were not rejected as outliers."""
    scale = np.array([np.sqrt(np.mean(c**2)) for c in columns.values()])
    rows = np.column_stack(list(columns.values())) / scale
    solution = robust_fit(rows, right)
    residual = right - rows @ solution
    spread = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
    kept = rows[np.abs(residual) <= max(BISQUARE * spread, 1e-300)]
    covariance = spread**2 * np.linalg.pinv(kept.T @ kept)
    errors = np.sqrt(np.diag(covariance))
    return {
        name: Value(float(x), float(e)) for name, x, e in zip(columns, solution / scale, errors / scale, strict=True)
    }


@dataclass(frozen=True, eq=False)
class OtherCurrent:
    """The windows of one rig test for three interpretations of its current."""

    motor: Windows  # windows with the current as logged
    supply: Windows  # windows with the motor's current if the supply's was logged, for a supply of `volts`
    volts: float  # voltage of the supply; 1 where it is unknown: R is then not in ohm

    @cached_property
    def sign(self) -> np.ndarray:
        """Sign of the motor's current in each window, if the log lost it, shape (n,)."""
        sign = np.sign(self.motor.volts)
        for _ in range(ROUNDS):
            values = values_of(_signed(self.motor, sign)) or {}
            sign = np.sign(self.motor.volts - (values["k"].value if "k" in values else 0.0) * self.motor.turn)
        return sign

    @cached_property
    def unsigned(self) -> Windows:
        """Windows with the motor's current, if the log lost its sign."""
        return _signed(self.motor, self.sign)

    def better(self, other: Windows, part: float, rows: np.ndarray | None = None) -> tuple[float, Value] | None:
        """Factor by which another interpretation reduces the unexplained voltage, and its R; None where it is no motor.

        Args:
            other: the windows with that interpretation.
            part: quantile of the unexplained voltages that is compared.
            rows: windows in which they are compared; None: all.
        """
        motor = self.motor if np.any(other.brushes) else _signed(self.motor, np.ones(self.motor.volts.size))
        as_logged, values = values_of(motor), values_of(other)
        if as_logged is None or values is None or "R" not in values:
            return None
        if values["R"].sign(2.0) <= 0 or ("k" in values and values["k"].sign(2.0) < 0):
            return None
        there = np.ones(other.volts.size, dtype=bool) if rows is None else rows
        left = [np.quantile(np.abs(left_by(v, w)[there]), part) for v, w in ((as_logged, motor), (values, other))]
        return float(left[0] / max(left[1], 1e-12)), values["R"]


def _signed(w: Windows, sign: np.ndarray) -> Windows:
    """The windows with a sign of the current, without brushes: a drop with the voltage's sign would explain a held
    voltage alone."""
    return replace(w, amperes=sign * w.amperes, rise=sign * w.rise, brushes=np.zeros_like(w.brushes))


def other_current(traces: Sequence[Measurement], config: RigConfig) -> OtherCurrent | None:
    """The current of one rig test in each interpretation; None for too few windows."""
    if TEST_BY_NAME[traces[0].test].boundary.terminals_open:
        return None
    drives = {t.file: v for t in traces if "current" in t.channels and (v := drive_voltage(t, config)) is not None}
    having = [t for t in traces if t.file in drives]
    least = NEAR * max((float(np.max(np.abs(v.value))) for v in drives.values()), default=0.0)
    if least == 0.0:
        return None
    volts = supply_of(having, config) or 1.0

    def divided(i: np.ndarray, v: np.ndarray) -> np.ndarray:
        return i * volts / np.where(np.abs(v) < least, least, v)

    small = _windows(having, drives, config, lambda i, v: (np.abs(v) < least).astype(float))
    motor, supply = (_windows(having, drives, config, read) for read in (lambda i, v: i, divided))
    if small is None or motor is None or supply is None:
        return None
    rows = (small.amperes == 0.0) & (small.calm > 0.0)
    return OtherCurrent(motor.where(rows), supply.where(rows), volts) if rows.sum() >= FEWEST else None


def supply_of(traces: Sequence[Measurement], config: RigConfig) -> float | None:
    """Voltage of the supply, logged or in rig.toml, V; None where it is unknown."""
    logged = [float(np.median(t.channels["supply"].value)) for t in traces if "supply" in t.channels]
    return float(np.median(logged)) if logged else config.supply_V


def _windows(
    traces: Sequence[Measurement],
    drives: Mapping[str, Channel],
    config: RigConfig,
    read: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> Windows | None:
    """Windows of all traces with a function of current and voltage in place of the current."""
    parts = []
    for trace in traces:
        current = trace.channels["current"]
        value = read(current.value, on_times(drives[trace.file], current.time))
        changed = replace(trace, channels={**trace.channels, "current": replace(current, value=value)})
        parts.append(windows_of(changed, config))
    return joined(parts)
