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
from ..problem.program import QUICK, Program
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

    def of(self, effect: RigEffect, rows: np.ndarray) -> np.ndarray:
        """Of the channels that an effect moves, in some of the fitted samples: of one, or of all."""
        channel = effect.place.channel
        moved = [self.by_channel[channel]] if channel in OBSERVED else self.by_channel.values()
        return np.sum([np.nan_to_num(each[rows], posinf=0.0, neginf=0.0) for each in moved], axis=0)


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
    gains = {effect: _gains(effect, background, changes, rows) for effect in rigs}
    alone = sorted((e for e in rigs if e.place.file), key=lambda effect: -gains[effect].max())
    found = []
    for effect in (e for e in rigs if e not in alone[settings.single_traces :]):
        (p,) = parameters_of(effect)
        change, own = changes[int(np.argmax(gains[effect]))], _of(effect, rows)
        way = -1.0 if effect.place.channel in DRIVING else 1.0  # beside a late input all others are early
        by = way * intervals[effect.place.test] * (1.0 if change.shift is None else change.shift)
        column = np.zeros((background.r.size, 1))
        column[own, 0] = change.of(effect, own) * p.domain.scale / by
        shape = {} if change.shift is None else {p.symbol: by}
        found.append(background.signature(Variant(effect, shape, (p.symbol,)), column, {p.symbol: p}))
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


def _of(effect: RigEffect, rows: Mapping[str, np.ndarray]) -> np.ndarray:
    """Fitted samples of the traces in which an effect is at work."""
    test, file = effect.place.test, effect.place.file
    return np.concatenate(
        [own for name, own in rows.items() if name == file or (not file and name.startswith(f"{test}/"))]
    )


def _gains(
    effect: RigEffect, background: Background, changes: Sequence[_Change], rows: Mapping[str, np.ndarray]
) -> np.ndarray:
    """By how much an effect would lower chi2 by each change, from the samples of its own traces alone."""
    own = _of(effect, rows)
    among = background.among(own, np.column_stack([change.of(effect, own) for change in changes]))
    far = np.array([change.shift is not None for change in changes])
    return np.where(far, np.where(among.power > 0.0, -2.0 * among.way - among.power, 0.0), among.gain)


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


_by_jax = Program(whiten, static=0, options=QUICK)
