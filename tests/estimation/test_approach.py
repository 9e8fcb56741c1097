"""How far the way to an optimum is gone; that it leads there is tested with the joint fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etcfit.estimation import approach as module
from etcfit.estimation.settings import FitSettings

CHI2 = {0.064: 40.0, 0.016: 60.0, 0.004: 61.0, 0.0: 62.0}  # what is forgiven less only adds to it


@pytest.mark.parametrize(("hopeless", "gone"), [(np.inf, 4), (70.0, 4), (60.5, 3), (50.0, 2), (30.0, 1)])
def test_the_way_ends_where_even_what_is_forgiven_leaves_too_much(
    hopeless: float, gone: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    descents: list[float] = []

    def descended(problem: Any, x: np.ndarray, weighted: float, *_: Any) -> tuple[np.ndarray, int]:
        descents.append(weighted)
        return x + 1.0, 5

    problem = SimpleNamespace(weighted=lambda late: late, chi2=lambda x, late: CHI2[late])
    problem.with_integrator_states = lambda x: problem
    monkeypatch.setattr(module, "descend", descended)
    monkeypatch.setattr(module.weights, "forgiving", lambda problem, late: late)
    settings = FitSettings(late=tuple(CHI2))
    end, steps = module.approach(problem, np.zeros(2), 1e-2, settings, hopeless)  # type: ignore[arg-type]
    assert descents == list(CHI2)[:gone]
    assert (end.tolist(), steps) == ([gone, gone], 5 * gone)
