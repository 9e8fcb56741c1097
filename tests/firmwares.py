"""Throttle controllers whose source is public, put down in their own units (%) from that source, as plain Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Settings:
    """What one types in."""

    # p, i, d: % of duty over % of travel; per s, times s
    p: float
    i: float
    d: float
    # bins, values: of the bias table, %; none where the ECU has none
    bins: Sequence[float] = (0.0, 100.0)
    values: Sequence[float] = (0.0, 0.0)

    def ahead(self, target: float) -> float:
        return float(np.interp(target, self.bins, self.values))


def clamp(low: float, value: float, high: float) -> float:
    return min(max(value, low), high)


@dataclass
class Rusefi:
    """electronic_throttle.cpp and efi_pid.cpp: 500 Hz. EtbController::update is getOpenLoop + getClosedLoop."""

    settings: Settings  # of it
    previous: float = 0.0
    i_term: float = 0.0
    # asked, held: what its PID made before any clamp, and its integral, tick by tick
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        error, dt = target - position, 1.0 / 500.0
        self.i_term += self.settings.i * dt * error
        if self.i_term > 100.0 * 100.0:  # maxValue * 100
            self.i_term = 100.0 * 100.0
        self.i_term = clamp(-30.0, self.i_term, 30.0)
        d_term = self.settings.d / dt * (error - self.previous)
        self.previous = error
        self.asked.append(self.settings.p * error + self.i_term + d_term)
        self.held.append(self.i_term)
        closed = clamp(-100.0, self.asked[-1], 100.0)
        return 100.0 * clamp(-0.9, 0.01 * (self.settings.ahead(target) + closed), 0.9)


@dataclass
class Fome:
    """electronic_throttle.cpp (getClosedLoop, setOutput) and efi_pid.cpp of FOME; its bias table holds steps of 0.5 %
    and of 0.1 %."""

    settings: Settings
    i_term: float = 0.0
    previous_error: float = 0.0
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        d_time = 1.0 / 500
        error = (target - position) * 1.0
        p_term = self.settings.p * error
        self.update_i_term(self.settings.i * d_time * error)
        d_term = self.settings.d / d_time * (error - self.previous_error)
        self.previous_error = error
        output = p_term + self.i_term + d_term + 0.0
        self.asked.append(output)
        self.held.append(self.i_term)
        if output > 100.0:
            output = 100.0
        elif output < -100.0:
            output = -100.0
        bins = [0.5 * round(b / 0.5) for b in self.settings.bins]
        values = [0.1 * round(v / 0.1) for v in self.settings.values]
        return clamp(-0.9, 0.01 * (float(np.interp(target, bins, values)) + output), 0.9) * 100.0

    def update_i_term(self, value: float) -> None:
        self.i_term += value
        for low, high in ((-100.0 * 100.0, 100.0 * 100.0), (-30.0, 30.0)):
            self.i_term = high if self.i_term > high else low if self.i_term < low else self.i_term


@dataclass
class PidV1:
    """PID_v1.cpp of Arduino-PID-Library, `Compute`: SetSampleTime(1), SetOutputLimits(-100, 100), P on error. It has no
    bias table."""

    settings: Settings
    output_sum: float = 0.0
    last_input: float | None = None
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        sample_time = 0.001
        if self.last_input is None:  # SetMode(AUTOMATIC) -> Initialize
            self.last_input = position
        error, d_input = target - position, position - self.last_input
        self.output_sum = clamp(-100.0, self.output_sum + self.settings.i * sample_time * error, 100.0)
        self.asked.append(self.settings.p * error + self.output_sum - self.settings.d / sample_time * d_input)
        self.held.append(self.output_sum)
        self.last_input = position
        return clamp(-100.0, self.asked[-1], 100.0)


@dataclass
class Textbook:
    """Astrom and Hagglund 2006, ch. 13, backward differences by 1 ms, a filter of 2 ms; the integral stands still at
    the limit (ch. 3.5)."""

    settings: Settings
    integral: float = 0.0
    slope: float = 0.0
    last: float = 0.0
    asked: list[float] = field(default_factory=list)
    held: list[float] = field(default_factory=list)

    def update(self, target: float, position: float) -> float:
        h, lag, error = 1e-3, 2e-3, target - position
        self.slope = lag / (lag + h) * self.slope + self.settings.d / (lag + h) * (error - self.last)
        self.last = error
        ahead, tried = self.settings.ahead(target), self.integral + self.settings.i * h * error
        self.asked.append(self.settings.p * error + tried + self.slope)
        duty = clamp(-100.0, clamp(-100.0, self.asked[-1], 100.0) + ahead, 100.0)
        if (self.asked[-1] + ahead - duty) * error <= 0.0:
            self.integral = tried
        self.held.append(self.integral)
        return duty


Firmware = Rusefi | Fome | PidV1 | Textbook
