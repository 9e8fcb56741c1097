"""What late channels and traces do to a residual: a difference of residuals, and the one that is late promises most."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Effect, compose
from etcfit.diagnosis.rig_screen import of_one_event, screen_of_late
from etcfit.diagnosis.score import score
from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.trial import judged
from etcfit.estimation.result import Termination
from etcfit.model.parameters import parameters_of
from etcfit.problem import weights
from etcfit.problem.prediction_error import columns
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Rig

SAMPLES = 8  # by which something is late
TRACE = "trace_late[response/1.csv]"


class Case:
    """A model at nominal values, and traces as it would log them, each sample with its own noise alone.

    Attributes:
        problem, x, weighted: the model; its residual is 0.
        late: its candidates that delay, by name.
    """

    def __init__(self, rig: Rig, traces: tuple[Trace, ...]) -> None:
        self.composition = compose(rig, traces)
        bare = self.composition.lean(())
        self.x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
        free_run = EstimationProblem.of(rig.config, bare, traces).free_run(self.x)
        self.traces = tuple(
            replace(t, data=np.where(np.isfinite(t.data), y, np.nan)) for t, y in zip(traces, free_run, strict=True)
        )
        self.problem = EstimationProblem.of(rig.config, bare, self.traces)
        self.weighted = self.problem.weighted(weights.free_running(self.problem))
        self.late = {e.name: e for e in self.composition.of_the_rig if e.delays}

    def screened(self, problem: EstimationProblem, **changes: Any) -> tuple[Signature, ...]:
        """Signatures where the data are those of a problem of the same shape; no parameter can imitate anything."""
        weighted = problem.weighted(weights.free_running(problem))
        r = problem.residual(self.x, weighted)[np.asarray(weighted.slots.weight) > 0.0]
        background = Background.spanned(r, np.zeros((r.size, 0)))
        settings = DiagnosisSettings(**changes)
        return screen_of_late(background, problem, self.x, weighted, [*self.late.values()], settings)

    def late_by(self, problem: EstimationProblem, effect: Effect, seconds: float) -> CandidateModel:
        """The model with an effect that is late by so much, beside a problem's data."""
        (p,) = parameters_of(effect)
        bare = problem.weighted(weights.free_running(problem))
        s = CandidateModel(
            self.composition, (), problem, bare, None, self.x, Termination(True, "by hand"), DiagnosisSettings()
        )
        return s.with_effects((effect,), {p.symbol: seconds})

    def logged(self, change: Callable[[Trace], np.ndarray]) -> EstimationProblem:
        """The problem with other data."""
        traces = tuple(replace(t, data=change(t)) for t in self.traces)
        return EstimationProblem.of(self.problem.config, self.problem.free_parameters, traces)


@pytest.fixture(scope="module")
def case(rig: Rig, traces: tuple[Trace, ...]) -> Case:
    return Case(rig, traces)


def moved(trace: Trace, *channels: str) -> np.ndarray:
    """Its data, these channels later by `SAMPLES`; the first value stands before."""
    data = trace.data.copy()
    for m in (trace.channels.index(channel) for channel in channels):
        data[SAMPLES:, m], data[:SAMPLES, m] = trace.data[:-SAMPLES, m], trace.data[0, m]
    return data


def interval(trace: Trace) -> float:
    return float(np.median(np.diff(trace.instants)))


def first(found: tuple[Signature, ...]) -> tuple[Effect, float]:
    """The most promising, and its value."""
    (value,) = found[0].values.values()
    return found[0].variant.effect, value


def test_a_channel_that_is_late_promises_most_at_its_lateness(case: Case) -> None:
    problem = case.logged(lambda t: moved(t, "current") if t.test.name == "response" else t.data)
    effect, value = first(case.screened(problem))
    assert effect.name == "channel_late[response.current]"
    (response,) = (t for t in case.traces if t.test.name == "response")
    assert value == pytest.approx(SAMPLES * interval(response))


def test_where_all_channels_are_late_it_is_the_trace(case: Case) -> None:
    problem = case.logged(lambda t: moved(t, *t.channels) if t.test.name == "response" else t.data)
    found = case.screened(problem)
    best = {g.variant.effect.name for g in found if g.gain > 0.999 * found[0].gain}
    # the only trace of its test: a voltage that is early is the same
    assert best == {"trace_late[response/1.csv]", "channel_late[response.voltage]"}
    values = {g.variant.effect.name: next(iter(g.values.values())) for g in found}
    assert values["trace_late[response/1.csv]"] == pytest.approx(-values["channel_late[response.voltage]"])


