"""A held plate at a constant voltage: a rig whose likelihood can be written down."""

from __future__ import annotations

import pytest

from etcfit.problem import weights
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData
from held_plate import held_plate, problem_of


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> tuple[EstimationProblem, WeightedData]:
    """Problem and data, each sample weighted by its own noise."""
    problem = problem_of(held_plate(tmp_path_factory.mktemp("rig")))
    return problem, problem.weighted(weights.free_running(problem))
