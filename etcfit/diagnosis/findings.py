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

    # file, test, channel, n: where, and how many samples
    file: str
    test: str
    channel: str
    n: int
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
    """One effect of the catalogue in one round.

    Args:
        effect: name.
        screened: fall of chi2 that the score test promised; for an effect that a check of the rig had found, the fall
            in the refit.
        own: share of its signature that no fitted parameter can imitate; 0: they imitate all of it.
        refitted: whether it was tried in a refit; the ratios are None otherwise.
        fit_rms_ratio, holdout_rms_ratio: free-run RMS over that without the effect.
        holdout_chi2_change: of the held-out residual.
        bic_change: below 0 where it is worth its parameters.
        prior: -2 ln prior, a part of it.
    """

    effect: str
    screened: float
    own: float
    refitted: bool
    fit_rms_ratio: float | None = None
    holdout_rms_ratio: float | None = None
    holdout_chi2_change: float | None = None
    bic_change: float | None = None
    prior: float | None = None


@dataclass(frozen=True, eq=False)
class RoundReport:
    """One round: the model it began with, the effects tried, and the effect added.

    Args:
        effects: at work beyond Eqs. 1-2.
        evidence: of the residual.
        fit_rms, holdout_rms: free-run RMS of that model, sigma, by which the candidates' ratios are divided. The latter
            None without a holdout.
        candidates: the most promising first.
        added: the effect found, or None.
        ties: effects that explain these data as well as the one added.
        why: one sentence.
        beside_formulas: whether effects with inexact formulas are at work in that model.
    """

    effects: tuple[str, ...]
    evidence: Evidence
    fit_rms: float
    holdout_rms: float | None
    candidates: tuple[Candidate, ...]
    added: str | None
    ties: tuple[str, ...]
    why: str
    beside_formulas: bool = False


@dataclass(frozen=True)
class Question:
    """A question on the cause of a misfit, with the probability of every answer.

    Args:
        asks: the question in words.
        answers: probability of each answer; they exclude each other and add up to one.
    """

    asks: str
    answers: Mapping[str, float]


@dataclass(frozen=True)
class Statement:
    """What is stated of an effect that was added.

    Args:
        effect: name.
        probability: that it is there, given the data.
        certainty: "found" from 0.90, "probably" from 0.70, "may be" below.
        acted_on: whether it is likely enough to change rig.toml because of it (`DiagnosisSettings.suspicion`).
        instead: probability of each other explanation of the same misfit, by name, the likeliest first.
        told_by: the measurement that would decide between them.
        sentence: the statement in words, with the line of rig.toml that mends a mistake of the rig.
    """

    effect: str
    probability: float
    certainty: str
    acted_on: bool
    instead: Mapping[str, float]
    told_by: str
    sentence: str


@dataclass(frozen=True)
class Tie:
    """Effects that these data cannot tell apart: the first of them is the one in the model."""

    effects: tuple[str, ...]  # names
    # how far the fit with each of the others is from that with the first: rms over samples, in units of the noise
    apart: tuple[float, ...]
    told_by: str  # which measurement would separate them


@dataclass(frozen=True)
class SetTried:
    """A set of effects that was refitted and compared with the one that the rounds found."""

    effects: tuple[str, ...]  # names
    # of taking it in place of the rounds' own set; None where the two cannot be compared, because one of them is far
    # from its data or has an effect that is not worth its parameters
    bic_change: float | None
    taken: bool  # whether it was taken


@dataclass(frozen=True)
class RigMistake:
    """Something wrong with the rig, or a habit of it, that was found in its traces."""

    effect: str  # name of the effect that takes it into account
    kind: str  # kind of mistake, see formats.md (diagnosis.json, `rig`)
    # test, channel: where; None where it is everywhere
    test: str | None
    channel: str | None
    # size, unit: of it, SI; a share where the unit is ""
    size: float
    unit: str
    mend: str  # the line of rig.toml that takes it into account
    sentence: str  # sentence of the statement on the effect
    file: str | None = None  # the one trace that it is in; None: it is in every trace of the test
    suspected: bool = False  # whether its probability is below `DiagnosisSettings.suspicion`


@dataclass(frozen=True, eq=False)
class SetAside:
    """A trace of another rig, and the free runs of two throttle bodies for it."""

    trace: Trace  # as measured
    others: np.ndarray  # free run of the body that was fitted to all other traces, SI, shape (n, M)
    own: np.ndarray  # free run of the body that was fitted to this trace alone, likewise


@dataclass(frozen=True, eq=False)
class Unexplained:
    """Structure that no effect of the catalogue explains, as a smooth curve.

    Args:
        enters: "torque", "friction", "voltage" or "position".
        depends_on: "angle", "speed", "load", "current" or "time".
        unit, axis_unit: of the curve and of its axis.
        axis, curve, sd: the curve over the range that was measured, and its standard deviation, shape (n,) each.
        size: rms of the contribution along the measured motion, in `unit`.
        fit_rms_ratio, holdout_rms_ratio: free-run errors with it over those without.
        bic_change: of adding it.
        fit, holdout: free-run errors with it.
        doubts: named effects that the curve replaces without loss: they are not proven.
        sentence: the finding in words.
        corrects: named effects whose formulas the curve corrects: the catalogue lacks no effect there.
    """

    enters: str
    depends_on: str
    unit: str
    axis_unit: str
    axis: np.ndarray
    curve: np.ndarray
    sd: np.ndarray
    size: float
    fit_rms_ratio: float
    holdout_rms_ratio: float | None
    bic_change: float
    fit: tuple[PredictionError, ...]
    holdout: tuple[PredictionError, ...]
    doubts: tuple[str, ...]
    sentence: str
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
        sets: sets of effects that were refitted and compared with the one that the rounds found.
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
