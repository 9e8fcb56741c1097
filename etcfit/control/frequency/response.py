"""The frequency response measured by sine traces, compared with the fitted model and its linear plant.

The ECU's gains need not be known: where its drive was logged, each trace shows C = drive / (setpoint - position), and
the closed loop of a plant P under that ECU is

    T = C P / (1 + C P).

With the measured P this is the measured T; with another P it is the loop around that plant.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import MeasurementError
from ...estimation.fitted_model import Fitted
from ...model.linear import TransferFunction
from ...problem.problem import EstimationProblem
from ...problem.trace import prepare
from ...rig.base import Measurement, RigConfig
from ...rig.signals import drive_voltage
from ..linearise import linear_plant
from ..settings import FrequencySettings
from .lag import Order, order_of
from .wave import NEARLY, Ratio, Signal, Waves, Window, common, fit_waves, frequency_of, fundamental, moving, settled

SETPOINT, POSITION, DRIVE = "setpoint", "position", "drive"
_HARMONICS = 7  # most harmonics that are fitted, including the fundamental
OUTSIDE_LOW = 0.01  # largest share of the setpoint's power in its 2nd to 5th harmonic


@dataclass(frozen=True, eq=False)
class Point:
    """The response at one frequency."""

    measurement: Measurement  # the trace
    window: Window  # the part of it that is used
    waves: Waves  # of setpoint and position (rad), and of the drive (V) where one was logged
    noise: float  # share of sensor noise in the power of the position

    @property
    def frequency(self) -> float:
        """Hz."""
        return self.waves.frequency

    @property
    def amplitude(self) -> float:
        """Amplitude of the position, rad."""
        return float(abs(self.waves.amplitudes[POSITION][0]))

    @property
    def closed_loop(self) -> Ratio:
        """Position over setpoint."""
        return self.waves.ratio({POSITION: 1.0}, {SETPOINT: 1.0})

    @property
    def plant(self) -> Ratio | None:
        """Position over drive, rad/V; None without a drive."""
        return self.waves.ratio({POSITION: 1.0}, {DRIVE: 1.0}) if DRIVE in self.waves.amplitudes else None

    @property
    def controller(self) -> Ratio | None:
        """Drive over setpoint - position, V/rad: the controller in the trace; None without a drive."""
        if DRIVE not in self.waves.amplitudes:
            return None
        return self.waves.ratio({DRIVE: 1.0}, {SETPOINT: 1.0, POSITION: -1.0})


def point_of(trace: Measurement, config: RigConfig, settings: FrequencySettings = FrequencySettings()) -> Point:
    """Fit one sine to setpoint, position and drive of a trace.

    Raises:
        MeasurementError: the trace has no setpoint or position, too few cycles or samples, or its setpoint is no sine.
    """
    channels = _channels(trace, config, settings)
    wanted, position = moving(channels[SETPOINT]), channels[POSITION]
    if wanted.time.size < 2 * settings.fewest_cycles:
        found = f"the setpoint moves in {wanted.time.size} samples only."
        raise _unfit(trace, settings, found, "Log the sine for longer.")
    frequency = frequency_of(wanted)
    begin, end = common(wanted, position)
    cycles = (end - begin) * frequency
    if cycles < settings.fewest_cycles - NEARLY:
        raise _unfit(trace, settings, f"{max(cycles, 0.0):.2g} cycles of {frequency:.3g} Hz.",
                     f"Log it for {settings.fewest_cycles / frequency:.2g} s or longer.")  # fmt: skip
    # the number of harmonics of which the slowest logged signal has 2.5 samples a cycle
    step = max(float(np.median(np.diff(signal.time))) for signal in channels.values())
    count = int(np.clip(1.0 / (2.5 * frequency * step), 1, _HARMONICS))
    window = settled(wanted, position, frequency, count)
    parts = {name: signal.between(window.begin, window.end) for name, signal in channels.items()}
    for name, signal in parts.items():
        density = signal.time.size / window.cycles
        if density < settings.samples_a_cycle:
            found = f"{density:.2g} samples a cycle of the {name}."
            raise _unfit(trace, settings, found, "Log it faster, or without gaps.")
    waves = fit_waves(parts, frequency, count)
    outside, low = waves.outside[SETPOINT], float(np.sum(waves.in_harmonics[SETPOINT][:4]))
    if outside > settings.outside or low > OUTSIDE_LOW:
        raise _unfit(trace, settings, f"the setpoint is no sine: {100.0 * outside:.2g} % of its power lies outside "
                     f"{waves.frequency:.3g} Hz, {100.0 * low:.2g} % in the 2nd to 5th harmonic.",
                     "Log the response to a sine, or move the file to closed_loop/.")  # fmt: skip
    power = float(np.var(parts[POSITION].value))
    return Point(trace, window, waves, trace.channels["position"].sigma ** 2 / power if power else math.inf)


def _channels(trace: Measurement, config: RigConfig, settings: FrequencySettings) -> dict[str, Signal]:
    """Setpoint, position and drive; a duty, which an ECU holds until the next sample, is delayed by half a step."""
    for name in (SETPOINT, POSITION):
        if name not in trace.channels:
            raise _unfit(trace, settings, f"no {name} among {', '.join(trace.channels)}.",
                         f"Add the column '{name} [deg]', or map its header under [columns].")  # fmt: skip
    logged = {name: trace.channels[name] for name in (SETPOINT, POSITION)}
    signals = {name: Signal(channel.time, channel.value) for name, channel in logged.items()}
    drive = drive_voltage(trace, config)
    if drive is None or float(np.ptp(drive.value)) == 0.0:
        return signals
    held = 0.0 if "voltage" in trace.channels else 0.5 * float(np.median(np.diff(drive.time)))
    return signals | {DRIVE: Signal(drive.time + held, drive.value)}


def _unfit(trace: Measurement, settings: FrequencySettings, found: str, mend: str) -> MeasurementError:
    required = (f"A frequency response needs setpoint and position over {settings.fewest_cycles} cycles or more, "
                f"{settings.samples_a_cycle:g} samples a cycle, and a setpoint with at most "
                f"{100.0 * settings.outside:g} % of its power outside one frequency ({100.0 * OUTSIDE_LOW:g} "
                "% in its 2nd to 5th harmonic).")  # fmt: skip
    return MeasurementError(trace.file, found, required, mend)


_LEAD = np.pi / 2.0  # rad: a larger lead at the lowest frequency is interpreted as a lag


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The frequency responses of sine traces, measured and modelled."""

    points: tuple[Point, ...]  # in order of frequency
    order: Order  # of lag from setpoint to position
    plant_order: Order | None  # of lag from drive to position; None where no drive was logged
    # position over drive of the fitted model, run free on each point's drive, rad/V; None without one
    nonlinear: tuple[complex | None, ...]
    linear: TransferFunction  # the linear plant about the middle of the sines, rad/V
    share: float  # of the travel at that operating point
    warnings: tuple[str, ...]  # traces that could not be used, with the reason
    settings: FrequencySettings = FrequencySettings()  # the settings used

    @property
    def frequencies(self) -> np.ndarray:
        """Hz."""
        return np.array([point.frequency for point in self.points])

    @property
    def plants(self) -> tuple[Ratio | None, ...]:
        """Position over drive as measured, rad/V; None where no drive was logged."""
        return tuple(point.plant for point in self.points)

    @property
    def linear_plant(self) -> tuple[complex, ...]:
        """The linear plant at each point, rad/V."""
        return tuple(np.asarray(self.linear(2j * np.pi * self.frequencies), dtype=complex).tolist())

    def loops_around(self, plants: Sequence[complex | None]) -> tuple[complex | None, ...]:
        """Position over setpoint at each point with this plant under the ECU; None where the drive is unknown.

        C P / (1 + C P)
        """
        ecus = [point.controller for point in self.points]
        return tuple(
            None if ecu is None or plant is None else ecu.value * plant / (1.0 + ecu.value * plant)
            for ecu, plant in zip(ecus, plants, strict=True)
        )


