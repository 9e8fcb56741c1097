"""Free-run errors of a model, trace by trace, in the units the user logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..model.parameters import AnyArray
from .trace import Trace


@dataclass(frozen=True, eq=False)
class PredictionError:
    """One channel of one trace: measured - simulated, free-running from the trace's start.

    Args:
        file, test, channel: where.
        unit: of rms and sigma, as logged.
        n: samples.
        rms: root mean square error.
        sigma: noise of one sample.
    """

    file: str
    test: str
    channel: str
    unit: str
    n: int
    rms: float
    sigma: float


def pooled(every: Sequence[PredictionError]) -> float:
    """sqrt(sum n (rms/sigma)^2 / sum n): error over noise of many channels, each counting for its samples."""
    n = np.array([row.n for row in every], dtype=float)
    ratio = np.array([row.rms / row.sigma for row in every])
    return float(np.sqrt(np.sum(n * ratio**2) / n.sum()))


@runtime_checkable
class Placed(Protocol):
    """A batch, as far as `columns` needs it: its traces and the entries of their instants, see `TraceBatch`."""

    @property
    def traces(self) -> tuple[Trace, ...]: ...

    @property
    def places(self) -> tuple[tuple[int, int, np.ndarray], ...]: ...


def columns(batch: Placed, array: Float[AnyArray, "T L M"]) -> list[Float[np.ndarray, "_ _"]]:
    """Take from a batch's (T, L, M) array what belongs to each trace: its instants by its channels."""
    array = np.asarray(array)
    return [
        array[marks, lane, : len(trace.channels)]
        for trace, (lane, _, marks) in zip(batch.traces, batch.places, strict=True)
    ]


def logged_unit(trace: Trace, channel: str) -> tuple[str, float]:
    """Unit in which a channel was logged and the size of that unit in SI."""
    name = channel if channel in trace.measurement.channels else "voltage"
    logged = trace.measurement.channels[name]
    return logged.unit, abs(logged.scale)


def rows(traces: Sequence[Trace], predicted: Sequence[Float[np.ndarray, "_ _"]]) -> tuple[PredictionError, ...]:
    """Score traces.

    Args:
        traces: as measured.
        predicted: free-run simulation of each, shape (n, M), SI.
    """
    out = []
    for trace, model in zip(traces, predicted, strict=True):
        for m, channel in enumerate(trace.channels):
            seen = np.isfinite(trace.data[:, m])
            unit, size = logged_unit(trace, channel)
            rms = float(np.sqrt(np.mean((trace.data[seen, m] - model[seen, m]) ** 2))) / size
            out.append(
                PredictionError(
                    trace.measurement.file,
                    trace.measurement.test,
                    channel,
                    unit,
                    int(seen.sum()),
                    rms,
                    float(trace.sigma[m]) / size,
                )
            )
    return tuple(out)
