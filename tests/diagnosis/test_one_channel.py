"""A mistake of one channel in one trace: what it does to the simulation, how it is screened, what it costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from etcfit.diagnosis.candidate_model import CandidateModel
from etcfit.diagnosis.composition import Effect, compose
from etcfit.diagnosis.loop import score_candidates
from etcfit.diagnosis.rig_screen import screen_of_single_traces
from etcfit.diagnosis.screen import Background, Signature
from etcfit.diagnosis.settings import DiagnosisSettings
from etcfit.diagnosis.tangents import Tangents
from etcfit.diagnosis.trial import Cost
from etcfit.estimation.result import Termination
from etcfit.model.parameters import parameters_of
from etcfit.model.rig_effects import AbstractRigEffect, rig_effect
from etcfit.problem import weights
from etcfit.problem.problem import EstimationProblem
from etcfit.problem.trace import Trace
from etcfit.rig.base import Rig

FILE = "response/2.csv"
SAMPLES = 4
# how the channel is logged by each effect of these sizes, from what it shows
SIZES = {
    f"channel_gain[{FILE}.current]": 0.08,
    f"channel_gain[{FILE}.position]": -0.05,
    f"channel_offset[{FILE}.current]": 0.06,
}


def again(trace: Trace, file: str) -> Trace:
    """The same trace under another file's name."""
    return replace(trace, measurement=replace(trace.measurement, file=file))


def effect_of(name: str) -> type[AbstractRigEffect]:
    effect = rig_effect(name)
    assert effect is not None
    return effect


class Case:
    """A model at nominal values, and traces as it would log them; the response is there twice."""

    def __init__(self, rig: Rig, traces: tuple[Trace, ...]) -> None:
        every = (*traces, *(again(trace, FILE) for trace in traces if trace.test.name == "response"))
        self.config, self.composition = rig.config, compose(rig, every)
        self.bare = self.composition.lean(())
        self.x = self.bare.layout.coordinates({p.symbol: p.nominal for p in self.bare.layout.parameters})
        self.problem = EstimationProblem.of_traces(rig.config, self.bare, every)

    def shown(self, name: str = "", value: float = 0.0) -> list[np.ndarray]:
        """What the model shows of each trace, (n, M), with an effect of this size."""
        if not name:
            return self.problem.free_run(self.x)
        effect = effect_of(name)
        (p,) = parameters_of(effect)
        layout = self.composition.lean((effect,))
        there = np.append(self.x, layout.layout.parameter(p.symbol).domain.coordinate(value))
        return self.problem.with_parameters(layout).free_run(there)

    def beside(self, shown: list[np.ndarray]) -> CandidateModel:
        """The model beside data that are these."""
        traces = tuple(replace(t, data=np.where(np.isfinite(t.data), y, np.nan))
                       for t, y in zip(self.problem.batch.traces, shown, strict=True))  # fmt: skip
        problem = EstimationProblem.of_traces(self.config, self.bare, traces)
        weighted = problem.weighted(weights.free_running(problem))
        end = Termination(True, "by hand")
        return CandidateModel(self.composition, (), problem, weighted, None, self.x, end, DiagnosisSettings())

    def screened(self, shown: list[np.ndarray]) -> dict[str, Signature]:
        """By name, the most promising of each."""
        s = self.beside(shown)
        found = score_candidates(s, self.composition.of_the_rig, kept=lambda whole: whole)
        return {g.variant.effect.name: g for g in sorted(found, key=lambda g: g.gain)}

    def by_hand(self, name: str, value: float) -> list[np.ndarray]:
        """What is shown without any effect, its one channel in its one trace changed by hand."""
        effect, out = effect_of(name), [y.copy() for y in self.shown()]
        for trace, y in zip(self.problem.batch.traces, out, strict=True):
            if trace.measurement.file == effect.place.file:
                m = trace.channels.index(effect.place.channel)
                y[:, m] = y[:, m] * (1.0 + value) if effect.kind == "channel_gain" else y[:, m] + value
        return out


def late_by(case: Case) -> float:
    """Seconds of `SAMPLES` intervals."""
    (mine,) = (t for t in case.problem.batch.traces if t.measurement.file == FILE)
    return SAMPLES * float(np.median(np.diff(mine.instants)))


