"""A trace as plain arrays: for tools that know nothing of etcfit, in processes that need not import it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from etcfit.problem.input_signal import InputSignal
    from etcfit.problem.trace import Trace


@dataclass(frozen=True, eq=False)
class PlainTrace:
    """One measurement and what etcfit knows of it before any fit, SI.

    Args:
        name: its file.
        test: its rig test.
        plate_held: the plate cannot move at all.
        gear_apart: the motor runs alone.
        circuit: current can flow.
        instants: of its samples, s, shape (n,).
        knots, volts: the input, freed of noise, linear between knots; two knots at one time make a jump; shape (k,).
        channels: what is observed, M names.
        data: samples, NaN where nothing was logged, shape (n, M).
        sigma: standard deviation of a sample's noise, shape (M,).
        start: current (A), angle (rad), speed (rad/s) at the first instant.
        release: instant at which a held plate was let go, s; None where it is free from the start.
    """

    name: str
    test: str
    plate_held: bool
    gear_apart: bool
    circuit: bool
    instants: np.ndarray
    knots: np.ndarray
    volts: np.ndarray
    channels: tuple[str, ...]
    data: np.ndarray
    sigma: np.ndarray
    start: tuple[float, float, float]
    release: float | None

    @property
    def release_symbol(self) -> str:
        """Name of its release instant among the parameters of a fit."""
        return f"release.{self.name}"

    def release_at(self, values: Mapping[str, float]) -> float | None:
        """That instant where the values have it, else the one that was read off the trace, s."""
        return values.get(self.release_symbol, self.release)

    def volts_at(self, times: np.ndarray, before: bool = False) -> np.ndarray:
        """The input at these instants (s), V; where it jumps, what it jumps to, or what it was before."""
        side = "left" if before else "right"
        k = np.clip(np.searchsorted(self.knots, times, side=side) - 1, 0, self.knots.size - 2)
        slope = np.diff(self.volts) / np.maximum(np.diff(self.knots), 1e-12)
        return self.volts[k] + slope[k] * (times - self.knots[k])


def plain(trace: Trace, jump_at: float | None = None, phase: float = 0.0) -> PlainTrace:
    """The same as plain arrays.

    Args:
        trace: as etcfit prepares it.
        jump_at: share of the interval at which the input jumps, where it does; None: it is linear there too, but for
            jumps in step with the samples.
        phase: of those.
    """
    boundary, release = trace.test.boundary, trace.release
    knots, volts = input_knots(trace.instants, trace.input, jump_at, phase)
    return PlainTrace(
        trace.measurement.file, trace.test.name, boundary.plate_held, boundary.gear_apart, trace.circuit,
        trace.instants, knots, volts, trace.channels, trace.data, trace.sigma, trace.start.state,
        None if release is None else release[0],
    )  # fmt: skip


def input_knots(
    times: np.ndarray, signal: InputSignal | None, jump_at: float | None, phase: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Instants and volts of an input that is linear in between; arguments as of `plain`."""
    if signal is None:
        return times[[0, -1]], np.zeros(2)
    if signal.held:
        return np.repeat(times, 2)[1:], np.repeat(signal.value, 2)[:-1]
    if jump_at is not None:
        share = np.where(signal.edge, jump_at, np.nan)
    elif signal.turn is not None:
        share = np.clip(signal.turn + phase, 0.0, 1.0)
    else:
        return times, signal.value
    (k,) = np.nonzero(np.isfinite(share))
    jumps = times[k] + share[k] * np.diff(times)[k]
    where = np.repeat(k + 1, 2)
    sides = np.stack((signal.value[k], signal.value[k + 1]), axis=1).ravel()
    return np.insert(times, where, np.repeat(jumps, 2)), np.insert(signal.value, where, sides)
