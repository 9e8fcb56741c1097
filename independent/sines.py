"""Sine setpoints under an engine computer, as its own logger writes them: setpoint, sensor volts, duty.

`python -m independent.sines measurements/bench_twin` adds them to the bench twin's folder.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from .bench_twin import TRUTH, UNDECLARED
from .control import Computer, follow
from .effects import Effects
from .folder import write_trace
from .instruments import CLOSED_V, OPEN_V, Bench, clock, wiper
from .protocols import Trace
from .simulate import throttle
from .truth import OPEN, Truth

FREQUENCIES = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0)  # Hz, the paper's range
COMPUTER = Computer(20.0, 300.0, 0.4)
STEP = 5e-5  # of the travel: of the setpoint


def sine(
    rng: np.random.Generator,
    truth: Truth,
    effects: Effects,
    computer: Computer,
    bench: Bench,
    frequency: float,
    *,
    middle: float = 0.4,
    swing: float = 0.1,
    cycles: float = 8.3,
    lead: float = 0.4,
) -> Trace:
    """One trace: still for `lead` s, then a sine about `middle` of `swing`, shares of the travel."""
    rate = 1.0 / computer.period
    duration = lead + max(cycles / frequency, 2.0)
    ticks = np.arange(round(duration * rate) + 2) / rate
    phase = 2 * np.pi * frequency * np.maximum(ticks - lead, 0.0)
    wanted = OPEN * STEP * np.round((middle + swing * np.sin(phase)) / STEP)
    angle, volts = follow(throttle(truth, effects), computer, wanted)
    when = clock(rng, bench, rate, duration)
    # the computer logs its own setpoint and duty as they are; the sensor is read a little early or late
    own = slice(when.logged.size)
    seen = wiper(effects, np.interp(when.true, ticks, angle))
    tps = CLOSED_V + (OPEN_V - CLOSED_V) * seen / OPEN
    columns = {
        "time [s]": when.logged,
        "setpoint [deg]": np.degrees(wanted[own]),
        "tps [V]": bench.sensors["tps"].read(rng, tps),
        "duty [%]": 100.0 * volts[own] / computer.supply,
    }
    return Trace(f"sine/{frequency:g}_Hz.csv", columns)


def write_sines(
    path: Path,
    seed: int,
    truth: Truth,
    effects: Effects,
    computer: Computer,
    bench: Bench,
    frequencies: Iterable[float] = FREQUENCIES,
) -> None:
    """sine/, a CSV a frequency, in a measurement folder."""
    (path / "sine").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for frequency in frequencies:
        write_trace(path, sine(rng, truth, effects, computer, bench, frequency), seed)


if __name__ == "__main__":
    write_sines(Path(sys.argv[1]), 1, TRUTH, UNDECLARED, COMPUTER, Bench())
