"""A held plate at a constant voltage: a rig whose optimum and likelihood can be written down.

The current is V / R_a whatever T_f, which is free too, may be.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import folders
from etcfit.estimation.ready import ready
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Rig
from etcfit.rig.reader import read_folder

SIGMA, VOLTS, OHM = 0.01, 2.0, 1.513
BELIEVED = "{ value = 1.6, sd = 0.2 }"
TOML = (
    folders.TOML
    + """
[noise]
current_A = SIGMA
voltage_V = 1e-6

[parameters]
R_a = BELIEVED
L_a = { fixed = 1e-9 }
K_b = { fixed = 0.0189 }
J_m = { fixed = 1e-6 }
J_L = { fixed = 1e-3 }
B_m = { fixed = 1e-5 }
B_L = { fixed = 1e-3 }
K_s = { fixed = 0.15 }
T_PL = { fixed = 0.36 }
"""
)


def current() -> np.ndarray:
    """What was measured, A, to the five decimals that the file holds, shape (40,)."""
    return np.round(VOLTS / OHM + SIGMA * np.random.default_rng(2).standard_normal(40), 5)


def held_plate(path: Path, believed: str = BELIEVED) -> Rig:
    """The rig; `believed` is what rig.toml says of R_a."""
    columns = 0.01 * np.arange(40), np.full(40, VOLTS), current()
    sheet = folders.sheet("time [s]", "voltage [V]", "current [A]", columns=columns)
    toml = TOML.replace("SIGMA", f"{SIGMA}").replace("BELIEVED", believed)
    return read_folder(folders.write(path, {"rig.toml": toml, "resistance/1.csv": sheet.text()}))


def problem_of(rig: Rig) -> EstimationProblem:
    """Its traces and unknowns, R_a and T_f."""
    return EstimationProblem.of_traces(rig.config, free_parameters(rig.config), ready(rig).fitted)
