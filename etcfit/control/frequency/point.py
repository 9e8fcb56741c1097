"""What one sine trace says: the response at its frequency, or why it says nothing."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ...errors import MeasurementError
from ...rig.base import Channel, Measurement, RigConfig
from ...rig.signals import drive_voltage
from ..settings import FrequencySettings
from .wave import Ratio, Signal, Waves, fit_waves
from .window import Window, common, frequency_of, moving, settled

SETPOINT, POSITION, DRIVE = "setpoint", "position", "drive"


@dataclass(frozen=True, eq=False)
class Point:
    """The response at one frequency.

    Args:
        measurement: the trace.
        window: the part of it that counts.
        waves: of setpoint and position (rad), and of the drive (V) where one was logged.
        noise: share of the position's power that its sensor's noise has.
    """

    measurement: Measurement
    window: Window
    waves: Waves
    noise: float

    @property
    def frequency(self) -> float:
        """Hz."""
        return self.waves.frequency

    @property
    def amplitude(self) -> float:
        """Of the position, rad."""
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
        """Drive over setpoint - position, V/rad: the ECU as the trace shows it; None without a drive."""
        if DRIVE not in self.waves.amplitudes:
            return None
        return self.waves.ratio({DRIVE: 1.0}, {SETPOINT: 1.0, POSITION: -1.0})


def point_of(trace: Measurement, config: RigConfig, settings: FrequencySettings = FrequencySettings()) -> Point:
    """Fit one sine to setpoint, position and drive of a trace.

    Args:
        trace: of the sine test.
        config: of the rig, for the supply behind a duty.
        settings: what a trace must have.
    Raises:
        MeasurementError: it has no setpoint or position, too few cycles or samples, or its setpoint is no sine.
    """
    channels = _channels(trace, config, settings)
    wanted = moving(channels[SETPOINT])
    if wanted.time.size < 2 * settings.fewest_cycles:
        found = f"the setpoint moves in {wanted.time.size} samples only."
        raise _unfit(trace, settings, found, "Log the sine for longer.")
    frequency = frequency_of(wanted, settings)
    _check_length(trace, wanted, channels[POSITION], frequency, settings)
    count = _harmonics(channels.values(), frequency, settings)
    window = settled(wanted, channels[POSITION], frequency, count, settings)
    parts = {name: signal.between(window.begin, window.end) for name, signal in channels.items()}
    _check_density(trace, parts, window, settings)
    waves = fit_waves(parts, frequency, count, settings)
    _check_sine(trace, waves, settings)
    power = float(np.var(parts[POSITION].value))
    return Point(trace, window, waves, trace.channels["position"].sigma ** 2 / power if power else math.inf)


def _channels(trace: Measurement, config: RigConfig, settings: FrequencySettings) -> dict[str, Signal]:
    """Setpoint, position and drive; a duty, which an ECU holds until the next sample, half a step later than logged."""
    for name in (SETPOINT, POSITION):
        if name not in trace.channels:
            raise _unfit(trace, settings, f"no {name} among {', '.join(trace.channels)}.",
                         f"Add the column '{name} [deg]', or map its header under [columns].")  # fmt: skip
    signals = {name: _signal(trace.channels[name]) for name in (SETPOINT, POSITION)}
    drive = drive_voltage(trace, config)
    if drive is None or float(np.ptp(drive.value)) == 0.0:
        return signals
    held = 0.0 if "voltage" in trace.channels else 0.5 * float(np.median(np.diff(drive.time)))
    return signals | {DRIVE: Signal(drive.time + held, drive.value)}


def _signal(channel: Channel) -> Signal:
    return Signal(channel.time, channel.value)


def _harmonics(signals: Iterable[Signal], frequency: float, settings: FrequencySettings) -> int:
    """As many as the slowest logged signal can tell."""
    step = max(float(np.median(np.diff(signal.time))) for signal in signals)
    return int(np.clip(1.0 / (settings.samples_a_harmonic * frequency * step), 1, settings.harmonics))


def _check_length(
    trace: Measurement, wanted: Signal, position: Signal, frequency: float, settings: FrequencySettings
) -> None:
    begin, end = common(wanted, position)
    cycles = (end - begin) * frequency
    if cycles < settings.fewest_cycles - settings.nearly:
        raise _unfit(trace, settings, f"{max(cycles, 0.0):.2g} cycles of {frequency:.3g} Hz.",
                     f"Log it for {settings.fewest_cycles / frequency:.2g} s or longer.")  # fmt: skip


def _check_density(
    trace: Measurement, parts: Mapping[str, Signal], window: Window, settings: FrequencySettings
) -> None:
    for name, signal in parts.items():
        density = signal.time.size / window.cycles
        if density < settings.samples_a_cycle:
            found = f"{density:.2g} samples a cycle of the {name}."
            raise _unfit(trace, settings, found, "Log it faster, or without gaps.")


def _check_sine(trace: Measurement, waves: Waves, settings: FrequencySettings) -> None:
    outside, low = waves.outside[SETPOINT], float(np.sum(waves.in_harmonics[SETPOINT][:4]))
    if outside > settings.outside or low > settings.outside_low:
        raise _unfit(trace, settings, f"the setpoint is no sine: {100.0 * outside:.2g} % of its power lies outside "
                     f"{waves.frequency:.3g} Hz, {100.0 * low:.2g} % in the 2nd to 5th harmonic.",
                     "Log the response to a sine, or move the file to closed_loop/.")  # fmt: skip


def _unfit(trace: Measurement, settings: FrequencySettings, found: str, mend: str) -> MeasurementError:
    required = (f"A frequency response needs setpoint and position over {settings.fewest_cycles} cycles or more, "
                f"{settings.samples_a_cycle:g} samples a cycle, and a setpoint with at most "
                f"{100.0 * settings.outside:g} % of its power outside one frequency ({100.0 * settings.outside_low:g} "
                "% in its 2nd to 5th harmonic).")  # fmt: skip
    return MeasurementError(trace.file, found, required, mend)
