"""A bridge that coasts in its off time: where the current stops within a period, the mean voltage is not duty x supply.

    share = (d omega / d V) / (omega / V)   at settled speeds,   V = duty x supply

With dry and viscous friction omega = (V - V_f)/k, so the share is 1 or more; a drag that grows with the square of speed
makes it 1/2 at least. A bridge that leaves the terminals open in the off time hands the EMF of the turning motor to
them as soon as the current has stopped: a light load then soon turns nearly as fast as under the whole supply, and the
share falls towards 0.

Source: Erickson and Maksimovic 2020, ch. 5 (discontinuous conduction). Differs from source: no converter is calculated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real, whole
from .. import TEST_BY_NAME
from ..base import Measurement, RigConfig
from ..finding import Finding
from ..signals import Plateau, drive_voltage, plateaus
from .base import AbstractDetector, Records


@dataclass(frozen=True)
class CoastingBridge(AbstractDetector):
    """See the module.

    Args:
        share: at most.
        errors: standard errors by which it must be lower.
        fewest: settled speeds in one direction.
        span: of their voltages, largest over smallest, at least.
        settled: relative change of the speed over the last part of a plateau, at most.
        noises: of a speed sample, that a speed must reach.
    """

    share: float = real(0.4, 0.0, 0.5)
    errors: float = real(3.0, 0.0)
    fewest: int = whole(4, 3)
    span: float = real(1.3, 1.0)
    settled: float = real(0.02, 0.0)
    noises: float = real(20.0, 0.0)
    kind: ClassVar[str] = "coasting_bridge"

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            if TEST_BY_NAME[test].boundary.terminals_open:
                continue
            speeds = [pair for trace in traces for pair in self._speeds(trace, records.config)]
            for side in (1.0, -1.0):
                found = self._concave(np.array([(v, w) for v, w in speeds if side * v > 0.0 and side * w > 0.0]))
                if found is not None:
                    yield self._finding(test, *found)
                    break

    def _speeds(self, trace: Measurement, config: RigConfig) -> Iterator[tuple[float, float]]:
        """Voltage and settled speed of each plateau, V and rad/s."""
        drive, speed = drive_voltage(trace, config), trace.channels.get("motor_speed")
        if drive is None or speed is None:
            return
        for plateau in plateaus(drive):
            late, before = plateau.settled(speed, 0.15), _before_last(plateau).settled(speed, 0.15)
            if abs(late) > self.noises * speed.sigma and abs(late - before) < self.settled * abs(late):
                yield plateau.settled(drive), late

    def _concave(self, pairs: np.ndarray) -> tuple[float, float, float, float] | None:
        """Share, its error, and the span of the voltages; None where the curve is not bent so."""
        if len(pairs) < self.fewest:
            return None
        v, w = np.abs(pairs).T
        if v.max() < self.span * v.min():
            return None
        (slope, _), covariance = np.polyfit(v, w, 1, cov=True)
        chord = float(np.mean(w) / np.mean(v))
        share, error = float(slope) / chord, float(np.sqrt(covariance[0, 0])) / chord
        low, high = float(v.min()), float(v.max())
        return (share, error, low, high) if share + self.errors * error < self.share else None

    def _finding(self, test: str, share: float, error: float, low: float, high: float) -> Finding:
        return Finding(
            self.kind, share, "", 0.0,
            f"In {test} the settled speed hardly grows with the voltage: from {low:.3g} to {high:.3g} V it grows by "
            f"{100.0 * share:.0f} +- {100.0 * error:.0f} % of what is in proportion to it. Friction makes "
            "that 100 % or more, the drag of air 50 % at least. A bridge that coasts in its off time makes it so, for "
            "its mean voltage is not duty x supply once the current stops within a period of the PWM.",
            "Let the bridge short the motor in the off time (switch the inputs, not the enable pin: slow decay), or "
            "log the mean voltage at the terminals; a limit of current or speed would look the same.", test,
        )  # fmt: skip


def _before_last(plateau: Plateau) -> Plateau:
    """The same without its last 15 %."""
    return Plateau(plateau.start, plateau.stop - 0.15 * (plateau.stop - plateau.start))
