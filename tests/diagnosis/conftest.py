"""A small rig whose traces nobody simulated: what comes before the first compiled program needs no more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import results
from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Composition, compose
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.estimation.ready import ready
from etcfit.estimation.result import Termination
from etcfit.model.effects import EFFECT_BY_NAME, EFFECTS
from etcfit.problem import weights
from etcfit.problem.free_parameters import free_parameters
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Fixed, Rig

GRAVITY = EFFECT_BY_NAME["gravity_load"]


@pytest.fixture(scope="session")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Rig:
    """B_m fixed, the circuit of the inductance test free."""
    return results.rig(tmp_path_factory.mktemp("rig"))


@pytest.fixture(scope="session")
def traces(rig: Rig) -> tuple[Trace, ...]:
    """Those that are fitted."""
    return ready(rig)[0]


@pytest.fixture(scope="session")
def composition(rig: Rig, traces: tuple[Trace, ...]) -> Composition:
    """The model of all effects."""
    return compose(rig, traces, only=EFFECTS)


@pytest.fixture(scope="session")
def small(rig: Rig, traces: tuple[Trace, ...]) -> CandidateModel:
    """One response, gravity the only candidate, nothing free but the spring and dry friction: quick to compile."""
    free = {"K_s", "T_f"}
    known = free_parameters(rig.config).layout.parameters
    held = {p.symbol: Fixed(p.nominal) for p in known if p.symbol not in free}
    little = replace(rig, config=replace(rig.config, parameters=held))
    response = tuple(t for t in traces if t.test.name == "response")
    composition = compose(little, response, only=(GRAVITY,))
    bare = composition.lean(())
    x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
    problem = EstimationProblem.of_traces(little.config, bare, response)
    weighted, end = problem.weighted(weights.free_running(problem)), Termination(True, "by hand")
    return CandidateModel(composition, (), problem, weighted, (problem, weighted), x, end, DiagnosisSettings())


@pytest.fixture(scope="session")
def model(rig: Rig, traces: tuple[Trace, ...], composition: Composition) -> CandidateModel:
    """Eqs. 1-2 in the composed model at random coordinates, a held-out trace beside them; nothing is simulated."""
    known = composition.lean(())
    x = np.random.default_rng(0).normal(size=len(known.layout.free))
    problem = EstimationProblem.of_traces(rig.config, known, traces)
    beside = EstimationProblem.of_traces(rig.config, known, traces[:1])
    weighted, holdout = (b.weighted(weights.free_running(b)) for b in (problem, beside))
    end = Termination(True, "by hand")
    return CandidateModel(composition, (), problem, weighted, (beside, holdout), x, end, DiagnosisSettings())
