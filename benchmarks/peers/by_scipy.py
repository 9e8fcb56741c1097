"""SciPy: `least_squares` over `solve_ivp` (LSODA), the same that etcfit's speed is compared with."""

from __future__ import annotations

from .. import scipy_twin
from .problem import Problem, Solved

STEPS = 60  # trial points at most
# with the twin's own accuracy a descent ends short of its optimum, at chi2/dof 1.075 instead of 1.034
ACCURACY = scipy_twin.Accuracy(1e-7, (1e-8, 1e-9, 1e-7), 1e-4)


def solve(problem: Problem) -> Solved:
    """Its optimum from the problem's start."""
    rig = scipy_twin.Rig(problem.N, problem.travel)
    solved = scipy_twin.solve(problem.traces, tuple(problem.start), problem.start, rig, STEPS, ACCURACY)
    values = {s: float(y) * problem.start[s] for s, y in zip(problem.start, solved.outcome.x, strict=True)}
    words = f"{solved.outcome.njev} Jacobians, {solved.evaluations} residuals; {solved.outcome.message}"
    return Solved(values, 2.0 * float(solved.outcome.cost), words)
