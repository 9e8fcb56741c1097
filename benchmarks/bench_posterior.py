"""What a posterior costs: ms a log-probability, time to convergence, effective samples a second against SciPy and NUTS.

    python -m benchmarks.bench_posterior                  makes and fits the 30-trace folder first
    python -m benchmarks.bench_posterior --run RUN        goes on from a fit

All in one run of one machine, so that ratios mean something where times do not. SciPy: the same likelihood, each sample
by its own noise, through `solve_ivp` (benchmarks/scipy_twin.py); a few evaluations are timed and its effective samples
a second EXTRAPOLATED, granting it emcee, our moves, as few evaluations as we need, and both cores. NUTS (blackjax): the
same density in the same standard coordinates, so that it needs no adaptation, its gradient by forward mode, which is
cheaper here than reverse mode through a long loop; its draws are granted to be independent.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import scipy_twin
from .plain import plain

SEED = 1
_REPEATS = 5
_STEP = 0.45  # NUTS: step size in standard coordinates


@dataclass(frozen=True)
class Timed:
    """Seconds on the wall and of the processor."""

    wall: float
    cpu: float


def timed(job: Callable[[], Any]) -> Timed:
    wall, cpu = time.perf_counter(), time.process_time()
    job()
    return Timed(time.perf_counter() - wall, time.process_time() - cpu)


def fitted(run: Path | None, scratch: Path) -> Any:
    """The fit of the 30-trace folder, or that in RUN."""
    from etcfit.estimation.joint_fit import fit
    from etcfit.rig.reader import read_folder
    from etcfit.run_folder.state import load_final

    if run is not None:
        return load_final(run).taken_as_exact()
    from independent import CONSISTENT, draw_truth, make_folder

    make_folder(scratch / "folder", draw_truth(np.random.default_rng(SEED), CONSISTENT), SEED, size="bench")
    return fit(read_folder(scratch / "folder"))


def log_probability(target: Any, size: int, threads: int) -> Timed:
    """Of one point, amortised over halves of `threads` ensembles side by side; the best of some."""
    points = target.mode + 0.3 * np.sqrt(np.diag(target.covariance)) * np.random.default_rng(0).standard_normal(
        (size, target.mode.size)
    )
    target.log_probability(points)  # compiles
    with ThreadPoolExecutor(threads) as pool:
        runs = [timed(lambda: list(pool.map(target.log_probability, [points] * threads))) for _ in range(_REPEATS)]
    count = size * threads
    return Timed(min(r.wall for r in runs) / count, min(r.cpu for r in runs) / count)


def by_scipy(result: Any, evaluations: int) -> Timed:
    """Of one likelihood through solve_ivp, one thread."""
    config = result.rig.config
    body = scipy_twin.Rig(config.gear_ratio, config.travel)
    traces = [plain(trace) for trace in result.problem.batch.traces]
    took = timed(lambda: [scipy_twin.residual(traces, result.values, body) for _ in range(evaluations)])
    return Timed(took.wall / evaluations, took.cpu / evaluations)


def by_nuts(target: Any, root: np.ndarray, draws: int) -> tuple[Timed, float]:
    """Of one draw, and the gradients it took."""
    import blackjax  # pyright: ignore[reportMissingImports]  # of the extra "benchmark"
    import jax
    import jax.numpy as jnp

    from etcfit.model.parameters import log_flats
    from etcfit.problem.residual import prior_residual, residual

    problem, weighted = target.problem, target.weighted
    form = problem.layout.form
    kinds = form.kinds[problem.pick.where]

    def density(u: Any) -> Any:
        x = target.mode + root @ u
        r, prior = residual(form, x, weighted), prior_residual(x, weighted)
        return -0.5 * (jnp.sum(r**2) + jnp.sum(prior**2)) + jnp.sum(log_flats(kinds, x))

    forward = jax.custom_vjp(density)
    forward.defvjp(
        lambda u: jax.jacfwd(lambda u: (density(u),) * 2, has_aux=True)(u)[::-1], lambda slope, down: (down * slope,)
    )
    nuts = blackjax.nuts(forward, step_size=_STEP, inverse_mass_matrix=jnp.ones(target.mode.size))
    step = jax.jit(nuts.step)
    key = jax.random.key(0)
    state = nuts.init(jnp.zeros(target.mode.size), key)
    state, _ = step(key, state)  # compiles
    gradients = 0

    def minimise() -> None:
        nonlocal state, gradients
        for k in range(draws):
            state, info = step(jax.random.fold_in(key, k), state)
            gradients += int(info.num_integration_steps)

    took = timed(minimise)
    return Timed(took.wall / draws, took.cpu / draws), gradients / draws


@dataclass(frozen=True)
class Sampled:
    """A posterior, how long it took, the fewest effective samples of a parameter, and log-probabilities computed."""

    posterior: Any
    took: Timed
    ess: float
    evaluations: int

    @property
    def pace(self) -> Timed:
        """Effective samples a second."""
        return Timed(self.ess / self.took.wall, self.ess / self.took.cpu)


def sampled(result: Any, folder: Path) -> Sampled:
    """The posterior from its first step."""
    from etcfit.posterior.sampling import sample

    kept: list[Any] = []
    took = timed(lambda: kept.append(sample(result, folder)))
    posterior = kept[0]
    steps, walkers = posterior.convergence.steps, posterior.chain.ensembles[0].points.shape[1]
    ess = min(m.ess for m in posterior.marginals.values())
    return Sampled(posterior, took, ess, steps * walkers * len(posterior.chain.ensembles))


def own_rows(s: Sampled) -> list[tuple[str, str]]:
    """Of our own sampler."""
    here, target = s.posterior.convergence, s.posterior.target
    walkers = s.posterior.chain.ensembles[0].points.shape[1]
    halves, whole = log_probability(target, walkers // 2, 2), log_probability(target, 2 * walkers, 1)
    return [
        ("log-probability, halves of two ensembles side by side", _ms(halves)),
        (f"log-probability, {2 * walkers} points at once", _ms(whole)),
        ("sampled", f"{here.steps} steps, {s.evaluations} evaluations, converged {here.converged}: {here.reason}"),
        ("to that end", f"{s.took.wall:.0f} s wall, {s.took.cpu:.0f} s cpu"),
        ("effective samples of the slowest parameter", f"{s.ess:.0f}"),
        ("a second", f"{s.pace.wall:.1f} wall, {s.pace.cpu:.1f} cpu"),
    ]


def scipy_rows(s: Sampled, evaluations: int) -> list[tuple[str, str]]:
    each = by_scipy(s.posterior.fit, evaluations)
    pace = s.ess / (s.evaluations * each.cpu)
    return [
        ("SciPy, one likelihood", f"{each.wall:.2f} s wall, {each.cpu:.2f} s cpu"),
        ("SciPy, effective samples a cpu second, EXTRAPOLATED", f"{pace:.5f}; ours is {s.pace.cpu / pace:.0f} x"),
    ]


def nuts_rows(s: Sampled, draws: int) -> list[tuple[str, str]]:
    each, gradients = by_nuts(s.posterior.target, s.posterior.chain.root, draws)
    return [
        ("NUTS, one draw", f"{each.wall:.2f} s wall, {each.cpu:.2f} s cpu, {gradients:.1f} gradients"),
        ("NUTS, effective samples a cpu second, at most", f"{1 / each.cpu:.2f}; ours is {s.pace.cpu * each.cpu:.1f} x"),
    ]


def _ms(each: Timed) -> str:
    return f"{1e3 * each.wall:.2f} ms wall, {1e3 * each.cpu:.2f} ms cpu"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, help="a run folder with a fit")
    parser.add_argument("--scipy", type=int, default=2, help="likelihoods to time")
    parser.add_argument("--nuts", type=int, default=20, help="draws to time")
    choices = parser.parse_args()
    from etcfit.backend import use_compilation_cache

    use_compilation_cache()
    with tempfile.TemporaryDirectory() as name:
        result = fitted(choices.run, Path(name))
        traces = result.problem.batch.traces
        samples = sum(t.data.shape[0] for t in traces)
        print(f"{len(traces)} traces fitted, {samples} samples, {result.x.size} parameters, "
              f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n\n| | measured |\n| --- | --- |")  # fmt: skip
        s = sampled(result, Path(name))
        for rows in (lambda: own_rows(s), lambda: scipy_rows(s, choices.scipy), lambda: nuts_rows(s, choices.nuts)):
            print("\n".join(f"| {what} | {text} |" for what, text in rows()), flush=True)


if __name__ == "__main__":
    main()
