"""The way to an optimum from far off: instants are forgiven at first, and what stood in for them is put back."""

from __future__ import annotations

import numpy as np

from ..problem import weights
from ..problem.problem import EstimationProblem
from .levenberg_marquardt import descend
from .settings import FitSettings


def approach(
    problem: EstimationProblem,
    x: np.ndarray,
    tolerance: float,
    settings: FitSettings = FitSettings(),
    hopeless: float = np.inf,
) -> tuple[np.ndarray, int]:
    """Descend with all sampling instants forgiven coarsely, then ever finer.

    Where the simulated plate hits its stop a little early, all samples up to the true impact are wrong, by an amount
    that no small step of a parameter changes.

    Args:
        problem: the data.
        x: coordinates to start from, shape (P,).
        tolerance: relative change of chi2 that ends each descent.
        settings: `late`, by how much instants are forgiven, and `steps`.
        hopeless: chi2 from which on a descent is the last: what is forgiven less only adds to it.
    Returns:
        coordinates where it ended, shape (P,), and the number of Levenberg-Marquardt steps.
    """
    steps = 0
    for late in settings.late:
        problem = problem.with_integrator_states(x)
        weighted = problem.weighted(weights.forgiving(problem, late))
        x, more = descend(problem, x, weighted, tolerance, settings.steps)
        steps += more
        if np.isfinite(hopeless) and problem.chi2(x, weighted) > hopeless:
            break
    return x, steps


def with_lag_of(start: np.ndarray, problem: EstimationProblem, x: np.ndarray) -> np.ndarray:
    """Coordinates x, shape (P,), with the L_a/R_a of the start where an ECU in the model saw jumps of its setpoint.

    As long as nobody has placed these jumps the circuit's lag stands in for what their instants are off by; from a lag
    of zero it would not come back, for there its gradient vanishes.
    """
    layout, held = problem.layout, problem.free_parameters.held
    if "L_a" not in layout.free or not problem.sees_jumps:
        return x
    first, now = layout.values(start, held), layout.values(x, held)
    at = layout.free.index("L_a")
    out = x.copy()
    out[at] = layout.parameter("L_a").domain.coordinate(float(first["L_a"] / first["R_a"] * now["R_a"]))
    return out
