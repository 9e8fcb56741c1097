"""The initial voltage in the integral of each ECU in the model: a search that halves its steps.

A resting plate does not respond to a small change, and a plate that slips jumps: there is no gradient to follow. Only

the beginning of a trace is simulated, and only traces that such an ECU drives; the voltages of one halving are parallel
lanes of one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from jaxtyping import Float, Int

from ..model.parameters import AnyArray
from .batch import TraceBatch
from .residual import WeightedData
from .trace import Trace

_SPANS = (3.0, 1.5, 0.7, 0.3, 0.15, 0.07, 0.03, 0.015, 0.007, 0.003)  # steps of the search, V
_SIDES = (-1.0, 1.0)  # signs of the steps; the best voltage so far is kept if neither is better
_FORGOTTEN = 1.0  # s after which a loop no longer depends on its initial state
_MOTION_SIGMAS = 8.0  # standard deviations of a sample that count as a motion

Simulate = Callable[[WeightedData], Float[AnyArray, "T L M"]]  # simulated value of each slot


@dataclass(frozen=True, eq=False)
class _Beginning:
    """The samples that determine the initial voltage in the integral of a trace."""

    # lane, rows: places of the samples in the simulated lanes; shape (k,)
    lane: int
    rows: Int[np.ndarray, " k"]
    data: Float[np.ndarray, "k M"]  # the samples, SI, shape (k, M)
    weight: Float[np.ndarray, "k M"]  # 1 / sigma; 0 without a sample; shape (k, M)

    def misfit(self, seen: Float[np.ndarray, "T L M"]) -> float:
        """Sum of squared errors, each over its noise; infinite if the simulation fails."""
        model = seen[self.rows, self.lane, : self.data.shape[1]]
        return float(np.nan_to_num(np.sum(((self.data - model) * self.weight) ** 2), nan=np.inf))


def fitted_integrals(batch: TraceBatch, weighted: WeightedData, simulate: Simulate) -> Float[np.ndarray, " traces"]:
    """The initial voltage of each integral that best fits the samples up to a second after the plate first moves, V; 0
    for traces that no ECU in the model drives.

    Args:
        batch: a batch with traces that an ECU drives.
        weighted: its data, for a free run.
        simulate: computes the samples of any batch of these traces.
    """
    driven = [k for k, trace in enumerate(batch.traces) if trace.controlled]
    lanes = sorted({batch.places[k][0] for k in driven})
    begun = [_beginning(batch.traces[k], lanes.index(batch.places[k][0]), batch.places[k][2]) for k in driven]
    length = 1 + max(int(each.rows[-1]) for each in begun)
    owner = np.full((length, len(lanes)), -1)  # the trace to whose integral each entry belongs
    for n, (k, each) in enumerate(zip(driven, begun, strict=True)):
        owner[batch.places[k][1] : batch.places[k][2][-1] + 1, each.lane] = n
    early = _side_by_side(weighted, length, np.tile(lanes, len(_SIDES)))

    def misfits(tried: list[np.ndarray]) -> Float[np.ndarray, "sides driven"]:
        """Misfit of each trace with each voltage."""
        level = np.concatenate([volts[owner] for volts in tried], axis=1)
        acts, steps = np.tile(owner >= 0, len(tried)), early.steps
        columns = (np.where(acts, level, old) for old in (steps.voltage0, steps.voltage1))
        replaced = steps._replace(**dict(zip(("voltage0", "voltage1"), columns, strict=True)))
        parts = np.split(np.asarray(simulate(early._replace(steps=replaced))), len(tried), axis=1)
        return np.array([[each.misfit(seen) for each in begun] for seen in parts])

    inputs = [batch.traces[k].input for k in driven]
    volts = np.array([0.0 if each is None else each.value[0] for each in inputs])
    least = misfits([volts] * len(_SIDES))[0]
    for span in _SPANS:
        tried = [volts + side * span for side in _SIDES]
        found = np.stack((least, *misfits(tried)))
        best = np.argmin(found, axis=0)
        volts, least = np.choose(best, [volts, *tried]), np.min(found, axis=0)
    out = np.zeros(len(batch.traces))
    out[driven] = volts
    return out


def _side_by_side(weighted: WeightedData, length: int, lanes: Int[np.ndarray, " l"]) -> WeightedData:
    """The first entries of some lanes; a repeated number, which takes no memory, stays repeated."""

    def cut(leaf: AnyArray) -> np.ndarray:
        leaf = np.asarray(leaf)
        if any(leaf.strides):
            return leaf[:length, lanes]
        return np.broadcast_to(leaf.flat[0], (length, lanes.size, *leaf.shape[2:]))

    names = ("steps", "resets", "slots", "test_of", "whitening")
    parts: dict[str, Any] = {name: jax.tree.map(cut, getattr(weighted, name)) for name in names}
    return weighted._replace(**parts)


def _beginning(trace: Trace, lane: int, marks: Int[np.ndarray, " n"]) -> _Beginning:
    """Samples up to a second after the plate first moves."""
    seen = np.isfinite(trace.data)
    if "position" not in trace.channels:
        return _Beginning(lane, marks[:1], np.zeros((1, seen.shape[1])), np.zeros((1, seen.shape[1])))
    m = trace.channels.index("position")
    moved = np.abs(trace.data[:, m] - trace.data[seen[:, m], m][0]) > _MOTION_SIGMAS * trace.sigma[m]
    first = trace.instants[np.argmax(moved)] if moved.any() else trace.instants[0]
    count = int(np.searchsorted(trace.instants, first + _FORGOTTEN))
    early = seen[:count]
    return _Beginning(lane, marks[:count], np.where(early, trace.data[:count], 0.0), early / trace.sigma)
