"""What is timed inside a process: a script that runs with the packages of whichever tree PYTHONPATH names.

    PYTHONPATH=TREE python -P benchmarks/speed/inside.py JOB ARGUMENTS

A line of JSON, figures by unit or name. It imports nothing beside it, only what is found in the tree: where versions
differ, what there is of each is looked for here, and what only serves to measure is each tree's own `benchmarks`.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any

POINTS = 64
LANES = 256
WALKERS = 44  # four a coordinate of the 30 traces, as etcfit has it; said here, for versions name it differently
REPEATS = 7
SCATTER = 1e-3  # of the points, in the fit's coordinates
TRIALS = 2  # points that SciPy may try


def seconds(call: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Median wall time of a call, after one that compiles."""
    from jax import block_until_ready

    def once() -> float:
        began = time.perf_counter()
        block_until_ready(call())
        return time.perf_counter() - began

    once()
    return statistics.median(once() for _ in range(repeats))


def fit_in(run: str) -> Any:
    """The fit that RUN holds; what is compiled for it is kept."""
    from etcfit.backend import use_compilation_cache
    from etcfit.run_folder.state import load_fit

    use_compilation_cache()
    return load_fit(Path(run))


def linearisation(fit: Any) -> Callable[[], Any]:
    """Residual and Jacobian of a fit's data at its end, as a step of least squares asks for them."""
    if find_spec("etcfit.problem.normal_equations") is None:  # an older version keeps the whole Jacobian
        return lambda: fit.problem.linearise(fit.x, fit.weighted)
    from etcfit.problem.normal_equations import normal_equations, shared_out

    form, x = fit.problem.layout.form, fit.problem.layout.padded(fit.x)
    if "pieces" not in signature(normal_equations).parameters:
        compute = normal_equations(form, fit.weighted, x.size)
        return lambda: compute(x)
    pieces: Any = shared_out(fit.weighted, fit.x.size)  # of a version before the kernels
    old: Any = normal_equations
    return lambda: old(form, x, pieces)


def jacobian(run: str) -> dict[str, float]:
    """A linearisation over chi2 of one point among `POINTS`."""
    import numpy as np

    from etcfit.problem.chi2 import chi2_of

    fit = fit_in(run)
    points = fit.x + SCATTER * np.random.default_rng(0).standard_normal((POINTS, fit.x.size))
    one = seconds(linearisation(fit))
    each = seconds(lambda: chi2_of(fit.problem, points, fit.weighted)) / POINTS
    return {"x": one / each, "ms": 1e3 * one, "ms chi2": 1e3 * each, "columns": fit.x.size}


def logprob(run: str) -> dict[str, float]:
    """A log-probability as the sampler asks for it: halves of two ensembles side by side."""
    from benchmarks.bench_posterior import log_probability
    from etcfit.posterior.target import Target

    each = log_probability(Target.from_fit(fit_in(run)), WALKERS // 2, 2)
    return {"ms": 1e3 * each.wall, "ms cpu": 1e3 * each.cpu}


def step() -> dict[str, float]:
    """A step of one trace, and of a lane among `LANES`."""
    import numpy as np

    from benchmarks.bench_stepper import AT, by_scan, voltage

    t, volts = voltage()
    scan, steps = by_scan(t, volts), t.size - 1
    many = AT * (1.0 + 0.1 * np.random.default_rng(0).standard_normal((LANES, AT.size)))
    one, all_ = seconds(lambda: scan(AT), 15), seconds(lambda: scan(many), 15)
    return {"one": 1e9 * one / steps, "lane": 1e9 * all_ / (steps * LANES)}


def scipy(folder: str, run: str, stages: str) -> dict[str, float]:
    """CPU seconds of SciPy's least squares for as many Jacobians as the fit in RUN computed."""
    from benchmarks.bench_fit import COMPARABLE, needed, twin

    counted = needed(Path(run), json.loads(Path(stages).read_text()))
    solved = twin(Path(folder), Path(run), TRIALS)
    if solved.worst >= COMPARABLE:
        raise SystemExit(f"SciPy and etcfit do not simulate the same: rms errors differ by a factor {solved.worst:.2f}")
    lean = counted["from the reading"] + counted["rounds of whitening"]
    return {"jacobian": solved.a_jacobian, "all": sum(counted.values()), "lean": lean}


JOBS: dict[str, Callable[..., dict[str, float]]] = {f.__name__: f for f in (jacobian, logprob, step, scipy)}


if __name__ == "__main__":
    print(json.dumps(JOBS[sys.argv[1]](*sys.argv[2:])))
