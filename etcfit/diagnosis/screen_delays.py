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

from ..model.parameters import parameters_of
from ..model.rig_effects import DRIVING, OBSERVED, AbstractRigEffect, Place
from ..problem.batch import KINDS
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel
from .composition import Effect, is_of_one_channel
from .screen import Background, Signature, Variant, ranked
from .settings import DiagnosisSettings
from .single_traces import rows_by_file, whitened

RigEffect = type[AbstractRigEffect]

_SHIFTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # sample intervals that are tried, late and early
_SHORT = 0.5  # sample intervals over which a shift is taken as linear
_SAME_RATE = 0.01  # relative difference of two sample intervals that no screening sees


class _Change(NamedTuple):
    """What the residual of the fitted samples would change by, were every channel late by so many sample intervals.

    Args:
        shift: sample intervals of each test, or of each trace; None: by channel for one interval, in the limit of a
            short shift.
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
    """The signature of every candidate that logs late, the most promising first; of those of single traces, and of
    single channels of them, only the few that stand out the most.

    Args:
        background: of the model and residual without them.
        problem, x, weighted: that model.
        candidates: effects of the rig that delay.
        settings: `single_traces`.
    """
    rows, intervals = rows_by_file(problem, weighted), _Intervals.of(problem)
    changes = _changes(problem, x, weighted, intervals.of_tests)
    # a trace that was logged at another rate than its test is late by samples of its own
    of_traces = changes if intervals.alike else _changes(problem, x, weighted, intervals.of_traces)
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect)]
    kinds = [[e for e in rigs if e.place.file and is_of_one_channel(e) is single] for single in (False, True)]
    gains = {e: _gains(e, background, of_traces if e.place.file else changes, rows) for e in rigs}
    few = settings.single_traces
    alone = [e for kind in kinds for e in sorted(kind, key=lambda effect: -gains[effect].max())[:few]]
    found = []
    for effect in (*(e for e in rigs if not e.place.file), *alone):
        (p,) = parameters_of(effect)
        change = (of_traces if effect.place.file else changes)[int(np.argmax(gains[effect]))]
        way = -1.0 if effect.place.channel in DRIVING else 1.0  # beside a late input all others are early
        by = way * intervals.at(effect.place) * (1.0 if change.shift is None else change.shift)
        column, own = np.zeros((background.r.size, 1)), _of(effect, rows)
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


class _Intervals(NamedTuple):
    """Usual sample intervals, s: of the test of each trace, and of the trace itself, by file."""

    of_tests: Mapping[str, float]
    of_traces: Mapping[str, float]

    @classmethod
    def of(cls, problem: EstimationProblem) -> _Intervals:
        spans = {trace.measurement.file: np.diff(trace.instants) for trace in problem.batch.traces}
        tests: dict[str, list[np.ndarray]] = {}
        for file, each in spans.items():
            tests.setdefault(Place.named(file).test, []).append(each)
        usual = {test: float(np.median(np.concatenate(each))) for test, each in tests.items()}
        return cls({f: usual[Place.named(f).test] for f in spans}, {f: float(np.median(s)) for f, s in spans.items()})

    @property
    def alike(self) -> bool:
        """Whether every trace was logged at the rate of its test."""
        return all(np.isclose(own, self.of_tests[file], rtol=_SAME_RATE) for file, own in self.of_traces.items())

    def at(self, place: Place) -> float:
        """Of a trace, or of a test."""
        if place.file:
            return self.of_traces[place.file]
        return next(usual for file, usual in self.of_tests.items() if Place.named(file).test == place.test)


def _changes(
    problem: EstimationProblem, x: np.ndarray, weighted: WeightedData, intervals: Mapping[str, float]
) -> list[_Change]:
    """By a short shift, and by every one of `_SHIFTS`, late and early, each in intervals by file."""
    seen = columns(problem.batch, problem.simulated(x, problem.guide_stiffness))

    def change(shift: float) -> dict[str, np.ndarray]:
        return _change(problem, weighted, seen, {file: shift * interval for file, interval in intervals.items()})

    late, early = change(_SHORT), change(-_SHORT)
    slope = {channel: (late[channel] - early[channel]) / (2.0 * _SHORT) for channel in late}
    return [_Change(None, slope), *(_Change(way * by, change(way * by)) for by in _SHIFTS for way in (1.0, -1.0))]


def _change(
    problem: EstimationProblem, weighted: WeightedData, seen: Sequence[np.ndarray], late_by: Mapping[str, float]
) -> dict[str, np.ndarray]:
    """Change of the residual of the fitted samples, shape (n,), by channel that was observed, were every trace late by
    so many seconds."""
    batch = problem.batch
    slots, moved = weighted.slots, np.zeros(np.shape(weighted.slots.value))
    for trace, (lane, _, marks), y in zip(batch.traces, batch.places, seen, strict=True):
        t, late = trace.instants, late_by[trace.measurement.file]
        for m in range(len(trace.channels)):
            moved[marks, lane, m] = np.interp(t - late, t, y[:, m]) - y[:, m]
    weight, kind = np.asarray(slots.weight), np.asarray(slots.kind)
    out = {}
    for channel in OBSERVED:
        here = (kind == KINDS.index(channel)) & (weight > 0.0)
        if here.any():
            out[channel] = whitened(weighted, -moved * here)[weight > 0.0]
    return out
