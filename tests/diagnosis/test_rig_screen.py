"""A winding that was warm in one trace: its signature is that trace's share of the resistance's tangent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Composition, Effect, compose
from etcfit.diagnosis.loop import score_candidates
from etcfit.diagnosis.rig_screen import gain_in_one_event, rows_by_file, screen_of_late, screen_of_single_traces
from etcfit.diagnosis.score import score
from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import Tangents
from etcfit.diagnosis.trial import judge_trial
from etcfit.estimation.result import Termination
from etcfit.model.parameters import parameters_of
from etcfit.model.rig_effects import Place, WarmStart
from etcfit.problem import weights
from etcfit.problem.prediction_error import columns
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
        shown = EstimationProblem.of_traces(rig.config, warm, every).free_run(there)
        logged = tuple(
            replace(t, data=np.where(np.isfinite(t.data), y, np.nan)) for t, y in zip(every, shown, strict=True)
        )
        self.problem = EstimationProblem.of_traces(rig.config, bare, logged)
        self.weighted = self.problem.weighted(weights.free_running(self.problem))
        end = Termination(True, "by hand")
        self.model = CandidateModel(
            self.composition, (), self.problem, self.weighted, None, self.x, end, DiagnosisSettings()
        )

    def screened(self) -> list[Signature]:
        candidates = [e for e in self.composition.of_the_rig if e.kind == "warm_start"]  # pyright: ignore[reportAttributeAccessIssue]
        of = (self.problem, self.x, self.weighted)
        return screen_of_single_traces(
            Background.of_model(*of), Tangents.of_model(*of), *of, candidates, self.model.settings
        )


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
    assert found.gain > 0.9 * float(np.sum(Background.of_model(case.problem, case.x, case.weighted).r ** 2))
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
    background = Background.of_model(case.problem, case.x, case.weighted)
    scale = case.composition.whole.layout.parameter("warm_ohm.response/2.csv").domain.scale
    own = Background.free_of(background.basis, change[:, None] * scale / small)
    assert np.linalg.norm(found.columns - own) < 0.02 * np.linalg.norm(own)


@pytest.mark.slow
def test_a_turn_asks_about_it_beside_all_others(case: Case) -> None:
    every = score_candidates(case.model, case.composition.candidates, kept=lambda whole: whole)
    assert WARM in {g.variant.effect.name for g in every}


def test_where_the_resistance_is_given_it_is_not_asked(rig: Rig, case: Case) -> None:
    known = replace(rig, config=replace(rig.config, parameters={**rig.config.parameters, "R_a": Fixed(1.5)}))
    bare = compose(known, case.problem.batch.traces).lean(())
    problem = EstimationProblem.of_traces(known.config, bare, case.problem.batch.traces)
    x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
    weighted = problem.weighted(weights.free_running(problem))
    of = (problem, x, weighted)
    found = screen_of_single_traces(
        Background.of_model(*of), Tangents.of_model(*of), *of, [case.effect], DiagnosisSettings()
    )
    assert found == []


# ---- What late channels and traces do to a residual: a difference of residuals, and the one that is late promises
# most.

SAMPLES = 8  # by which something is late
TRACE = "trace_late[response/1.csv]"


class Delayed:
    """A model at nominal values, and traces as it would log them, each sample with its own noise alone.

    Attributes:
        problem, x, weighted: the model; its residual is 0.
        late: its candidates that delay, by name.
    """

    def __init__(self, rig: Rig, traces: tuple[Trace, ...]) -> None:
        self.composition = compose(rig, traces)
        bare = self.composition.lean(())
        self.x = bare.layout.coordinates({p.symbol: p.nominal for p in bare.layout.parameters})
        free_run = EstimationProblem.of_traces(rig.config, bare, traces).free_run(self.x)
        self.traces = tuple(
            replace(t, data=np.where(np.isfinite(t.data), y, np.nan)) for t, y in zip(traces, free_run, strict=True)
        )
        self.problem = EstimationProblem.of_traces(rig.config, bare, self.traces)
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
        return EstimationProblem.of_traces(self.problem.config, self.problem.free_parameters, traces)


@pytest.fixture(scope="module")
def delayed(rig: Rig, traces: tuple[Trace, ...]) -> Delayed:
    return Delayed(rig, traces)


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


def test_a_channel_that_is_late_promises_most_at_its_lateness(delayed: Delayed) -> None:
    problem = delayed.logged(lambda t: moved(t, "current") if t.test.name == "response" else t.data)
    effect, value = first(delayed.screened(problem))
    assert effect.name == "channel_late[response.current]"
    (response,) = (t for t in delayed.traces if t.test.name == "response")
    assert value == pytest.approx(SAMPLES * interval(response))


def test_where_all_channels_are_late_it_is_the_trace(delayed: Delayed) -> None:
    problem = delayed.logged(lambda t: moved(t, *t.channels) if t.test.name == "response" else t.data)
    found = delayed.screened(problem)
    best = {g.variant.effect.name for g in found if g.gain > 0.999 * found[0].gain}
    # the only trace of its test: a voltage that is early is the same
    assert best == {"trace_late[response/1.csv]", "channel_late[response.voltage]"}
    values = {g.variant.effect.name: next(iter(g.values.values())) for g in found}
    assert values["trace_late[response/1.csv]"] == pytest.approx(-values["channel_late[response.voltage]"])


@pytest.mark.parametrize("name", ["channel_late[response.position]", "trace_late[response/1.csv]"])
def test_a_signature_is_the_change_of_the_residual(delayed: Delayed, name: str) -> None:
    """Of a model that is late by as much; where its traces have no entry the signature has straight lines."""
    effect = delayed.late[name]
    problem = delayed.logged(lambda t: moved(t, *({"position"} if "channel" in name else t.channels))
                          if t.test.name == "response" else t.data)  # fmt: skip
    found = next(g for g in delayed.screened(problem, single_traces=1) if g.variant.effect is effect)
    (p,) = parameters_of(effect)
    with_it = problem.with_parameters(delayed.composition.lean((effect,)))
    x = np.append(delayed.x, p.domain.coordinate(found.values[p.symbol]))
    assert with_it.layout.free[-1] == p.symbol
    weighted = with_it.weighted(weights.free_running(with_it))
    seen = np.asarray(weighted.slots.weight) > 0.0
    without = problem.residual(delayed.x, problem.weighted(weights.free_running(problem)))
    change = (with_it.residual(x, weighted) - without)[seen]
    size = found.values[p.symbol] / p.domain.scale
    assert_allclose(found.columns[:, 0] * size, change, atol=0.02 * np.abs(change).max())
    assert np.linalg.norm(found.columns[:, 0] * size - change) < 0.01 * np.linalg.norm(change)
    assert found.gain == pytest.approx(float(np.sum(without**2)), rel=1e-3)  # next to nothing is left


def test_of_many_traces_only_those_that_stand_out_keep_a_signature(delayed: Delayed) -> None:
    problem = delayed.logged(lambda t: moved(t, *t.channels) if t.test.name == "inductance" else t.data)
    every = [g.variant.effect for g in delayed.screened(problem, single_traces=1)]
    assert [e.name for e in every if e.scope == "trace"] == ["trace_late[inductance/1.csv]"]


def test_of_all_latenesses_tried_only_the_best_gets_a_signature(
    delayed: Delayed, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signature is as long as all samples, and thirteen latenesses of each candidate are tried."""
    made: list[Signature] = []
    once = Background.signature

    def counted(self: Background, *args: Any) -> Signature:
        made.append(once(self, *args))
        return made[-1]

    monkeypatch.setattr(Background, "signature", counted)
    assert sorted(map(id, delayed.screened(delayed.problem))) == sorted(map(id, made))