def frequency_response(
    fitted: Fitted, traces: Sequence[Measurement], settings: FrequencySettings = FrequencySettings()
) -> FrequencyResponse:
    """Fit a sine to every trace, and a sine of its frequency to the model's free run on that trace's drive."""
    found, warnings = list[Point](), list[str]()
    for trace in traces:
        try:
            found.append(point_of(trace, fitted.config, settings))
        except MeasurementError as error:
            warnings.append(str(error))
    points = tuple(sorted(found, key=lambda point: point.frequency))
    lower, upper = fitted.config.stops
    middle = float(np.median([point.waves.offsets[POSITION] for point in points])) if points else lower
    share = float(np.clip((middle - lower) / (upper - lower), 0.0, 1.0))
    driven = [(point.frequency, ratio) for point in points if (ratio := point.plant) is not None]

    def order(measured: Sequence[tuple[float, Ratio]]) -> Order:
        return order_of(np.array([each for each, _ in measured]), [ratio for _, ratio in measured], settings)

    return FrequencyResponse(
        points,
        order([(point.frequency, point.closed_loop) for point in points]),
        order(driven) if driven else None,
        _free_runs(fitted, points),
        linear_plant(fitted, share),
        share,
        tuple(warnings),
        settings,
    )


def phases(values: Sequence[complex | None]) -> np.ndarray:
    """Phases in order of frequency, rad, nan for None.

    The first is between -270 and 90 degrees, each of the others within 180 degrees of the one before.
    """
    angles = np.array([np.nan if value is None else np.angle(value) for value in values])
    there = np.flatnonzero(np.isfinite(angles))
    angles[there] = np.unwrap(angles[there])
    return angles - 2.0 * np.pi if there.size and angles[there[0]] > _LEAD else angles


def _free_runs(fitted: Fitted, points: Sequence[Point]) -> tuple[complex | None, ...]:
    """The model's position over the measured drive at each point; None where no drive was logged."""
    driven = [point for point in points if point.plant is not None]
    ready = [prepare(point.measurement, fitted.config) for point in driven]
    traces = tuple(trace for trace in ready if trace is not None)
    if not traces:
        return (None,) * len(points)
    runs = (
        EstimationProblem.of_traces(fitted.config, fitted.free_parameters, traces).refined(fitted.x).free_run(fitted.x)
    )
    runs_by_file = {
        trace.measurement.file: Signal(trace.instants, run[:, trace.channels.index(POSITION)])
        for trace, run in zip(traces, runs, strict=True)
    }
    return tuple(_described(point, runs_by_file.get(point.measurement.file)) for point in points)


def _described(point: Point, position: Signal | None) -> complex | None:
    """A simulated position's fundamental over that of the measured drive, in the part of the trace that is used."""
    if position is None or not np.all(np.isfinite(position.value)):
        return None
    part, waves = position.between(point.window.begin, point.window.end), point.waves
    return fundamental(part, point.frequency, waves.middle, waves.harmonics) / complex(waves.amplitudes[DRIVE][0])