@pytest.fixture(scope="module")
def case(rig: Rig, traces: tuple[Trace, ...]) -> Case:
    return Case(rig, traces)


@pytest.fixture(params=["machine code", pytest.param("jax", marks=pytest.mark.slow)])
def kernels(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "jax":
        monkeypatch.setenv("ETCFIT_KERNELS", "jax")
    return request.param


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("name", [f"channel_gain[{FILE}.current]", f"channel_offset[{FILE}.current]"])
def test_it_reads_as_if_its_column_had_been_changed_by_hand(case: Case, name: str) -> None:
    value = SIZES[name]
    for found, hand in zip(case.shown(name, value), case.by_hand(name, value), strict=True):
        assert_allclose(found, hand, rtol=0.0, atol=1e-9 * np.nanmax(np.abs(hand)))
    assert any(not np.allclose(a, b) for a, b in zip(case.shown(name, value), case.shown(), strict=True))


@pytest.mark.usefixtures("kernels")
def test_one_that_is_late_reads_as_if_its_column_had_been_moved(case: Case) -> None:
    """Of the angle, whose path is smooth: between samples it is nearly straight."""
    late, traces = late_by(case), case.problem.batch.traces
    for trace, found, prompt in zip(
        traces, case.shown(f"channel_late[{FILE}.position]", late), case.shown(), strict=True
    ):
        hand, t = prompt.copy(), trace.instants
        if trace.measurement.file == FILE:
            m = trace.channels.index("position")
            hand[:, m] = np.interp(t - late, t, prompt[:, m])
            assert np.max(np.abs(hand - prompt)) > 0.1
        assert_allclose(found, hand, rtol=0.0, atol=5e-3)


@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("name", [*SIZES])
def test_the_channel_that_is_wrong_in_one_trace_promises_most(case: Case, name: str) -> None:
    value = SIZES[name]
    found = case.screened(case.shown(name, value))
    assert [*found][-1] == name
    (size,) = found[name].values.values()
    assert size == pytest.approx(value, rel=0.15)


def test_the_channel_that_is_late_in_one_trace_promises_most(case: Case) -> None:
    name = f"channel_late[{FILE}.current]"
    late = late_by(case)
    found = case.screened(case.shown(name, late))
    assert [*found][-1] == name
    (size,) = found[name].values.values()
    assert size == pytest.approx(late)


def test_what_all_traces_of_a_test_share_promises_most_for_the_test(case: Case) -> None:
    name = "channel_gain[response.current]"
    found = case.screened(case.shown(name, 0.08))
    assert [*found][-1] == name
    assert found[f"channel_gain[{FILE}.current]"].gain < 0.8 * found[name].gain


def test_where_the_test_has_no_tangent_what_is_read_is_whitened(case: Case) -> None:
    """Of the model alone, with no gain of a whole test beside it: the same column as a model with a small gain has."""
    effect, s, small = effect_of(f"channel_gain[{FILE}.current]"), case.beside(case.shown()), 1e-4
    of = (s.problem, s.x, s.weighted)
    background = Background.of_model(*of)
    (found,) = screen_of_single_traces(background, Tangents.of_model(*of), *of, [effect], s.settings)
    (p,) = parameters_of(effect)
    there, seen = s.with_effects((effect,), {p.symbol: small}), np.asarray(s.weighted.slots.weight) > 0.0
    change = (there.problem.residual(there.x, there.weighted) - s.problem.residual(s.x, s.weighted))[seen]
    own = background.free_of(background.basis, change[:, None] * p.domain.scale / small)
    assert np.linalg.norm(own) > 1.0
    assert_allclose(found.columns, own, atol=1e-6 * float(np.linalg.norm(own)))


def prices(case: Case, *names: str) -> list[int]:
    return [Cost.of_effect(effect_of(name), case.composition).variants for name in names]


def test_a_channel_of_one_trace_is_one_of_more_places_than_a_test(case: Case) -> None:
    every: list[Effect] = [*case.composition.of_the_rig]
    single = [e for e in every if e.scope == "trace" and e.place.channel]  # pyright: ignore[reportAttributeAccessIssue]
    one, whole, trace = prices(
        case, f"channel_gain[{FILE}.current]", "channel_gain[response.current]", f"trace_late[{FILE}]"
    )
    assert one == len(every)
    assert whole == trace == len(every) - len(single) < one