def test_nothing_is_late_where_nothing_is_left(delayed: Delayed) -> None:
    assert max(g.gain for g in delayed.screened(delayed.problem)) < 1e-12


def test_the_data_are_the_models_own(delayed: Delayed) -> None:
    assert all(np.isfinite(y).all() for y in columns(delayed.problem.batch, delayed.problem.simulated(delayed.x, 0.0)))
    assert delayed.problem.chi2(delayed.x, delayed.weighted) < 1e-12


# ---- more than one event


def response_of(delayed: Delayed) -> Trace:
    return next(t for t in delayed.traces if t.test.name == "response")


def test_a_lateness_of_a_whole_trace_is_worth_its_parameter(delayed: Delayed) -> None:
    problem, effect = delayed.logged(lambda t: moved(t, *t.channels) if t.test.name == "response" else t.data), TRACE
    s = delayed.late_by(problem, delayed.late[effect], SAMPLES * interval(response_of(delayed)))
    before = score(s.without(delayed.late[effect]))
    most = gain_in_one_event(s, delayed.late[effect])
    assert 0.0 < most < 0.7 * (before.chi2 - s.chi2)
    verdict = judge_trial(delayed.late[effect], before, s).verdict
    assert verdict.gain == pytest.approx(before.chi2 - s.chi2 - most)
    assert verdict.score.chi2 == pytest.approx(s.chi2)


def test_what_explains_one_event_alone_is_not(delayed: Delayed) -> None:
    """Late in one stretch of the trace, and nowhere else."""

    def once(t: Trace) -> np.ndarray:
        some, data = slice(t.instants.size // 2, t.instants.size // 2 + t.instants.size // 20), t.data.copy()
        data[some] = moved(t, *t.channels)[some]
        return data if t.test.name == "response" else t.data

    problem, effect = delayed.logged(once), delayed.late[TRACE]
    s = delayed.late_by(problem, effect, SAMPLES * interval(response_of(delayed)))
    before = s.without(effect)
    assert gain_in_one_event(s, effect) == pytest.approx(before.chi2, rel=0.01)
    assert judge_trial(effect, score(before), s).verdict.bic_change > 0.0
