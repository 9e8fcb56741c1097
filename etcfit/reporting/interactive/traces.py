"""Data of each trace in the page: verdict and cure, channels of data and models, missing torque, input.

The verdict is a traffic light (a colour, a sign and a word). A trace is judged by the rule of `estimation.goodness`,
one held out under the filter of the final model too: its free run is off wherever an edge of the input fell between two
samples, however right the model. Of a model too far from the data to whiten the residual is the free-run error over the
sensors' noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...diagnosis.findings import Diagnosis, Motion
from ...estimation.agreement import in_words
from ...estimation.goodness import Goodness, Left, goodness_of, worst
from ...estimation.result import FitResult
from ...problem.prediction_error import columns
from ...problem.trace import Trace
from ...rig.base import ALLOWED_FOR, Finding
from .. import packed
from ..diagnosis.ledger import Shown
from ..pictures import all_traces
from .plant import Excitation, excitations

_SHOWN = {
    Left.FITS: ("green", "fits: nothing but noise is left"),
    Left.STRAYS: ("yellow", "fits from sample to sample, but its free run strays"),
    Left.MORE: ("yellow", "nearly: more than noise is left"),
    Left.FAR: ("red", "far off"),
}


@dataclass(frozen=True)
class Light:
    """The verdict on one trace."""

    channels: tuple[Goodness, ...]

    @property
    def worst(self) -> Goodness:
        """Its worst channel, by which the trace is judged."""
        return worst(self.channels)

    @property
    def shown(self) -> tuple[str, str]:
        """The verdict as a colour, "green", "yellow" or "red", and in words."""
        return _SHOWN[self.worst.left]

    @property
    def says(self) -> list[str]:
        """A sentence on each channel that does not fit."""
        return [each.says for each in self.channels if each.says]


def lights(result: FitResult) -> list[Light]:
    """One verdict per trace, fitted traces first, then held-out ones."""
    every, score = all_traces(result), (*result.score_fit, *result.score_holdout)
    return [
        Light(goodness_of([trace], [r], score, result.settings))
        for trace, r in zip(every, residuals(result), strict=True)
    ]


def residuals(result: FitResult) -> Sequence[np.ndarray]:
    """r of each trace, fitted traces first, then held-out ones; shape (n, M) each."""
    fitted, holdout = list(result.whitened), result.holdout
    if holdout is None:
        return fitted
    if result.far:
        return [*fitted, *((trace.data - np.asarray(result.predicted[trace.measurement.file])) / np.asarray(trace.sigma)
                           for trace in holdout.batch.traces)]  # fmt: skip
    r = holdout.residual(result.x, holdout.weighted(holdout.kalman(result.x)))
    return [*fitted, *columns(holdout.batch, r)]


_ASK = "What the model may lack has not been looked for: run `etcfit diagnose RUN`."
_EDGES = (
    "Log what drives the throttle faster, or in step with the output that switches it: then each edge has its instant."
)
_NOBODY = "Nothing found names this trace. `etcfit check --advise FOLDER --at RUN` says which further trace would tell."


def cures(trace: Trace, light: Light, final: FitResult, diagnosis: Diagnosis | None) -> list[str]:
    """Sentences, the most specific first; none for a trace whose residual is noise."""
    if light.worst.left in (Left.FITS, Left.STRAYS):
        return [] if light.worst.left is Left.FITS else [_EDGES]
    unit = {p.symbol: p.unit for p in final.free_parameters.layout.parameters}
    said = list(_of_the_rig(trace, final, diagnosis))
    said += [in_words(c, unit[c.parameter]) for c in final.contradictions if c.test == trace.test.name]
    said += [warning for warning in final.warnings if trace.measurement.file in warning]
    said += [_ASK] if diagnosis is None else list(_of_the_model(trace, diagnosis))
    return list(dict.fromkeys(said)) or [_NOBODY]


def _of_the_rig(trace: Trace, final: FitResult, diagnosis: Diagnosis | None) -> Iterator[str]:
    """Mistakes of the rig in this trace, each with the line of rig.toml that mends it or a measurement that decides."""
    mistakes: Sequence[Any] = (*(diagnosis.rig if diagnosis is not None else ()), *final.rig.findings)
    for each in mistakes:
        here = each.test in (None, trace.test.name) if each.file is None else each.file == trace.measurement.file
        if each.kind not in ALLOWED_FOR and here:
            if isinstance(each, Finding):
                yield f"{each.kind.replace('_', ' ')}: {each.found} Mend: {each.mend}"
            else:
                yield each.sentence


def _of_the_model(trace: Trace, diagnosis: Diagnosis) -> Iterator[str]:
    """Correlations of this trace's residual, the unexplained rest, and measurements that separate ties."""
    last = diagnosis.rounds[-1].evidence if diagnosis.rounds else None
    for row in last.rows if last is not None else ():
        if row.file == trace.measurement.file and not row.white:
            yield f"The residual of {row.channel.replace('_', ' ')} correlates with {row.strongest}."
    if diagnosis.unexplained is not None:
        yield diagnosis.unexplained.sentence
    for tie in diagnosis.ties:
        names = " and ".join(name.replace("_", " ") for name in tie.effects)
        yield f"{names} cannot be told apart here. What would: {tie.told_by}."


