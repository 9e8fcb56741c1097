"""What a tie says of two fits, and what it does to the covariance of the parameters."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from etcfit.diagnosis.ambiguity import Apart, apart, between


def stand(**at: float) -> Any:
    """A model whose residual is the sum of its coordinates, up and down, at two of four samples; at the others 0."""
    shape = np.array([1.0, 0.0, -1.0, 0.0]).reshape(4, 1, 1)
    problem = SimpleNamespace(layout=SimpleNamespace(free=tuple(at)), residual=lambda x, weighted: np.sum(x) * shape)
    return SimpleNamespace(problem=problem, x=np.array(list(at.values())), weighted=SimpleNamespace(samples=4.0))


def test_fits_are_apart_by_their_residuals_and_by_what_both_fit() -> None:
    found = apart(stand(K_s=1.0, T_PL=2.0, u=0.5), stand(T_PL=1.5, K_s=3.0, v=0.1))
    assert np.isclose(found.residual, (4.6 - 3.5) * np.sqrt(0.5))
    assert found.moved == {"K_s": -2.0, "T_PL": 0.5}


def test_an_interval_holds_what_the_tied_model_gives() -> None:
    s, moved = stand(T_PL=1.5, K_s=3.0, v=0.1), Apart(0.05, {"K_s": -2.0, "T_PL": 0.5})
    added = between(s, [moved])
    assert np.allclose(added, np.outer([0.5, -2.0, 0.0], [0.5, -2.0, 0.0]))
    assert np.all(np.abs([0.5, -2.0]) <= 1.96 * np.sqrt(np.diag(added))[:2])
    assert np.array_equal(between(s, [moved, moved]), 2.0 * added)
    assert not between(s, []).any()
