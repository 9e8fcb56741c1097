"""Samples that the rig logs late, brought to the instants that they show: there whitening knows what is uncertain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..model.effects import AbstractEffect
from ..model.parameters import Scalar
from ..model.rig_effects import AbstractRigEffect
from ..model.throttle import Throttle
from .batch import TraceBatch
from .innovations import Moved


def moved_samples(
    batch: TraceBatch, types: tuple[type[AbstractEffect], ...], values: Mapping[str, Scalar]
) -> Moved | None:
    """Where they belong: earlier or later by as many samples as their lateness has intervals; None where none is late.

    Those that would lie before the first sample of their trace, or after its last, belong nowhere. What is left of a
    lateness, half an interval at most, is that of the reading.

    Args:
        batch: the traces.
        types: effects of the model.
        values: of its parameters, SI by symbol.
    """
    late = tuple(effect for effect in types if issubclass(effect, AbstractRigEffect) and effect.delays)
    if not late:
        return None
    by = Throttle.build(late, values).lateness(batch.steps, batch.test_of)
    shape = batch.slots.value.shape
    seconds = {channel: np.broadcast_to(np.asarray(each, dtype=float), shape[:2]) for channel, each in by.items()}
    forth, back = (np.broadcast_to(np.arange(shape[0])[:, None, None], shape).copy() for _ in range(2))
    for trace, (lane, row, marks) in zip(batch.traces, batch.places, strict=True):
        interval = float(np.median(np.diff(trace.instants)))
        for m, channel in enumerate(trace.channels):
            if channel in seconds and (shift := round(float(seconds[channel][row, lane]) / interval)):
                shift = max(-marks.size, min(marks.size, shift))
                shown, logged = (marks[: marks.size - shift], marks[shift:]) if shift > 0 else (
                    marks[-shift:], marks[: marks.size + shift])  # fmt: skip
                forth[marks, lane, m] = back[marks, lane, m] = shape[0]
                forth[shown, lane, m], back[logged, lane, m] = logged, shown
    still = np.broadcast_to(np.arange(shape[0])[:, None, None], shape)
    return None if np.array_equal(forth, still) else Moved(forth, back)
