"""The signature in the residual of rig effects of single traces, and of signals that are logged late."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from ..kernels.machine import available
from ..model.parameters import declared, parameters_of
from ..model.rig_effects import DRIVING, FAMILY_BY_KIND, OBSERVED, AbstractRigEffect, Place, number_of
from ..problem import late_kernels
from ..problem.batch import KINDS
from ..problem.innovations import whiten
from ..problem.one_pass_kernels import rows_of
from ..problem.prediction_error import columns
from ..problem.problem import EstimationProblem
from ..problem.residual import WeightedData
from .candidate_model import CandidateModel
from .composition import Effect, is_of_one_channel
from .screen import Background, Signature, ranked
from .settings import DiagnosisSettings
from .tangents import Tangents, Variant

# ---- The signature of an effect of the rig in one trace: the tangent of a parameter, restricted to that trace
#
#     d r / d a = d r / d p in the samples of the trace, 0 elsewhere
#
# A winding that was warm in one trace has the tangent of R_a there (`like` of the effect's family). A channel that
# reads too much in one trace has the tangent of the same effect of the whole test, where the model contains that one;
# elsewhere the change of the reading is whitened: - W (d y_logged / d a). So one known tangent, or one whitening,
# serves hundreds of traces.


LATE_STRETCHES = (
    20  # equal parts of a trace, each one event: a lateness must explain more than the part that gains most
)


RigEffect = type[AbstractRigEffect]


def screen_of_single_traces(
    background: Background,
    tangents: Tangents,
    problem: EstimationProblem,
    x: np.ndarray,
    weighted: WeightedData,
    candidates: Sequence[Effect],
    settings: DiagnosisSettings,
) -> list[Signature]:
    """The signatures of the candidates that lower chi2 most, of whole traces and of single channels; candidates whose
    tangent is unknown here are left out."""
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect)]
    if not rigs:
        return []
    rows, columns = rows_by_file(problem, weighted), _Columns(background, tangents, problem, x, weighted)
    known = {e: column for e in rigs if (column := columns.of_effect(e)) is not None}
    kinds = [{e: c for e, c in known.items() if is_of_one_channel(e) is single} for single in (False, True)]
    few, found = settings.single_traces, []
    for effect in (e for kind in kinds for e in _standing_out(kind, background, rows)[:few]):
        (p,) = parameters_of(effect)
        own, whole = rows[effect.place.file], np.zeros((background.r.size, 1))
        whole[own, 0] = known[effect][own]
        found.append(background.signature(Variant(effect, {}, (p.symbol,)), whole, {p.symbol: p}))
    return found


def of_whole_tests(candidates: Sequence[Effect]) -> set[str]:
    """Parameters of effects of whole tests whose tangents give the signatures of candidates of single traces."""
    rigs = [e for e in candidates if issubclass(e, AbstractRigEffect) and not e.like]
    return {p.symbol for e in rigs for p in parameters_of(_in_whole_test(e))}


def _in_whole_test(effect: RigEffect) -> RigEffect:
    return FAMILY_BY_KIND[effect.kind].at(effect.place._replace(file=""))


class _Columns:
    """Signatures of effects of single traces, computed for every trace of their test.

    Args:
        background, tangents, problem, x, weighted: as of `screen_of_single_traces`.
    """

    def __init__(
        self,
        background: Background,
        tangents: Tangents,
        problem: EstimationProblem,
        x: np.ndarray,
        weighted: WeightedData,
    ) -> None:
        self._background, self._tangents = background, tangents
        self._problem, self._x, self._weighted = problem, x, weighted
        self._kept: dict[RigEffect, np.ndarray | None] = {}

    def of_effect(self, effect: RigEffect) -> np.ndarray | None:
        """d residual / d amplitude over its scale, shape (n,); None where it is unknown."""
        whole = _in_whole_test(effect)
        if whole not in self._kept:
            self._kept[whole] = self._of_test(whole)
        return self._kept[whole]

    def _of_test(self, whole: RigEffect) -> np.ndarray | None:
        (p,) = parameters_of(whole)
        if whole.like:
            return self._of_parameter(whole.like, p.domain.scale)
        found = self._tangents.along(p.symbol, p.domain.scale)
        return self._of_reading(whole) if found is None and whole.place.channel in OBSERVED else found

    def _of_parameter(self, symbol: str, scale: float) -> np.ndarray | None:
        """The derivative by a parameter of the throttle, which the background contains."""
        layout = self._problem.layout
        if symbol not in layout.free:
            return None
        k = layout.free.index(symbol)
        return self._background.jacobian[:, k] * scale / layout.numbers(self._x)[1][k]

    def _of_reading(self, whole: RigEffect) -> np.ndarray:
        """- W (y_logged - y_hat) at an amplitude of its scale, in every trace."""
        ((field, p),) = declared(whole).items()
        channel, weight = whole.place.channel, np.asarray(self._weighted.slots.weight)
        seen = self._seen
        read = whole(**{field: p.domain.scale}).read({channel: seen}, number_of(whole.place.test), None)[channel]
        here = (np.asarray(self._weighted.slots.kind) == KINDS.index(channel)) & (weight > 0.0)
        return whitened(self._weighted, np.where(here, seen - read, 0.0))[weight > 0.0]

    @cached_property
    def _seen(self) -> Float[np.ndarray, "T L M"]:
        return self._problem.simulated(self._x, self._problem.guide_stiffness)


def whitened(weighted: WeightedData, error: Float[np.ndarray, "T L M"]) -> Float[np.ndarray, "T L M"]:
    """An error, SI, whitened by the filter of the data."""
    if available():
        return late_kernels.whitened(weighted.whitening, error[None], rows_of(weighted))[0]
    return np.asarray(_by_jax(weighted.whitening, error))


_by_jax = jax.jit(whiten)


def _standing_out(
    alone: Mapping[RigEffect, np.ndarray], background: Background, rows: Mapping[str, np.ndarray]
) -> list[RigEffect]:
    """Effects of single traces by how much they would lower chi2 from the samples of the trace alone, the most first.

    Args:
        alone: the effects, and the signature of each in all samples, shape (n,).
        rows: fitted samples of each trace, by file.
    """
    gains: dict[RigEffect, float] = {}
    for effect, column in alone.items():
        own = rows[effect.place.file]
        gains[effect] = float(background.among(own, column[own, None]).gain[0])
    return sorted(alone, key=lambda effect: -gains[effect])


def rows_by_file(problem: EstimationProblem, weighted: WeightedData) -> dict[str, np.ndarray]:
    """Which of the fitted samples, in the order of the residual's, belong to each trace, by file."""
    weight = np.asarray(weighted.slots.weight)
    number = np.full(weight.shape, -1)
    for k, (lane, _, marks) in enumerate(problem.batch.places):
        number[marks, lane] = k
    fitted = number[weight > 0.0]
    return {trace.measurement.file: np.flatnonzero(fitted == k) for k, trace in enumerate(problem.batch.traces)}


