"""A small rig whose traces nobody simulated: what stands before the first compiled program needs no more."""

from __future__ import annotations

import pytest

import results
from etcfit.estimation.joint_fit import ready
from etcfit.problem.trace import Trace
from etcfit.rig.base import Rig


@pytest.fixture(scope="session")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """B_m fixed, the circuit of the inductance test free."""
    return results.rig(tmp_path_factory.mktemp("rig"))


@pytest.fixture(scope="session")
def traces(rig: Rig) -> tuple[Trace, ...]:
    """Those that are fitted."""
    return ready(rig)[0]
