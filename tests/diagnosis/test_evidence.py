"""How much of something is a function of one quantity, what a residual goes along with, and whether it is noise."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.evidence import (
    Place,
    correlation,
    evidence,
    explained,
    is_white,
    sentences,
    shares,
    strongest,
    whiteness,
)
from etcfit.diagnosis.findings import Share, Whiteness
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.result import Termination
from etcfit.problem import weights

N = 6000
SETTINGS = DiagnosisSettings()
BINS = SETTINGS.share_bins


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


# ---- a share of the variance


@pytest.mark.parametrize("curve", [np.sin, np.sign, np.square, lambda a: np.exp(-((a / 0.3) ** 2))])
def test_a_function_of_the_axis_is_explained_by_it(rng: np.random.Generator, curve: Any) -> None:
    axis = rng.uniform(-2.0, 2.0, N)
    assert explained(axis, curve(axis), BINS) > 0.95
    assert explained(axis, 1e3 - 1e-4 * curve(axis), BINS) == pytest.approx(
        explained(axis, curve(axis), BINS), abs=1e-6
    )


def test_noise_is_not(rng: np.random.Generator) -> None:
    """Nor does chance count: on average over many draws nothing is left of what 24 bins take."""
    shares = [explained(rng.normal(size=500), rng.normal(size=500), BINS) for _ in range(40)]
    assert max(shares) < 0.08
    assert np.mean(shares) < 0.015


def test_a_share_is_that_of_the_variance(rng: np.random.Generator) -> None:
    axis, noise = rng.uniform(-3.0, 3.0, N), rng.normal(size=N)
    curve = np.sin(axis)
    size = float(np.std(curve))
    for level in (0.5, 1.0, 2.0):
        expected = size**2 / (size**2 + level**2)
        assert explained(axis, curve + level * noise, BINS) == pytest.approx(expected, abs=0.03)


def test_a_function_of_another_quantity_is_not_explained(rng: np.random.Generator) -> None:
    assert explained(rng.normal(size=N), np.sin(rng.normal(size=N)), BINS) < 0.01


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_an_axis_that_rests_half_of_the_time_has_fewer_bins(rng: np.random.Generator, rest: float) -> None:
    """A plate lies on its stop: many samples share one angle."""
    axis = np.where(rng.uniform(size=N) < rest, 0.0, rng.uniform(0.0, 1.5, N))
    assert explained(axis, np.cos(axis), BINS) > 0.95
    assert explained(axis, rng.normal(size=N), BINS) < 0.01


def test_what_does_not_vary_explains_nothing_and_is_not_explained(rng: np.random.Generator) -> None:
    noise = rng.normal(size=N)
    assert explained(np.full(N, 0.3), noise, BINS) == 0.0
    assert explained(noise, np.full(N, 0.3), BINS) == 0.0


def test_shares_are_of_all_traces_and_only_where_something_is_known(rng: np.random.Generator) -> None:
    along = [{name: rng.normal(size=N) for name in ("angle", "speed", "current", "load", "time")} for _ in range(2)]
    missing = [np.sin(a["speed"]) for a in along]
    missing[0][::2] = np.nan
    found = {s.axis: s for s in shares("torque", along, missing, SETTINGS)}
    assert set(found) == {"angle", "speed", "current", "load", "time"}
    assert found["speed"].share > 0.95
    assert max(found[a].share for a in ("angle", "current", "load", "time")) < 0.01
    assert {s.axis for s in shares("voltage", along, missing, SETTINGS)} == {"current", "speed", "angle", "time"}
    assert shares("torque", along, [np.full(N, np.nan)] * 2, SETTINGS) == []


# ---- what a residual goes along with


def test_the_strongest_is_the_one_it_correlates_with_most_whatever_the_sign(rng: np.random.Generator) -> None:
    a, b = rng.normal(size=N), 50.0 + 7.0 * rng.normal(size=N)
    r = rng.normal(size=N) + 0.1 * a - 0.05 * (b - 50.0)
    name, rho = strongest(r, {"angle": a, "speed": b, "time": np.linspace(0.0, 1.0, N)})
    assert name == "speed"
    assert rho == pytest.approx(float(np.corrcoef(r, b)[0, 1]))
    assert rho < -0.2


def test_a_signal_that_does_not_vary_correlates_with_nothing(rng: np.random.Generator) -> None:
    assert correlation(rng.normal(size=N), np.full(N, 3.0)) == 0.0
    assert correlation(np.zeros(N), rng.normal(size=N)) == 0.0


# ---- is it noise?


def judged(r: np.ndarray, **signals: np.ndarray) -> Whiteness:
    """One channel of one trace, half of its instants without a sample."""
    n = r.size
    logged = np.arange(2 * n) % 2 == 0
    whole = np.full(2 * n, 1e9)
    whole[logged] = r
    still = {name: np.zeros(2 * n) for name in ("input", "speed", "angle", "current", "time")}
    along = still | {name: np.repeat(value, 2) for name, value in signals.items()}
    return whiteness(Place("response/a.csv", "response", "position"), whole, logged, along, SETTINGS)


def test_noise_is_called_white(rng: np.random.Generator) -> None:
    every = [judged(rng.normal(size=2000), angle=rng.normal(size=2000)) for _ in range(20)]
    assert all(row.white for row in every)
    assert all(row.n == 2000 for row in every)
    assert all(0.9 < row.rms < 1.1 for row in every)


def test_a_residual_that_is_too_large_is_not_white(rng: np.random.Generator) -> None:
    row = judged(1.2 * rng.normal(size=2000))
    assert not row.white
    assert row.ljung_box > 1e-4
    assert row.rms == pytest.approx(1.2, abs=0.05)


def test_a_residual_that_repeats_itself_is_not_white(rng: np.random.Generator) -> None:
    w = rng.normal(size=2001)
    row = judged((w[1:] + 0.3 * w[:-1]) / np.sqrt(1.09))
    assert not row.white
    assert row.ljung_box < 1e-4


@pytest.mark.parametrize("name", ["speed", "angle", "current", "input", "time"])
def test_a_residual_that_goes_along_with_what_the_plate_did_is_not_white(rng: np.random.Generator, name: str) -> None:
    signal = rng.normal(size=2000)
    row = judged(0.15 * signal + 0.98 * rng.normal(size=2000), **{name: signal})
    assert not row.white
    assert row.ljung_box > 1e-4
    assert row.strongest == name
    assert row.p < 1e-4


def test_a_residual_that_goes_along_with_the_direction_says_so(rng: np.random.Generator) -> None:
    speed = rng.normal(size=2000) ** 3
    row = judged(0.3 * np.sign(speed) + 0.95 * rng.normal(size=2000), speed=speed)
    assert row.strongest == "sign of speed"
    assert not row.white


# ---- in words


def row(rms: float, white: bool, channel: str = "position") -> Whiteness:
    return Whiteness("response/a.csv", "response", channel, 100, rms, 0.5, "angle", -0.4, 0.5, white)


def test_the_sentences_name_the_largest_residual_and_every_share_worth_it() -> None:
    rows = [row(1.0, True), row(3.0, False), row(20.0, False, "current")]
    found = [Share("torque", "angle", 0.62), Share("voltage", "current", 0.3), Share("torque", "speed", 0.04)]
    assert sentences(rows, found, SETTINGS) == [
        "2 of 3 residuals are not white; the largest, current in response/a.csv, is 20 times its noise and goes along "
        "with angle (correlation -0.40).",
        "Of the missing torque, a curve over one quantity takes away: angle 62 %.",
        "Of the missing voltage, a curve over one quantity takes away: current 30 %.",
    ]


def test_where_all_is_noise_nothing_else_is_said() -> None:
    said = sentences([row(1.0, True)] * 4, [Share("torque", "angle", 0.9)], SETTINGS)
    assert said == ["All 4 residuals are white: noise, as far as these tests see."]


# ---- on a model


def test_every_channel_of_every_trace_is_tested_where_it_was_logged(small: CandidateModel) -> None:
    """Its trace was drawn by hand and is no throttle's."""
    found = evidence(small)
    (trace,) = small.problem.batch.traces
    assert [(r.file, r.test, r.channel) for r in found.rows] == [
        (trace.measurement.file, "response", channel) for channel in trace.channels
    ]
    assert [r.n for r in found.rows] == np.isfinite(trace.data).sum(axis=0).tolist()
    assert not found.white
    assert found.sentences[0].startswith(f"{sum(not r.white for r in found.rows)} of {len(found.rows)} residuals")
    assert found.shares == ()  # 60 samples are too few


def test_whether_all_is_white_is_told_without_what_it_goes_along_with(
    small: CandidateModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The evidence of a candidate that only its whiteness decides on."""
    module = importlib.import_module("etcfit.diagnosis.evidence")
    lenient = replace(small.settings, large_rms=1e9, white_p=1e-300)
    every = [small, replace(small, settings=lenient)]
    whole = [evidence(s).white for s in every]
    monkeypatch.setattr(module, "missing_voltage", lambda *_: pytest.fail("nobody reads it"))
    assert [is_white(s) for s in every] == whole == [False, True]


def test_far_from_the_data_a_residual_is_judged_by_its_noise_not_by_its_weight(small: CandidateModel) -> None:
    problem = weights.discounted(small.problem, small.x)
    far = replace(small, problem=problem, weighted=problem.weighted(weights.free_running(problem)),
                  end=Termination(True, "far", far=True))  # fmt: skip
    assert far.chi2 < 0.5 * small.chi2
    assert [r.rms for r in evidence(far).rows] == pytest.approx([r.rms for r in evidence(small).rows])
