"""A Diagnosis made by hand: a limp-home spring that Eqs. 1-2 lack, and a little left unexplained; and verdicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import results
from etcfit.diagnosis.composition import Effect
from etcfit.diagnosis.findings import (
    Candidate,
    Diagnosis,
    Discrepancy,
    Evidence,
    Motion,
    RoundReport,
    SetTried,
    Share,
    Tie,
    Unexplained,
    Whiteness,
)
from etcfit.diagnosis.probabilities import probabilities, questions
from etcfit.diagnosis.score import Score
from etcfit.diagnosis.settings import DEFAULT
from etcfit.diagnosis.statements import Named, statement
from etcfit.diagnosis.trial import TrialVerdict
from etcfit.estimation.joint_fit import FitResult
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.problem.prediction_error import PredictionError, pooled
from etcfit.rig.base import Rig

FOUND = "limp_home_spring"


def diagnosis(rig: Rig, **changes: Any) -> Diagnosis:
    """Errors of 20 sigma before, of 1 after."""
    before, after = results.result(rig, off=20.0), results.result(rig, added=(FOUND,), off=0.5)
    of_rounds = rounds(before), (FOUND,), False, DEFAULT
    asked = questions(*of_rounds)
    fields: dict[str, Any] = {
        "before": before,
        "after": after,
        "start": (),
        "final": (FOUND,),
        "rounds": rounds(before),
        "added": (FOUND,),
        "removed": ("backlash was taken away again: later effects explain the same (BIC -3.0).",),
        "sets": (SetTried((FOUND, "backlash"), 12.5, False), SetTried(("gravity_load", "backlash"), -3.0, False)),
        "ties": (
            Tie(
                (FOUND, "airflow_torque"),
                (0.03,),
                "limp_home_spring: a slow ramp; airflow_torque: the same without air",
            ),
        ),
        "unexplained": unexplained(after),
        "discrepancy": (Discrepancy("friction", "time", 0.0027, "N*m"),),
        "probabilities": probabilities(asked, *of_rounds),
        "questions": asked,
        "statements": (statement(EFFECT_BY_NAME[FOUND], Named(FOUND), 0.9, asked[0].answers, DEFAULT),),
        "motions": (motion("response/1.csv", False, 0), motion("response/2.csv", True, 1)),
        "verdict": ("Eqs. 1-2 lack the limp-home spring.", "With it, the held-out error falls to the noise."),
    }
    return Diagnosis(**(fields | changes))


def explained(rig: Rig) -> Diagnosis:
    """The start model already explains the data."""
    same = results.result(rig)
    fine = Evidence((whiteness(1.0, True),), True, (Share("torque", "angle", 0.001),), ("All residuals are white.",))
    nothing = RoundReport(
        (), fine, 1.0, 1.0, (), None, (), "No effect of the catalogue promises to explain anything more."
    )
    motions = tuple(replace(m, effects={}) for m in (motion("response/1.csv", False, 0),))
    return diagnosis(rig, before=same, after=same, final=(), rounds=(nothing,), added=(), removed=(), sets=(), ties=(),
                     statements=(), questions=questions((nothing,), (), False, DEFAULT),
                     discrepancy=(), unexplained=None, motions=motions, verdict=("Nothing is missing.",))  # fmt: skip


def rounds(before: FitResult) -> tuple[RoundReport, ...]:
    """One that adds the spring, one that adds nothing."""
    shares = (Share("torque", "angle", 0.62), Share("torque", "load", 0.21), Share("torque", "speed", 0.08),
              Share("voltage", "current", 0.03))  # fmt: skip
    says = ("2 of 8 residuals are not white.", "Of the missing torque, a curve over one quantity explains: angle 62 %.")
    first = Evidence((whiteness(20.0, False),), False, shares, says)
    last = Evidence((whiteness(1.0, True),), True, (Share("torque", "angle", 0.01),), ("All residuals are white.",))
    best = Candidate(FOUND, 41000.0, 0.8, True, 0.06, 0.05, -39000.0, -30412.7)
    other = Candidate("airflow_torque", 30500.0, 0.7, True, 0.41, 0.47, -21000.0, -15002.1)
    third = Candidate("stribeck_friction", 9000.0, 0.5, True, 0.9, 0.93, -5000.0, -812.0)
    rest = tuple(
        Candidate(name, 50.0 - k, 0.1, False) for k, name in enumerate(("backlash", "gravity_load", "cogging_torque"))
    )
    small = Candidate("cogging_torque", 12.0, 0.9, True, 0.999, 1.001, 3.0, 8.1)
    fit, held = pooled(before.score_fit), pooled(before.score_holdout)
    return (
        RoundReport(
            (), first, fit, held, (best, other, third, *rest), FOUND, ("airflow_torque",), f"{FOUND} explains most."
        ),
        RoundReport(
            (FOUND,), last, 0.06 * fit, 0.05 * held, (small,), None, (), "cogging_torque is not worth its parameters."
        ),
    )


def error(ratio: float, n: int = 10, sigma: float = 0.01) -> PredictionError:
    """Free-run error of so many sigma."""
    return PredictionError("response/a.csv", "response", "position", "deg", n, ratio * sigma, sigma)


def score(chi2: float, count: float = 1000.0, held_out: float | None = None, rms: float = 1.0) -> Score:
    """Free-run errors of `rms` sigma; nothing is held out without `held_out`."""
    return Score(chi2, count, held_out, (error(rms),), () if held_out is None else (error(rms),))


def verdict(effect: Effect, bic: float, **changes: Any) -> TrialVerdict:
    """Of an effect that lowers chi2 of 1000 samples from 1000 to 900 and helps on the traces held out."""
    fields: dict[str, Any] = {
        "score": score(changes.pop("chi2", 900.0)),
        "samples": 1000.0,
        "fit_rms_ratio": 0.7,
        "holdout_rms_ratio": 0.8,
        "holdout_chi2_change": -50.0,
        "gain": 100.0,
        "slack": 0.02,
    }
    return TrialVerdict(effect=effect, bic_change=bic, **(fields | changes))


def whiteness(rms: float, white: bool) -> Whiteness:
    p = 0.4 if white else 0.0
    return Whiteness("response/1.csv", "response", "position", 60, rms, p, "angle", -0.4, p, white)


def motion(file: str, held_out: bool, seed: int, n: int = 3000) -> Motion:
    """Strokes over the travel; below 9 degrees a spring of 0.25 N m and more that the first model took for preload."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, 12.0, n)
    angle = np.clip(0.8 + 0.79 * np.sin(1.3 * time) + 0.02 * np.sin(31.0 * time), 0.0, 1.57)
    speed = np.gradient(angle, time)
    spring = 0.25 / (1.0 + np.exp((angle - 0.157) / 0.01)) + 0.4 * np.clip(0.157 - angle, 0.0, None)
    left = 0.006 * np.sin(6.0 * angle) + 0.02 * rng.standard_normal(n)
    resting = np.abs(speed) < 0.02
    torque = np.where(resting, np.nan, spring - 0.06 + 0.06 * angle + left)
    current = 0.6 + 0.4 * angle + 0.3 * np.sign(speed) + 0.02 * rng.standard_normal(n)
    voltage = 0.004 * rng.standard_normal(n)
    axes = {"time": time, "angle": angle, "speed": speed, "current": current, "load": 0.39 * current}
    effects = {FOUND: {"torque": spring, "voltage": np.zeros(n)}}
    after = {"torque": np.where(resting, np.nan, left), "voltage": voltage}
    return Motion(file, "response", held_out, axes, torque, voltage, after, effects)


def unexplained(after: FitResult) -> Unexplained:
    axis = np.linspace(0.0, 1.0, 60)
    smaller = [
        tuple(replace(row, rms=0.9 * row.rms) for row in rows) for rows in (after.score_fit, after.score_holdout)
    ]
    return Unexplained(
        enters="torque",
        depends_on="angle",
        unit="N*m",
        axis_unit="1",
        axis=axis,
        curve=0.012 * np.sin(9.0 * axis),
        sd=0.002 + 0.002 * axis,
        size=0.0085,
        fit_rms_ratio=0.9,
        holdout_rms_ratio=0.9,
        bic_change=-80.0,
        fit=smaller[0],
        holdout=smaller[1],
        sentence="The rest enters as torque and depends on angle: a curve of 0.0085 N*m rms.",
    )
