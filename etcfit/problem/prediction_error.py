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
    """Free-running error of one channel of one trace."""

    file: str  # the trace, relative to the measurement folder
    test: str  # the rig test, which is the name of its folder
    channel: str  # the quantity that is compared, such as position
    unit: str  # unit of rms and sigma: the one in which the channel was logged
    n: int  # samples compared
    rms: float  # root mean square of measured minus simulated, the model running free from the logged input
    sigma: float  # standard deviation of one sample's noise, in the same unit


def pooled(every: Sequence[PredictionError]) -> float:
    """sqrt(sum n (rms/sigma)^2 / sum n): error over noise of many channels, dimensionless; 1 if it is noise."""
    n = np.array([row.n for row in every], dtype=float)
    ratio = np.array([row.rms / row.sigma for row in every])
    return float(np.sqrt(np.sum(n * ratio**2) / n.sum()))


@runtime_checkable
class Placed(Protocol):
    """The part of a batch that `columns` needs, see `TraceBatch`."""

    @property
    def traces(self) -> tuple[Trace, ...]:
        """The traces in the order given."""
        ...

    @property
    def places(self) -> tuple[tuple[int, int, np.ndarray], ...]:
        """For each trace its lane, its first entry, and the entry of each of its instants."""
        ...


def columns(batch: Placed, array: Float[AnyArray, "T L M"]) -> list[Float[np.ndarray, "_ _"]]:
    """The part of each trace in an array over the batch.

    Args:
        batch: its traces and their places.
        array: shape (T, L, M).
    Returns:
        For each trace shape (n, M) with its own instants n and channels M.
    """
    array = np.asarray(array)
    return [
        array[marks, lane, : len(trace.channels)]
        for trace, (lane, _, marks) in zip(batch.traces, batch.places, strict=True)
    ]


def logged_unit(trace: Trace, channel: str) -> tuple[str, float]:
    """Unit in which a channel was logged, and the size of one such unit in SI."""
    name = channel if channel in trace.measurement.channels else "voltage"
    logged = trace.measurement.channels[name]
    return logged.unit, abs(logged.scale)


def rows(traces: Sequence[Trace], predicted: Sequence[Float[np.ndarray, "_ _"]]) -> tuple[PredictionError, ...]:
    """Errors of free runs, one row for each channel of each trace; samples that were not logged do not count.

    Args:
        predicted: free run of each, shape (n, M), SI.
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
