"""A channel with the wrong sign: current against voltage, EMF and motor speed against the motion.

    R < 0:  voltage or current is turned round     k < 0:  EMF, motor speed, or both leads of the motor

in `circuit.py`'s equation, whose R and k are positive; and a motor alone takes energy and turns with its voltage,
integral v i dt > 0 and integral v omega dt > 0. Voltage, current and motor speed open the plate where they are
positive, and the EMF is negative while it falls.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...ranges import real
from .. import TEST_BY_NAME
from ..base import Measurement
from ..finding import Finding
from ..signals import on_times
from .base import AbstractDetector, Records, Signs, column, everywhere, in_files


@dataclass(frozen=True)
class ChannelSign(AbstractDetector):
    """See the module.

    Args:
        errors: standard errors by which a reading must lie below zero.
    """

    errors: float = real(5.0, 0.0)
    kind: ClassVar[str] = "channel_sign"
    explains: ClassVar[bool] = True

    def find(self, records: Records) -> Iterator[Finding]:
        for test, traces in records.tests.items():
            turned: dict[str, list[Measurement]] = {}
            for trace in traces:
                signs = records.signs(trace, self.errors)
                for name in _turned(trace, signs) if signs else ():
                    turned.setdefault(name, []).append(trace)
            for name, having in turned.items():
                yield _finding(name, test, having, traces)


def _turned(trace: Measurement, signs: Signs) -> tuple[str, ...]:
    """Channels with the wrong sign."""
    boundary = TEST_BY_NAME[trace.test].boundary
    if boundary.terminals_open:
        return ("emf" if "emf" in trace.channels else "voltage",) if signs.k < 0 else ()
    if boundary.gear_apart:  # R hides behind a motor that spins, and k behind brushes where few windows tell
        if _opposed(trace, "current"):
            return (_driver(trace, signs),)
        return ("motor_speed",) if _opposed(trace, "motor_speed") else ()
    if signs.R < 0:
        return (_driver(trace, signs),)
    return ("voltage", "current") if signs.k < 0 else ()


def _opposed(trace: Measurement, name: str, errors: float = 10.0) -> bool:
    """Integral v i dt < 0, or v omega dt < 0, beyond the channel's noise: no motor that starts from rest, and is driven
    by nothing else, gives energy or runs against its voltage."""
    voltage, channel = trace.channels.get("voltage"), trace.channels.get(name)
    if voltage is None or channel is None:
        return False
    volts = on_times(voltage, channel.time)
    return float(np.sum(volts * channel.value)) < -errors * channel.sigma * float(np.sqrt(np.sum(volts**2)))


def _driver(trace: Measurement, signs: Signs) -> str:
    """Of voltage and current the one that the motion is against; with the plate held the one below zero."""
    if signs.k:
        return "current" if signs.k > 0 else "voltage"
    return "current" if float(np.mean(trace.channels["current"].value)) < 0.0 else "voltage"


def _finding(name: str, test: str, having: list[Measurement], traces: tuple[Measurement, ...]) -> Finding:
    files = [trace.file for trace in having]
    channel = having[0].channels.get(name) or having[0].channels["voltage"]
    against = {"emf": "the plate's motion", "motor_speed": "voltage and current", "current": "the voltage",
               "voltage": "the current" if len(having[0].channels) < 3 else "the motion"}[name]  # fmt: skip
    found = f"{in_files(test, files, traces)} {name.replace('_', ' ')} has the opposite sign of {against}."
    return Finding("channel_sign", -1.0, "", 0.0, found[0].upper() + found[1:],
                   f"Head its column '{column(channel, -1.0)}' there, or turn the leads and log again.",
                   test, everywhere(files, traces), name, sure=True)  # fmt: skip
