"""What a diagnosis finds, as plain data: the report, diagnosis.json and the notebook show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..estimation.result import FitResult
from ..problem.prediction_error import PredictionError
from ..problem.trace import Trace
from .settings import DEFAULT, DiagnosisSettings


@dataclass(frozen=True)
class Whiteness:
    """Is one channel's whitened residual noise?"""

    file: str  # the trace
    test: str  # rig test
    channel: str  # quantity
    n: int  # samples
    rms: float  # of the whitened residual; 1 where nothing is missing
    ljung_box: float  # p-value of no autocorrelation
    # the signal that it correlates with most: "input", "speed", "sign of speed", "angle", "current" or "time"
    strongest: str
    correlation: float  # with that signal
    p: float  # that signal's p-value, for the number of signals tried
    white: bool  # whether it is neither too large nor correlated


@dataclass(frozen=True)
class Share:
    """How much of the missing torque or voltage is a function of one quantity."""

    enters: str  # "torque" or "voltage"
    axis: str  # "angle", "speed", "current", "load" or "time"
    share: float  # of the variance of the missing torque or voltage that a smooth curve over the axis takes away


@dataclass(frozen=True, eq=False)
class Evidence:
    """The residual of one model."""

    rows: tuple[Whiteness, ...]  # by trace and channel
    white: bool  # all of them are white, or would be without one event of one trace
    shares: tuple[Share, ...]  # what the missing torque and voltage depend on, largest first
    sentences: tuple[str, ...]  # rows and shares in words


@dataclass(frozen=True)
class Candidate:
    """One effect of the catalogue in one round."""

    effect: str  # name
    # fall of chi2 that the score test promised; for an effect that a check of the rig had found, the fall in the refit
    screened: float
    own: float  # share of its signature that no fitted parameter can imitate; 0: they imitate all of it
    refitted: bool  # whether it was tried in a refit; the ratios are None otherwise
    fit_rms_ratio: float | None = None  # free-running error of the fitted traces with it over that without it
    holdout_rms_ratio: float | None = None  # the same of the held-out traces; None where there are none
    holdout_chi2_change: float | None = None  # of the held-out residual
    # change of the Bayesian information criterion, `prior` included; below -10 it is worth its parameters
    bic_change: float | None = None
    prior: float | None = None  # -2 ln prior, a part of it


@dataclass(frozen=True, eq=False)
class RoundReport:
    """One round: the model it began with, the effects tried, and the effect added."""

    effects: tuple[str, ...]  # at work beyond Eqs. 1-2
    evidence: Evidence  # of the residual
    # fit_rms, holdout_rms: free-run RMS of that model, sigma, by which the candidates' ratios are divided. The latter
    # None without a holdout.
    fit_rms: float
    holdout_rms: float | None
    candidates: tuple[Candidate, ...]  # the most promising first
    added: str | None  # the effect found, or None
    ties: tuple[str, ...]  # effects that explain these data as well as the one added
    why: str  # one sentence
    beside_formulas: bool = False  # whether effects with inexact formulas are at work in that model
    # chi2 per sample of that model, its formulas taken as exact; None far from the data, where the rows are exact too
    chi2_per_sample: float | None = None


@dataclass(frozen=True)
class Question:
    """A question on the cause of a misfit, with the probability of every answer."""

    asks: str  # the question in words
    answers: Mapping[str, float]  # probability of each answer; they exclude each other and add up to one


@dataclass(frozen=True)
class Statement:
    """What is stated of an effect that was added."""

    effect: str  # name
    probability: float  # that it is there, given the data
    certainty: str  # "found" from 0.90, "probably" from 0.70, "may be" below
    acted_on: bool  # whether it is likely enough to change rig.toml because of it (`DiagnosisSettings.suspicion`)
    # probability of each other explanation of the same misfit, by name, the likeliest first
    instead: Mapping[str, float]
    told_by: str  # the measurement that would decide between them
    sentence: str  # the statement in words, with the line of rig.toml that mends a mistake of the rig


@dataclass(frozen=True)
class Tie:
    """Effects that these data cannot tell apart: the first of them is the one in the model."""

    effects: tuple[str, ...]  # names
    # how far the fit with each of the others is from that with the first: rms over samples, in units of the noise
    apart: tuple[float, ...]
    told_by: str  # which measurement would separate them


@dataclass(frozen=True)
class SetTried:
    """A set of effects whose free run was compared with that of the set that the rounds found."""

    effects: tuple[str, ...]  # names
    bic_change: float  # of taking it in place of the set kept before it
    taken: bool  # whether it was taken


