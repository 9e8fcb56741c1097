"""A held-out trace of another session: whether another scale of its drive explains what the model misses there.

    e(g) = rms of (y - y_hat(g u)) over sigma,    g: the drive that acted over the one logged

A throttle whose winding is warm, or whose supply is lower than the one stated, gets less torque out of the same log. A
trace that the model misses by far more than those it was fitted to is run again with its drive at other scales; where
one of them takes away most of the error, it is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..problem.prediction_error import PredictionError, pooled, rows
from ..problem.problem import EstimationProblem
from ..problem.trace import Trace
from .settings import SessionSettings

_FACTORS = np.exp(np.linspace(-0.5, 0.5, 41))  # of the drive: 0.61 to 1.65 in steps of 2.5 %
_FINER = np.exp(np.linspace(-0.025, 0.025, 11))


class DriveScale(NamedTuple):
    """The drive of one trace at the scale that suits it best.

    Args:
        file: of the trace.
        factor: drive that acted over the one logged.
        before, after: error of the free run with the drive as logged and at that scale, in sigma.
    """

    file: str
    factor: float
    before: float
    after: float

    @property
    def words(self) -> str:
        """For the warnings of a fit."""
        off = 100.0 * (self.factor - 1.0)
        size = f"{abs(off):.2g} % {'stronger' if off > 0.0 else 'weaker'}"
        return (
            f"{self.file} is held out, and the model misses it by {self.before:.3g} times the noise, far more than "
            f"what it was fitted to. With a drive {size} than logged it would miss it by {self.after:.3g}: another "
            "supply or another temperature of the winding does that. Log supply and temperature with each session."
        )


def drive_scale(problem: EstimationProblem, x: np.ndarray, trace: Trace) -> DriveScale:
    """The scale of a trace's drive at which the model comes nearest to it.

    Args:
        problem: of the fitted traces.
        x: coordinates where the fit ended, shape (P,).
        trace: driven, by no ECU in the model.
    """
    before, *coarse = _errors(problem, x, trace, np.array([1.0, *_FACTORS]))
    about = _FACTORS[int(np.argmin(coarse))]
    finer = about * _FINER
    errors = _errors(problem, x, trace, finer)
    best = int(np.argmin(errors))
    return DriveScale(trace.measurement.file, float(finer[best]), before, errors[best])


def drives_of_another_session(
    problem: EstimationProblem,
    x: np.ndarray,
    held_out: Sequence[Trace],
    errors: tuple[Sequence[PredictionError], Sequence[PredictionError]],
    settings: SessionSettings,
) -> tuple[DriveScale, ...]:
    """Held-out traces that the model misses far more than the fitted ones, and misses little with another drive.

    Args:
        problem: of the fitted traces.
        x: coordinates where the fit ended, shape (P,).
        held_out: the other traces.
        errors: of the free run, of the fitted and of the held-out traces.
        settings: what is far more, and what is little.
    """
    fitted, others = errors
    usual, found = pooled(fitted), []
    for trace in held_out:
        own = [row for row in others if row.file == trace.measurement.file]
        if trace.input is None or trace.controlled or not own or not pooled(own) > settings.strange * usual:
            continue
        scale = drive_scale(problem, x, trace)
        if scale.after < settings.explained * scale.before:
            found.append(scale)
    return tuple(found)


def _errors(problem: EstimationProblem, x: np.ndarray, trace: Trace, factors: np.ndarray) -> list[float]:
    """Of the free run at each scale of the drive, in sigma."""
    signal = trace.input
    assert signal is not None, f"{trace.measurement.file} is not driven: it has no drive to scale"
    scaled = tuple(replace(trace, input=replace(signal, value=factor * signal.value)) for factor in factors)
    beside = problem.beside(scaled, x)
    free = beside.free_run(x)
    return [pooled(rows((one,), (model,))) for one, model in zip(beside.batch.traces, free, strict=True)]
