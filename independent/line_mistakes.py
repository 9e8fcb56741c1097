"""What goes wrong on one unit of a line: with the bench's wiring, with its channels, with what the bench was told.

Each has three sizes: hard to see, as it happens, and obvious. A mistake changes the throttle that the bench sees, or
what the bench logs of it; `rig.toml` and `fleet.toml` know nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from .protocols import Trace, quantity, unit
from .truth import Truth

Seen = Callable[[Truth, float], Truth]
Logged = Callable[[Trace, float], Trace]


def gear_ratio(truth: Truth, factor: float) -> Truth:
    """A gear with other teeth than the nameplate says; inertia and damping of the motor come through it too."""
    return replace(truth, N=truth.N * factor)


def series_resistance(truth: Truth, ohm: float) -> Truth:
    """A connector that was not pressed home."""
    return replace(truth, R_a=truth.R_a + ohm)


def scaled(trace: Trace, wanted: str, factor: float) -> Trace:
    """A quantity of the trace times a factor; nothing where it was not logged."""
    columns = {name: x * (factor if quantity(name) == wanted else 1.0) for name, x in trace.columns.items()}
    return Trace(trace.file, columns)


def current_gain(trace: Trace, factor: float) -> Trace:
    """A shunt of another value.

    The model has K_m = K_b, so that a current in all traces that is too large by one factor looks like a throttle with
    that much more of every torque and inertia and that much less R_a: it fits, and only the population shows it.
    """
    return scaled(trace, "current", factor)


def sensor_end_points(trace: Trace, factor: float) -> Trace:
    """The position sensor's supply is off."""
    return scaled(trace, "tps", factor)


def time_scale(trace: Trace, factor: float) -> Trace:
    """The clock of the responses."""
    return scaled(trace, "time", factor) if trace.file.startswith("response/") else trace


def channel_sign(trace: Trace, factor: float) -> Trace:
    """The current clamp of the responses turned round."""
    return scaled(trace, "current", factor) if trace.file.startswith("response/") else trace


def current_offset(trace: Trace, amps: float) -> Trace:
    """The clamp was not set to zero."""
    per = {"A": 1.0, "mA": 1e3}
    off = {name: per[unit(name)] * amps for name in trace.columns if quantity(name) == "current"}
    return Trace(trace.file, {name: x + off.get(name, 0.0) for name, x in trace.columns.items()})


def channel_late(trace: Trace, rows: float) -> Trace:
    """The current behind the other columns."""
    by = int(rows)
    late = {name: quantity(name) == "current" for name in trace.columns}
    return Trace(trace.file, {name: x[:-by] if late[name] else x[by:] for name, x in trace.columns.items()}
                 if any(late.values()) else trace.columns)  # fmt: skip


# name -> what it does, its size when low, medium, high
ON_THE_BENCH: Mapping[str, tuple[Seen, tuple[float, float, float]]] = {
    "gear_ratio": (gear_ratio, (1.04, 1.10, 1.33)),
    "series_resistance": (series_resistance, (0.15, 0.5, 1.0)),
}
IN_THE_LOG: Mapping[str, tuple[Logged, tuple[float, float, float]]] = {
    "current_gain": (current_gain, (1.06, 1.10, 1.20)),
    "sensor_end_points": (sensor_end_points, (1.01, 1.04, 1.08)),
    "time_scale": (time_scale, (1.01, 1.04, 1.08)),
    "channel_sign": (channel_sign, (-1.0, -1.0, -1.0)),
    "current_offset": (current_offset, (0.02, 0.1, 0.25)),
    "channel_late": (channel_late, (1.0, 2.0, 5.0)),
}
LINE_MISTAKES = (*ON_THE_BENCH, *IN_THE_LOG)


def drawn_gains(rng: np.random.Generator, spread: Mapping[str, float]) -> dict[str, float]:
    """A rig's own gain by channel."""
    return {channel: 1.0 + share * rng.standard_normal() for channel, share in spread.items()}
