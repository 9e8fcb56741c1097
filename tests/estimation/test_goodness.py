"""Whether a channel fits: by the size and independence of its residual, and by its free run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import results
from etcfit.estimation.goodness import STRAYS, Goodness, Left, goodness_of, inflation, warnings_of, worst
from etcfit.problem.prediction_error import PredictionError
from etcfit.problem.trace import Trace
from etcfit.reporting.pictures import all_traces


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Trace:
    every = all_traces(results.result(results.rig(tmp_path_factory.mktemp("rig"))))
    return next(each for each in every if each.test.name == "inductance")


def of(trace: Trace, r: np.ndarray, free: float = 1.0) -> Goodness:
    """Of the trace's one channel, its residual r, shape (n,)."""
    (channel,) = trace.channels
    row = PredictionError(trace.measurement.file, trace.test.name, channel, "A", r.size, 0.01 * free, 0.01)
    (found,) = goodness_of([trace], [r[:, None]], [row])
    return found


def white(trace: Trace) -> np.ndarray:
    r = np.random.default_rng(3).standard_normal(trace.instants.size)
    return r / np.sqrt(np.mean(r**2))


def test_the_size_of_the_residual_decides_and_few_samples_may_scatter(trace: Trace) -> None:
    r = white(trace)
    limit = 4.0 * np.sqrt(2.0 / r.size)
    sizes = {1.0: Left.FITS, 1.0 + 0.9 * limit: Left.FITS, 1.0 + 1.1 * limit: Left.MORE, 50.0: Left.FAR}
    assert {size: of(trace, np.sqrt(size) * r).left for size in sizes} == sizes
    assert of(trace, 5.0 * r).rms == pytest.approx(5.0)
    assert of(trace, np.full(r.size, np.nan)).left is Left.FAR
    assert of(trace, np.full(r.size, np.nan)).off == np.inf


def test_a_residual_that_is_not_independent_is_more_than_noise(trace: Trace) -> None:
    slow = np.sin(np.linspace(0.0, 9.0, trace.instants.size))
    found = of(trace, slow)
    assert (found.left, found.correlated) == (Left.MORE, True)
    assert inflation(slow) > 1.0  # what widens the intervals
    assert "not independent" in found.says


def test_noise_whose_free_run_is_far_off_strays(trace: Trace) -> None:
    assert of(trace, white(trace), STRAYS).left is Left.FITS
    found = of(trace, white(trace), 1.1 * STRAYS)
    assert found.left is Left.STRAYS
    assert found.off == pytest.approx(1.1 * STRAYS)
    assert of(trace, white(trace)).says == ""


def test_the_worst_is_of_the_worst_kind_and_then_the_furthest_off(trace: Trace) -> None:
    every = [of(trace, white(trace), free) for free in (1.0, 10.0, 20.0)]
    loud = of(trace, 1.38 * white(trace))
    assert worst(every) is every[2]
    assert worst([*every, loud]) is loud


def test_each_kind_is_counted_in_a_warning_of_its_own(trace: Trace) -> None:
    fits, strays, more = of(trace, white(trace)), of(trace, white(trace), 10.0), of(trace, 1.38 * white(trace))
    assert warnings_of([fits, fits], 1.0) == []
    said = warnings_of([fits, strays, more, more], 2.5)
    assert said[0].startswith("2 of 4 residuals are larger than their noise or not independent")
    assert "up to 2.5 times" in said[0]
    assert said[1].startswith("1 of 4 residuals is noise from sample to sample, but the free run strays")
    assert "10 times the noise" in said[1]


@pytest.mark.parametrize(
    ("widest", "said"),
    [
        (1.0, "No interval becomes wider by 5 %"),
        (1.049, "No interval becomes wider by 5 %"),
        (1.051, "Intervals are widened for it (up to 1.1 times)"),
        (2.34, "Intervals are widened for it (up to 2.3 times)"),
    ],
)
def test_an_interval_that_was_not_widened_is_not_said_to_be(widest: float, said: str, trace: Trace) -> None:
    (words,) = warnings_of([of(trace, 1.38 * white(trace))], widest)
    assert said in words
    assert "1.0 times" not in words


def test_what_a_row_of_a_file_says_is_the_same_rule(tmp_path: Path) -> None:
    from etcfit.run_folder.fit import score_json

    result = results.result(results.rig(tmp_path), off=0.6)
    written = {(row["file"], row["channel"]): row["left"] for row in score_json(result)["fit"]}
    assert written == {(each.file, each.channel): each.left for each in result.goodness}
    assert len(set(written.values())) > 1