# ---- The signature of a channel or a trace that is logged late: the same simulation, read at other times.
#
#     r(late) - r(0) = -W (y_hat(t - late) - y_hat(t))
#
# No new simulation is needed, and the whitening W of a trace does not depend on other traces. So one whitening for each
# channel and each lateness tried serves every test and every trace, and hundreds of candidates are cheap. A shift as
# long as the changes of the signal has no useful derivative, so several shifts of either sign are tried; a short one is
# taken as linear.

_SHIFTS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # sample intervals that are tried, late and early
_SHORT = 0.5  # sample intervals over which a shift is taken as linear
_SAME_RATE = 0.01  # relative difference up to which two sample intervals count as equal


class _Change(NamedTuple):
    """Change of the residual of the fitted samples if every channel were late by so many sample intervals."""

    # sample intervals of each test, or of each trace; None: by channel for one interval, in the limit of a short shift
    shift: float | None
    by_channel: Mapping[str, np.ndarray]  # shape (n,) each

    def by_effect(self, effect: RigEffect, rows: np.ndarray) -> np.ndarray:
        """The change by the channels that an effect makes late, one or all, in some of the fitted samples."""
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
    """The signature of every candidate that logs late, the most promising first; among candidates of single traces, and
    of single channels of them, only the few that lower chi2 most."""
    rows, intervals = rows_by_file(problem, weighted), _Intervals.of_problem(problem)
    changes = _changes(problem, x, weighted, intervals.of_tests)
    # a trace that was logged at another rate than its test is late by its own sample intervals
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
        way = -1.0 if effect.place.channel in DRIVING else 1.0  # relative to a late input all other channels are early
        by = way * intervals.at(effect.place) * (1.0 if change.shift is None else change.shift)
        column, own = np.zeros((background.r.size, 1)), _of(effect, rows)
        column[own, 0] = change.by_effect(effect, own) * p.domain.scale / by
        shape = {} if change.shift is None else {p.symbol: by}
        found.append(background.signature(Variant(effect, shape, (p.symbol,)), column, {p.symbol: p}))
    return ranked(found)


def gain_in_one_event(s: CandidateModel, effect: Effect) -> float:
    """The largest fall of chi2 that an effect at work makes in one stretch of a trace."""
    without = s.without(effect)
    with_it, before = (
        columns(each.problem.batch, each.problem.residual(each.x, each.weighted)) for each in (s, without)
    )
    gains = [
        np.sum(stretch)
        for old, new in zip(before, with_it, strict=True)
        for stretch in np.array_split(np.nansum(old**2 - new**2, axis=1), LATE_STRETCHES)
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
    """Fall of chi2 that an effect promises for each change, from the samples of its own traces alone."""
    own = _of(effect, rows)
    among = background.among(own, np.column_stack([change.by_effect(effect, own) for change in changes]))
    far = np.array([change.shift is not None for change in changes])
    return np.where(far, np.where(among.power > 0.0, -2.0 * among.way - among.power, 0.0), among.gain)


class _Intervals(NamedTuple):
    """Usual sample intervals, s: of the test of each trace, and of the trace itself, by file."""

    of_tests: Mapping[str, float]
    of_traces: Mapping[str, float]

    @classmethod
    def of_problem(cls, problem: EstimationProblem) -> _Intervals:
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
