"""A FitResult made by hand, without a fit: real traces of `folders.good`, invented values and residuals."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import folders
from etcfit.control.design import Design, propose
from etcfit.control.pid import RULES, Task
from etcfit.control.settings import DesignSettings, FrontSettings, OptimumSettings
from etcfit.estimation.agreement import Compromise, Influence, Pull
from etcfit.estimation.contradiction import Contradiction
from etcfit.estimation.fitted_model import Fitted
from etcfit.estimation.identifiability import Direction, Identifiability
from etcfit.estimation.joint_fit import FitResult, StartSummary
from etcfit.estimation.ready import ready
from etcfit.model.effects import EFFECT_BY_NAME
from etcfit.posterior.chain import Chain, Convergence
from etcfit.posterior.profile import Profile
from etcfit.posterior.sampling import Posterior
from etcfit.posterior.target import Target
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.prediction_error import rows
from etcfit.problem.problem import EstimationProblem
from etcfit.rig.base import Rig
from etcfit.rig.paper_readings import read_graphs
from etcfit.rig.reader import read_folder
from gaussian import SEEDS

# a design in no time: where good gains are not asked for, the searches for them end at once
BRIEF = DesignSettings(
    draws=5,
    optimum=OptimumSettings(searches=1, sweeps=1, population=8, elite=4, rounds=1, starts=1, last_rounds=1),
    front=FrontSettings(rounds=1),
)


@contextmanager
def limits_unsought() -> Iterator[None]:
    """What keeps gains from meeting everything is a search for each limit: within, a design names some without one."""
    with patch("etcfit.control.design.binding", lambda task: ("the supply voltage", "dry friction")):
        yield


def proposed(fitted: Fitted, task: Task, *rules: str) -> Design:
    """Gains by these rules, those of the first proposed."""
    with limits_unsought():
        return propose(fitted, task, rules[0], {name: RULES[name] for name in rules}, "laplace")


EXTRA = """
[parameters]
B_m = { fixed = 2e-5 }

[tests.inductance]
series_ohm = "free"

