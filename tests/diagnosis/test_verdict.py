"""The last word of a diagnosis: run free, the final model must not be further from the data than the first."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from etcfit.diagnosis import _astray
from etcfit.problem.prediction_error import PredictionError


def result(fitted: float, held_out: float | None) -> Any:
    """A fit whose free-running errors are so many sigma."""

    def rows(rms: float | None) -> tuple[PredictionError, ...]:
        return () if rms is None else (PredictionError("response/a.csv", "response", "position", "deg", 100, rms, 1.0),)

    return SimpleNamespace(score_fit=rows(fitted), score_holdout=rows(held_out))


@pytest.mark.parametrize(
    ("after", "before", "astray"),
    [
        ((1.0, 2.5), (9.0, 2.0), True),  # what was held out decides
        ((9.0, 2.3), (1.0, 2.0), False),  # worse by 15 %: a slip may fall elsewhere
        ((2.5, None), (2.0, None), True),
        ((1.9, None), (2.0, None), False),
        ((1.0, float("nan")), (9.0, 2.0), True),  # it diverged
    ],
)
def test_a_model_that_strays_from_what_was_held_out_is_not_kept(after: tuple, before: tuple, astray: bool) -> None:
    assert _astray(result(*after), result(*before)) is astray