@dataclass(frozen=True, eq=False)
class Bins:
    """Groups of neighbouring samples, each of which becomes two points."""

    starts: np.ndarray  # first sample of each bin, shape (B,); in a short trace every sample is a bin
    size: int  # number of samples n

    @classmethod
    def of_samples(cls, size: int, most: int) -> Bins:
        """Bins of n samples for at most `most` points."""
        if size <= most:
            return cls(np.arange(size), size)
        return cls(np.unique(np.linspace(0, size, max(1, most // 2), endpoint=False).astype(int)), size)

    @property
    def whole(self) -> bool:
        """Whether every sample is kept."""
        return self.starts.size == self.size

    def instants(self, time: np.ndarray) -> np.ndarray:
        """Instants of the points: a quarter and three quarters into each bin, s; shape (n,) or (2 B,)."""
        if self.whole:
            return time
        ends = np.append(self.starts[1:], self.size) - 1
        begin, span = time[self.starts], time[ends] - time[self.starts]
        return np.stack([begin + 0.25 * span, begin + 0.75 * span], axis=1).ravel()

    def extremes(self, value: np.ndarray) -> np.ndarray:
        """Minimum and maximum of each bin in their order, shape as of `instants`; NaN for an empty bin."""
        if self.whole:
            return value
        size = np.diff(np.append(self.starts, self.size))
        places = self.starts[:, None] + np.arange(size.max())
        inside = np.less(np.arange(size.max()), size[:, None])
        piece = np.where(inside, value[np.minimum(places, self.size - 1)], np.nan)
        seen = np.isfinite(piece)
        lowest, highest = np.where(seen, piece, np.inf).argmin(axis=1), np.where(seen, piece, -np.inf).argmax(axis=1)
        both = np.sort(np.stack([lowest, highest], axis=1), axis=1)
        return np.where(np.any(seen, axis=1, keepdims=True), np.take_along_axis(piece, both, axis=1), np.nan).ravel()


_LEAST_SPAN = {"i": 0.02, "theta": 0.05, "omega": 1.0}  # A, rad, rad/s


_NUMBERS = 1_750_000  # drawn on a page, two bytes each: three megabytes and a half, a third more as text
_CORNERS = 110_000  # of inputs, eight bytes each
_FEWEST, _MOST = 100, 8_000  # points of one trace
# numbers of a point: two for its instant, four for missing torque and voltage; and for each channel the measurement,
# two models and their errors
_COLUMNS, _OF_CHANNEL = 6, 5


@dataclass(frozen=True, eq=False)
class TraceSources:
    """All data of the traces."""

    before: FitResult | None  # the first model if a diagnosis was made, else None
    final: FitResult  # the model of the page
    diagnosis: Diagnosis | None  # the diagnosis, or None


def traces_json(sources: TraceSources) -> list[dict[str, Any]]:
    """One object per trace, fitted traces first, then held-out ones."""
    every = all_traces(sources.final)
    columns = sum(_COLUMNS + _OF_CHANNEL * len(trace.channels) for trace in every)
    points, corners = (int(np.clip(budget // max(1, shares), _FEWEST, _MOST))
                       for budget, shares in ((_NUMBERS, columns), (_CORNERS, len(every))))  # fmt: skip
    problems = (sources.final.problem, *([sources.final.holdout] if sources.final.holdout is not None else []))
    driven = [each for problem in problems for each in excitations(problem, sources.final.x, corners)]
    motions = {motion.file: motion for motion in sources.diagnosis.motions} if sources.diagnosis is not None else {}
    return [
        _trace(sources, trace, light, motions.get(trace.measurement.file), excitation, points)
        for trace, light, excitation in zip(every, lights(sources.final), driven, strict=True)
    ]


def _trace(
    sources: TraceSources, trace: Trace, light: Light, motion: Motion | None, excitation: Excitation | str, points: int
) -> dict[str, Any]:
    bins = Bins.of_samples(trace.instants.size, points)
    simulated = isinstance(excitation, Excitation)
    return {
        "file": trace.measurement.file,
        "test": trace.test.name,
        "held_out": trace.measurement.held_out,
        "light": light.shown[0],
        "word": light.shown[1],
        "off": light.worst.off,
        "says": light.says,
        "cures": cures(trace, light, sources.final, sources.diagnosis),
        "samples": int(trace.instants.size),
        "whole": bins.whole,
        "t": packed.instants(bins.instants(trace.instants)),
        "channels": [_channel(sources, trace, m, bins) for m in range(len(trace.channels))],
        "missing": list(_missing(trace, motion, bins)),
        "sim": _sim(trace, excitation, sources.final) if simulated else None,
        "why_not": "" if simulated else excitation,
    }


def _channel(sources: TraceSources, trace: Trace, m: int, bins: Bins) -> dict[str, Any]:
    name, file = trace.channels[m], trace.measurement.file
    shown = Shown.of_channel(trace, name)

    def left(result: FitResult | None) -> dict[str, Any] | None:
        """Measured - simulated over the sensor's noise."""
        if result is None:
            return None
        return packed.values(bins.extremes((trace.data - np.asarray(result.predicted[file]))[:, m] / trace.sigma[m]))

    def carried(values: np.ndarray) -> dict[str, Any]:
        return packed.values(bins.extremes(shown(values)))

    def error(result: FitResult | None) -> float | None:
        """Free-run error over the sensor's noise."""
        rows = () if result is None or file not in result.predicted else (*result.score_fit, *result.score_holdout)
        found = next((row for row in rows if (row.file, row.channel) == (file, name)), None)
        return None if found is None or not np.isfinite(found.rms) else float(found.rms / found.sigma)

    def model(result: FitResult | None) -> dict[str, Any] | None:
        return None if result is None else carried(np.asarray(result.predicted[file])[:, m])

    return {
        "name": name,
        "unit": shown.unit,
        "size": shown.size,
        "origin": shown.origin,
        "sigma": float(trace.sigma[m]) / abs(shown.size),
        "measured": carried(trace.data[:, m]),
        "before": model(sources.before),
        "after": model(sources.final),
        "error_before": left(sources.before),
        "error_after": left(sources.final),
        "rms_before": error(sources.before),
        "rms_after": error(sources.final),
    }


def _missing(trace: Trace, motion: Motion | None, bins: Bins) -> Iterator[dict[str, Any]]:
    """Missing torque and voltage along the measured motion, with the first and with the final model, if known."""
    if motion is None or motion.torque.size != trace.instants.size:
        return
    for enters, unit, before in (("torque", "N m", motion.torque), ("voltage", "V", motion.voltage)):
        after = np.asarray(motion.after[enters], dtype=float)
        if np.isfinite(before).any() or np.isfinite(after).any():
            yield {
                "name": f"missing {enters}",
                "unit": unit,
                "before": packed.values(bins.extremes(np.asarray(before, dtype=float))),
                "after": packed.values(bins.extremes(after)),
            }


def _sim(trace: Trace, excitation: Excitation, final: FitResult) -> dict[str, Any]:
    """The input of the page's simulation, and the ranges of current, angle and speed (SI) that judge its steps."""
    release, boundary = excitation.release, excitation.boundary
    predicted = np.asarray(final.predicted[trace.measurement.file])
    to_state = {"current": ("i", 1.0), "position": ("theta", 1.0),
                "motor_speed": ("omega", 1.0 / boundary["gear_ratio"])}  # fmt: skip
    span = dict(_LEAST_SPAN)
    for m, name in enumerate(trace.channels):
        if name in to_state:
            state, factor = to_state[name]
            seen = predicted[np.isfinite(predicted[:, m]), m]
            span[state] = max(span[state], factor * float(np.ptp(seen)) if seen.size else 0.0)
    return {
        "t": packed.instants(excitation.time),
        "v": packed.floats(excitation.level),
        "within": excitation.within,
        "boundary": dict(boundary),
        "start": list(excitation.start),
        "release": release if np.isfinite(release) else None,
        "readings": {name: list(line) for name, line in excitation.readings.items()},
        "lacks": list(excitation.lacks),
        "span": span,
    }