[holdout]
files = ["response/2.csv"]
"""


def rig(folder: Path, synthetic: bool = True) -> Rig:
    """The good folder, B_m fixed, one response held out."""
    files = folders.good()
    toml = folders.TOML.replace("[rig]", "[rig]\nsynthetic = true") if synthetic else folders.TOML
    files |= {"rig.toml": toml + EXTRA, "response/2.csv": folders.response(seed=7).text()}
    return read_folder(folders.write(folder, files))


def result(
    rig: Rig, lost: tuple[str, ...] = (), added: tuple[str, ...] = (), off: float = 0.0, **changes: Any
) -> FitResult:
    """A fit of the rig at nominal values, every coordinate known to 0.02, traces simulated almost as measured.

    Args:
        lost: symbols that are not identifiable.
        added: effects beyond Eqs. 1-2 and rig.toml.
        off: by how many sigma the simulation is wrong besides the noise.
        changes: fields of the result.
    """
    known = free_parameters(rig.config, tuple(EFFECT_BY_NAME[name] for name in added))
    layout, (fitted, held_out, _) = known.layout, ready(rig)
    x = layout.coordinates({p.symbol: p.nominal for p in layout.parameters})
    rng = np.random.default_rng(0)
    noise = [rng.standard_normal(t.data.shape) + off * _wave(t.instants) for t in (*fitted, *held_out)]
    predicted = {t.measurement.file: t.data - t.sigma * r for t, r in zip((*fitted, *held_out), noise, strict=True)}
    problem = EstimationProblem.of_traces(rig.config, known, fitted)
    direction = Direction(lost, (1.0,) * len(lost), np.inf)
    fields: dict[str, Any] = {
        "rig": rig,
        "free_parameters": known,
        "x": x,
        "values": {s: float(v) for s, v in layout.values(x, known.held).items()},
        "covariance": 0.02**2 * np.eye(x.size),
        "identifiability": Identifiability(
            layout.free, np.ones(x.size), (direction,) if lost else (), 0.02**2 * np.eye(x.size), lost
        ),
        "readings": read_graphs(rig),
        "problem": problem,
        "holdout": EstimationProblem.of_traces(rig.config, known, held_out) if held_out else None,
        "weighted": problem.weighted(weights.free_running(problem)),
        "whitened": tuple(noise[: len(fitted)]),
        "predicted": predicted,
        "score_fit": rows(fitted, [predicted[t.measurement.file] for t in fitted]),
        "score_holdout": rows(held_out, [predicted[t.measurement.file] for t in held_out]),
        "chi2_per_dof": 1.02,
        "converged": True,
        "reason": "gradient zero",
        "starts": (StartSummary("reading", 1e4, 500.0, 12), StartSummary("scattered 1", np.inf, 501.0, 20)),
        "widening": dict.fromkeys(layout.free, 1.0),
        "warnings": ("something is odd",),
    }
    return FitResult(**(fields | changes))


def compromised(result: FitResult) -> FitResult:
    """Two tests pull, one of which contradicts the others, so that the fit is a compromise."""
    pulls = [("inductance", None, "L_a", -34.0, -0.6), ("inductance", "inductance/1.csv", "L_a", -20.0, -0.4),
             ("response", None, "R_a", 0.9, 0.01), ("response", "response/1.csv", "K_b", 0.2, 0.01)]  # fmt: skip
    why, size = "inductance contradicts the other tests", result.x.size
    return replace(
        result,
        influence=Influence(tuple(Pull(*each) for each in pulls), {"B_m": "viscous", "J_m": "viscous"}),
        contradictions=(Contradiction("inductance", "L_a", -34.0, 1.2e-3, 0.42e-3, 1e-9, 0.97),),
        compromise=Compromise(
            why, ("inductance",), result.x[None] - 0.5, 1e-4 * np.eye(size)[None], np.full((1, size), np.nan)
        ),
    )


def posterior_of(fit: FitResult, steps: int) -> Posterior:
    """The normal one, sampled by our own sampler; one channel of the response counts a ninth."""
    precision = np.linalg.inv(fit.covariance)

    def target(x: np.ndarray) -> np.ndarray:
        return -0.5 * np.einsum("kp,pq,kq->k", x - fit.x, precision, x - fit.x)

    chain = Chain.begin(target, fit.free_parameters.layout.free, fit.x, fit.covariance, SEEDS).advanced(target, steps)
    factors = {("response/1.csv", "current"): 3.0, ("response/1.csv", "position"): 1.0}
    known = Target(fit.problem, fit.weighted, fit.x, fit.covariance, factors)
    return Posterior(fit, known, chain, Convergence.judge(chain.ensembles))


def profiles_of(fit: FitResult) -> dict[str, Profile]:
    """A one-sided one, of J_L."""
    value = fit.values["J_L"] * np.array([0.5, 1.0, 2.0, 4.0])
    return {"J_L": Profile("J_L", value, np.array([1.0, 0.0, 2.0, 6.0]), None, float(value[2]))}


def bench_twin(folder: Path) -> FitResult:
    """Where a joint fit of the bench twin with its spring ended (tests/bench_twin_fit.npz), beside its measurements."""
    rig = read_folder(folder)
    rig = replace(rig, config=replace(rig.config, effects=("limp_home_spring",)))
    known = free_parameters(rig.config)
    with np.load(Path(__file__).parent / "bench_twin_fit.npz", allow_pickle=False) as end:
        order = [list(end["symbols"]).index(symbol) for symbol in known.layout.free]
        x, covariance = end["x"][order], end["covariance"][np.ix_(order, order)]
    values = {s: float(v) for s, v in known.layout.values(x, known.held).items()}
    return result(rig, x=x, covariance=covariance, values=values)


def _wave(instants: np.ndarray) -> np.ndarray:
    """Three periods of rms 1, shape (n, 1)."""
    return np.sqrt(2.0) * np.sin(6.0 * np.pi * (instants - instants[0]) / np.ptp(instants))[:, None]
