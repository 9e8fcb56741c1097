"""What a channel or a trace that is logged late would do to the residual: the same simulation, read off at other times.

    r(late) - r(0) = -W (y_hat(t - late) - y_hat(t))

Nothing is simulated anew, and the whitening W of a trace knows no other, so one whitening for each channel and each
lateness tried serves every test and every trace: candidates cost next to nothing, were there hundreds of traces. A
shift as long as the signal's own changes has no useful derivative, so several are tried, of either sign; a short one is
taken as linear.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.machine import available
from ..model.parameters import parameters_of
from ..model.rig_effects import DRIVING, OBSERVED, AbstractRigEffect
from ..problem.batch import KINDS
from ..problem.innovations import whiten
from ..problem.late_kernels import whitened
from ..problem.one_pass_kernels import rows_of
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel
from .composition import Effect
from .screen import Background, Signature, Variant, ranked
from .settings import DiagnosisSettings
from .single_traces import rows_by_file

RigEffect = type[AbstractRigEffect]

_SHIFTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # sample intervals that are tried, late and early
_SHORT = 0.5  # sample intervals over which a shift is taken as linear


class _Change(NamedTuple):
    """What the residual of the fitted samples would change by, were every channel late by so many sample intervals.

    Args:
        shift: sample intervals of each test; None: by channel for one interval, in the limit of a short shift.
        by_channel: shape (n,) each.
    """

    shift: float | None
    by_channel: Mapping[str, np.ndarray]

    def of(self, effect: RigEffect) -> np.ndarray:
        """Of the channels that an effect moves, in every trace: of one, or of all."""
        channel = effect.place.channel
        return self.by_channel[channel] if channel in OBSERVED else np.sum([*self.by_channel.values()], axis=0)


def screen_of_late(
    background: Background,
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    candidates: Sequence[Effect],
    settings: DiagnosisSettings,
) -> tuple[Signature, ...]:
    """The signature of every candidate that logs late, the most promising first; of those of single traces only the few
    that stand out the most.

    Args:
        background: of the model and residual without them.
        problem, x, weighted: that model.
        candidates: effects of the rig that delay.
        settings: `single_traces`.
    """
    intervals, changes, rows = _intervals(problem), _changes(problem, x, weighted), rows_by_file(problem, weighted)
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect)]
    alone = [e for e in rigs if e.place.file]
    standing_out = _standing_out(alone, background, changes, rows)[: settings.single_traces]
    found = []
    for effect in (e for e in rigs if e not in alone or e in standing_out):
        (p,) = parameters_of(effect)
        here = np.isin(np.arange(background.r.size), np.concatenate(_of(effect, rows)))
        way = -1.0 if effect.place.channel in DRIVING else 1.0  # beside a late input all others are early
        best: list[Signature] = []  # one at a time is kept: a signature is as long as all samples
        for change in changes:
            by = way * intervals[effect.place.test] * (1.0 if change.shift is None else change.shift)
            column = change.of(effect) * here * p.domain.scale / by
            shape = {} if change.shift is None else {p.symbol: by}
            one = background.signature(Variant(effect, shape, (p.symbol,)), column[:, None], {p.symbol: p})
            best = [*ranked([*best, one])]
        found += best
    return ranked(found)


def of_one_event(s: CandidateModel, effect: Effect) -> float:
    """By how much an effect that is at work lowers chi2 in one stretch of a trace, that where it lowers it the most.

    Args:
        s: the model with it.
        effect: one of those added.
    """
    without = s.without(effect)
    with_it, before = (
        columns(each.problem.batch, each.problem.residual(each.x, each.weighted)) for each in (s, without)
    )
    gains = [
        np.sum(stretch)
        for old, new in zip(before, with_it, strict=True)
        for stretch in np.array_split(np.nansum(old**2 - new**2, axis=1), s.settings.late_stretches)
    ]
    return max(0.0, float(max(gains)))


def _of(effect: RigEffect, rows: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """Fitted samples of the traces in which an effect is at work."""
    test, file = effect.place.test, effect.place.file
    return [own for name, own in rows.items() if name == file or (not file and name.startswith(f"{test}/"))]


def _standing_out(
    alone: Sequence[RigEffect], background: Background, changes: Sequence[_Change], rows: Mapping[str, np.ndarray]
) -> list[RigEffect]:
    """Those of single traces, by how much they would lower chi2 from the samples of the trace alone, the most first."""
    gains = {effect: 0.0 for effect in alone}
    for effect in alone:
        own = np.concatenate(_of(effect, rows))
        for change in changes:
            way, power = background.among(own, change.of(effect)[own])
            gain = way**2 / max(power, 1e-300) if change.shift is None else -2.0 * way - power
            gains[effect] = max(gains[effect], gain)
    return sorted(alone, key=lambda effect: -gains[effect])


def _intervals(problem: EstimationProblem) -> dict[str, float]:
    """Usual sample interval of each rig test, s."""
    spans: dict[str, list[np.ndarray]] = {}
    for trace in problem.batch.traces:
        spans.setdefault(trace.test.name, []).append(np.diff(trace.instants))
    return {test: float(np.median(np.concatenate(each))) for test, each in spans.items()}


def _changes(problem: EstimationProblem, x: np.ndarray, weighted: WeightedData) -> list[_Change]:
    """By a short shift, and by every one of `_SHIFTS`, late and early."""
    seen = columns(problem.batch, problem.simulated(x, problem.guide_stiffness))
    late, early = (_change(problem, weighted, seen, shift) for shift in (_SHORT, -_SHORT))
    slope = {channel: (late[channel] - early[channel]) / (2.0 * _SHORT) for channel in late}
    far = [_Change(way * by, _change(problem, weighted, seen, way * by)) for by in _SHIFTS for way in (1.0, -1.0)]
    return [_Change(None, slope), *far]


def _change(
    problem: EstimationProblem, weighted: WeightedData, seen: Sequence[np.ndarray], shift: float
) -> dict[str, np.ndarray]:
    """Change of the residual of the fitted samples, shape (n,), by channel that was observed."""
    batch, intervals = problem.batch, _intervals(problem)
    slots, moved = weighted.slots, np.zeros(np.shape(weighted.slots.value))
    for trace, (lane, _, marks), y in zip(batch.traces, batch.places, seen, strict=True):
        t, late = trace.instants, shift * intervals[trace.test.name]
        for m in range(len(trace.channels)):
            moved[marks, lane, m] = np.interp(t - late, t, y[:, m]) - y[:, m]
    weight, kind = np.asarray(slots.weight), np.asarray(slots.kind)
    out = {}
    for channel in OBSERVED:
        here = (kind == KINDS.index(channel)) & (weight > 0.0)
        if here.any():
            own = -moved * here
            out[channel] = _whitened(weighted, own)[weight > 0.0]
    return out


def _whitened(weighted: WeightedData, error: Float[np.ndarray, "T L M"]) -> Float[np.ndarray, "T L M"]:
    if available():
        return whitened(weighted.whitening, error[None], rows_of(weighted))[0]
    return np.asarray(_by_jax(weighted.whitening, error))


_by_jax = jax.jit(whiten)
