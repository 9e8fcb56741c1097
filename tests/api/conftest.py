"""Results made by hand as a notebook holds them; every figure is closed again."""

from __future__ import annotations

from collections.abc import Iterator

import matplotlib
import matplotlib.pyplot as plt
import pytest

import diagnoses
import results
from etcfit.api.explanation import Diagnosed
from etcfit.api.fit import Fit
from etcfit.rig.base import Rig


@pytest.fixture(autouse=True)
def _no_window() -> Iterator[None]:
    matplotlib.use("Agg")
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def fitted(rig: Rig) -> Fit:
    """J_L is not identifiable."""
    return Fit(results.result(rig, lost=("J_L",)))


@pytest.fixture(scope="module")
def found(rig: Rig) -> Diagnosed:
    return Diagnosed(diagnoses.diagnosis(rig))
