"""What a bench logs of the truth: white noise, an ADC's steps, a clock that jitters, a coarse time column."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .effects import NONE, Effects
from .simulate import Motion
from .truth import OPEN

CLOSED_V, OPEN_V = 0.45, 4.73  # the paper's TPS, Table 1
RPM = 60 / (2 * math.pi)

# unit a column is logged in -> (logged per sensor unit, decimals written)
UNITS: dict[str, tuple[float, int]] = {
    "V": (1.0, 5),
    "mV": (1e3, 2),
    "A": (1.0, 5),
    "mA": (1e3, 2),
    "rpm": (1.0, 0),
    "s": (1.0, 6),
    "ms": (1e3, 3),
    "deg": (180 / math.pi, 4),
    "%": (1e2, 3),
}


@dataclass(frozen=True)
class Sensor:
    """Reads value + sigma * white noise, rounded to whole steps."""

    quantity: str  # name of its column
    unit: str  # of sigma and step
    sigma: float  # standard deviation of the noise before the ADC
    step: float  # of the ADC

    @property
    def declared(self) -> float:
        """Noise after the ADC: sqrt(sigma^2 + step^2 / 12)."""
        return math.hypot(self.sigma, self.step / math.sqrt(12))

    def read(self, rng: np.random.Generator, true: np.ndarray) -> np.ndarray:
        """One reading of each true value, in this sensor's unit."""
        return self.step * np.round((true + self.sigma * rng.standard_normal(true.shape)) / self.step)


def _sensors() -> dict[str, Sensor]:
    listed = (
        Sensor("voltage", "V", 0.010, 30 / 2**14),
        Sensor("current", "A", 0.008, 20 / 2**12),
        Sensor("tps", "V", 0.003, 5 / 2**12),
        Sensor("emf", "V", 0.010, 20 / 2**12),
        Sensor("motor_speed", "rpm", 10.0, 1.0),
    )
    return {sensor.quantity: sensor for sensor in listed}


@dataclass(frozen=True)
class Bench:
    """The instruments of one bench."""

    sensors: dict[str, Sensor] = field(default_factory=_sensors)  # by quantity
    jitter: float = 0.01  # of the true sampling instants about the logged times, in sample periods, rms
    time_step: float = 1e-6  # resolution of the time column, s
    rise: float = 0.0  # time the amplifier takes for a voltage jump, s
    series_ohm: float = 1.218  # harness and shunt in the inductance test, ohm (the paper's R_t - R_a is 1.218)
    supply: float = 12.0  # V
    # None: the voltage jumps at any instant; else so many sample periods before the first sample that shows it, one
    # clock driving output and logger
    edge_phase: float | None = None
    # the same as a time, s. A nanosecond before a sample, which shows it, is on that sample; so is 0 or a nanosecond
    # after it (-1e-9), but the sample does not show it yet.
    edge_lead: float | None = None
    # None: the responses' terminal voltage is logged; else the duty of a bridge in its place, fed by a supply of that
    # resistance, which nobody logs
    supply_ohm: float | None = None

    def edge_place(self, rate: float) -> float | None:
        """Sample periods of a clock of `rate` Hz by which a jump comes before a sample; None: at any instant."""
        return self.edge_phase if self.edge_lead is None else self.edge_lead * rate


PERFECT = Bench(
    {name: Sensor(name, sensor.unit, 0.0, 1e-9) for name, sensor in _sensors().items()}, jitter=0.0, time_step=1e-9
)


@dataclass(frozen=True)
class Clock:
    """The times a logger writes and the instants at which it really samples, s."""

    logged: np.ndarray
    true: np.ndarray


def clock(rng: np.random.Generator, bench: Bench, rate: float, duration: float) -> Clock:
    """Samples at `rate` Hz for `duration` s; the true instants scatter, the logged ones are rounded."""
    count = math.ceil(duration * rate)
    scatter = np.clip(bench.jitter * rng.standard_normal(count), -0.4, 0.4)
    nominal = np.arange(count) / rate
    logged = bench.time_step * np.round(nominal / bench.time_step)
    return Clock(logged, np.maximum(nominal + scatter / rate, 0.0))


def true_values(
    quantity: str, motion: Motion, emf_constant: float, gear_ratio: float, effects: Effects = NONE
) -> np.ndarray:
    """What a noiseless sensor of this quantity would read, in the sensor's unit."""
    match quantity:
        case "voltage":
            return motion.voltage
        case "current":
            return motion.current
        case "tps":
            return CLOSED_V + (OPEN_V - CLOSED_V) * wiper(effects, motion.sensed) / OPEN
        case "emf":
            return emf_constant * motion.motor_speed
        case "motor_speed":
            return gear_ratio * motion.motor_speed * RPM
    raise ValueError(f"no sensor for {quantity}")


def wiper(effects: Effects, angle: np.ndarray) -> np.ndarray:
    """Angle that the potentiometer shows, with what bends its track and where it is worn, rad."""
    bend, spot = effects.position_sensor_nonlinearity, effects.sensor_dead_spot
    if effects.sensor_hysteresis.play > 0.0:
        angle = _within_play(angle, 0.5 * effects.sensor_hysteresis.play)
    if spot.width > 0.0:
        angle = _held_over(angle, spot.angle - 0.5 * spot.width, spot.angle + 0.5 * spot.width)
    if bend.bow == 0.0 and bend.wave == 0.0:
        return angle
    share = angle / OPEN
    return angle + bend.bow * np.sin(np.pi * share) + bend.wave * np.sin(2 * np.pi * share)


def _within_play(angle: np.ndarray, half: float) -> np.ndarray:
    """What is dragged along by a driver that has so much play to either side; it begins in the middle."""
    shown, at = np.empty_like(angle), angle[0]
    for k, driver in enumerate(angle):
        at = min(max(at, driver - half), driver + half)
        shown[k] = at
    return shown


def _held_over(angle: np.ndarray, low: float, high: float) -> np.ndarray:
    """Within the band, the edge at which it was entered; a trace that begins within it shows the lower one."""
    inside = (angle > low) & (angle < high)
    last = np.maximum.accumulate(np.where(inside, -1, np.arange(len(angle))))
    edge = np.where((last >= 0) & (angle[last] >= high), high, low)
    return np.where(inside, edge, angle)


@dataclass(frozen=True)
class CurrentChannel:
    """How one trace's current is logged: so much late (s), so much off (A)."""

    late: float
    offset: float

    def instants(self, true: np.ndarray, start: float) -> np.ndarray:
        """When the rows' currents were really sampled, s; never before the start, and rising."""
        return np.maximum(true - self.late, start + 1e-9 * np.arange(1, len(true) + 1))


def current_channel(rng: np.random.Generator, effects: Effects) -> CurrentChannel:
    """Drawn anew for each trace."""
    late, off = effects.channel_delay, effects.current_sensor_offset
    return CurrentChannel(_scattered(rng, late.time, late.scatter), _scattered(rng, off.amps, off.scatter))


def _scattered(rng: np.random.Generator, value: float, relative: float) -> float:
    return value * (1.0 + relative * rng.standard_normal()) if value != 0.0 else 0.0