@pytest.mark.parametrize("name", ["channel_late[response.position]", "trace_late[response/1.csv]"])
def test_a_signature_is_the_change_of_the_residual(case: Case, name: str) -> None:
    """Of a model that is late by as much; where its traces have no entry the signature has straight lines."""
    effect = case.late[name]
    problem = case.logged(lambda t: moved(t, *({"position"} if "channel" in name else t.channels))
                          if t.test.name == "response" else t.data)  # fmt: skip
    found = next(g for g in case.screened(problem, single_traces=1) if g.variant.effect is effect)
    (p,) = parameters_of(effect)
    with_it = problem.with_parameters(case.composition.lean((effect,)))
    x = np.append(case.x, p.domain.coordinate(found.values[p.symbol]))
    assert with_it.layout.free[-1] == p.symbol
    weighted = with_it.weighted(weights.free_running(with_it))
    seen = np.asarray(weighted.slots.weight) > 0.0
    without = problem.residual(case.x, problem.weighted(weights.free_running(problem)))
    change = (with_it.residual(x, weighted) - without)[seen]
    size = found.values[p.symbol] / p.domain.scale
    assert_allclose(found.columns[:, 0] * size, change, atol=0.02 * np.abs(change).max())
    assert np.linalg.norm(found.columns[:, 0] * size - change) < 0.01 * np.linalg.norm(change)
    assert found.gain == pytest.approx(float(np.sum(without**2)), rel=1e-3)  # next to nothing is left


def test_of_many_traces_only_those_that_stand_out_keep_a_signature(case: Case) -> None:
    problem = case.logged(lambda t: moved(t, *t.channels) if t.test.name == "inductance" else t.data)
    every = [g.variant.effect for g in case.screened(problem, single_traces=1)]
    assert [e.name for e in every if e.scope == "trace"] == ["trace_late[inductance/1.csv]"]


def test_of_all_latenesses_tried_only_the_best_gets_a_signature(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    """A signature is as long as all samples, and thirteen latenesses of each candidate are tried."""
    made: list[Signature] = []
    once = Background.signature

    def counted(self: Background, *args: Any) -> Signature:
        made.append(once(self, *args))
        return made[-1]

    monkeypatch.setattr(Background, "signature", counted)
    assert sorted(map(id, case.screened(case.problem))) == sorted(map(id, made))


def test_nothing_is_late_where_nothing_is_left(case: Case) -> None:
    assert max(g.gain for g in case.screened(case.problem)) < 1e-12


def test_the_data_are_the_models_own(case: Case) -> None:
    assert all(np.isfinite(y).all() for y in columns(case.problem.batch, case.problem.simulated(case.x, 0.0)))
    assert case.problem.chi2(case.x, case.weighted) < 1e-12


# ---- more than one event


def response_of(case: Case) -> Trace:
    return next(t for t in case.traces if t.test.name == "response")


def test_a_lateness_of_a_whole_trace_is_worth_its_parameter(case: Case) -> None:
    problem, effect = case.logged(lambda t: moved(t, *t.channels) if t.test.name == "response" else t.data), TRACE
    s = case.late_by(problem, case.late[effect], SAMPLES * interval(response_of(case)))
    before = score(s.without(case.late[effect]))
    most = of_one_event(s, case.late[effect])
    assert 0.0 < most < 0.7 * (before.chi2 - s.chi2)
    verdict = judged(case.late[effect], before, s).verdict
    assert verdict.gain == pytest.approx(before.chi2 - s.chi2 - most)
    assert verdict.score.chi2 == pytest.approx(s.chi2)


def test_what_explains_one_event_alone_is_not(case: Case) -> None:
    """Late in one stretch of the trace, and nowhere else."""

    def once(t: Trace) -> np.ndarray:
        some, data = slice(t.instants.size // 2, t.instants.size // 2 + t.instants.size // 20), t.data.copy()
        data[some] = moved(t, *t.channels)[some]
        return data if t.test.name == "response" else t.data

    problem, effect = case.logged(once), case.late[TRACE]
    s = case.late_by(problem, effect, SAMPLES * interval(response_of(case)))
    before = s.without(effect)
    assert of_one_event(s, effect) == pytest.approx(before.chi2, rel=0.01)
    assert judged(effect, score(before), s).verdict.bic_change > 0.0
