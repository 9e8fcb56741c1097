"""A winding that was warm in one trace: its signature is that trace's share of the resistance's tangent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Composition, compose
from etcfit.diagnosis.loop import score_candidates
from etcfit.diagnosis.rig_screen import rows_by_file, screen_of_single_traces
from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import Tangents
from etcfit.estimation.result import Termination
from etcfit.model.rig_effects import Place, WarmStart
from etcfit.problem import weights
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Fixed, Rig

WARM = "warm_start[response/2.csv]"
OHM = 0.02


def twice(trace: Trace) -> Trace:
    """The same trace under another file's name."""
    return replace(trace, measurement=replace(trace.measurement, file="response/2.csv"))


class Case:
    """A model at nominal values, three traces as it would log them, the last one with a warm winding."""

    def __init__(self, rig: Rig, traces: tuple[Trace, ...]) -> None:
        every = (*traces, *(twice(trace) for trace in traces if trace.test.name == "response"))
        self.composition: Composition = compose(rig, every)
        bare = self.composition.lean(())
        self.x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
        self.effect = WarmStart.at(Place.named("response/2.csv"))
        warm = self.composition.lean((self.effect,))
        there = np.append(self.x, warm.layout.parameter("warm_ohm.response/2.csv").domain.coordinate(OHM))
        shown = EstimationProblem.of(rig.config, warm, every).free_run(there)
        logged = tuple(
            replace(t, data=np.where(np.isfinite(t.data), y, np.nan)) for t, y in zip(every, shown, strict=True)
        )
        self.problem = EstimationProblem.of(rig.config, bare, logged)
        self.weighted = self.problem.weighted(weights.free_running(self.problem))
        end = Termination(True, "by hand")
        self.model = CandidateModel(
            self.composition, (), self.problem, self.weighted, None, self.x, end, DiagnosisSettings()
        )

    def screened(self) -> list[Signature]:
        candidates = [e for e in self.composition.of_the_rig if e.kind == "warm_start"]  # pyright: ignore[reportAttributeAccessIssue]
        of = (self.problem, self.x, self.weighted)
        return screen_of_single_traces(Background.of(*of), Tangents.of(*of), *of, candidates, self.model.settings)


@pytest.fixture(scope="module")
def case(rig: Rig, traces: tuple[Trace, ...]) -> Case:
    return Case(rig, traces)


def test_each_trace_of_a_test_that_has_another_is_asked_about(case: Case) -> None:
    names = {e.name for e in case.composition.of_the_rig if e.kind == "warm_start"}  # pyright: ignore[reportAttributeAccessIssue]
    assert names == {"warm_start[response/1.csv]", WARM}
    assert not any(e.scope == "trace" for e in case.composition.prompt)


def test_the_trace_that_was_warm_promises_all_and_its_resistance(case: Case) -> None:
    found = max(case.screened(), key=lambda g: g.gain)
    assert found.variant.effect is case.effect
    left = case.problem.residual(case.x, case.weighted)[np.asarray(case.weighted.slots.weight) > 0.0]
    assert found.gain > 0.9 * float(np.sum(Background.of(case.problem, case.x, case.weighted).r ** 2))
    assert float(np.sum(left**2)) > 100.0
    assert found.values["warm_ohm.response/2.csv"] == pytest.approx(OHM, rel=0.1)


def test_the_signature_is_the_change_of_the_residual(case: Case) -> None:
    """Of a model with a hundredth of that resistance more, no parameter following."""
    (found,) = (g for g in case.screened() if g.variant.effect is case.effect)
    small = 0.01 * OHM
    there = case.model.with_effects((case.effect,), {"warm_ohm.response/2.csv": small})
    seen = np.asarray(case.weighted.slots.weight) > 0.0
    change = (there.problem.residual(there.x, there.weighted) - case.problem.residual(case.x, case.weighted))[seen]
    rows = rows_by_file(case.problem, case.weighted)["response/2.csv"]
    assert_allclose(np.delete(change, rows), 0.0, atol=1e-12)
    background = Background.of(case.problem, case.x, case.weighted)
    scale = case.composition.whole.layout.parameter("warm_ohm.response/2.csv").domain.scale
    own = Background.free_of(background.basis, change[:, None] * scale / small)
    assert np.linalg.norm(found.columns - own) < 0.02 * np.linalg.norm(own)


def test_a_turn_asks_about_it_beside_all_others(case: Case) -> None:
    every = score_candidates(case.model, case.composition.candidates).signatures
    assert WARM in {g.variant.effect.name for g in every}


def test_where_the_resistance_is_given_it_is_not_asked(rig: Rig, case: Case) -> None:
    known = replace(rig, config=replace(rig.config, parameters={**rig.config.parameters, "R_a": Fixed(1.5)}))
    bare = compose(known, case.problem.batch.traces).lean(())
    problem = EstimationProblem.of(known.config, bare, case.problem.batch.traces)
    x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
    weighted = problem.weighted(weights.free_running(problem))
    of = (problem, x, weighted)
    found = screen_of_single_traces(Background.of(*of), Tangents.of(*of), *of, [case.effect], DiagnosisSettings())
    assert found == []
