"""chi2 of many points in one pass is the sum of the squared residuals of each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import results
from etcfit.estimation.ready import ready
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.problem.chi2 import chi2_of
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem


@pytest.mark.slow  # compiles the model
@pytest.mark.parametrize(
    "added",
    [(), ("winding_heating", "limp_home_spring", "stop_bounce"), ("channel_delay",)],
    ids=["Eqs. 1-2", "with memories", "with delays"],
)
def test_one_pass_gives_what_the_residual_gives(tmp_path: Path, added: tuple[str, ...]) -> None:
    rig = results.rig(tmp_path)
    known = free_parameters(rig.config, tuple(EFFECT_BY_NAME[name] for name in added))
    problem = EstimationProblem.of_traces(rig.config, known, ready(rig)[0])
    x = known.layout.off_bounds(known.layout.coordinates({p.symbol: p.nominal for p in known.layout.parameters}))
    weighted = problem.weighted(problem.kalman(x))
    points = x + 0.02 * np.random.default_rng(1).standard_normal((3, x.size))
    each = [problem.linearise(point, weighted) for point in points]
    expected = [float(np.sum(here.r**2) + np.sum(here.prior**2)) for here in each]
    assert_allclose(chi2_of(problem, points, weighted), expected, rtol=1e-9)