@dataclass(frozen=True)
class RigMistake:
    """Something wrong with the rig, or a habit of it, that was found in its traces."""

    effect: str  # name of the effect that takes it into account
    kind: str  # kind of mistake: series_resistance, channel_gain, channel_sign, ...
    test: str | None  # rig test; None: every test
    channel: str | None  # channel; None where none is meant
    size: float  # of the mistake, in `unit`; a share where that is empty
    unit: str  # SI
    mend: str  # the line of rig.toml, or the header of the CSV, that takes it into account
    sentence: str  # all that in words
    file: str | None = None  # trace; None: every trace of the test
    # its probability is below `settings.suspicion`: change nothing because of it; `sentence` says what to measure
    suspected: bool = False


@dataclass(frozen=True, eq=False)
class SetAside:
    """A trace of another rig, and the free runs of two throttle bodies for it."""

    trace: Trace  # as measured
    others: np.ndarray  # free run of the body that was fitted to all other traces, SI, shape (n, M)
    own: np.ndarray  # free run of the body that was fitted to this trace alone, likewise


@dataclass(frozen=True, eq=False)
class Unexplained:
    """Structure that no effect of the catalogue explains, as a smooth curve."""

    enters: str  # "torque", "friction", "voltage" or "position"
    depends_on: str  # "angle", "speed", "load", "current" or "time"
    # unit, axis_unit: of the curve and of its axis
    unit: str
    axis_unit: str
    # axis, curve, sd: the curve over the range that was measured, and its standard deviation, shape (n,) each
    axis: np.ndarray
    curve: np.ndarray
    sd: np.ndarray
    size: float  # rms of the contribution along the measured motion, in `unit`
    fit_rms_ratio: float  # free-running error with it over that without it, fitted traces
    holdout_rms_ratio: float | None  # the same, held-out traces
    bic_change: float  # of adding it
    # fit, holdout: free-run errors with it
    fit: tuple[PredictionError, ...]
    holdout: tuple[PredictionError, ...]
    sentence: str  # the finding in words
    # named effects whose formulas the curve corrects: the catalogue lacks no effect there
    corrects: tuple[str, ...] = ()


@dataclass(frozen=True)
class Discrepancy:
    """A random curve that the residual of the final model shows; intervals allow for it."""

    enters: str  # "torque", "friction", "voltage" or "position"
    depends_on: str  # "angle", "speed", "load", "current" or "time"
    size: float  # its standard deviation at any value of the axis
    unit: str  # of the size, SI


@dataclass(frozen=True, eq=False)
class Motion:
    """One trace drawn along its measured motion: what torque and voltage the model lacks there, shape (n,) each."""

    # file, test, held_out: which trace
    file: str
    test: str
    held_out: bool
    # "time" (s), "angle" (rad), "speed" (rad/s), "current" (A), "load" (N m through the gear)
    axes: Mapping[str, np.ndarray]
    torque: np.ndarray  # missing, N m; NaN where the plate rests or presses on a stop, or no angle was logged
    voltage: np.ndarray  # missing, V; NaN where no current was logged
    after: Mapping[str, np.ndarray]  # torque and voltage that the final model lacks, by name as above
    # for each added effect the torque (N m) and the voltage (V) it contributes there, by effect and name
    effects: Mapping[str, Mapping[str, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The effects that the first model lacked, and how much better the final model is.

    Args:
        before, after: the fits of the first and of the final model.
        start, final: effects at work beyond Eqs. 1-2.
        rounds: each round of the loop; the last one adds nothing.
        added: effects in the order found, without those that were taken away again or are in doubt.
        removed: a sentence for each effect that gave way to another or was taken away again.
        sets: far from the data, the set of effects that was grown in the free run.
        ties: effects that cannot be told apart.
        unexplained: structure that no effect explains; None where there is none.
        motions: missing torque and voltage along the measured motion.
        rig: mistakes of the rig itself among the effects added.
        probabilities: of every effect refitted, of "nothing" and "unexplained", given the data.
        questions: questions on the cause of the misfit, each with answers that exclude each other.
        statements: on each effect added, in the order found.
        aside: traces of another rig, with the evidence for it; the rest of the diagnosis is of the other traces.
        discrepancy: curves that the final residual shows; the intervals of `after` allow for them.
        verdict: the whole in a few sentences.
        settings: the settings of the diagnosis.
    """

    before: FitResult
    after: FitResult
    start: tuple[str, ...]
    final: tuple[str, ...]
    rounds: tuple[RoundReport, ...]
    added: tuple[str, ...]
    removed: tuple[str, ...]
    ties: tuple[Tie, ...]
    unexplained: Unexplained | None
    motions: tuple[Motion, ...] = field(repr=False)
    sets: tuple[SetTried, ...] = ()
    rig: tuple[RigMistake, ...] = ()
    aside: tuple[SetAside, ...] = field(default=(), repr=False)
    probabilities: Mapping[str, float] = field(default_factory=dict)
    questions: tuple[Question, ...] = ()
    statements: tuple[Statement, ...] = ()
    discrepancy: tuple[Discrepancy, ...] = ()
    verdict: tuple[str, ...] = ()
    settings: DiagnosisSettings = DEFAULT
