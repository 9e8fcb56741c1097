"""A small folder from the independent generator, its fit and its diagnosis: one fixture each, a minute or more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from etcfit.diagnosis import Diagnosis, diagnose
from etcfit.estimation.joint_fit import FitResult, fit
from etcfit.problem.prediction_error import pooled
from etcfit.rig.reader import read_folder
from independent import Effects, Truth, draw_truth, make_folder


@dataclass(frozen=True)
class Case:
    """A folder, what it was made from, its fit of Eqs. 1-2, and what was found missing in that."""

    truth: Truth
    effects: Effects
    result: FitResult
    diagnosis: Diagnosis


def case(path: Path, seed: int, effects: Effects) -> Case:
    truth = draw_truth(np.random.default_rng(seed))
    make_folder(path, truth, seed, effects, size="small")
    result = fit(read_folder(path))
    return Case(truth, effects, result, diagnose(result))


def folder(seed: int, effects: Effects) -> Callable[..., Case]:
    @pytest.fixture(scope="module")
    def made(tmp_path_factory: pytest.TempPathFactory) -> Case:
        return case(tmp_path_factory.mktemp("rig"), seed, effects)

    return made


def falls(diagnosis: Diagnosis) -> float:
    """Held-out free-running error over that of Eqs. 1-2."""
    return pooled(diagnosis.after.score_holdout) / pooled(diagnosis.before.score_holdout)
