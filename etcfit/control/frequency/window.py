"""The part of a sine trace that has settled: whole cycles, without what came before the plate swung evenly."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...rig.signals import even_grid
from ..settings import FrequencySettings
from .wave import Signal, departure, fit_waves

_PADDED = 8  # times its length that a setpoint is transformed in, to see its frequency between the bins
_FEWEST = 4  # samples that a cycle is fitted to


class Window(NamedTuple):
    """Part of a trace.

    Args:
        begin, end: s.
        cycles: whole ones in it.
        skipped: cycles before it that were left out.
    """

    begin: float
    end: float
    cycles: int
    skipped: float


def moving(setpoint: Signal) -> Signal:
    """A setpoint without the parts before and after it moves."""
    first = np.flatnonzero(setpoint.value != setpoint.value[0])
    last = np.flatnonzero(setpoint.value != setpoint.value[-1])
    if not first.size:
        return Signal(setpoint.time[:0], setpoint.value[:0])
    begin, end = max(int(first[0]) - 1, 0), min(int(last[-1]) + 1, setpoint.time.size - 1)
    return Signal(setpoint.time[begin : end + 1], setpoint.value[begin : end + 1])


def frequency_of(setpoint: Signal, settings: FrequencySettings = FrequencySettings()) -> float:
    """Where the setpoint's spectrum has its peak, then by least squares, Hz."""
    time, step = even_grid(setpoint.time)
    even = np.interp(time, setpoint.time, setpoint.value)
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), _PADDED * even.size))
    rough = float(np.argmax(spectrum)) / (_PADDED * even.size * step)
    return fit_waves({"setpoint": setpoint}, rough, settings=settings).frequency


def common(setpoint: Signal, position: Signal) -> tuple[float, float]:
    """From when to when both were logged, the last sample's own step counted, s."""
    last = min(float(s.time[-1] + np.median(np.diff(s.time))) for s in (setpoint, position))
    return max(float(setpoint.time[0]), float(position.time[0])), last


def settled(
    setpoint: Signal,
    position: Signal,
    frequency: float,
    harmonics: int,
    settings: FrequencySettings = FrequencySettings(),
) -> Window:
    """Whole cycles counted back from the end, without the first ones that are not like the last half of them.

    A cycle strays whose own mean and fundamental differ from those of the last half by more than `strays` times what
    the cycles of that half differ by (root mean square). The very first one is left out wherever three others remain:
    what fades within the noise of single samples does not within that of their mean.

    Args:
        setpoint, position: two cycles or more of both.
        frequency: Hz.
        harmonics: H of the waves that the last half is fitted with.
        settings: `nearly`, `strays` and `same`.
    """
    begin, end = common(setpoint, position)
    count = int((end - begin) * frequency + settings.nearly)
    edges = end - np.arange(count, -1, -1) / frequency
    first = max(_strays(signal, edges, frequency, harmonics, settings) for signal in (setpoint, position))
    first = max(first, 1) if count > 3 else first
    return Window(float(edges[first]), end, count - first, (end - begin) * frequency - (count - first))


def _strays(signal: Signal, edges: np.ndarray, frequency: float, harmonics: int, settings: FrequencySettings) -> int:
    """How many cycles come before the first from which on none strays."""
    half = max((edges.size - 1) // 2, 2)
    reference = signal.between(edges[-1 - half], edges[-1])
    residual = Signal(signal.time, departure(signal, reference, frequency, harmonics, settings))
    sizes = np.array([_size(residual.between(a, b), frequency) for a, b in pairwise(edges)])
    scatter, swing = float(np.sqrt(np.mean(sizes[-half:] ** 2))), float(np.ptp(reference.value))
    limit = max(settings.strays * scatter, settings.same * swing)
    return int(np.max(np.flatnonzero(sizes[:-half] > limit) + 1, initial=0))


def _size(cycle: Signal, frequency: float) -> float:
    """Mean and fundamental together; 0 in a gap."""
    if cycle.time.size < _FEWEST:
        return 0.0
    angle = 2.0 * np.pi * frequency * cycle.time
    columns = np.column_stack([np.ones(angle.size), np.cos(angle), np.sin(angle)])
    return float(np.linalg.norm(np.linalg.lstsq(columns, cycle.value, rcond=None)[0]))
