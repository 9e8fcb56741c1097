"""A held plate at a constant voltage: a rig whose likelihood can be written down."""

from __future__ import annotations

import numpy as np
import pytest

import folders
from etcfit.estimation.joint_fit import ready
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.residual import WeightedData
from etcfit.problem.weights import free_running
from etcfit.rig.reader import read_folder

SIGMA, VOLTS, OHM = 0.01, 2.0, 1.513
TOML = (
    folders.TOML
    + f"""
[noise]
current_A = {SIGMA}
voltage_V = 1e-6

[parameters]
R_a = {{ value = 1.6, sd = 0.2 }}
L_a = {{ fixed = 1e-9 }}
K_b = {{ fixed = 0.0189 }}
J_m = {{ fixed = 1e-6 }}
J_L = {{ fixed = 1e-3 }}
B_m = {{ fixed = 1e-5 }}
B_L = {{ fixed = 1e-3 }}
K_s = {{ fixed = 0.15 }}
T_PL = {{ fixed = 0.36 }}
"""
)


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> tuple[EstimationProblem, WeightedData]:
    """A held plate at 2 V: the current is V/R_a whatever T_f, which is free too, may be."""
    rng = np.random.default_rng(2)
    time = 0.01 * np.arange(40)
    current = VOLTS / OHM + SIGMA * rng.standard_normal(40)
    sheet = folders.sheet("time [s]", "voltage [V]", "current [A]", columns=(time, VOLTS + 0.0 * time, current))
    files = {"rig.toml": TOML, "resistance/1.csv": sheet.text()}
    rig = read_folder(folders.write(tmp_path_factory.mktemp("rig"), files))
    problem = EstimationProblem.of(rig.config, free_parameters(rig.config), ready(rig)[0])
    return problem, problem.weighted(free_running(problem))
